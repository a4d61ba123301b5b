"""The numbers that pictures, depth and lenses may hold, at both ends."""

import dofsim
import numpy as np
import pytest

METHODS = ["lens", "poisson", "gaussian", "hexagonal", "levels", "taps", "sprites"]
HEIGHT, WIDTH = 33, 65
RNG = np.random.default_rng(0)
LENS = dofsim.Lens(aperture_radius=0.05, focus_distance=2.0, fov=40.0)

DEPTHS = {
    "18 orders of magnitude": 10.0 ** RNG.uniform(-6, 12, (HEIGHT, WIDTH)),
    "some of it infinite": np.where(RNG.random((HEIGHT, WIDTH)) < 0.3, np.inf, 10.0 ** RNG.uniform(-1, 3)),
    "all of it infinite": np.full((HEIGHT, WIDTH), np.inf),
    "as far as floats go": np.where(RNG.random((HEIGHT, WIDTH)) < 0.3, 3e38, 2.0),
}
COLORS = {
    "1e30": 1e30 * RNG.random((HEIGHT, WIDTH, 3)),
    "negative": RNG.normal(size=(HEIGHT, WIDTH, 3)),
    "the largest floats": np.where(RNG.random((HEIGHT, WIDTH, 3)) < 0.5, 3.4e38, 1e-38),
    "denormals": 1e-42 * RNG.random((HEIGHT, WIDTH, 3)),
    "all magnitudes": 10.0 ** RNG.uniform(-44, 38, (HEIGHT, WIDTH, 3)),
}


def render(color, depth, lens=LENS, **options):
    return dofsim.render(color.astype(np.float32), depth.astype(np.float32), lens, device="cpu", **options)


def render_if_it_is(color, depth, lens, method):
    """Render, unless the flagship says no to circles of confusion of more than 16384 pixels."""
    try:
        return render(color, depth, lens, method=method)
    except ValueError as error:
        if method != "lens" or "their circles of confusion would have" not in str(error):
            raise
        return None


@pytest.mark.parametrize("depth", DEPTHS)
@pytest.mark.parametrize("color", COLORS)
@pytest.mark.parametrize("method", METHODS)
def test_finite_in_finite_out(method, color, depth):
    out = render_if_it_is(COLORS[color], DEPTHS[depth], LENS, method)
    if out is None:
        assert depth == "18 orders of magnitude"
        return
    assert np.isfinite(out).all()
    if COLORS[color].min() >= 0:
        # But for rounding; and the flagship parts mixed pixels into some that are brighter than their mean.
        most = COLORS[color].astype(np.float32).max()
        assert out.min() >= -1e-7 * most
        most = most * np.float32(1 + 1e-4) + 1e-44
        assert method == "lens" or out.max() <= most


@pytest.mark.parametrize("value", [1e-46, 1e-40, 2.0**-1074])
def test_depth_whose_inverse_is_no_float_is_refused_or_far(value):
    depth = np.full((HEIGHT, WIDTH), 2.0)
    depth[3, 4] = value
    color = RNG.random((HEIGHT, WIDTH, 3))
    with pytest.raises(ValueError, match=r"1 of .* are not valid; the first is .* row 3, column 4"):
        dofsim.render(color, depth, LENS, device="cpu")
    assert np.isfinite(dofsim.render(color, depth, LENS, device="cpu", invalid="far")).all()


@pytest.mark.parametrize("aperture_radius", [0.0, 1e-300, 1e-12, 1e-3, 1.0, 30.0, 1e6, 1e300])
@pytest.mark.parametrize("method", METHODS)
def test_any_circle_of_confusion(method, aperture_radius):
    depth = np.where(np.arange(WIDTH) < 30, 1.0, 5.0) * np.ones((HEIGHT, 1))
    lens = LENS.replace(aperture_radius=aperture_radius)
    color = RNG.random((HEIGHT, WIDTH, 3)).astype(np.float32)
    out = render_if_it_is(color, depth, lens, method)
    if out is None:
        assert aperture_radius > 1
        return
    assert np.isfinite(out).all()
    if aperture_radius <= 1e-12:
        np.testing.assert_allclose(out, color, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("z", [1e-6, 1e-3])
def test_one_depth_that_is_far_too_near_costs_no_more(method, z):
    """A filter as wide as the largest circle of confusion would take minutes and all memory."""
    depth = np.full((270, 480), 3.0)
    depth[100, 200] = z
    lens = dofsim.Lens(aperture_radius=0.05, focus_distance=2.0, fov=20.0)
    out = render_if_it_is(RNG.random((270, 480, 3)), depth, lens, method)
    assert out is None or np.isfinite(out).all()


@pytest.mark.parametrize("method", METHODS)
def test_half_floats_are_what_their_floats_are(method):
    color = RNG.uniform(-2.0, 6e4, (HEIGHT, WIDTH, 3)).astype(np.float16)
    depth = RNG.choice([6e-5, 0.5, 2.0, 300.0, 65504.0, np.inf], (HEIGHT, WIDTH)).astype(np.float16)
    words = {"method": method, "device": "cpu"}
    lens = LENS.replace(aperture_radius=0.001)
    out = dofsim.render(color, depth, lens, **words)
    assert out.dtype == np.float16
    wide = dofsim.render(color.astype(np.float32), depth.astype(np.float32), lens, **words)
    # Unmixed pixels may be brighter than halves can say.
    np.testing.assert_array_equal(out, np.clip(wide, -65504, 65504).astype(np.float16))


# What the sums of many small shares in single precision leave of a lamp's light.
ENERGY = {**dict.fromkeys(METHODS, 1e-5), "lens": 1e-6}


@pytest.mark.parametrize("method", ENERGY)
def test_the_light_of_one_pixel_of_a_million_in_a_4k_frame(method):
    color = np.full((2160, 3840, 3), 0.5, np.float32)
    color[1000, 2001] = 1e6
    depth = np.full((2160, 3840), 4.0, np.float32)
    out = render(color, depth, dofsim.Lens(aperture_radius=0.03, focus_distance=2.0, fov=50.0), method=method)
    gained = (out[800:1200, 1800:2200].astype(np.float64) - 0.5).sum(axis=(0, 1)) / (1e6 - 0.5)
    np.testing.assert_allclose(gained, 1.0, rtol=0, atol=ENERGY[method])
