"""Bars a few pixels wide, close to the lens, before a patterned middle distance and background."""

from typing import Any

import numpy as np

from .shapes import bitmap, box, floor, glow, rod, sphere, wall
from .textures import blend, checks, noise, scattered, wave, weathered


def shapes() -> dict[str, Any]:
    rng = np.random.default_rng(7)
    rust = weathered(blend(noise(512, 64, 1, (2.0, 24.0)), (0.08, 0.05, 0.05), (0.55, 0.25, 0.10)), 3)
    steel = weathered(blend(wave(512, 64, 0, 24), (0.10, 0.12, 0.16), (0.65, 0.70, 0.75)), 5)
    bricks = weathered(blend(checks(1024, 1024, 14, 22), (0.45, 0.16, 0.10), (0.80, 0.62, 0.45)), 9)
    crates = weathered(blend(wave(256, 256, 3, 5), (0.35, 0.22, 0.08), (0.85, 0.65, 0.30)), 13)
    grass = weathered(blend(noise(1024, 1024, 15, (4.0, 200.0)), (0.04, 0.14, 0.03), (0.45, 0.65, 0.15)), 17)

    scene: dict[str, Any] = {
        "floor": floor(-0.55, 8.0, 0.8, 13.5, glow(bitmap(grass, (4.0, 3.0)))),
        "wall": wall(13.0, 8.0, 5.5, glow(bricks)),
        "crate_left": box(-0.70, -0.28, 4.00, (0.26, 0.26, 0.26), glow(crates), turn=25.0),
        "crate_right": box(0.95, -0.20, 4.90, (0.34, 0.34, 0.34), glow(crates), turn=-32.0),
        "crate_far": box(0.10, -0.10, 7.50, (0.45, 0.45, 0.45), glow(crates), turn=10.0),
        "ball": sphere(0.16, -0.05, 3.90, 0.30, glow(scattered(256, 19)), turn=20.0),
        "balloon": sphere(-1.60, 0.95, 8.00, 0.50, glow(scattered(256, 29)), turn=80.0),
    }
    # Uprights lean and stand unevenly so that no pixel column or lens row is special.
    for i, right in enumerate(np.linspace(-0.62, 0.62, 15)):
        lean, shift, z = rng.uniform(-0.03, 0.03), rng.uniform(-0.015, 0.015), rng.uniform(1.38, 1.50)
        foot, head = (right + shift - lean, -0.6, z), (right + shift + lean, 0.6, z + 0.04)
        scene[f"upright{i}"] = rod(foot, head, 0.0045 + 0.0025 * rng.random(), glow(rust))
    for i, up in enumerate((-0.24, 0.27)):
        scene[f"rail{i}"] = rod((-0.8, up, 1.52), (0.8, up + 0.05, 1.48), 0.008, glow(steel))
    # A second, coarser fence between the near one and the plane in focus.
    for i, right in enumerate(np.linspace(-1.0, 1.0, 6)):
        scene[f"post{i}"] = rod((right, -0.6, 2.5), (right + 0.08, 1.2, 2.6), 0.011, glow(steel))
    return scene
