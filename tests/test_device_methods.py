"""The GPU path computes what the CPU path computes: methods, scenes and kinds of picture."""

import functools

import dofsim
import numpy as np
import pytest
from both_devices import (
    CASES,
    HEIGHT,
    METRIC_CASES,
    SCENES,
    WIDTH,
    assert_agree,
    flatten,
    noise,
    random_color,
    render,
    small,
    surfaces,
)


def test_every_method_is_tested_here():
    from dofsim._dofsim import methods_available

    assert sorted(CASES) == sorted(methods_available())


@pytest.mark.parametrize(("method", "options"), flatten(CASES))
@pytest.mark.parametrize("name", SCENES)
def test_gpu_and_cpu_agree(gpu, name, method, options):
    scene = SCENES[name]()
    on_cpu = render(*scene, "cpu", method=method, **options)
    assert_agree(render(*scene, gpu, method=method, **options), on_cpu, method)


@pytest.mark.parametrize(
    "size", [(1, 7), (7, 1), (7, 63), (63, 65), (65, 127), (127, 64), (1, 4097), (4097, 1)]
)
@pytest.mark.parametrize("method", CASES)
def test_gpu_and_cpu_agree_at_odd_sizes(gpu, method, size):
    scene = small(*size)
    on_gpu, on_cpu = (render(*scene, device, method=method) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, method)


@pytest.mark.parametrize(("method", "options"), flatten(METRIC_CASES))
def test_gpu_and_cpu_agree_on_distances(gpu, method, options):
    depth = np.random.default_rng(8).uniform(0.5, 8.0, (HEIGHT, WIDTH)).astype(np.float32)
    depth[:5] = np.inf
    for focus in (2.0, np.inf):
        lens = dofsim.Lens(aperture_radius=0.1, focus_distance=focus, fov=40.0)
        call = functools.partial(dofsim.render, random_color(), depth, lens, method=method, **options)
        assert_agree(call(device=gpu), call(device="cpu"), method)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("method", CASES)
def test_gpu_and_cpu_agree_on_all_channels(gpu, method, channels):
    color, (_, disparity) = random_color(channels), surfaces()
    options = {"method": method, "alpha": None if channels in (1, 3) else "none"}
    on_gpu, on_cpu = (render(color, disparity, device, **options) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, method)


@pytest.mark.parametrize("method", CASES)
def test_gpu_and_cpu_agree_on_all_frames(gpu, method):
    color, disparity = (plane[:, :150] for plane in surfaces())
    options = {"method": method, "supersample": 2, "overscan": 5, "transfer": "srgb"}
    picture = (255 * color).astype(np.uint8)
    on_gpu, on_cpu = (render(picture, disparity, device, **options) for device in (gpu, "cpu"))
    assert np.abs(on_gpu.astype(int) - on_cpu).max() <= 1


@pytest.mark.parametrize("method", CASES)
def test_a_difference_is_seen(gpu, method):
    """The comparison is of two devices, and one that is a little off fails it."""
    scene = noise()
    off = render(*scene, gpu, strength_px=6.02, method=method)
    with pytest.raises(AssertionError):
        assert_agree(off, render(*scene, "cpu", method=method), method)


@pytest.mark.parametrize("method", CASES)
def test_every_run_gives_the_same_bits(gpu, method):
    scene = noise()
    first = render(*scene, gpu, method=method)
    for _ in range(3):
        np.testing.assert_array_equal(render(*scene, gpu, method=method), first)


@pytest.mark.parametrize("method", CASES)
def test_what_is_in_focus_changes_no_bit(gpu, method):
    color, disparity = surfaces()
    np.testing.assert_array_equal(render(color, disparity, gpu, strength_px=0.0, method=method), color)
    np.testing.assert_array_equal(render(color, np.full_like(disparity, 0.0), gpu, method=method), color)


@pytest.mark.parametrize("method", CASES)
def test_scenes_stay_on_the_device(gpu, method):
    # A part with all the surfaces of the whole in it.
    color, disparity = (plane[20:60, 50:110].copy() for plane in surfaces())
    scene = dofsim.Scene(color, disparity, depth_kind="disparity", device=gpu)
    lens = dofsim.Lens.from_disparity(strength_px=6.0, focus=0.0)
    stack = scene.focal_stack(lens, [0.0, -0.5, 1.0], method=method)
    for picture, focus in zip(stack, (0.0, -0.5, 1.0), strict=True):
        np.testing.assert_array_equal(picture, render(color, disparity, gpu, focus=focus, method=method))


def layers(alpha):
    """Three layers, the last of which is whole unless the scene is open."""
    rng = np.random.default_rng(11)
    color = rng.random((3, HEIGHT, WIDTH, 4), dtype=np.float32)
    if alpha == "whole":
        color[..., 3] = 1.0
        color[0, 40:, :, 3] = 0.0
    if alpha != "open":
        color[2, ..., 3] = 1.0
    color[..., :3] *= color[..., 3:]
    _, disparity = surfaces()
    return color, np.stack([disparity + 2.0, disparity + 1.0, np.full_like(disparity, -1.0)])


@pytest.mark.parametrize("alpha", ["whole", "partial", "open"])
@pytest.mark.parametrize("strength_px", [0.0, 3.0])
def test_gpu_and_cpu_agree_on_layers(gpu, alpha, strength_px):
    scene = layers(alpha)
    on_gpu, on_cpu = (render(*scene, device, strength_px=strength_px) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "lens")


# Lens points farther apart than neighbouring pixels; and more views than are followed in one pass.
@pytest.mark.parametrize(("strength_px", "views"), [(30.0, 64), (4.0, 4096)])
def test_gpu_and_cpu_agree_on_any_number_of_views(gpu, strength_px, views):
    color, disparity = surfaces()
    # A part with all the surfaces of the whole in it.
    part = np.s_[:, :] if views < 1024 else np.s_[30:62, 60:100]
    scene = color[part].copy(), disparity[part].copy()
    on_gpu, on_cpu = (render(*scene, d, strength_px=strength_px, views=views) for d in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "lens")


def test_highlights_by_the_thousand_are_all_drawn(gpu):
    """Where the front layer is empty, all that is behind it outshines it."""
    color, disparity = layers("whole")
    color[0, 8:] = 0.0
    on_gpu, on_cpu = (render(color, disparity, device, strength_px=3.0) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "lens")


@pytest.mark.parametrize("method", ["lens", "gaussian"])
def test_fields_of_packed_records_are_read_in_order(gpu, method):
    color, disparity = surfaces()
    records = np.zeros(disparity.shape, [("label", "u1"), ("color", "f4", 3), ("depth", "f4")])
    records["color"], records["depth"] = color, disparity
    expected = render(color, disparity, gpu, method=method)
    for turned in (slice(None), slice(None, None, -1)):
        given = (records[name][turned][turned] for name in ("color", "depth"))
        np.testing.assert_array_equal(render(*given, gpu, method=method), expected)
    unaligned = np.zeros(color.nbytes + 1, np.uint8)[1:].view(np.float32).reshape(color.shape)
    with pytest.raises(ValueError, match="out must be C-contiguous and aligned"):
        render(color, disparity, gpu, method=method, out=unaligned)
