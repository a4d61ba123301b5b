"""Balls at many depths between a patterned floor and a patterned wall."""

from typing import Any

from .shapes import bitmap, floor, glow, sphere, wall
from .textures import blend, checks, noise, scattered, wave, weathered

# (right, up, z, radius, kind of texture)
BALLS = [
    (-0.36, -0.20, 1.55, 0.14, 0),
    (0.52, 0.24, 1.80, 0.10, 1),
    (0.34, -0.26, 2.30, 0.18, 2),
    (-0.22, 0.20, 3.00, 0.16, 3),
    (-0.72, -0.12, 3.60, 0.32, 1),
    (0.12, -0.14, 4.10, 0.30, 0),
    (0.95, 0.05, 4.60, 0.34, 3),
    (-0.30, 0.10, 5.80, 0.40, 2),
    (0.75, 0.75, 7.20, 0.50, 0),
    (-1.90, 0.90, 8.50, 0.62, 2),
    (1.95, -0.05, 9.00, 0.50, 1),
]


def shapes() -> dict[str, Any]:
    balls = [
        weathered(blend(checks(256, 512, 10, 6), (0.75, 0.12, 0.08), (0.95, 0.85, 0.60)), 11),
        weathered(blend(wave(256, 512, 14, 5), (0.05, 0.20, 0.55), (0.70, 0.90, 0.95)), 21),
        scattered(256, 31),
        weathered(blend(wave(256, 512, 0, 9), (0.10, 0.35, 0.10), (0.95, 0.90, 0.30)), 41),
    ]
    tiles = weathered(blend(checks(1024, 1024, 8, 8), (0.16, 0.13, 0.11), (0.70, 0.66, 0.58)), 51)
    plaster = weathered(
        blend(wave(1024, 1024, 13, 4, 2.0), scattered(1024, 61), (0.75, 0.60, 0.45))
        * (0.4 + 0.6 * noise(1024, 1024, 66, (1.0, 8.0)))[..., None],
        64,
    )
    scene: dict[str, Any] = {
        f"ball{i}": sphere(right, up, z, radius, glow(balls[kind]), turn=37.0 * i)
        for i, (right, up, z, radius, kind) in enumerate(BALLS)
    }
    scene["floor"] = floor(-0.46, 7.5, 0.5, 12.5, glow(bitmap(tiles, (5.0, 4.0))))
    scene["wall"] = wall(12.0, 7.5, 5.6, glow(plaster))
    return scene
