"""What real lenses get wrong: cat's eyes, vignetting, axial and lateral colour, breathing."""

import dofsim
import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracle import lens as oracle

HEIGHT, WIDTH = 160, 200
MIDDLE = np.array([0.5 * (WIDTH - 1), 0.5 * (HEIGHT - 1)])
HALF_DIAGONAL = 0.5 * np.hypot(WIDTH, HEIGHT)
FOV = 50.0
FOCAL_PX = 0.5 * WIDTH / np.tan(np.radians(0.5 * FOV))
LENS = dofsim.Lens(aperture_radius=0.2, focus_distance=2.0, fov=FOV)
Y, X = np.mgrid[:HEIGHT, :WIDTH]


def lamps(at, channels=3, dark=1e-8):
    color = np.full((HEIGHT, WIDTH, channels), dark, np.float32)
    color[at[1], at[0]] = 1e4
    return color


def moments(plane):
    """Energy, centroid and radius of a disc: four times its variance along an axis is its radius squared."""
    plane = plane.astype(np.float64) / 1e4
    total = plane.sum()
    mean = np.array([(plane * X).sum(), (plane * Y).sum()]) / total
    variance = (plane * ((X - mean[0]) ** 2 + (Y - mean[1]) ** 2)).sum() / total / 2.0
    return total, mean, 2.0 * np.sqrt(variance - 1.0 / 12.0)


def overlap(apart):
    """Part of the unit disc that another, moved by `apart`, leaves of it."""
    return (2.0 * np.arccos(0.5 * apart) - 0.5 * apart * np.sqrt(4.0 - apart**2)) / np.pi


def lens_of_circles(apart, radius):
    """Area over pi that the unit disc shares with one of another radius."""
    a = (apart**2 + 1.0 - radius**2) / (2.0 * apart)
    b = apart - a
    if a <= -1.0 or apart <= radius - 1.0:
        return 1.0
    segment = np.arccos(a) - a * np.sqrt(1.0 - a**2)
    other = radius**2 * np.arccos(b / radius) - b * np.sqrt(radius**2 - b**2)
    return (segment + other) / np.pi


def stop(at, amount):
    return amount * (np.array(at) - MIDDLE) / HALF_DIAGONAL


# Cat's eyes


@pytest.mark.parametrize("edge", [False, True], ids=["plain", "beside an edge"])
@pytest.mark.parametrize("at", [(100, 80), (150, 50), (40, 120), (175, 130)])
def test_the_area_of_a_cats_eye_is_the_intersection_of_two_circles(at, edge):
    depth = np.full((HEIGHT, WIDTH), 3.0)
    if edge:
        depth[:6] = 2.0
    clipped = LENS.replace(cat_eye=0.9, vignetting="optical")
    total, mean, _ = moments(dofsim.render(lamps(at), depth, clipped)[..., 0])
    whole, _, _ = moments(dofsim.render(lamps(at), depth, LENS)[..., 0])
    # Lens point l is seen at the pixel p = at + radius l, where the stop is at c(at) + grows l: so it clips
    # like one that stands still and is larger, |l - c / (1 - grows)| <= 1 / (1 - grows).
    radius = float(dofsim.coc(depth, LENS)[80, 100])
    grows = radius * 0.9 / HALF_DIAGONAL
    c, larger = stop(at, 0.9) / (1.0 - grows), 1.0 / (1.0 - grows)
    assert total / whole == pytest.approx(lens_of_circles(np.hypot(*c), larger), abs=0.006)
    points = oracle.lens_points(60)
    seen = points[np.hypot(*(points - c).T) <= larger]
    assert_allclose(mean - np.array(at), radius * seen.mean(axis=0), atol=0.01 * radius)


@pytest.mark.parametrize(("z", "sign"), [(3.0, 1.0), (1.5, -1.0)])
def test_the_sweep_clips_every_pixel_by_its_own_stop(z, sign):
    """A picture of one channel that nothing stands out of, against views that are clipped one by one."""
    rng = np.random.default_rng(11)
    color = np.kron(rng.uniform(0.4, 0.6, (HEIGHT // 8, WIDTH // 8)), np.ones((8, 8)))
    depth = np.full((HEIGHT, WIDTH), z)
    lens = LENS.replace(cat_eye=1.0)
    out = dofsim.render(color.astype(np.float32), depth, lens, views=1024)
    shift = -float(dofsim.coc(depth, LENS)[0, 0])
    assert np.sign(shift) == -sign
    light, seen = np.zeros(color.shape), np.zeros(color.shape)
    c = [(X - MIDDLE[0]) / HALF_DIAGONAL, (Y - MIDDLE[1]) / HALF_DIAGONAL]
    from scipy import ndimage

    for x, y in oracle.lens_points(14):
        passed = np.hypot(x - c[0], y - c[1]) <= 1.0
        light += passed * ndimage.shift(color, (-shift * y, -shift * x), order=1, mode="reflect")
        seen += passed
    inside = np.s_[20:-20, 20:-20]
    difference = (out - light / seen)[inside]
    assert np.sqrt(np.mean(difference**2)) < 0.0025
    assert np.abs(difference).max() < 0.012


def test_cats_eyes_leave_constant_pictures_and_what_is_in_focus_alone():
    color = np.random.default_rng(12).random((HEIGHT, WIDTH, 3), dtype=np.float32)
    lens = LENS.replace(cat_eye=1.0)
    np.testing.assert_array_equal(dofsim.render(color, np.full((HEIGHT, WIDTH), 2.0), lens), color)
    depth = np.where(X < 90, 1.6, 3.0)
    out = dofsim.render(np.full_like(color, 0.7), depth, lens)
    assert_allclose(out, 0.7, rtol=1e-5)


@pytest.mark.parametrize("simd", ["portable", "best"])
def test_cats_eyes_are_the_same_for_every_instruction_set_and_number_of_threads(monkeypatch, simd):
    color = np.random.default_rng(13).random((HEIGHT, WIDTH, 3), dtype=np.float32)
    depth = np.where(np.hypot(X - 120, Y - 60) < 30, 1.5, 3.0)
    lens = LENS.replace(cat_eye=0.8, tilt=(20.0, 10.0), axial_color=(0.02, 0.0, -0.02))
    plain = dofsim.render(color, depth, lens, threads=1)
    if simd == "portable":
        monkeypatch.setenv("DOFSIM_SIMD", "portable")
    np.testing.assert_array_equal(dofsim.render(color, depth, lens, threads=3), plain)


# Vignetting


def test_natural_vignetting_is_the_fourth_power_of_the_cosine():
    color = np.full((HEIGHT, WIDTH, 3), 0.8, np.float32)
    for method in ("lens", "gaussian"):
        out = dofsim.render(
            color, np.full((HEIGHT, WIDTH), 3.0), LENS.replace(vignetting="natural"), method=method
        )
        tan2 = ((X - MIDDLE[0]) ** 2 + (Y - MIDDLE[1]) ** 2) / FOCAL_PX**2
        assert_allclose(out, 0.8 * ((1.0 + tan2) ** -2.0)[..., np.newaxis] * np.ones(3), rtol=2e-4)


def test_optical_vignetting_is_what_the_stop_leaves():
    color = np.full((HEIGHT, WIDTH, 4), 0.8, np.float32)
    color[..., 3] = 1.0
    lens = LENS.replace(cat_eye=0.9, vignetting="optical")
    out = dofsim.render(color, np.full((HEIGHT, WIDTH), 3.0), lens)
    apart = 0.9 * np.hypot(X - MIDDLE[0], Y - MIDDLE[1]) / HALF_DIAGONAL
    assert_allclose(out[..., 0], 0.8 * overlap(apart), atol=2e-3)
    assert_allclose(out[..., 3], 1.0, atol=1e-5)


# Colours


@pytest.mark.parametrize("z", [1.4, 3.0])
def test_axial_colour_gives_every_channel_its_own_radius(z):
    axial = (-0.08, 0.0, 0.05)
    out = dofsim.render(lamps((100, 80)), np.full((HEIGHT, WIDTH), z), LENS.replace(axial_color=axial))
    radii = [moments(out[..., c])[2] for c in range(3)]
    expected = [0.2 * FOCAL_PX * abs(1.0 / z - 0.5 - shift) for shift in axial]
    assert_allclose(radii, expected, rtol=0.01, atol=0.05)
    # Blue is focused nearer: its rim is outside behind the focus, and inside in front of it.
    assert (radii[2] > radii[1] > radii[0]) == (z > 2.0)


@pytest.mark.parametrize("channels", [3, 4])
def test_axial_colour_is_every_channel_at_its_own_focus(channels):
    rng = np.random.default_rng(14)
    color = rng.random((HEIGHT, WIDTH, channels), dtype=np.float32)
    if channels == 4:
        color[..., 3] = 1.0
    depth = np.full((HEIGHT, WIDTH), 3.0)
    axial = (-0.06, 0.0, 0.09)
    for method in ("lens", "poisson"):
        out = dofsim.render(color, depth, LENS.replace(axial_color=axial), method=method)
        for c, shift in enumerate(axial):
            alone = LENS.replace(focus_distance=1.0 / (0.5 + shift))
            expected = dofsim.render(color, depth, alone, method=method)
            assert_allclose(out[..., c], expected[..., c], atol=2e-6)


def test_lateral_colour_gives_every_channel_its_own_size():
    lateral, at = (-0.02, 0.0, 0.03), (150, 40)
    for method in ("lens", "sprites"):
        out = dofsim.render(
            lamps(at), np.full((HEIGHT, WIDTH), 3.0), LENS.replace(lateral_color=lateral), method=method
        )
        for c, larger in enumerate(lateral):
            _, mean, radius = moments(out[..., c])
            assert_allclose(mean, MIDDLE + (np.array(at) - MIDDLE) * (1.0 + larger), atol=0.2)
            expected = (1.0 + larger) * 0.2 * FOCAL_PX * (0.5 - 1.0 / 3.0)
            assert radius == pytest.approx(expected, rel=0.02 if method == "lens" else 0.1)


def test_colours_need_three_channels():
    grey = np.ones((40, 40), np.float32)
    for flaw in ("axial_color", "lateral_color"):
        with pytest.raises(ValueError, match=f"lens: {flaw} needs color of three channels"):
            dofsim.render(grey, np.full((40, 40), 3.0), LENS.replace(**{flaw: (0.01, 0.0, -0.01)}))
    # The same for all three is no colour.
    dofsim.render(grey, np.full((40, 40), 3.0), LENS.replace(axial_color=(0.01, 0.01, 0.01)))


@pytest.mark.parametrize("method", ["poisson", "gaussian", "hexagonal", "levels", "taps", "sprites"])
def test_methods_that_draw_one_opening_refuse_cats_eyes(method):
    with pytest.raises(ValueError, match=rf'cat_eye is for method="lens"; method="{method}"'):
        dofsim.render(
            np.ones((40, 40, 3), np.float32), np.full((40, 40), 3.0), LENS.replace(cat_eye=0.5), method=method
        )


# Breathing


def test_a_lens_that_breathes_enlarges_the_picture_as_it_is_focused_nearer():
    lens = dofsim.Lens.from_camera(
        focal_length_mm=50, f_number=4.0, focus_distance=float("inf"), sensor="full frame", breathing=True
    )
    at, depth = (150, 40), np.full((HEIGHT, WIDTH), 2.0)
    assert_allclose(moments(dofsim.render(lamps(at), depth, lens)[..., 0])[1], at, atol=0.05)
    near = lens.replace(focus_distance=0.5)
    _, mean, _ = moments(dofsim.render(lamps(at), depth, near)[..., 0])
    larger = 0.5 / (0.5 - 0.05)
    assert_allclose(mean, MIDDLE + (np.array(at) - MIDDLE) * larger, atol=0.2)
    still = lens.replace(breathing_focal_length_mm=None, focus_distance=0.5)
    assert_allclose(moments(dofsim.render(lamps(at), depth, still)[..., 0])[1], at, atol=0.05)
