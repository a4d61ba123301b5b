"""Sprites on a GPU, which adds them up in tiles: of any radius, in frames of any size."""

import numpy as np
import pytest
from both_devices import assert_agree, noise, random_color, render, small


def ramp(height, width, bright=0.0):
    """Make a slope from before the focus to behind it, with lamps on it."""
    color = random_color(size=(height, width))
    color[::31, ::37] += bright
    disparity = np.linspace(-1.0, 1.0, height * width, dtype=np.float32).reshape(height, width)
    return color, disparity


def scattered(height, width):
    """Make a plane in focus, and bright points far before it and behind it."""
    rng = np.random.default_rng(3)
    is_drawn = rng.random((height, width)) < 0.01
    disparity = np.where(is_drawn, rng.uniform(-1.0, 1.0, (height, width)), 0.0).astype(np.float32)
    color = random_color(size=(height, width))
    color[is_drawn] *= 20.0
    return color, disparity


WIDE = {
    "slope": ramp(61, 83),
    "lamps": ramp(83, 61, bright=100.0),
    "scattered": scattered(301, 407),
    "one pixel": small(1, 1),
}


@pytest.mark.parametrize("radius_px", [33.0, 90.0])
@pytest.mark.parametrize("name", WIDE)
def test_wide_sprites_agree_with_the_cpu(gpu, name, radius_px):
    options = {"strength_px": radius_px, "max_coc_px": 100.0, "method": "sprites"}
    on_gpu, on_cpu = (render(*WIDE[name], device, **options) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "sprites")


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_widest_sprites_agree_with_the_cpu(gpu, side):
    """More points cover a pixel than a software rasteriser's loops have turns."""
    color, disparity = random_color(size=(21, 30)), np.full((21, 30), side, np.float32)
    # Of another sprite.
    disparity[:, 15:] *= 0.999
    options = {"strength_px": 256.0, "max_coc_px": 256.0, "method": "sprites"}
    on_gpu, on_cpu = (render(color, disparity, device, **options) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "sprites")


@pytest.mark.parametrize("size", [(3, 16400), (16400, 3), (2, 32768), (32768, 2)])
def test_frames_are_of_any_length(gpu, size):
    on_gpu, on_cpu = (render(*small(*size), device, method="sprites") for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "sprites")


def test_a_lamp_does_not_drown_what_is_beside_it(gpu):
    """What shows past something in front is as it was, however bright the row is before it."""
    rng = np.random.default_rng(9)
    color = rng.random((40, 900, 3), dtype=np.float32)
    disparity = np.where(rng.random((40, 900)) < 0.3, 0.5, 0.0).astype(np.float32)
    color[:, 5:40] = 1e5
    part = np.s_[:, 300:]
    on_gpu, on_cpu = (render(color, disparity, device, method="sprites")[part] for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "sprites")


@pytest.mark.parametrize(("scene", "radius_px"), [(noise(), 6.0), (ramp(83, 61, bright=100.0), 60.0)])
def test_every_run_gives_the_same_bits(gpu, restricted, scene, radius_px):
    """In devices that are opened anew, too, whose memory holds other values."""
    options = {"strength_px": radius_px, "method": "sprites"}
    first = render(*scene, gpu, **options)
    for _ in range(2):
        np.testing.assert_array_equal(render(*scene, gpu, **options), first)
        render(*scene, gpu, strength_px=radius_px / 2, method="sprites")
        np.testing.assert_array_equal(render(*scene, gpu, **options), first)
        restricted()
