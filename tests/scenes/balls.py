"""A few balls well apart over a tiled floor: an easier scene than `spheres`, with less hidden behind less."""

from typing import Any

from .shapes import bitmap, floor, glow, sphere, wall
from .textures import blend, checks, noise, wave, weathered

# (right, up, z, radius, kind of texture)
BALLS = [
    (-0.42, -0.22, 1.90, 0.16, 0),
    (0.55, -0.20, 2.60, 0.22, 1),
    (-0.62, -0.14, 3.90, 0.32, 2),
    (0.35, -0.10, 4.60, 0.36, 0),
    (-0.60, 0.60, 6.50, 0.50, 1),
    (1.60, 0.20, 8.50, 0.60, 2),
]


def shapes() -> dict[str, Any]:
    balls = [
        weathered(blend(checks(256, 512, 8, 5), (0.75, 0.12, 0.08), (0.95, 0.85, 0.60)), 12),
        weathered(blend(wave(256, 512, 10, 4), (0.05, 0.20, 0.55), (0.70, 0.90, 0.95)), 22),
        weathered(blend(wave(256, 512, 0, 7), (0.10, 0.35, 0.10), (0.95, 0.90, 0.30)), 42),
    ]
    tiles = weathered(blend(checks(1024, 1024, 8, 8), (0.16, 0.13, 0.11), (0.70, 0.66, 0.58)), 52)
    plaster = weathered(
        blend(wave(1024, 1024, 9, 3, 2.0), (0.85, 0.80, 0.70), (0.45, 0.40, 0.38))
        * (0.4 + 0.6 * noise(1024, 1024, 67, (1.0, 8.0)))[..., None],
        65,
    )
    scene: dict[str, Any] = {
        f"ball{i}": sphere(right, up, z, radius, glow(balls[kind]), turn=41.0 * i)
        for i, (right, up, z, radius, kind) in enumerate(BALLS)
    }
    scene["floor"] = floor(-0.46, 7.5, 0.5, 12.5, glow(bitmap(tiles, (5.0, 4.0))))
    scene["wall"] = wall(12.0, 7.5, 5.6, glow(plaster))
    return scene
