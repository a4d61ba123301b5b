"""Sprites: against their formula, and what their text says of them."""

from itertools import pairwise

import cv2
import dofsim
import numpy as np
import pytest
from oracle import sprites as oracle
from oracle.levels import enlarge
from test_constant_depth import disc, polygon


def render(color, coc_px, **options):
    """Render with this signed circle of confusion at every pixel."""
    lens = dofsim.Lens.from_disparity(strength_px=1.0, focus=0.0)
    disparity = -np.asarray(coc_px, np.float32)
    return dofsim.render(color, disparity, lens, depth_kind="disparity", method="sprites", **options)


SPRITE = np.random.default_rng(2).random((5, 4))


@pytest.fixture(scope="module")
def color():
    return np.random.default_rng(3).random((37, 53, 3), dtype=np.float32)


@pytest.fixture(scope="module")
def edges():
    """Surfaces in front, in focus and behind, most of them sloped."""
    y, x = np.mgrid[:37, :53]
    coc_px = np.where(x < 25, -5.5 + 0.05 * y, np.where(y < 18, 0.0, 2.0 + 0.1 * x))
    coc_px[25:30, 36:46] = 1.3
    return coc_px.astype(np.float32)


@pytest.fixture(scope="module")
def noise():
    return np.random.default_rng(4).uniform(-5.0, 5.0, (37, 53)).astype(np.float32)


@pytest.mark.parametrize("scene", ["edges", "noise"])
@pytest.mark.parametrize("threshold", [1.0, 2.5])
def test_it_is_its_formula(request, color, scene, threshold):
    coc_px = request.getfixturevalue(scene)
    expected = oracle.render(color, coc_px, SPRITE, coc_threshold_px=threshold)
    out = render(color, coc_px, sprite=SPRITE, coc_threshold_px=threshold)
    np.testing.assert_allclose(out, expected, atol=1e-5)


def point_picture(coc_px, size=80, **options):
    """Picture of a bright point alone, on black ground that is as far away; at half the size."""
    picture = np.zeros((size, size), np.float32)
    picture[40, 40] = 1.0
    out = render(picture, np.full((size, size), coc_px), **options)
    return out


@pytest.mark.parametrize("coc_px", [13.0, -13.0])
def test_a_point_has_the_shape_of_the_texture(coc_px):
    letter = np.array([[1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [1, 1, 1, 0.5]])
    out = point_picture(coc_px, sprite=letter)
    share = oracle.texture(letter, coc_px)
    expected = np.zeros((80, 80))
    reach = len(share) // 2
    expected[40 - reach : 41 + reach, 40 - reach : 41 + reach] = share
    halved = expected.reshape(40, 2, 40, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(out, enlarge(halved[..., None], 2)[..., 0], atol=1e-6)
    # The empty corner of the letter is up and to the right behind the focus, and turned by half in front.
    quarter = np.s_[29:39, 42:52] if coc_px > 0 else np.s_[42:52, 29:39]
    assert out[quarter].max() < 1e-6
    assert out.sum() == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("radius_px", [4.0, 7.25, 16.0, 31.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("blades", [0, 5])
def test_constant_depth_is_a_convolution_at_half_the_size(radius_px, side, blades):
    picture = np.random.default_rng(5).random((66, 84)).astype(np.float32)
    aperture = dofsim.Aperture(blades=blades, rotation=20.0)
    out = render(picture, np.full(picture.shape, side * radius_px), aperture=aperture)
    turn = 180.0 if side < 0 else 0.0
    kernel = polygon(radius_px, blades, 20.0 + turn) if blades else disc(radius_px)
    blurred = cv2.filter2D(
        picture.astype(np.float64), -1, kernel[::-1, ::-1].copy(), borderType=cv2.BORDER_REFLECT
    )
    halved = blurred.reshape(33, 2, 42, 2).mean(axis=(1, 3))
    expected = cv2.resize(halved, (84, 66), interpolation=cv2.INTER_LINEAR)
    # The reference sums the disc's area in strips; nothing else is not exact.
    assert np.abs(out - expected).max() < 1e-4


def halves(left, right, height=60, width=120):
    picture = np.full((height, width), right, np.float32)
    picture[:, : width // 2] = left
    return picture


def test_the_layer_behind_does_not_leak_over_sharp_things():
    # Bright behind, dark in focus: drawn with no more than addition, light falls on the sharp half.
    color, coc_px = halves(1.0, 0.1), halves(12.0, 0.0)
    out = render(color, coc_px)
    np.testing.assert_array_equal(out[:, 60:], color[:, 60:])
    # And no dark rim is left where light would have come from what is sharp.
    np.testing.assert_allclose(out[:, :60], 1.0, atol=1e-5)


def test_the_layer_in_front_has_soft_edges():
    color, coc_px = halves(1.0, 0.0), halves(-12.0, 0.0)
    row = render(color, coc_px)[30]
    # From all to nothing over the width of the disc, half-way at the edge, without a step.
    np.testing.assert_allclose(row[:44], 1.0, atol=1e-4)
    np.testing.assert_allclose(row[76:], 0.0, atol=1e-6)
    assert row[59:61].mean() == pytest.approx(0.5, abs=0.05)
    assert np.abs(np.diff(row)).max() < 0.08
    np.testing.assert_array_less(np.diff(row), 1e-6)


def test_front_and_back_do_not_mix():
    # Red in front, blue behind, both blurred: the red bleeds over the blue, never the other way round.
    red, blue = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    color = np.where(halves(1, 0)[..., None] > 0, red, blue).astype(np.float32)
    coc_px = halves(-8.0, 8.0)
    coc_px[:, 100:] = 0.0
    out = render(color, coc_px)
    assert out[30, 62, 0] > 0.2
    np.testing.assert_allclose(out[:, :45], np.broadcast_to(red, (60, 45, 3)), atol=1e-4)
    np.testing.assert_allclose(out.sum(axis=2), 1.0, atol=1e-4)
    # What is in focus is touched by neither, out of reach of the layer in front.
    np.testing.assert_array_equal(out[:, 100:], color[:, 100:])


def test_a_bright_point_in_front_keeps_its_light():
    picture = np.zeros((60, 60), np.float32)
    picture[30, 30] = 1000.0
    coc_px = np.zeros((60, 60))
    coc_px[30, 30] = -10.0
    out = render(picture, coc_px)
    assert out.sum(dtype=np.float64) == pytest.approx(1000.0, rel=0.02)


@pytest.mark.parametrize("coc_px", [0.0, 0.9, -1.0, 1.0])
def test_up_to_the_threshold_nothing_is_drawn(color, coc_px):
    np.testing.assert_array_equal(render(color, np.full(color.shape[:2], coc_px)), color)
    wide = render(color, np.full(color.shape[:2], 4.0 * coc_px), coc_threshold_px=4.0)
    np.testing.assert_array_equal(wide, color)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sprites_set_in_without_a_step(color, sign):
    radii = np.arange(0.9, 2.3, 0.1)
    pictures = [render(color, np.full(color.shape[:2], sign * r)) for r in radii]
    whole = np.abs(pictures[-1] - pictures[0]).max()
    assert all(np.abs(b - a).max() < 0.2 * whole for a, b in pairwise(pictures))


def test_circles_of_confusion_are_cut_at_their_largest(color, edges):
    np.testing.assert_array_equal(
        render(color, edges, max_coc_px=3.0), render(color, np.clip(edges, -3.0, 3.0))
    )


def test_a_mean_disc_texture_is_close_to_the_disc(color, edges):
    y, x = (np.mgrid[:256, :256] + 0.5) / 128.0 - 1.0
    drawn = render(color, 2.0 * edges, sprite=(np.hypot(x, y) <= 1.0).astype(np.float32))
    np.testing.assert_allclose(drawn, render(color, 2.0 * edges), atol=5e-3)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"sprite": np.ones(4)}, TypeError, "sprite must be a two-dimensional array of numbers"),
        ({"sprite": "star"}, TypeError, "sprite must be a two-dimensional array of numbers"),
        ({"sprite": np.zeros((3, 3))}, ValueError, "sprite must let light through"),
        ({"sprite": -np.ones((3, 3))}, ValueError, "sprite must hold transmissions.*got -1"),
        ({"sprite": np.ones((0, 3))}, ValueError, "sprite must have at least one row"),
        ({"sprite": SPRITE, "aperture": dofsim.Aperture()}, ValueError, "aperture and sprite are both given"),
        ({"coc_threshold_px": 0.1}, ValueError, "coc_threshold_px must be .*got 0.1"),
        ({"max_coc_px": 1e4}, ValueError, "max_coc_px must be .*got 10000"),
    ],
)
def test_bad_options_are_named(color, edges, options, error, message):
    with pytest.raises(error, match=message):
        render(color, edges, **options)
