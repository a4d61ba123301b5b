"""Small lamps far brighter than white at dusk, before and behind the focus plane, some half hidden."""

from typing import Any

import numpy as np

from .shapes import X_RIGHT, Shape, bitmap, box, floor, glow, rod, sphere, wall
from .textures import blend, checks, noise, scattered, wave, weathered

LAMPS = 44
COLORS = [(1.0, 0.78, 0.45), (1.0, 0.35, 0.15), (0.55, 0.80, 1.0), (0.45, 1.0, 0.55), (1.0, 0.95, 0.9)]

# Lamps given as (right, up, z): just beside what stands before them, and close to the lens.
BEHIND_EDGES = [(-1.55, 1.10, 12.0), (-1.35, 0.20, 11.0), (3.35, 1.20, 12.0), (2.00, -0.10, 7.0)]
NEAR = [(0.16, -0.24, 1.60), (-0.46, 0.30, 1.75), (0.30, 0.05, 1.90)]


def shapes() -> dict[str, Any]:
    facade = 0.10 * weathered(blend(checks(1024, 1024, 18, 12), (0.15, 0.18, 0.30), (0.75, 0.60, 0.45)), 3)
    road = 0.12 * weathered(blend(wave(1024, 1024, 7, 3), (0.20, 0.20, 0.24), (0.70, 0.60, 0.50)), 7)
    bark = 0.10 * weathered(
        blend(noise(512, 128, 9, (3.0, 40.0)), (0.20, 0.12, 0.08), (0.90, 0.70, 0.45)), 11
    )
    cloth = 0.30 * scattered(256, 13)
    scene: dict[str, Any] = {
        "road": floor(-0.50, 9.0, 1.0, 16.5, glow(bitmap(road, (5.0, 4.0)))),
        "facade": wall(16.0, 9.0, 6.8, glow(facade)),
        "trunk": rod((-0.30, -0.6, 2.0), (-0.22, 0.8, 2.1), 0.035, glow(bark)),
        "branch": rod((-0.26, 0.12, 2.05), (0.20, 0.46, 1.9), 0.010, glow(bark)),
        "post": rod((0.44, -0.6, 1.60), (0.47, 0.6, 1.65), 0.013, glow(bark)),
        "bench": box(0.36, -0.36, 3.95, (0.30, 0.12, 0.10), glow(cloth), turn=18.0),
        "walker": sphere(-0.72, -0.12, 4.10, 0.24, glow(cloth), turn=40.0),
        "kiosk": box(-1.50, -0.10, 7.50, (0.45, 0.42, 0.40), glow(cloth), turn=-25.0),
        "dome": sphere(1.70, 0.00, 9.00, 0.60, glow(cloth), turn=70.0),
    }
    return scene


def lamp(
    right: float, up: float, z: float, diameter_px: float, radiance: float, color: tuple[float, float, float]
) -> Shape:
    """Make a lamp; its apparent size is that at a width of 512 pixels, where one pixel is z / 667 metres."""
    return {
        "type": "sphere",
        "center": [X_RIGHT * right, up, z],
        "radius": 0.5 * diameter_px * z / 667.0,
        **glow(tuple(radiance * c for c in color)),
    }


def lamps() -> dict[str, Any]:
    rng = np.random.default_rng(5)
    scene: dict[str, Any] = {}

    def add_lamp(name: str, right: float, up: float, z: float, diameter_px: float, radiance: float) -> None:
        color = COLORS[rng.integers(len(COLORS))]
        scene[name] = lamp(right, up, z, diameter_px, radiance, color)

    depths = np.concatenate([rng.uniform(5.0, 15.5, 30), rng.uniform(2.2, 3.6, 8), rng.uniform(3.9, 4.1, 6)])
    for i in range(LAMPS):
        z = depths[i]
        right = z * rng.uniform(-0.36, 0.36)
        up = max(z * rng.uniform(-0.24, 0.26), -0.47)
        add_lamp(f"lamp{i}", right, up, z, rng.uniform(1.0, 6.0), rng.uniform(20.0, 80.0))
    for i, (right, up, z) in enumerate(BEHIND_EDGES):
        add_lamp(f"cut{i}", right, up, z, rng.uniform(2.0, 6.0), rng.uniform(20.0, 80.0))
    for i, (right, up, z) in enumerate(NEAR):
        add_lamp(f"near{i}", right, up, z, 2.0 + 1.5 * i, 20.0 + 25.0 * i)
    return scene
