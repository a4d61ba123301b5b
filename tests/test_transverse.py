"""Where rays land: coma, astigmatism, barn doors, measured lenses."""

import pickle

import dofsim
import numpy as np
import pytest
from dofsim import LensMap
from dofsim._lens_map import lens_points
from dofsim._options import make_lens
from numpy.testing import assert_allclose, assert_array_equal
from scipy import ndimage

HEIGHT, WIDTH = 200, 280
HALF_DIAGONAL = 0.5 * np.hypot(WIDTH, HEIGHT)
MIDDLE = np.array([0.5 * (WIDTH - 1), 0.5 * (HEIGHT - 1)])
Y, X = np.mgrid[:HEIGHT, :WIDTH]
# Shifts are disparities, in pixels: positive ones are in front of the focus.
LENS = dofsim.Lens.from_disparity(strength_px=1.0, focus=0.0)
BRIGHT = 1e4
THIN = LensMap([0.0, 1.0], np.stack([lens_points(33)] * 2))


def render(color, shift, lens, **options):
    shift = np.full((HEIGHT, WIDTH), float(shift)) if np.ndim(shift) == 0 else shift
    return dofsim.render(color, shift, lens, depth_kind="disparity", **{"device": "cpu", **options})


def disc_points(n=500):
    """Points of the round opening, evenly."""
    at = (np.arange(n) + 0.5) / n * 2 - 1
    x, y = np.meshgrid(at, at)
    inside = np.hypot(x, y) <= 1
    return np.stack([x[inside], y[inside]], axis=-1)


def frame_of(at):
    """Height of a field, and the directions away from the axis and across."""
    off = np.asarray(at, float) - MIDDLE
    distance = np.hypot(*off)
    away = off / distance if distance > 0 else np.array([1.0, 0.0])
    return distance / HALF_DIAGONAL, away, np.array([-away[1], away[0]])


def landings(at, points, coma=0.0, astigmatism=0.0, shift=0.0):
    """Where the light of a point lands, by the formulas of third order."""
    height, away, across = frame_of(at)
    u, v = points @ away, points @ across
    along = HALF_DIAGONAL * (coma * height / 3 * (3 * u**2 + v**2) + 0.5 * astigmatism * height**2 * u)
    beside = HALF_DIAGONAL * (coma * height / 3 * 2 * u * v - 0.5 * astigmatism * height**2 * v)
    return np.asarray(at) + along[:, None] * away + beside[:, None] * across - shift * points


def lamp(at, dark=0.0):
    color = np.full((HEIGHT, WIDTH, 3), dark, np.float32)
    color[at[1], at[0]] = BRIGHT
    return color


def binned(landed):
    """Count the part of the light in each pixel."""
    edges = np.arange(HEIGHT + 1) - 0.5, np.arange(WIDTH + 1) - 0.5
    counts, _, _ = np.histogram2d(landed[:, 1], landed[:, 0], bins=edges)
    return counts / len(landed)


def moments(plane):
    plane = plane.astype(np.float64)
    light = plane.sum()
    mean = np.array([(plane * X).sum(), (plane * Y).sum()]) / light
    dx, dy = X - mean[0], Y - mean[1]
    covariance = np.array([[(plane * a * b).sum() for b in (dx, dy)] for a in (dx, dy)]) / light
    return light, mean, covariance


# A thin lens is the special case


def scenes():
    rng = np.random.default_rng(1)
    texture = rng.random((HEIGHT, WIDTH, 3), dtype=np.float32)
    steps = np.where((X // 50 + Y // 40) % 2, -9.0, 5.0)
    lamps = 0.1 * texture
    lamps[20::60, 30::70] = BRIGHT
    return {"flat": (texture, np.full_like(steps, -7.0)), "steps": (texture, steps), "lamps": (lamps, steps)}


@pytest.mark.parametrize("name", ["flat", "steps", "lamps"])
@pytest.mark.parametrize(
    ("changes", "aperture"),
    [({}, {}), ({"cat_eye": 0.7}, {"blades": 5, "rotation": 20.0})],
    ids=["disc", "pentagon in a barrel"],
)
def test_the_map_of_a_thin_lens_is_a_thin_lens(name, changes, aperture):
    color, shift = scenes()[name]
    lens, opening = LENS.replace(**changes), dofsim.Aperture(**aperture)
    expected = render(color, shift, lens, aperture=opening)
    got = render(color, shift, lens.replace(psf=THIN), aperture=opening)
    # Rays may be rounded to the other side of a cell.
    assert_allclose(got, expected, rtol=1e-5, atol=1e-5 * expected.max())


def test_a_thin_map_leans_with_the_focus():
    lens = dofsim.Lens(aperture_radius=0.1, focus_distance=2.0, fov=50.0, tilt=(30.0, 10.0))
    color = scenes()["steps"][0]
    depth = 2.0 + 0.01 * X
    expected = dofsim.render(color, depth, lens, device="cpu")
    got = dofsim.render(color, depth, lens.replace(psf=THIN), device="cpu")
    assert_allclose(got, expected, atol=1e-5)


def test_a_lens_of_twice_the_disc_is_one_of_twice_the_strength():
    color, shift = scenes()["steps"]
    twice = LensMap([0.0], 2.0 * lens_points(33)[None])
    expected = render(color, shift, dofsim.Lens.from_disparity(strength_px=2.0, focus=0.0), views=512)
    got = render(color, shift, LENS.replace(psf=twice), views=512)
    assert_allclose(got, expected, atol=1e-5)


def test_what_is_in_focus_on_the_axis_stays_as_it_is():
    color = scenes()["flat"][0]
    # In the middle rays land within a twentieth of a pixel, in the corners within a tenth.
    got = render(color, 0.0, LENS.replace(coma=0.0003, astigmatism=0.0006))
    near = np.hypot(X - MIDDLE[0], Y - MIDDLE[1]) < 3
    assert_allclose(got[near], color[near], atol=1e-6)
    assert np.abs(got - color).max() > 1e-3


# Points of light


@pytest.mark.parametrize("shift", [0.0, -12.0, 12.0])
@pytest.mark.parametrize("at", [(230, 40), (60, 150)])
def test_coma_is_the_image_of_the_lens_by_its_formula(at, shift):
    image = render(lamp(at), shift, LENS.replace(coma=0.2))[..., 0] / BRIGHT
    landed = landings(at, disc_points(), coma=0.2, shift=shift)
    light, mean, covariance = moments(image)
    assert light == pytest.approx(1.0, abs=1e-5)
    _, binned_mean, binned_covariance = moments(binned(landed))
    assert_allclose(mean, binned_mean, atol=0.01)
    assert_allclose(covariance, binned_covariance, atol=0.01 * np.trace(binned_covariance))
    assert np.minimum(image, binned(landed)).sum() > 0.985
    lit = image > 1e-4
    for axis, grid in enumerate((X, Y)):
        assert grid[lit].min() == pytest.approx(landed[:, axis].min(), abs=1.0)
        assert grid[lit].max() == pytest.approx(landed[:, axis].max(), abs=1.0)


@pytest.mark.parametrize("side", [1, -1])
def test_under_astigmatism_a_point_is_a_line_at_each_of_two_foci(side):
    at = (int(MIDDLE[0] + 0.5) + 100, int(MIDDLE[1] + 0.5))
    height, away, across = frame_of(at)
    focus = 0.5 * 0.2 * height**2 * HALF_DIAGONAL
    image = render(lamp(at), side * focus, LENS.replace(astigmatism=0.2))[..., 0]
    _, mean, covariance = moments(image)
    line, thin = (across, away) if side > 0 else (away, across)
    assert thin @ covariance @ thin == pytest.approx(1 / 12, abs=0.2)
    # A disc's variance is a quarter of its squared radius.
    assert line @ covariance @ line == pytest.approx((2 * focus) ** 2 / 4 + 1 / 12, rel=0.01)
    assert_allclose(mean, at, atol=0.02)


def test_a_surface_is_drawn_as_its_points_are():
    rng = np.random.default_rng(3)
    color = ndimage.gaussian_filter(rng.random((HEIGHT, WIDTH)), 2.0)
    color = (0.5 + 0.15 * (color - color.mean()) / color.std()).astype(np.float32)
    lens = {"coma": 0.05, "astigmatism": 0.04}
    got = render(color, 3.0, LENS.replace(**lens), views=2048)
    inner = slice(24, -24, 7), slice(24, -24, 7)
    points = disc_points(40)
    for y, x in zip(Y[inner].ravel(), X[inner].ravel(), strict=True):
        # Light goes back as it came, so that a pixel sees what is as far on the other side of it.
        met = 2 * np.array([x, y]) - landings((x, y), points, shift=3.0, **lens)
        seen = ndimage.map_coordinates(color.astype(float), met.T[::-1], order=3).mean()
        assert got[y, x] == pytest.approx(seen, abs=0.02)


def test_a_highlight_is_as_bright_as_a_faint_point():
    # A cell that is no highlight is swept, one that is has an image of its own.
    at = (230, 40)
    faint = np.zeros((HEIGHT, WIDTH, 3), np.float32) + 0.5
    faint[at[1] - 2 : at[1] + 3, at[0] - 2 : at[0] + 3] = 2.0
    coma = 0.04
    lens = LENS.replace(coma=coma)
    swept = render(faint, -6.0, lens, views=4096)[..., 0] - 0.5
    bright = np.where(faint > 1.0, np.float32(BRIGHT), np.float32(0.0))
    # Coma moves a point out by a third of it in the mean, as the field grows: surfaces are larger by as
    # much, and as bright as before, while a highlight keeps its light.
    drawn = render(bright, -6.0, lens)[..., 0] * (1.5 / BRIGHT) * (1 + coma / 3) ** 2
    assert drawn.sum() == pytest.approx(swept.sum(), rel=0.01)
    # The one has the aberrations of its own place, the other of those of the pixels that see it.
    assert_allclose(moments(drawn)[1], moments(swept)[1], atol=0.1)
    assert np.abs(drawn - swept).max() < 0.1 * drawn.max()


# Fields go over into one another


def test_no_seam_is_where_tiles_meet():
    rng = np.random.default_rng(5)
    large = ndimage.gaussian_filter(rng.random((HEIGHT + 40, WIDTH + 40)), 1.5).astype(np.float32)
    large = np.stack([large] * 3, axis=-1)
    lens = {"coma": 0.1, "astigmatism": 0.05}

    def cut(dx, dy):
        """Render the picture from another corner on, with the axis where it was in the scene."""
        part = np.ascontiguousarray(large[dy : dy + HEIGHT, dx : dx + WIDTH])
        moved = LENS.replace(principal_point=(-dx / WIDTH, -dy / HEIGHT), **lens)
        return render(part, -3.0, moved, views=2048)

    one, other = cut(0, 0)[24:-24, 24:-24], cut(21, 11)[24 - 11 : -24 - 11, 24 - 21 : -24 - 21]
    off = np.abs(one - other)
    # What is left is the noise of lens samples, and no more of it at a border than elsewhere.
    assert off.mean() < 0.01 * large.std()
    y, x = np.mgrid[24 : HEIGHT - 24, 24 : WIDTH - 24]
    border = (x % 64 == 0) | (x % 64 == 63) | (y % 32 == 0) | (y % 32 == 31)
    assert off[border].mean() < 1.2 * off[~border].mean()


def test_the_picture_changes_smoothly_as_aberrations_set_in():
    color, shift = scenes()["steps"]
    for values in (shift, np.zeros_like(shift)):
        before = render(color, values, LENS)
        for coma in (1e-5, 3e-5, 1e-4, 3e-4):
            got = render(color, values, LENS.replace(coma=coma))
            # Pixels at which lens points meet an edge change by whole rays.
            assert np.abs(got - before).mean() < 0.002 + 20 * coma


# Visibility


@pytest.mark.parametrize("shift", [-10.0, 0.0])
def test_a_card_hides_the_half_of_the_lens_that_it_stands_before(shift):
    at, near, edge = (150, 60), 14.0, 150 + 2
    shifts = np.where(edge < X, near, shift)
    color = lamp(at)
    color[edge < X] = 0.0
    image = render(color, shifts, LENS.replace(coma=0.15))[..., 0] / BRIGHT
    # The beam of a lens point has moved by `l (near - shift)` at the card, which begins at `edge + 1/2`.
    points = disc_points()
    passes = points[:, 0] * (near - shift) < edge + 0.5 - at[0]
    landed = landings(at, points[passes], coma=0.15, shift=shift)
    expected = binned(landed) * passes.mean()
    assert image.sum() == pytest.approx(passes.mean(), abs=0.02)
    assert np.minimum(image, expected).sum() > 0.95 * passes.mean()


@pytest.mark.parametrize("doors", [(0.5, 2.0, 0.0), (1.0, 0.6, 0.8)])
def test_barn_doors_clip_what_they_hide(doors):
    at, shift = (240, 50), -14.0
    image = render(lamp(at), shift, LENS.replace(barn_doors=doors))[..., 0] / BRIGHT
    height, away, _ = frame_of(at)
    stop = -doors[2] * height * away
    points = disc_points()
    passes = (np.abs(points - stop) <= doors[:2]).all(1)
    landed = landings(at, points[passes], shift=shift)
    light, mean, covariance = moments(image)
    # The light that arrives is shared, as with a cat's eye.
    assert light == pytest.approx(1.0, abs=1e-5)
    assert_allclose(mean, landed.mean(0), atol=0.1)
    assert_allclose(covariance, np.cov(landed.T), atol=0.5)


def test_barn_doors_do_not_darken():
    got = render(np.full((HEIGHT, WIDTH, 3), 0.5, np.float32), -9.0, LENS.replace(barn_doors=(0.4, 0.7, 0.9)))
    assert_allclose(got, 0.5, atol=1e-5)


# Measured lenses


def picture_of(transmission, texels=96):
    at = (np.arange(texels) + 0.5) / texels * 2 - 1
    x, y = np.meshgrid(at, at)
    return np.where(np.hypot(x, y) <= 1, transmission(x, y), 0.0)


def test_a_picture_of_a_disc_is_a_thin_lens():
    even = LensMap.from_pictures([0.0], picture_of(lambda x, y: 1.0, 256)[None])
    inside = np.hypot(*np.moveaxis(lens_points(65), -1, 0)) <= 0.98
    assert np.abs(even.behind[0] - lens_points(65))[inside].max() < 0.02


@pytest.mark.parametrize("shift", [-24.0, 24.0])
def test_a_point_looks_as_its_picture(shift):
    behind = picture_of(lambda x, y: 0.2 + (x + 0.3 * y > 0))
    in_front = picture_of(lambda x, y: 0.2 + x**2 + y**2)
    lens = LENS.replace(psf=LensMap.from_pictures([0.0], behind[None], in_front=in_front[None]))
    # A field to the right of the axis, as that of the pictures.
    at = (240, 100)
    image = render(lamp(at), shift, lens)[..., 0] / BRIGHT
    source = behind if shift < 0 else in_front
    size = abs(shift)
    rows = (Y - at[1]) / size, (X - at[0]) / size
    texel = [(v + 1) * len(source) / 2 - 0.5 for v in rows]
    expected = ndimage.map_coordinates(source, texel, order=1, mode="constant")
    expected /= expected.sum()
    assert image.sum() == pytest.approx(1.0, abs=1e-5)
    assert np.minimum(image, expected).sum() > 0.96


def test_pictures_turn_with_the_field():
    right = picture_of(lambda x, y: x > 0.0)
    lens = LENS.replace(psf=LensMap.from_pictures([0.0, 1.0], np.stack([right] * 2)))
    for at in ((240, 99), (140, 30), (40, 160)):
        _, away, _ = frame_of(at)
        _, mean, _ = moments(render(lamp(at), -20.0, lens)[..., 0])
        # Half a disc's centroid is 4 / (3 pi) of its radius away.
        assert_allclose(mean - at, 20 * 4 / (3 * np.pi) * away, atol=0.4)


def test_light_that_does_not_arrive_is_missing_in_the_disc_and_not_in_the_exposure():
    points = lens_points(65)
    behind = np.where(points[..., :1] > 0.4, np.nan, points)
    lens = LENS.replace(psf=LensMap([0.0], behind[None]))
    at = (140, 100)
    image = render(lamp(at), -20.0, lens)[..., 0]
    assert image.sum() / BRIGHT == pytest.approx(1.0, abs=1e-5)
    _, away, _ = frame_of(at)
    along = ((X - at[0]) * away[0] + (Y - at[1]) * away[1])[image > 1e-3 * image.max()]
    assert along.max() == pytest.approx(0.4 * 20, abs=1.5)
    assert along.min() == pytest.approx(-20, abs=1.5)
    wall = render(np.full((HEIGHT, WIDTH, 3), 0.25, np.float32), -20.0, lens)
    assert_allclose(wall, 0.25, atol=1e-5)


def test_maps_are_values(tmp_path):
    given = lens_points(9)[None].copy()
    given[0, 4, 6] = np.nan
    one = LensMap([0.5], given, focused=0.01 * lens_points(9)[None])
    other = LensMap([0.5], given, focused=0.01 * lens_points(9)[None])
    assert one == other
    assert hash(one) == hash(other)
    assert repr(one) == repr(other)
    assert one != LensMap([0.5], given)
    assert pickle.loads(pickle.dumps(one)) == one
    assert_array_equal(one.behind, given)
    assert_array_equal(one.in_front, given)
    assert_array_equal(one.field, [0.5])
    one.save(tmp_path / "lens.npz")
    assert LensMap.load(tmp_path / "lens.npz") == one
    lens = LENS.replace(psf=one, coma=0.0)
    assert lens.psf == one
    assert lens == LENS.replace(psf=other)
    assert lens != LENS
    assert pickle.loads(pickle.dumps(lens)) == lens
    assert "psf=LensMap(" in repr(lens)
    assert lens.replace(psf=None) == LENS


# Linearity, threads, and what is refused


def test_light_adds_up_and_scales():
    rng = np.random.default_rng(7)
    guide, shift = scenes()["steps"]
    a, b = rng.random((2, HEIGHT, WIDTH, 3), dtype=np.float32)
    lens = LENS.replace(coma=0.05, astigmatism=0.03)

    def through(channels):
        return render(channels, shift, lens, guide=guide)

    assert_allclose(through(a + b), through(a) + through(b), atol=2e-5)
    assert_allclose(render(2 * guide, shift, lens), 2 * render(guide, shift, lens), rtol=1e-6)


def test_threads_do_not_matter():
    color, shift = scenes()["lamps"]
    lens = LENS.replace(coma=0.08, astigmatism=0.02, barn_doors=(0.9, 0.8, 0.4))
    one = render(color, shift, lens, threads=1)
    for threads in (2, 3):
        assert_array_equal(render(color, shift, lens, threads=threads), one)


@pytest.mark.parametrize(
    "changes", [{"coma": 0.1}, {"astigmatism": 0.1}, {"barn_doors": (1.0, 1.0, 0.5)}, {"psf": THIN}]
)
def test_what_cannot_draw_them_says_so(changes):
    (name,) = changes
    color, lens = np.ones((32, 32, 3), np.float32), LENS.replace(**changes)
    shift = np.zeros((32, 32))
    for method in ("poisson", "gaussian", "hexagonal", "levels", "taps", "sprites"):
        with pytest.raises(ValueError, match=f'{name} is for method="lens"; method="{method}"'):
            dofsim.render(color, shift, lens, depth_kind="disparity", method=method, device="cpu")
    with pytest.raises(ValueError, match="gradients are for a lens without coma, astigmatism"):
        dofsim.vjp(color, shift, lens, color, depth_kind="disparity")
    for device in dofsim.devices():
        with pytest.raises(ValueError, match=f'device must be "cpu" or "auto" for a lens with {name}'):
            dofsim.render(color, shift, lens, depth_kind="disparity", device=device.id)
    dofsim.render(color, shift, lens, depth_kind="disparity", device="auto")


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: LENS.replace(coma=0.3), r"^coma must be .* from -0.25 to 0.25; got 0.3"),
        (lambda: LENS.replace(astigmatism=float("nan")), "^astigmatism must be"),
        (lambda: LENS.replace(barn_doors=(0.0, 1.0, 0.0)), "^barn_doors must be"),
        (lambda: LENS.replace(barn_doors=(1.0, 1.0, 2.0)), "^barn_doors must be"),
        (lambda: LENS.replace(psf=THIN, coma=0.1), "^coma must be 0 with psf"),
        (lambda: LensMap([0.0], lens_points(5)), "^behind must be numbers of shape"),
        (lambda: LensMap([0.0, 1.0], lens_points(5)[None]), "^behind must have shape .* 2 places as field"),
        (lambda: LensMap([1.0, 0.5], np.stack([lens_points(5)] * 2)), "^field must be rising"),
        (lambda: LensMap([0.0], 9 * lens_points(5)[None]), "^in_front must be offsets of at most 4 radii"),
        (lambda: LensMap([0.0], "text"), "^behind must be numbers"),
        (lambda: LensMap([0.0], lens_points(5)[None], focused=lens_points(7)[None]), "^focused must have"),
        (lambda: LensMap([0.0], np.full((1, 5, 5, 2), np.nan)), "^light must arrive"),
        (lambda: LensMap.from_pictures([0.0], np.zeros((1, 8, 8))), "^behind must hold light"),
        (lambda: LensMap.from_pictures([0.0], -np.ones((1, 8, 8))), "^behind must hold light"),
        (lambda: LensMap.from_pictures([0.0], np.ones((2, 8, 8))), r"^behind must have shape \(F, H, W\)"),
    ],
)
def test_bad_values_are_named(make, match):
    with pytest.raises(ValueError, match=match):
        make()


def test_spherical_aberration_is_in_the_map():
    with pytest.raises(ValueError, match=r"^aperture: spherical must be 0 for a lens with psf"):
        render(lamp((9, 9)), 1.0, LENS.replace(psf=THIN), aperture=dofsim.Aperture(spherical=0.5))


def test_a_lens_file_names_a_map(tmp_path):
    THIN.save(tmp_path / "thin.npz")
    words = {
        "strength_px": 1.0,
        "focus": 0.0,
        "psf": str(tmp_path / "thin.npz"),
        "barn_doors": [1.0, 0.5, 0.2],
    }
    assert make_lens(words) == LENS.replace(psf=THIN, barn_doors=(1.0, 0.5, 0.2))


def test_a_file_that_is_no_map_is_named(tmp_path):
    path = tmp_path / "lens.npz"
    path.write_bytes(b"nothing")
    with pytest.raises(ValueError, match=r"lens\.npz: not a lens map"):
        LensMap.load(path)


def test_spherical_aberration_and_coma_go_together():
    aperture = dofsim.Aperture(spherical=0.9)
    at = (int(MIDDLE[0] + 0.5), int(MIDDLE[1] + 0.5))
    color = lamp(at)
    plain = render(color, -12.0, LENS, aperture=aperture)
    both = render(color, -12.0, LENS.replace(coma=0.2), aperture=aperture)
    # Beside the middle, the comet is as long as a seventh of a pixel: both ways to draw the disc meet.
    assert np.abs(both - plain).sum() < 0.06 * plain.sum()
    at = (240, 60)
    image = render(lamp(at), -12.0, LENS.replace(coma=0.2), aperture=aperture)[..., 0] / BRIGHT
    points = disc_points()
    # Behind the focus the light within `rho` is `(1 - s) rho^2 + s rho^4`.
    within, at_rho = (points**2).sum(1), np.linspace(0, 1, 4001)
    rho = np.interp(within, 0.1 * at_rho**2 + 0.9 * at_rho**4, at_rho)
    moved = points * (rho / np.sqrt(within))[:, None]
    landed = landings(at, points, coma=0.2) + 12.0 * moved
    _, mean, covariance = moments(binned(landed))
    assert_allclose(moments(image)[1], mean, atol=0.03)
    assert_allclose(moments(image)[2], covariance, atol=0.01 * np.trace(covariance))
    assert np.minimum(image, binned(landed)).sum() > 0.97


# A prescription


HALF_DIAGONAL_MM = 24.0


@pytest.fixture(scope="module")
def double_gauss():
    """Trace a lens once: give it as a lens, and its rays."""
    objectives = pytest.importorskip("optiland.samples.objectives")
    from dofsim._prescription import Traced

    lens = dofsim.Lens.from_optiland(
        objectives.DoubleGauss(), focus_distance=2.0, half_diagonal_mm=HALF_DIAGONAL_MM
    )
    return lens, Traced(objectives.DoubleGauss(), 2.0)


@pytest.mark.parametrize("height", [0.0, 0.7, 1.0])
@pytest.mark.parametrize("distance", [1.2, 2.0, 6.0])
def test_a_double_gauss_draws_points_as_its_rays_land(double_gauss, height, distance):
    lens, traced = double_gauss
    size, half_diagonal_mm = 1000, HALF_DIAGONAL_MM
    middle, half_diagonal = 0.5 * (size - 1), 0.5 * np.hypot(size, size)
    direction = np.array([1.0, 1.0]) / np.sqrt(2)
    at = np.round(middle + 0.97 * height * half_diagonal * direction).astype(int)
    off = np.hypot(*(at - middle)) / half_diagonal
    color = np.zeros((size, size), np.float32)
    color[at[1], at[0]] = BRIGHT
    image = dofsim.render(color, np.full((size, size), distance), lens, device="cpu") / BRIGHT
    # Rays of the point itself through the stop, as Optiland traces them.
    tangent = np.full(1, off * half_diagonal_mm / abs(traced.image_distance))
    chief = traced.landings(tangent, traced.aimed(tangent, np.zeros((1, 2))), traced.focus)[0]
    pupil = traced.aimed(tangent, disc_points(120), distance=1e3 * distance)
    landed = traced.landings(tangent, pupil, 1e3 * distance)[0] - chief
    landed = (
        landed[~np.isnan(landed).any(-1)] * np.sign(traced.image_distance) * half_diagonal / half_diagonal_mm
    )
    # In the frame of the field, which is towards the lower right corner.
    across = np.array([-direction[1], direction[0]])
    landed = at + landed[:, :1] * direction + landed[:, 1:] * across
    edges = np.arange(size + 1) - 0.5
    expected, _, _ = np.histogram2d(landed[:, 1], landed[:, 0], bins=[edges, edges])
    expected /= expected.sum()
    y, x = np.mgrid[:size, :size]
    light = image.sum()
    mean = np.array([(image * x).sum(), (image * y).sum()]) / light
    variance = (image * ((x - mean[0]) ** 2 + (y - mean[1]) ** 2)).sum() / light - 1 / 6
    radius, by_rays = (np.sqrt(2 * max(v, 0.0)) for v in (variance, landed.var(0).sum()))
    overlap = np.minimum(image, expected).sum()
    assert light == pytest.approx(1.0, abs=1e-4)
    # Spots of about a pixel are swept: of 64 lens points, and by how they change textures, not by their area.
    assert_allclose(mean, landed.mean(0), atol=0.02 if by_rays > 3 else 0.06)
    assert radius == pytest.approx(by_rays, rel=0.03, abs=0.01 if by_rays > 3 else 0.3)
    assert overlap > (0.94 if by_rays > 3 else 0.75)
