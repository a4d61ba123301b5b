"""What all methods but "lens" have in common: laws, options, and what they refuse."""

import re

import dofsim
import numpy as np
import pytest
from dofsim._dofsim import methods_available, simd_available

# Each method with options that make it do all it can. A further method is a further line.
METHODS = {
    "poisson": {"taps": 24, "max_coc_px": 12.0},
    "gaussian": {"max_coc_px": 12.0},
    "hexagonal": {"max_coc_px": 12.0},
    "levels": {"c0_px": 5.0},
    "taps": {"variant": "thirteen"},
    "sprites": {"sprite": np.array([[0.5, 1.0], [1.0, 1.0]]), "coc_threshold_px": 1.5},
}
# What each method can be asked for, as its errors list it.
OPTIONS = {
    "lens": "views, resolution",
    "poisson": "bokeh, taps, leak_test",
    "gaussian": "focal_range",
    "hexagonal": "none of its own",
    "levels": "c0_px",
    "taps": "variant, hyperfocal_factor",
    "sprites": "sprite, coc_threshold_px",
}

HEIGHT, WIDTH = 70, 150
STRENGTH_PX = 6.0


def render(color, depth, method, strength_px=STRENGTH_PX, **options):
    lens = dofsim.Lens.from_disparity(strength_px=strength_px, focus=0.0)
    chosen = METHODS.get(method, {}) | options
    return dofsim.render(color, depth, lens, depth_kind="disparity", method=method, **chosen)


@pytest.fixture(scope="module")
def depth():
    d = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    d[40:, 90:] = 0.0
    d[20:50, 30:80] = np.linspace(0.3, 1.0, 50, dtype=np.float32)
    return d


@pytest.fixture(scope="module")
def color():
    return np.random.default_rng(1).random((HEIGHT, WIDTH, 3), dtype=np.float32)


def test_every_method_is_tested_here():
    assert methods_available() == list(OPTIONS) == ["lens", *METHODS]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, np.uint8, np.uint16])
def test_closed_aperture_changes_no_bit(method, dtype, color, depth):
    picture = (255 * color).astype(dtype) if np.issubdtype(dtype, np.integer) else color.astype(dtype)
    np.testing.assert_array_equal(render(picture, depth, method, 0.0, transfer="linear"), picture)


@pytest.mark.parametrize("method", METHODS)
def test_plane_in_focus_changes_no_bit(method, color):
    np.testing.assert_array_equal(render(color, np.zeros(color.shape[:2]), method), color)


@pytest.mark.parametrize("method", METHODS)
def test_it_blurs(method, color, depth):
    out = render(color, depth, method)
    sharp = depth == 0.0
    assert out[~sharp].std() < 0.9 * color[~sharp].std()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("value", [0.7, 300.0])
def test_constant_picture_stays_constant(method, depth, value):
    noisy = np.random.default_rng(4).uniform(-1.0, 1.0, depth.shape).astype(np.float32)
    for d in (depth, noisy):
        out = render(np.full((*d.shape, 3), value, np.float32), d, method)
        np.testing.assert_allclose(out, value, rtol=1e-5)


@pytest.mark.parametrize(
    "options",
    [*({"method": method} for method in METHODS), {"method": "poisson", "taps": 2, "bokeh": "inverse"}],
    ids=str,
)
def test_no_light_becomes_less_than_none(options):
    # A mean of two taps is that of their differences from the pixel: minus its light, where both are dark.
    rng = np.random.default_rng(1)
    for _ in range(5):
        lit = np.where(rng.random((48, 64, 1)) < 0.5, rng.random((48, 64, 4)), 0.0)
        assert render(lit, rng.uniform(-2.0, 2.0, lit.shape[:2]), **options).min() >= 0.0


@pytest.mark.parametrize("method", METHODS)
def test_channels_are_filtered_alike(method, color, depth):
    together = render(color, depth, method)
    for c in range(3):
        np.testing.assert_array_equal(together[..., c], render(color[..., c], depth, method))
    four = np.concatenate([color, np.ones_like(color[..., :1])], axis=-1)
    np.testing.assert_array_equal(render(four, depth, method)[..., :3], together)
    np.testing.assert_array_equal(render(color[..., :2], depth, method, alpha="none"), together[..., :2])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("threads", [1, 3])
def test_number_of_threads_changes_no_bit(method, color, depth, threads):
    np.testing.assert_array_equal(render(color, depth, method, threads=threads), render(color, depth, method))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("name", simd_available())
def test_instruction_set_changes_no_bit(monkeypatch, method, depth, name, channels):
    c = np.random.default_rng(3).random((HEIGHT, WIDTH, channels), dtype=np.float32)
    monkeypatch.setenv("DOFSIM_SIMD", "portable")
    plain = render(c, depth, method)
    monkeypatch.setenv("DOFSIM_SIMD", name)
    np.testing.assert_array_equal(render(c, depth, method), plain)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (2, 2), (3, 65)])
def test_every_size_is_rendered(method, size):
    rng = np.random.default_rng(6)
    out = render(rng.random((*size, 3), dtype=np.float32), rng.uniform(-1.0, 1.0, size), method)
    assert out.shape == (*size, 3)
    assert out.min() >= 0.0
    assert out.max() <= 1.0


@pytest.mark.parametrize("method", METHODS)
def test_a_bright_point_keeps_its_light(method):
    point = np.zeros((65, 65), np.float32)
    point[32, 32] = 1000.0
    out = render(point, np.ones((65, 65)), method)
    assert out.min() >= 0.0
    assert out.sum(dtype=np.float64) == pytest.approx(1000.0, rel=0.02)


@pytest.mark.parametrize("method", METHODS)
def test_supersampling_averages_the_full_size(method, color, depth):
    full = render(color, depth, method, 2 * STRENGTH_PX)
    expected = full.reshape(HEIGHT // 2, 2, WIDTH // 2, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(render(color, depth, method, supersample=2), expected, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_overscan_is_a_crop(method, color, depth):
    whole = render(color, depth, method)
    np.testing.assert_array_equal(render(color, depth, method, overscan=7), whole[7:-7, 7:-7])


@pytest.mark.parametrize("method", METHODS)
def test_scenes_take_the_same_options(method, color, depth):
    lens = dofsim.Lens.from_disparity(strength_px=STRENGTH_PX, focus=0.0)
    scene = dofsim.Scene(color, depth, depth_kind="disparity")
    options = {"method": method, **METHODS[method]}
    np.testing.assert_array_equal(scene.render(lens, **options), render(color, depth, method))
    stack = scene.focal_stack(lens, [0.0, -1.0], **options)
    np.testing.assert_array_equal(stack[0], render(color, depth, method))
    assert (stack[0] != stack[1]).any()


@pytest.mark.parametrize("method", METHODS)
def test_layers_are_refused_by_name(method):
    layers, depths = np.ones((2, 8, 8, 4), np.float32), np.ones((2, 8, 8))
    with pytest.raises(
        ValueError, match=f'method="{method}" takes color and depth of one layer; got 2 layers'
    ):
        render(layers, depths, method)


@pytest.mark.parametrize("method", ["gaussian", "levels", "taps"])
def test_other_openings_are_refused_by_name(method, color, depth):
    expected = re.escape(f'aperture must be a plain disc for method="{method}"')
    with pytest.raises(ValueError, match=expected + r".*Aperture\(blades=6\)"):
        render(color, depth, method, aperture=dofsim.Aperture(blades=6))
    np.testing.assert_array_equal(
        render(color, depth, method, aperture=dofsim.Aperture()), render(color, depth, method)
    )


@pytest.mark.parametrize("method", OPTIONS)
def test_options_of_others_are_refused_by_name(method, color, depth):
    expected = re.escape(f'magic is not an option of method="{method}", which has {OPTIONS[method]}')
    with pytest.raises(TypeError, match=f"^{expected}$"):
        render(color, depth, method, magic=1)
    scene = dofsim.Scene(color, np.ones(depth.shape))
    lens = dofsim.Lens(aperture_radius=0.1, focus_distance=2.0, fov=40.0)
    for call in (scene.render, lambda lens, **o: scene.focal_stack(lens, [1.0], **o)):
        with pytest.raises(TypeError, match="magic is not an option"):
            call(lens, method=method, magic=1)


@pytest.mark.parametrize("method", OPTIONS)
def test_none_is_an_option_not_given(method, color, depth):
    own = [] if method == "hexagonal" else OPTIONS[method].split(", ")
    empty = dict.fromkeys([*own, "max_coc_px", "in_focus"])
    lens = dofsim.Lens.from_disparity(strength_px=STRENGTH_PX, focus=0.0)
    out = dofsim.render(color, depth, lens, depth_kind="disparity", method=method, **empty)
    np.testing.assert_array_equal(
        out, dofsim.render(color, depth, lens, depth_kind="disparity", method=method)
    )


@pytest.mark.parametrize(
    ("method", "options", "error", "message"),
    [
        ("lens", {"views": 8}, ValueError, "views must be from 16 to 16384; got 8"),
        ("lens", {"views": 64.5}, TypeError, "views must be a whole number; got 64.5"),
        ("taps", {"variant": "eleven"}, ValueError, 'variant must be one of "thirteen", .*; got "eleven"'),
        ("taps", {"variant": 13}, TypeError, "variant must be a word; got 13"),
        ("taps", {"hyperfocal_factor": "far"}, TypeError, "hyperfocal_factor must be a number; got 'far'"),
        ("taps", {"hyperfocal_factor": -1.0}, ValueError, "hyperfocal_factor must be .*; got -1"),
    ],
)
def test_bad_options_are_named(color, depth, method, options, error, message):
    with pytest.raises(error, match=f"^{message}$"):
        render(color, depth, method, **options)
