"""What a point out of focus is drawn as: every opening, on plain tiles and beside an edge."""

import pickle

import dofsim
import numpy as np
import pytest
from dofsim.io import write_image
from oracle import openings

HEIGHT, WIDTH = 128, 160
AT = 64, 70  # row and column of the lamp


def heart(x, y):
    x, y = 1.2 * x, 0.1 - 1.2 * y
    return (x**2 + y**2 - 0.75) ** 3 < 1.2 * x**2 * y**3


TEXELS = 64
HEART = heart(*np.meshgrid(*[(np.arange(TEXELS) + 0.5) / TEXELS * 2.0 - 1.0] * 2))


def heart_of_texels(x, y):
    at = [np.clip(((v + 1.0) * 0.5 * TEXELS).astype(int), 0, TEXELS - 1) for v in (y, x)]
    return np.where(np.hypot(x, y) <= 1.0, HEART[at[0], at[1]], 0.0)


def squeezed(inside, ratio):
    return lambda x, y: inside(x * max(ratio, 1.0), y / min(ratio, 1.0))


def ring(x, y):
    return openings.disc(x, y) & (np.hypot(x, y) >= 0.5)


def bulging(x, y):
    """Five blades that bulge half-way: the arcs of circles through two corners and a point between."""
    half = np.pi / 5
    apex = 0.5 + 0.5 * np.cos(half)
    centre = (apex**2 - 1.0) / (2.0 * (apex - np.cos(half)))
    middles = np.radians(20.0) + half * (2 * np.arange(5) + 1)
    return np.all(
        [np.hypot(x - centre * np.cos(a), y + centre * np.sin(a)) <= apex - centre for a in middles], axis=0
    )


def gaussian(x, y):
    return openings.disc(x, y) * np.exp(-0.5 * (np.hypot(x, y) / 0.4) ** 2)


def aberrated(x, y):
    return openings.disc(x, y) * (1.0 + 0.6 * (2.0 * (x**2 + y**2) - 1.0))


# An opening and its transmission, behind the focus.
OPENINGS = {
    "disc": (dofsim.Aperture(), openings.disc),
    "triangle": (dofsim.Aperture(blades=3, rotation=17.0), openings.polygon(3, 17.0)),
    "hexagon": (dofsim.Aperture(blades=6, rotation=15.0), openings.polygon(6, 15.0)),
    "bulging": (dofsim.Aperture(blades=5, rotation=20.0, roundness=0.5), bulging),
    "tall": (dofsim.Aperture(ratio=1.8), squeezed(openings.disc, 1.8)),
    "wide": (dofsim.Aperture(blades=6, ratio=0.6), squeezed(openings.polygon(6, 0.0), 0.6)),
    "mirror": (dofsim.Aperture(obstruction=0.5), ring),
    "gaussian": (dofsim.Aperture(apodization=0.4), gaussian),
    "spherical": (dofsim.Aperture(spherical=0.6), aberrated),
    "image": (dofsim.Aperture(image=HEART), heart_of_texels),
}


def lens(strength_px=1.0):
    return dofsim.Lens.from_disparity(strength_px=strength_px, focus=0.0)


def lamp(shift_px, aperture, edge=False, **options):
    """Draw one bright pixel at a shift, and give what is drawn around it."""
    color = np.full((HEIGHT, WIDTH), 1e-3, np.float32)
    color[AT] = 1e4
    depth = np.full((HEIGHT, WIDTH), shift_px, np.float32)
    if edge:
        # Something in the same tiles that does not reach the disc: visibility is asked for.
        depth[:, 118:] = 0.0
    out = dofsim.render(color, depth, lens(), depth_kind="disparity", aperture=aperture, **options)
    reach = int(np.ceil(abs(shift_px))) + 1
    rows, columns = (slice(at - reach, at + reach + 1) for at in AT)
    return out[rows, columns].astype(np.float64) / 1e4, out.sum(dtype=np.float64) / 1e4


@pytest.mark.parametrize("edge", [False, True], ids=["plain", "beside an edge"])
@pytest.mark.parametrize("shift_px", [-5.7, -12.0, -24.6])
@pytest.mark.parametrize("name", OPENINGS)
def test_a_point_is_drawn_as_the_opening_with_all_its_light(name, shift_px, edge):
    aperture, transmission = OPENINGS[name]
    drawn, energy = lamp(shift_px, aperture, edge)
    reach = drawn.shape[0] // 2
    # A pixel sees the point through the lens point (q - p) / t: behind the focus the picture is upright.
    exact = openings.kernel(transmission, abs(shift_px), reach)
    assert energy == pytest.approx(1.0, abs=4e-3)
    # The grid of the oracle and the steps in which radii are told apart leave this much at the rim.
    whole = exact.max()
    assert np.abs(drawn - exact).max() < 0.12 * whole
    assert np.abs(drawn - exact).sum() < 0.02 + 0.12 / abs(shift_px)


@pytest.mark.parametrize("name", OPENINGS)
def test_in_front_the_opening_is_turned_round(name):
    aperture, _ = OPENINGS[name]
    if name == "spherical":
        aperture = dofsim.Aperture(spherical=-0.6)
    behind, _ = lamp(-12.0, OPENINGS[name][0])
    in_front, _ = lamp(12.0, aperture)
    np.testing.assert_allclose(in_front, behind[::-1, ::-1], atol=2e-6)


@pytest.mark.parametrize("side", ["behind", "in front"])
def test_aberration_turns_from_a_bright_rim_to_a_soft_one_through_the_focus(side):
    shift_px = -20.0 if side == "behind" else 20.0
    drawn, energy = lamp(shift_px, dofsim.Aperture(spherical=0.7))
    middle = drawn.shape[0] // 2
    y, x = np.mgrid[-middle : middle + 1, -middle : middle + 1]
    rho = np.hypot(x, y) / 20.0
    rim, centre = drawn[(rho > 0.8) & (rho < 0.95)].mean(), drawn[rho < 0.2].mean()
    assert energy == pytest.approx(1.0, abs=4e-3)
    # The density is 1 + 0.7 (2 rho^2 - 1), or 1 - 0.7 (2 rho^2 - 1): 4.2 and 0.37 over these rings.
    assert rim / centre == pytest.approx(4.20 if side == "behind" else 0.372, rel=0.05)


def test_aberration_leaves_what_is_in_focus_and_the_mean_alone():
    color = np.random.default_rng(5).random((HEIGHT, WIDTH, 3), dtype=np.float32)
    depth = np.zeros((HEIGHT, WIDTH), np.float32)
    aberrated = dofsim.Aperture(spherical=0.9)
    out = dofsim.render(color, depth, lens(9.0), depth_kind="disparity", aperture=aberrated)
    np.testing.assert_array_equal(out, color)
    depth[:, 60:100] = 1.0
    depth[70:, :] = -1.0
    flat = dofsim.render(
        np.full_like(color, 0.4), depth, lens(9.0), depth_kind="disparity", aperture=aberrated
    )
    np.testing.assert_allclose(flat, 0.4, rtol=1e-5)


def test_images_may_be_files_and_only_their_ratios_matter(tmp_path):
    picture = np.repeat((0.25 * HEART[..., np.newaxis]).astype(np.float32), 3, axis=-1)
    write_image(tmp_path / "heart.exr", picture)
    from_file = dofsim.Aperture(image=tmp_path / "heart.exr")
    np.testing.assert_allclose(lamp(-9.0, from_file)[0], lamp(-9.0, OPENINGS["image"][0])[0], atol=1e-7)
    np.testing.assert_allclose(from_file.image, 0.25 * HEART, atol=1e-6)


@pytest.mark.parametrize("name", OPENINGS)
def test_apertures_are_values(name):
    aperture, _ = OPENINGS[name]
    again = pickle.loads(pickle.dumps(aperture))
    assert again == aperture
    assert hash(again) == hash(aperture)
    assert repr(again) == repr(aperture)
    assert aperture != dofsim.Aperture(blades=11)


def test_images_of_one_size_are_told_apart():
    one, other = dofsim.Aperture(image=HEART), dofsim.Aperture(image=HEART[::-1])
    assert one != other
    assert repr(one) != repr(other)


@pytest.mark.parametrize(
    ("words", "error", "match"),
    [
        ({"roundness": 0.5}, ValueError, "roundness is for blades"),
        ({"blades": 5, "roundness": 1.5}, ValueError, "roundness must be"),
        ({"ratio": 0.0}, ValueError, "ratio must be"),
        ({"obstruction": 1.0}, ValueError, "obstruction must be"),
        ({"spherical": -1.5}, ValueError, "spherical must be"),
        ({"image": np.zeros((4, 4))}, ValueError, "image must let light through"),
        ({"image": np.full((4, 4), -1.0)}, ValueError, "image must hold transmissions"),
        ({"image": np.ones((4, 4, 3))}, TypeError, "image must be a two-dimensional array"),
        ({"image": np.ones((4, 4)), "blades": 5}, ValueError, "image is the whole opening"),
    ],
)
def test_bad_openings_are_refused_by_name(words, error, match):
    with pytest.raises(error, match=match):
        dofsim.Aperture(**words)


FEATURES = {
    "blades": dofsim.Aperture(blades=6),
    "roundness": dofsim.Aperture(blades=6, roundness=0.3),
    "ratio": dofsim.Aperture(ratio=1.5),
    "obstruction": dofsim.Aperture(obstruction=0.4),
    "apodization": dofsim.Aperture(apodization=0.4),
    "spherical": dofsim.Aperture(spherical=0.4),
    "image": dofsim.Aperture(image=HEART),
}
HONOURED = {
    "lens": set(FEATURES),
    "sprites": set(FEATURES),
    "poisson": set(FEATURES) - {"spherical", "image"},
    "hexagonal": {"blades"},
    "gaussian": set(),
    "levels": set(),
    "taps": set(),
}


@pytest.mark.parametrize("feature", FEATURES)
@pytest.mark.parametrize("method", HONOURED)
def test_openings_are_drawn_or_refused_by_name(method, feature):
    color, depth = np.ones((40, 40, 3), np.float32), np.full((40, 40), -4.0, np.float32)

    def run():
        return dofsim.render(
            color, depth, lens(), depth_kind="disparity", method=method, aperture=FEATURES[feature]
        )

    if feature in HONOURED[method]:
        np.testing.assert_allclose(run(), 1.0, rtol=1e-4)
    else:
        refusal = rf'aperture must be .* for method="{method}", .* draw .*{feature}'
        with pytest.raises(ValueError, match=refusal):
            run()
