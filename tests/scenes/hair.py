"""Wires about a pixel wide: a tangle close to the lens, one in focus, and one far behind."""

from typing import Any

import numpy as np

from .shapes import bitmap, floor, glow, sphere, tubes, wall
from .textures import blend, checks, noise, scattered, wave, weathered

PIECES = 12

# (wires, depth from, depth to, radius in metres, half the spread across, half the bend)
TANGLES = [
    (46, 1.40, 1.75, 0.0011, 0.55, 0.10),
    (22, 3.80, 4.30, 0.0030, 1.40, 0.25),
    (16, 7.0, 9.0, 0.007, 3.0, 0.6),
]


def shapes() -> dict[str, Any]:
    rng = np.random.default_rng(23)
    looks = [
        glow(weathered(blend(noise(256, 32, seed, (1.0, 12.0)), dark, light), seed + 50))
        for seed, dark, light in [
            (1, (0.05, 0.03, 0.02), (0.30, 0.18, 0.10)),
            (2, (0.60, 0.42, 0.18), (1.00, 0.85, 0.50)),
            (3, (0.35, 0.05, 0.03), (0.80, 0.25, 0.12)),
        ]
    ]
    cloth = weathered(
        blend(wave(1024, 1024, 17, 29), (0.10, 0.24, 0.35), (0.75, 0.78, 0.70))
        * (0.3 + 0.7 * checks(1024, 1024, 5, 7))[..., None],
        31,
    )
    ground = weathered(blend(checks(1024, 1024, 6, 6), (0.45, 0.40, 0.36), (0.85, 0.80, 0.70)), 35)
    scene: dict[str, Any] = {
        "floor": floor(-0.75, 8.0, 1.5, 11.5, glow(bitmap(ground, (4.0, 3.0)))),
        "wall": wall(11.0, 8.0, 4.8, glow(cloth)),
        "head": sphere(-0.15, -0.10, 4.05, 0.42, glow(scattered(256, 37)), turn=15.0),
        "far": sphere(1.60, 0.30, 7.50, 0.60, glow(scattered(256, 43)), turn=120.0),
        "near": sphere(0.50, -0.42, 1.95, 0.16, glow(scattered(256, 47)), turn=60.0),
    }
    for tangle, (wires, z_near, z_far, radius, spread, bend) in enumerate(TANGLES):
        paths = []
        for _ in range(wires):
            # A cubic from below the picture to above it.
            across = rng.uniform(-spread, spread) + np.array([0.0, *rng.uniform(-bend, bend, 3)])
            z = rng.uniform(z_near, z_far, 4)
            t = np.linspace(0.0, 1.0, PIECES + 1)[:, None]
            weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
            up = 0.5 * z_far * (2.0 * t[:, 0] - 1.0)
            paths.append(np.stack([weights @ across, up, weights @ z], axis=-1))
        for kind, look in enumerate(looks):
            scene[f"wires{tangle}_{kind}"] = tubes(paths[kind :: len(looks)], radius, look)
    return scene
