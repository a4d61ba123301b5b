"""Laws of channels that go through a lens by a guide: each is the same linear map, whatever it holds."""

import dofsim
import numpy as np
import pytest
from dofsim._dofsim import simd_available

HEIGHT, WIDTH = 96, 136
SIZE = (HEIGHT, WIDTH)


def lens(strength_px=9.0, **words):
    return dofsim.Lens.from_disparity(strength_px=strength_px, focus=0.0).replace(**words)


def render(channels, depth, guide, *, through=None, **options):
    options = {"depth_kind": "disparity", **options}
    return dofsim.render(channels, depth, through or lens(), guide=guide, **options)


@pytest.fixture(scope="module")
def depth():
    """Surfaces behind, in and in front of the focus, a slope, and bars too thin to have a pure pixel."""
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    d = np.full(SIZE, -1.0, np.float32)
    d[:, :40] = -0.6 + 0.004 * x[:, :40]
    d[55:, 90:] = 0.0
    d[(x - 70) ** 2 + (y - 40) ** 2 < 22**2] = 1.0
    d[20:80, 100:130:7] = 0.7
    return d


@pytest.fixture(scope="module")
def guide(depth):
    """Texture, partly covered edges and lamps that outshine everything by far."""
    rng = np.random.default_rng(3)
    color = (0.2 + 0.25 * (depth > 0.5) + 0.2 * rng.random(SIZE))[..., None] * np.array([1.0, 0.8, 0.5])
    # A pixel of an edge holds some of both surfaces.
    color[:, 1:-1] = (color[:, :-2] + 2 * color[:, 1:-1] + color[:, 2:]) / 4
    color[rng.random(SIZE) < 0.002] += 60.0
    return color.astype(np.float32)


@pytest.fixture(scope="module")
def rgba(guide):
    """Give the guide coverage: a background that is not there, with soft edges."""
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    alpha = np.clip(np.hypot(x - 20, y - 75) / 4 - 4, 0, 1)
    return np.dstack([guide * alpha[..., None], alpha]).astype(np.float32)


@pytest.fixture(scope="module")
def channels():
    """Twenty-three channels that have nothing to do with the guide, of either sign."""
    planes = np.random.default_rng(4).standard_normal((*SIZE, 23), dtype=np.float32)
    return planes * np.geomspace(1e-3, 1e3, 23, dtype=np.float32)


KINDS = ["light", "matte", "data", "light", "normal", "normal", "normal"]


@pytest.mark.parametrize("kind", ["light", "matte", "data"])
@pytest.mark.parametrize("supersample", [1, 2])
def test_the_result_of_a_sum_is_the_sum_of_the_results(channels, depth, rgba, kind, supersample):
    a, b = np.abs(channels[..., 10]), np.abs(channels[..., 11])
    all_three = np.dstack([a, b, 2 * a + b])
    out = render(all_three, depth, rgba, kinds=kind, supersample=supersample)
    scale = np.abs(all_three).max()
    np.testing.assert_allclose(out[..., 2], 2 * out[..., 0] + out[..., 1], rtol=1e-4, atol=3e-6 * scale)


@pytest.mark.parametrize("kind", ["light", "data"])
def test_a_channel_of_four_times_the_values_has_four_times_the_result(channels, depth, guide, kind):
    plain = render(channels, depth, guide, kinds=kind)
    np.testing.assert_array_equal(render(4 * channels, depth, guide, kinds=kind), 4 * plain)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 23])
def test_a_channel_does_not_depend_on_those_that_travel_along(channels, depth, rgba, count):
    kinds = (["light", "data", "matte"] * 8)[:count]
    together = render(channels[..., :count], depth, rgba, kinds=kinds)
    assert together.shape == (*SIZE, count)
    for c in {0, count // 2, count - 1}:
        alone = render(channels[..., c], depth, rgba, kinds=kinds[c])
        np.testing.assert_array_equal(together[..., c], alone)


def test_the_order_of_channels_changes_no_bit(channels, depth, rgba):
    order = [6, 2, 5, 0, 3, 4, 1]
    kinds = ["light", "data", "matte", "data", "light", "matte", "light"]
    plain = render(channels[..., :7], depth, rgba, kinds=kinds)
    turned = render(channels[..., :7][..., order], depth, rgba, kinds=[kinds[c] for c in order])
    np.testing.assert_array_equal(turned, plain[..., order])


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_what_is_in_focus_keeps_every_bit(channels, depth, rgba, dtype):
    given = channels[..., 3:10].astype(dtype)
    out = render(given, depth, rgba, kinds=KINDS, through=lens(0.0))
    assert out.dtype == dtype
    np.testing.assert_array_equal(out, given)
    there = dofsim.Lens(aperture_radius=0.1, focus_distance=4.0, fov=40.0)
    out = dofsim.render(given, np.full(SIZE, 4.0), there, guide=rgba, kinds=KINDS)
    np.testing.assert_array_equal(out, given)


def test_threads_and_instructions_change_no_bit(channels, depth, rgba, monkeypatch):
    plain = render(channels[..., 3:10], depth, rgba, kinds=KINDS, threads=1)
    np.testing.assert_array_equal(render(channels[..., 3:10], depth, rgba, kinds=KINDS, threads=5), plain)
    for name in simd_available():
        monkeypatch.setenv("DOFSIM_SIMD", name)
        np.testing.assert_array_equal(render(channels[..., 3:10], depth, rgba, kinds=KINDS), plain)


def test_a_picture_led_by_itself_is_nearly_its_render(depth, rgba):
    beauty = dofsim.render(rgba, depth, lens(), depth_kind="disparity", device="cpu")
    led = render(rgba, depth, rgba, kinds=["light"] * 3 + ["matte"])
    assert np.sqrt(np.mean((led - beauty)[..., 3] ** 2)) < 4e-3
    error = np.abs(np.log1p(np.maximum(led, 0)) - np.log1p(beauty))[..., :3]
    assert np.mean(error) < 1e-3
    assert np.quantile(error, 0.99) < 0.02


def test_the_weights_of_every_pixel_add_up_to_one(depth, guide):
    # Without highlights, of whose discs a part may be hidden.
    ones = np.ones((*SIZE, 2), np.float32)
    out = render(ones, depth, np.minimum(guide, 0.6), kinds=["light", "data"])
    np.testing.assert_allclose(out, 1.0, rtol=2e-5)


@pytest.mark.parametrize("strength_px", [1.5, 9.0])
@pytest.mark.parametrize("covered", [False, True])
def test_means_of_data_stay_within_the_range_of_the_values(depth, guide, rgba, covered, strength_px):
    # Values of two kinds, so that the least weight below 0 goes beyond them.
    given = np.random.default_rng(5).integers(0, 2, (*SIZE, 5)).astype(np.float32)
    out = render(given, depth, rgba if covered else guide, kinds="data", through=lens(strength_px))
    seen = rgba[..., 3] > 0 if covered else np.ones(SIZE, bool)
    low, high = given[seen].min(axis=0), given[seen].max(axis=0)
    slack = 1e-5 * (high - low)
    inside = (out >= low - slack) & (out <= high + slack)
    # Where nothing is covered as far as the lens sees, nothing is known; where it is in focus, values stay.
    alpha = render(rgba[..., 3], depth, rgba, kinds="matte", through=lens(strength_px))
    assert np.all(inside | (covered & (alpha <= 1e-6))[..., None])


def test_what_is_not_covered_has_no_weight_in_data(depth, rgba):
    position = np.where(rgba[..., 3] > 0, 5.0, np.inf).astype(np.float32)
    out = render(position, depth, rgba, kinds="data")
    known = np.isfinite(out) & (out > 0)
    np.testing.assert_allclose(out[known], 5.0, rtol=1e-5)
    assert np.all(known | (rgba[..., 3] == 0))


def test_what_is_infinite_has_no_weight_and_stays_where_it_is_in_focus(depth, guide):
    far = np.where(depth < -0.9, np.inf, 3.0).astype(np.float32)
    far[0, 0] = np.nan
    out = render(np.dstack([far, far]), depth, guide, kinds="data")
    seen = np.isfinite(out) & (out != 0)
    np.testing.assert_allclose(out[seen], 3.0, rtol=1e-5)
    # A pixel behind an edge sees some of what is finite.
    assert np.any(seen[..., 0] & ~np.isfinite(far))
    np.testing.assert_array_equal(render(far, depth, guide, kinds="data", through=lens(0.0)), far)


def test_normals_come_back_with_unit_length(channels, depth, guide):
    normals = channels[..., :3] / np.linalg.norm(channels[..., :3], axis=-1, keepdims=True)
    out = render(normals, depth, guide, kinds="normal")
    np.testing.assert_allclose(np.linalg.norm(out, axis=-1), 1.0, atol=1e-5)
    mean = render(normals, depth, guide, kinds="data")
    length = np.linalg.norm(mean, axis=-1, keepdims=True)
    np.testing.assert_allclose(out, mean / length, rtol=1e-3, atol=1e-5)


def test_mattes_of_objects_add_up_to_the_coverage(depth, rgba):
    alpha = rgba[..., 3]
    masks = np.dstack([alpha * (np.digitize(depth, [-0.5, 0.5]) == number) for number in range(3)])
    out = render(np.dstack([masks, alpha]).astype(np.float32), depth, rgba, kinds="matte")
    np.testing.assert_allclose(out[..., :3].sum(-1), out[..., 3], atol=1e-5)


def test_a_lens_darkens_light_and_nothing_else(depth, guide):
    ones = np.ones((*SIZE, 3), np.float32)
    dark = dofsim.Lens(aperture_radius=0.05, focus_distance=2.0, fov=70.0, vignetting="natural")
    out = render(
        ones, np.full(SIZE, 2.0), guide, kinds=["light", "matte", "data"], depth_kind="z", through=dark
    )
    assert out[0, 0, 0] < 0.8
    np.testing.assert_array_equal(out[..., 1:], 1.0)


def test_a_lens_that_breathes_is_linear_too(channels, depth, guide):
    breathing = dofsim.Lens(
        aperture_radius=0.03, focus_distance=0.5, fov=40.0, sensor_mm=24.0, breathing_focal_length_mm=50.0
    )
    metres = 1.0 / (1.5 + depth)
    a, b = np.abs(channels[..., 10]), np.abs(channels[..., 11])
    out = render(np.dstack([a, b, a + b]), metres, guide, through=breathing, depth_kind="z")
    np.testing.assert_allclose(out[..., 2], out[..., 0] + out[..., 1], rtol=1e-4, atol=1e-4)


def test_up_to_four_channels_are_their_own_guide(guide, depth):
    own = dofsim.render(guide, depth, lens(), kinds="light", depth_kind="disparity")
    np.testing.assert_array_equal(own, render(guide, depth, guide, kinds="light"))


def test_a_scene_of_channels_is_a_stack(channels, depth, guide):
    words = {"depth_kind": "disparity"}
    scene = dofsim.Scene(channels[..., :5], depth, guide=guide, kinds="data", **words)
    stack = scene.focal_stack(lens(), [0.0, 1.0])
    assert stack.shape == (2, *SIZE, 5)
    np.testing.assert_array_equal(stack[0], render(channels[..., :5], depth, guide, kinds="data"))


def test_the_margin_is_cut_off_and_finer_pixels_are_averaged(channels, depth, guide):
    out = render(channels[..., :5], depth, guide, overscan=8)
    assert out.shape == (HEIGHT - 16, WIDTH - 16, 5)
    assert render(channels[..., :5], depth, guide, supersample=2).shape == (HEIGHT // 2, WIDTH // 2, 5)


def given(**changed):
    small = np.ones((8, 8, 5), np.float32)
    words = {"color": small, "depth": small[..., 0], "guide": small[..., :3], "depth_kind": "disparity"}
    return words | {"lens": lens()} | changed


NAN = np.full((8, 8, 5), np.nan, np.float32)
REFUSED = [
    ({"guide": None, "kinds": "light"}, "guide must be given for color of more than 4 channels"),
    ({"guide": np.ones((9, 8, 3), np.float32)}, r"guide must have the rows and columns of color, \[8, 8\]"),
    ({"guide": np.ones((8, 8, 5), np.float32)}, "guide must have 1 to 4 channels"),
    ({"guide": np.ones((1, 8, 8, 4), np.float32)}, "guide must have the layers, rows and columns of color"),
    ({"guide": np.ones((8, 8, 3), np.uint8)}, "transfer must be given for integer"),
    ({"guide": "picture"}, "guide must be a NumPy array"),
    ({"guide": NAN[..., :3]}, "guide has 64 pixels that are not finite"),
    ({"color": np.ones((8, 8, 0), np.float32)}, "color must have shape"),
    ({"color": np.ones((2, 8, 8, 4), np.float32)}, "color must have shape"),
    ({"color": np.ones((8, 8, 5), np.uint8)}, "color must have dtype float16, float32 or float64"),
    ({"color": NAN}, "color must be finite where it is light .*; got NaN in channel 0 at row 0, column 0"),
    ({"kinds": "beauty"}, 'kinds must be one of "light", "matte", "data", "normal"; got "beauty"'),
    ({"kinds": ["light"] * 4}, "kinds must name one kind, or one for each of 5 channels; got 4"),
    ({"kinds": 3}, "kinds must be a kind, or a sequence"),
    ({"kinds": ["normal", "normal", "data", "data", "data"]}, "three channels in a row"),
    ({"method": "gaussian"}, 'guide and kinds are for method="lens"; got method="gaussian"'),
    ({"lens": lens(axial_color=(0.0, 0.01, 0.0))}, "lens: axial_color is of red, green and blue"),
    ({"lens": lens(lateral_color=(0.001, 0.0, 0.0))}, "lens: lateral_color is of red, green and blue"),
]


@pytest.mark.parametrize(("changed", "text"), REFUSED, ids=[str(i) for i in range(len(REFUSED))])
def test_what_cannot_be_used_is_refused_by_name(changed, text):
    words = given(**changed)
    with pytest.raises((ValueError, TypeError), match=text) as caught:
        dofsim.render(words.pop("color"), words.pop("depth"), words.pop("lens"), **words)
    assert "\n" not in str(caught.value)
