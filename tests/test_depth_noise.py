"""Noise of depth is no geometry: surfaces stay whole, lamps keep their light, and a still stays still."""

from importlib.resources import files

import dofsim
import numpy as np
import pytest
from dofsim.io import read_rgbd
from dofsim.metrics import srgb


def flicker(method):
    """Measure how a still of the built-in picture changes under noise of 2/255 of its disparities."""
    color, depth = read_rgbd(files("dofsim") / "data/demo.exr")
    disparity = 1 / depth
    rng = np.random.default_rng(8)
    deviation = 2 / 255 * (disparity.max() - disparity.min())
    lens = dofsim.Lens(aperture_radius=0.018, focus_distance=0.55, fov=40.0)
    noisy = [1 / np.maximum(disparity + rng.normal(0, deviation, depth.shape), 1e-3) for _ in range(4)]
    frames = [dofsim.render(color, z.astype(np.float32), lens, method=method) for z in noisy]
    return np.std([srgb(frame) for frame in frames], axis=0).mean()


def test_a_still_flickers_no_more_than_with_sprites():
    assert flicker("lens") < flicker("sprites")


@pytest.mark.parametrize("shape", ["wall", "slope", "bowl"])
def test_a_textured_surface_flickers_no_more_than_with_sprites(shape):
    rng = np.random.default_rng(3)
    color = (0.1 + 0.8 * rng.random((40, 60, 3))).repeat(2, 0).repeat(2, 1).astype(np.float32)
    y, x = np.mgrid[:80, :120] / np.array([80, 120])[:, None, None]
    exact = {
        "wall": 0.5 + 0 * x,
        "slope": 0.4 + 0.15 * x,
        "bowl": 0.4 + 0.03 * np.sin(3 * x) * np.sin(3 * y),
    }[shape]
    lens = dofsim.Lens.from_disparity(strength_px=25, focus=0.8)
    noisy = [np.float32(exact + rng.normal(0, 0.01, exact.shape)) for _ in range(4)]

    def changes(method):
        frames = [srgb(dofsim.render(color, d, lens, method=method, depth_kind="disparity")) for d in noisy]
        return np.std(frames, axis=0)[12:-12, 12:-12].mean()

    assert changes("lens") < changes("sprites")


@pytest.mark.parametrize("deviation", [0.005, 0.01, 0.02])
def test_a_lamp_on_a_noisy_wall_keeps_its_light(deviation):
    rng = np.random.default_rng(5)
    lens = dofsim.Lens.from_disparity(strength_px=70, focus=0.6)
    for _ in range(4):
        wall = np.full((100, 100, 3), 0.02, np.float32)
        lamp = wall.copy()
        lamp[50, 50] = 250
        depth = (0.3 + 0.5 * deviation * rng.standard_normal((100, 100))).astype(np.float32)
        with_lamp, without = (dofsim.render(c, depth, lens, depth_kind="disparity") for c in (lamp, wall))
        light = (with_lamp - without)[..., 0].sum(dtype=float) / 249.98
        assert light == pytest.approx(1.0, abs=0.05)
