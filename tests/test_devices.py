"""The GPU path computes what the CPU path computes, and what goes wrong on a device is a `DeviceError`."""

import functools
import re

import dofsim
import numpy as np
import pytest
from dofsim.cli import run

# Of the picture's range. Both paths compute in float32, but the GPU also has the optics in float32, and may
# fuse products into sums.
AGREEMENT = 2e-4

# The flagship adds up hundreds of views, and a ray that just grazes a cell may meet it on one device alone.
LENS_AGREEMENT = 2e-3
LENS_PSNR = 60.0

OPENINGS = [
    dofsim.Aperture(blades=6, rotation=10.0),
    dofsim.Aperture(blades=5, roundness=0.4, ratio=1.5),
    dofsim.Aperture(obstruction=0.5, apodization=0.6),
    dofsim.Aperture(image=np.arange(12.0).reshape(3, 4)),
]

# Every method on the GPU, with the options that change what it does.
CASES = {
    "lens": [{}, {"views": 64}, *({"aperture": opening} for opening in OPENINGS)],
    "gaussian": [{}, {"max_coc_px": 3.0}, {"max_coc_px": 12.0}],
    "poisson": [{}, {"taps": 40, "max_coc_px": 12.0}, {"leak_test": "off"}, {"bokeh": "ring"}],
    "hexagonal": [
        {},
        {"aperture": dofsim.Aperture(blades=6, rotation=17.0)},
        {"aperture": dofsim.Aperture(blades=4, rotation=45.0)},
        {"max_coc_px": 3.0},
    ],
    "levels": [{}, {"c0_px": 1.0}, {"c0_px": 3.0}, {"c0_px": 11.0}],
    "taps": [{"variant": name} for name in ("thirteen", "seven", "six", "four", "four_rings")],
    "sprites": [
        {},
        {"coc_threshold_px": 2.5, "max_coc_px": 4.0},
        {"aperture": OPENINGS[0]},
        {"aperture": dofsim.Aperture(spherical=0.7)},
        {"sprite": np.arange(12.0).reshape(3, 4)},
    ],
}
# Options in metres.
METRIC_CASES = {
    "gaussian": [{"focal_range": 2.0}],
    "taps": [{"hyperfocal_factor": 0.3}, {"hyperfocal_factor": 0.0}],
}

HEIGHT, WIDTH = 70, 151


def flatten(cases):
    return [
        pytest.param(method, options, id="-".join([method, *map(str, options.values())]))
        for method, choices in cases.items()
        for options in choices
    ]


def random_color(channels=3, size=(HEIGHT, WIDTH)):
    return np.random.default_rng(channels).random((*size, channels), dtype=np.float32)


def surfaces():
    """Behind, in and in front of the focus, with edges between them and a slope."""
    disparity = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    disparity[40:, 90:] = 0.0
    disparity[20:50, 30:80] = np.linspace(0.3, 1.0, 50, dtype=np.float32)
    return random_color(), disparity


def noise():
    return random_color(), np.random.default_rng(7).uniform(-1.0, 1.0, (HEIGHT, WIDTH)).astype(np.float32)


def lamps():
    color, disparity = surfaces()
    color[::13, ::17] = 500.0
    return color, disparity


def tilted():
    return random_color(), np.broadcast_to(0.3 + 0.01 * np.arange(WIDTH, dtype=np.float32), (HEIGHT, WIDTH))


def small(height, width):
    rng = np.random.default_rng(5)
    return random_color(size=(height, width)), rng.uniform(-1.0, 1.0, (height, width)).astype(np.float32)


SCENES = {
    "surfaces": surfaces,
    "noise": noise,
    "lamps": lamps,
    "tilted": tilted,
    "1x1": functools.partial(small, 1, 1),
    "1x9": functools.partial(small, 1, 9),
    "9x1": functools.partial(small, 9, 1),
    "3x65": functools.partial(small, 3, 65),
}


def render(color, disparity, device, strength_px=6.0, focus=0.0, **options):
    lens = dofsim.Lens.from_disparity(strength_px=strength_px, focus=focus)
    return dofsim.render(color, disparity, lens, depth_kind="disparity", device=device, **options)


def assert_agree(on_gpu, on_cpu, method):
    """Assert that two pictures are the same to a share of their range."""
    assert on_gpu.shape == on_cpu.shape
    assert on_gpu.dtype == on_cpu.dtype
    assert np.isfinite(on_gpu).all()
    apart = np.abs(on_gpu.astype(np.float64) - on_cpu) / (float(np.ptp(on_cpu)) or 1.0)
    assert apart.max() <= (LENS_AGREEMENT if method == "lens" else AGREEMENT)
    if method == "lens" and apart.any():
        assert -10.0 * np.log10(np.mean(apart**2)) >= LENS_PSNR


def test_every_method_is_tested_here():
    from dofsim._dofsim import methods_available

    assert sorted(CASES) == sorted(methods_available())


@pytest.mark.parametrize(("method", "options"), flatten(CASES))
@pytest.mark.parametrize("name", SCENES)
def test_gpu_and_cpu_agree(gpu, name, method, options):
    scene = SCENES[name]()
    on_cpu = render(*scene, "cpu", method=method, **options)
    assert_agree(render(*scene, gpu, method=method, **options), on_cpu, method)


# What lenses do beyond a thin one, and what makes the same of each method's picture on both devices.
FLAWS = {
    "tilt": {"tilt": (10.0, -20.0)},
    "field_curvature": {"field_curvature": 0.3},
    "axial_color": {"axial_color": (0.03, 0.0, -0.02)},
    "lateral_color": {"lateral_color": (0.01, 0.0, -0.02)},
    "breathing": {"sensor_mm": 36.0, "breathing_focal_length_mm": 50.0},
    "natural": {"vignetting": "natural"},
    "principal_point": {"principal_point": (0.1, -0.2), "vignetting": "natural", "tilt": (5.0, 5.0)},
    "all": {
        "tilt": (5.0, 10.0),
        "axial_color": (-0.02, 0.0, 0.04),
        "lateral_color": (0.004, 0.0, -0.003),
        "vignetting": "natural",
    },
}
# And those that only the flagship honours.
CLIPPED = {
    "cat_eye": {"cat_eye": 0.7},
    "optical": {"cat_eye": 1.0, "vignetting": "optical"},
    "full": {"cat_eye": 0.5, "vignetting": "full", "tilt": (8.0, 0.0)},
}


def metric_scene(channels=3):
    """Surfaces of several depths with edges and slopes between them, and lamps."""
    depth = np.full((HEIGHT, WIDTH), 6.0, np.float32)
    depth[40:, 90:] = 3.0
    depth[20:50, 30:80] = np.linspace(1.5, 2.5, 50, dtype=np.float32)
    depth[:6, :] = np.inf
    color = random_color(channels)
    color[::13, ::17] = 40.0
    if channels == 4:
        color[..., 3] = random_color(1)[..., 0]
        color[..., :3] *= color[..., 3:]
    return color, depth


def through(flaw, device, method, channels=3, **options):
    lens = dofsim.Lens(aperture_radius=0.08, focus_distance=3.0, fov=40.0, **flaw)
    return dofsim.render(*metric_scene(channels), lens, device=device, method=method, **options)


@pytest.mark.parametrize("flaw", FLAWS)
@pytest.mark.parametrize("method", CASES)
def test_gpu_and_cpu_agree_on_lenses(gpu, method, flaw):
    on_gpu, on_cpu = (through(FLAWS[flaw], device, method) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, method)


@pytest.mark.parametrize("flaw", CLIPPED)
@pytest.mark.parametrize("aperture", [None, OPENINGS[1]], ids=["disc", "blades"])
def test_gpu_and_cpu_agree_on_barrels(gpu, flaw, aperture):
    on_gpu, on_cpu = (through(CLIPPED[flaw], d, "lens", aperture=aperture) for d in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "lens")


@pytest.mark.parametrize("flaw", ["axial_color", "all"])
@pytest.mark.parametrize("method", CASES)
def test_gpu_and_cpu_agree_on_colors_with_coverage(gpu, method, flaw):
    on_gpu, on_cpu = (through(FLAWS[flaw], device, method, channels=4) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, method)


@pytest.mark.parametrize("name", ["surfaces", "noise", "lamps"])
@pytest.mark.parametrize("spherical", [0.6, -0.6])
def test_gpu_and_cpu_agree_on_aberrated_openings(gpu, name, spherical):
    scene, aperture = SCENES[name](), dofsim.Aperture(spherical=spherical)
    on_gpu, on_cpu = (render(*scene, device, aperture=aperture) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "lens")


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
    color, disparity = surfaces()
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
    scene = surfaces()
    on_gpu, on_cpu = (render(*scene, d, strength_px=strength_px, views=views) for d in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "lens")


def test_highlights_by_the_thousand_are_all_drawn(gpu):
    """Where the front layer is empty, all that is behind it outshines it."""
    color, disparity = layers("whole")
    color[0, 8:] = 0.0
    on_gpu, on_cpu = (render(color, disparity, device, strength_px=3.0) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "lens")


@pytest.mark.parametrize("method", CASES)
def test_passes_are_timed(gpu, method):
    color, disparity = surfaces()
    scene = dofsim.Scene(color, disparity, depth_kind="disparity", device=gpu)
    lens = dofsim.Lens.from_disparity(strength_px=6.0, focus=0.0)
    passes = dict(scene.profile(lens, method=method))
    several = {
        "lens": "lens/sweep",
        "gaussian": "gaussian/blur_x",
        "levels": "levels/filter",
        "hexagonal": "hexagonal/shade",
        "sprites": "sprites/draw",
    }
    assert passes[several.get(method, method)] > 0.0
    assert all(milliseconds >= 0.0 for milliseconds in passes.values())


def test_the_cpu_has_no_passes():
    color, disparity = surfaces()
    scene = dofsim.Scene(color, disparity, depth_kind="disparity", device="cpu")
    with pytest.raises(dofsim.DeviceError, match="profile: there are no times to show"):
        scene.profile(dofsim.Lens.from_disparity(strength_px=6.0, focus=0.0))


def test_devices_are_described(gpu):
    for number, device in enumerate(dofsim.devices()):
        assert device.id == f"gpu:{number}"
        assert device.kind in {"discrete", "integrated", "virtual", "software", "other"}
        assert device.backend in {"vulkan", "metal", "dx12"}
        assert device.max_buffer_bytes >= device.max_binding_bytes >= 1 << 27
        assert device.name in repr(device)


def test_devices_go_by_number_and_by_name(gpu):
    scene = surfaces()
    expected = render(*scene, "gpu:0", method="taps")
    name = dofsim.devices()[0].name
    np.testing.assert_array_equal(render(*scene, name, method="taps"), expected)
    np.testing.assert_array_equal(render(*scene, name.upper(), method="taps"), expected)


@pytest.mark.parametrize("device", ["tpu", "gpu:x", "gpu:-1", ""])
def test_what_is_no_device_is_named(device):
    with pytest.raises(ValueError, match=f"device must be .*got {re.escape(repr(device))}".replace("'", '"')):
        render(*surfaces(), device)


def test_a_number_that_is_no_adapter_is_named():
    with pytest.raises(dofsim.DeviceError, match='there is no "gpu:99"; there is'):
        render(*surfaces(), "gpu:99")


def test_a_software_rasteriser_is_not_chosen_by_itself(monkeypatch):
    monkeypatch.delenv("DOFSIM_DEVICE", raising=False)
    scene = surfaces()
    if all(device.kind == "software" for device in dofsim.devices()):
        with pytest.raises(dofsim.DeviceError, match='device="gpu": no GPU was found'):
            render(*scene, "gpu", method="taps")
        np.testing.assert_array_equal(
            render(*scene, "auto", method="taps"), render(*scene, "cpu", method="taps")
        )
    else:
        assert_agree(render(*scene, "gpu", method="taps"), render(*scene, "cpu", method="taps"), "taps")


def test_the_environment_chooses(gpu, monkeypatch):
    scene = surfaces()
    monkeypatch.setenv("DOFSIM_DEVICE", "gpu:0")
    expected = render(*scene, "gpu:0", method="taps")
    np.testing.assert_array_equal(render(*scene, "gpu", method="taps"), expected)
    np.testing.assert_array_equal(render(*scene, "auto", method="taps"), expected)
    monkeypatch.setenv("DOFSIM_DEVICE", "gpu:99")
    with pytest.raises(dofsim.DeviceError, match='environment variable DOFSIM_DEVICE: there is no "gpu:99"'):
        render(*scene, "auto", method="taps")
    monkeypatch.setenv("DOFSIM_DEVICE", "cpu")
    with pytest.raises(dofsim.DeviceError, match='the environment variable DOFSIM_DEVICE is "cpu"'):
        render(*scene, "gpu", method="taps")
    np.testing.assert_array_equal(render(*scene, "auto", method="taps"), render(*scene, "cpu", method="taps"))


def test_the_command_lists_devices(gpu, capsys):
    assert run(["devices"]) == 0
    out = capsys.readouterr().out
    for device in dofsim.devices():
        assert f"{device.id}  {device.name}" in out
