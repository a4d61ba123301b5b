"""The GPU path computes what the CPU path computes: channels that a guide leads."""

import dofsim
import numpy as np
import pytest
from both_devices import (
    CLIPPED,
    FLAWS,
    HEIGHT,
    LENS_AGREEMENT,
    OPENINGS,
    SCENES,
    WIDTH,
    assert_agree,
    metric_scene,
    random_color,
)
from dofsim._dofsim import device_traffic
from test_channels_in_layers import BRIGHT, SIZE, fog_before_a_ball_before_a_wall
from test_channels_in_layers import led as led_in_layers
from test_channels_in_layers import lens as relative_lens
from test_device_bands import tall
from test_holdouts import DEVICE_CASES, PICTURES

# Nine channels are three groups of light and data, and one of weights where some have none.
KINDS = ["light"] * 5 + ["matte"] + ["data"] + ["normal"] * 3


def channels_of(shape, guide):
    """Make a channel for each of the kinds; the light of one is the guide's."""
    values = np.random.default_rng(11).random((*shape, len(KINDS)), dtype=np.float32)
    values[..., 0] *= guide if guide.ndim == len(shape) else guide[..., 0]
    values[..., 3] -= 0.5
    values[..., -3:] -= 0.3
    return values


def assert_all_agree(on_gpu, on_cpu):
    """Assert that every channel is the same to a share of its range, and that as many data are unknown."""
    assert on_gpu.shape == on_cpu.shape
    known = np.isfinite(on_cpu)
    np.testing.assert_array_equal(np.isfinite(on_gpu), known)
    on_gpu, on_cpu = (np.where(known, one, 0) for one in (on_gpu, on_cpu))
    for c in range(on_cpu.shape[-1]):
        assert_agree(on_gpu[..., c], on_cpu[..., c], "lens")


def both(gpu, channels, depth, lens, **options):
    return [dofsim.render(channels, depth, lens, device=device, **options) for device in (gpu, "cpu")]


@pytest.mark.parametrize("strength_px", [0.4, 6.0, 25.0])
@pytest.mark.parametrize("name", SCENES)
def test_gpu_and_cpu_agree_on_channels(gpu, name, strength_px):
    guide, disparity = SCENES[name]()
    channels = channels_of(disparity.shape, guide)
    # Wide blur is at full resolution on a GPU, and slow on a software rasteriser.
    options = {"depth_kind": "disparity", "guide": guide, "kinds": KINDS, "resolution": "full"}
    options |= {"views": 64} if strength_px > 10 else {}
    lens = dofsim.Lens.from_disparity(strength_px=strength_px, focus=0.0)
    assert_all_agree(*both(gpu, channels, disparity, lens, **options))


@pytest.mark.parametrize("name", BRIGHT)
def test_gpu_and_cpu_agree_on_channels_in_layers(gpu, name):
    layers, depth = BRIGHT[name]
    channels = channels_of(depth.shape, layers)
    on_gpu, on_cpu = (led_in_layers(channels, depth, layers, kinds=KINDS, device=d) for d in (gpu, "cpu"))
    assert_all_agree(on_gpu, on_cpu)


def test_layers_in_focus_are_composed_alike(gpu):
    """What passes a layer is the guide's own, whatever the number of channels."""
    layers = np.stack([random_color(4), random_color(3).repeat(2, axis=-1)[..., :4]])
    layers[1, ..., 3] = 1.0
    layers[0, ..., :3] *= layers[0, ..., 3:]
    depth = np.zeros((2, HEIGHT, WIDTH), np.float32)
    depth[1, :, 120:] = -1.0
    channels = channels_of(depth.shape, layers)
    on_gpu, on_cpu = (led_in_layers(channels, depth, layers, kinds=KINDS, device=d) for d in (gpu, "cpu"))
    assert_all_agree(on_gpu, on_cpu)


@pytest.mark.parametrize("holdout", DEVICE_CASES)
@pytest.mark.parametrize("picture", PICTURES)
def test_gpu_and_cpu_agree_on_channels_past_holdouts(gpu, picture, holdout):
    color, depth = picture(lamps=5)
    channels = channels_of(depth.shape, color)
    options = {"guide": color, "kinds": KINDS, "holdout": DEVICE_CASES[holdout], "depth_kind": "disparity"}
    assert_all_agree(*both(gpu, channels, np.float32(depth), relative_lens(), **options))


@pytest.mark.parametrize("flaw", ["tilt", "field_curvature", "breathing", "natural", *CLIPPED])
def test_gpu_and_cpu_agree_on_channels_through_lenses(gpu, flaw):
    lens = dofsim.Lens(aperture_radius=0.08, focus_distance=3.0, fov=40.0, **(FLAWS | CLIPPED)[flaw])
    guide, depth = metric_scene(4)
    channels = channels_of(depth.shape, guide)
    # Data of which some are not known have weights of their own.
    channels[:9, :, 6] = np.inf
    assert_all_agree(*both(gpu, channels, depth, lens, guide=guide, kinds=KINDS, aperture=OPENINGS[1]))


@pytest.mark.parametrize("kinds", ["light", "matte", "data"])
@pytest.mark.parametrize("count", [1, 4])
def test_gpu_and_cpu_agree_on_channels_that_lead_themselves(gpu, count, kinds):
    _, depth = metric_scene()
    lens = dofsim.Lens(aperture_radius=0.08, focus_distance=3.0, fov=40.0)
    options = {"kinds": kinds, "alpha": "none", "overscan": 3}
    assert_all_agree(*both(gpu, random_color(count), depth, lens, **options))


def test_sharpening_is_what_the_guide_allows(gpu):
    """Light is sharpened as far as the guide's own light allows, and data never."""
    rng = np.random.default_rng(3)
    texture = (0.1 + 0.9 * (rng.random((*SIZE, 1)) < 0.4)).astype(np.float32)
    channels = rng.random((3, *SIZE, 2), dtype=np.float32)
    rendered = []
    for wall in (texture, np.ones_like(texture)):
        layers, depth = fog_before_a_ball_before_a_wall(wall.repeat(3, axis=-1))
        # Lens points are dense enough to sharpen.
        options = {"kinds": ["light", "data"], "through": relative_lens(1.0)}
        on_gpu, on_cpu = (led_in_layers(channels, depth, layers, device=d, **options) for d in (gpu, "cpu"))
        assert_all_agree(on_gpu, on_cpu)
        rendered.append(on_gpu)
    apart = np.abs(rendered[0] - rendered[1])
    assert apart[..., 0].max() > 10 * LENS_AGREEMENT
    assert apart[..., 1].max() == 0


@pytest.mark.parametrize("flaw", ["thin", "breathing", "full"])
def test_channels_in_bands_are_the_same(gpu, restricted, flaw):
    """No bit differs at the seams, or anywhere else."""
    guide, depth = tall()
    channels = channels_of(depth.shape, guide)
    words = {"thin": {}, **FLAWS, **CLIPPED}[flaw]
    lens = dofsim.Lens(aperture_radius=0.15, focus_distance=3.0, fov=40.0, **words)
    options = {"guide": guide, "kinds": KINDS, "views": 16, "supersample": 2, "device": gpu}
    whole = dofsim.render(channels, depth, lens, **options)
    restricted(max_binding_bytes=700_000)
    np.testing.assert_array_equal(dofsim.render(channels, depth, lens, **options), whole)


def test_layers_past_holdouts_in_bands_are_the_same(gpu, restricted):
    guide, depth = tall(1600)
    alpha = np.ones_like(depth)
    layers = np.stack([np.dstack([0.3 * guide, 0.3 * alpha]), np.dstack([guide, alpha])])
    depths = np.stack([np.full_like(depth, 1.4), depth])
    holdout = np.float32(np.hypot(*np.mgrid[-800:800, -20:20]) < 500), np.full_like(depth, 2.0)
    channels = channels_of(depths.shape, layers)
    lens = dofsim.Lens(aperture_radius=0.15, focus_distance=3.0, fov=40.0)
    options = {"guide": layers, "kinds": KINDS, "views": 16, "holdout": holdout, "device": gpu}
    whole = dofsim.render(channels, depths, lens, **options)
    restricted(max_binding_bytes=2_600_000)
    np.testing.assert_array_equal(dofsim.render(channels, depths, lens, **options), whole)


def test_many_lenses_of_one_scene(gpu):
    """Pictures of a scene are those of renders, and what does not depend on channels is uploaded once."""
    guide, depth = metric_scene(4)
    channels = channels_of(depth.shape, guide)
    options = {"guide": guide, "kinds": KINDS}
    lens = dofsim.Lens(aperture_radius=0.08, focus_distance=3.0, fov=40.0)
    scene = dofsim.Scene(channels, depth, device=gpu, **options)
    stack = scene.focal_stack(lens, [2.0, 3.0])
    np.testing.assert_array_equal(stack[1], dofsim.render(channels, depth, lens, device=gpu, **options))

    def uploaded(count):
        before = device_traffic()["uploaded_bytes"]
        words = {"guide": guide, "kinds": KINDS[:count], "device": gpu}
        dofsim.render(np.ascontiguousarray(channels[..., :count]), depth, lens, **words)
        return device_traffic()["uploaded_bytes"] - before

    # Channels of the same group: nothing but their planes.
    assert uploaded(4) - uploaded(1) < 3 * 4 * depth.size + 4096


def test_ids_are_the_same_on_both_devices(gpu):
    guide, depth = metric_scene(4)
    ids = np.stack([np.where(depth < 2.8, 1.5, 2.5), guide[..., 3]], axis=-1)
    ids = np.concatenate([ids, np.zeros_like(ids)], axis=-1).astype(np.float32)
    lens = dofsim.Lens(aperture_radius=0.08, focus_distance=3.0, fov=40.0)
    on_gpu, on_cpu = (dofsim.render_ids(ids, depth, lens, guide=guide, device=d) for d in (gpu, "cpu"))
    for name in (1.5, 2.5):
        covered = [np.where(one[..., 0::2] == name, one[..., 1::2], 0).sum(-1) for one in (on_gpu, on_cpu)]
        assert np.abs(covered[0] - covered[1]).max() <= LENS_AGREEMENT


def test_lenses_that_no_gpu_traces_are_refused_by_name(gpu):
    _, depth = metric_scene()
    lens = dofsim.Lens(aperture_radius=0.08, focus_distance=3.0, fov=40.0, coma=0.1)
    with pytest.raises(ValueError, match='device must be "cpu" or "auto" for a lens with coma'):
        dofsim.render(random_color(1), depth, lens, kinds="light", device=gpu)
