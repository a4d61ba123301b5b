"""Poisson-disc taps: against the formula, and what the article's figures show."""

import itertools

import dofsim
import numpy as np
import pytest
from oracle import poisson as oracle

LENS = dofsim.Lens.from_disparity(strength_px=8.0, focus=0.0)


def render(color, disparity, lens=LENS, **options):
    return dofsim.render(color, disparity, lens, depth_kind="disparity", method="poisson", **options)


@pytest.fixture(scope="module")
def scene():
    """Noise over slopes, steps and random depth, some of it beyond the largest circle."""
    rng = np.random.default_rng(8)
    disparity = np.repeat(np.linspace(-1.0, 1.0, 150)[None], 60, axis=0)
    disparity[10:20] = rng.uniform(-1.0, 1.0, (10, 150))
    disparity[30:45, 20:140] = 0.4
    disparity[40:55, 100:] = -0.5
    return rng.random((60, 150, 3), dtype=np.float32), disparity.astype(np.float32)


TAPS = np.array([(0.5, 0.0), (-0.3, 0.4), (0.0, -1.0)])


@pytest.mark.parametrize("leak_test", ["on", "off"])
@pytest.mark.parametrize("max_coc_px", [5.0, 1.65, 20.0])
@pytest.mark.parametrize("taps", [None, TAPS, np.column_stack([TAPS, [0.2, 3.0, 1.0]])])
def test_formula(scene, taps, max_coc_px, leak_test):
    color, disparity = scene
    expected = oracle.render(
        color, disparity, dofsim.coc(disparity, LENS, depth_kind="disparity"),
        oracle.TWELVE if taps is None else taps, max_coc_px, leak_test == "on",
    )  # fmt: skip
    out = render(color, disparity, taps=taps, max_coc_px=max_coc_px, leak_test=leak_test)
    np.testing.assert_allclose(out, expected, atol=1e-5)


def test_the_articles_choices_are_the_defaults(scene):
    np.testing.assert_array_equal(
        render(*scene), render(*scene, taps=oracle.TWELVE, max_coc_px=5.0, leak_test="on")
    )
    np.testing.assert_array_equal(
        render(*scene), render(*scene, taps=12, bokeh="uniform", aperture=dofsim.Aperture())
    )


@pytest.fixture(scope="module")
def sharp_before_blurred():
    """Make a bright square in focus before a dark background with a circle of confusion of 10 px."""
    color = np.full((64, 64), 0.1, np.float32)
    disparity = np.full((64, 64), -5.0 / 8.0, np.float32)
    color[24:40, 24:40] = 1.0
    disparity[24:40, 24:40] = 0.0
    return color, disparity


def halo(picture):
    """Add up the light around the square."""
    around = np.ones(picture.shape, bool)
    around[24:40, 24:40] = False
    return (picture - 0.1)[around].sum()


def test_the_leak_test_removes_the_halo_of_what_is_sharp(sharp_before_blurred):
    leaking = render(*sharp_before_blurred, leak_test="off")
    tested = render(*sharp_before_blurred)
    assert halo(leaking) > 60.0
    # What is left are bilinear taps across the very edge: sharp in part, and so counted in part.
    assert halo(tested) < 0.1 * halo(leaking)
    np.testing.assert_array_equal(tested[24:40, 24:40], 1.0)


def test_what_is_blurred_spreads_over_what_is_behind_it():
    # The square in front and blurred, the background blurred too: its taps count.
    color = np.full((64, 64), 0.1, np.float32)
    disparity = np.full((64, 64), -0.3, np.float32)
    color[24:40, 24:40] = 1.0
    disparity[24:40, 24:40] = 5.0 / 8.0
    assert halo(render(color, disparity)) > 0.9 * halo(render(color, disparity, leak_test="off")) > 25.0


def profile(**options):
    """Give the mean brightness of a blurred point by distance from its middle, over that of an even disc."""
    point = np.zeros((65, 65), np.float32)
    point[32, 32] = 1.0
    out = render(point, np.full((65, 65), -2.0, np.float32), max_coc_px=16.0, taps=128, **options)
    y, x = np.mgrid[:65, :65]
    distance = np.hypot(x - 32, y - 32)
    edges = (0.5, 5.0, 10.0, 15.0, 17.5)
    rings = [(distance >= a) & (distance < b) for a, b in itertools.pairwise(edges)]
    return np.array([out[ring].mean() * np.pi * 16.0**2 for ring in rings])


def test_bokeh_changes_the_profile_as_named():
    uniform, gaussian, inverse, ring = (profile(bokeh=b) for b in ("uniform", "gaussian", "inverse", "ring"))
    np.testing.assert_allclose(uniform[:3], 1.0, atol=0.25)
    assert gaussian[0] > 1.4 * uniform[0]
    assert gaussian[2] < 0.8 * uniform[2]
    assert inverse[0] < 0.5 * uniform[0]
    assert inverse[2] > 1.15 * uniform[2]
    np.testing.assert_array_equal(ring[:2], 0.0)
    assert ring[3] > 2.0


@pytest.mark.parametrize(("place", "turn"), [("behind", 0.0), ("in front", 180.0)])
@pytest.mark.parametrize("taps", [12, 128])
def test_blades_give_the_point_their_shape(place, turn, taps):
    point = np.zeros((65, 65), np.float32)
    point[32, 32] = 1.0
    depth = np.full((65, 65), -2.0 if place == "behind" else 2.0, np.float32)
    triangle = dofsim.Aperture(blades=3, rotation=20.0)
    out = render(point, depth, max_coc_px=20.0, taps=taps, aperture=triangle)
    y, x = np.mgrid[:65, :65]
    angle = np.arctan2(-(y - 32), x - 32) - np.radians(20.0 + turn)
    # The distance to a side of the triangle along each direction, and a pixel and a half of interpolation.
    side = 20.0 * 0.5 / np.cos(np.mod(angle, 2 * np.pi / 3) - np.pi / 3) + 1.5
    assert (out[np.hypot(x - 32, y - 32) > side] == 0.0).all()
    assert np.count_nonzero(out) > 2 * taps


def test_more_taps_are_less_noise():
    noise = np.random.default_rng(9).random((100, 100), dtype=np.float32)
    depth = np.full((100, 100), 2.0, np.float32)
    spread = [render(noise, depth, taps=n, max_coc_px=10.0).std() for n in (6, 12, 48, 128)]
    assert spread == sorted(spread, reverse=True)


def test_generated_taps_are_the_same_each_time(scene):
    np.testing.assert_array_equal(render(*scene, taps=50), render(*scene, taps=50))


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"taps": 0}, ValueError, "taps must be from 1 to 128; got 0"),
        (
            {"taps": 1.5},
            TypeError,
            r"taps must be a whole number or an array.*\(N, 3\).*1.5",
        ),
        ({"taps": [[1.0]]}, TypeError, r"taps must be a whole number or an array.*\[\[1.0\]\]"),
        ({"taps": np.ones((2, 2))}, ValueError, r"taps must lie within 1 of the centre.*got \(1, 1\)"),
        ({"taps": TAPS, "bokeh": "ring"}, ValueError, "bokeh and aperture must not be given"),
        ({"taps": TAPS, "aperture": dofsim.Aperture(blades=6)}, ValueError, "bokeh and aperture must not be"),
        (
            {"bokeh": "busy"},
            ValueError,
            'bokeh must be one of "uniform", .*; got "busy"',
        ),
        ({"max_coc_px": -1}, ValueError, "max_coc_px must be a radius.*got -1"),
        ({"leak_test": "maybe"}, ValueError, 'leak_test must be one of "on", "off"; got "maybe"'),
        ({"leak_test": True}, TypeError, "leak_test must be a word; got True"),
    ],
)
def test_bad_options_are_named(scene, options, error, message):
    with pytest.raises(error, match=message):
        render(*scene, **options)
