"""The street of `lights`, every lamp in full view of the pinhole: what one layer can hold."""

from typing import Any

import numpy as np

from .lights import COLORS, lamp, shapes

__all__ = ["lamps", "shapes"]

LAMPS = 40
# What stands before the lamps, as the pinhole sees it: thick lines (from, to, half width) in x / z and
# y / z, with their least distance.
IN_THE_WAY = [
    ((-0.150, -0.30), (-0.105, 0.39), 0.018, 2.0),
    ((-0.127, 0.058), (0.105, 0.242), 0.006, 1.9),
    ((0.275, -0.38), (0.285, 0.37), 0.009, 1.6),
    ((0.015, -0.090), (0.167, -0.090), 0.035, 3.8),
    ((-0.176, -0.029), (-0.176, -0.029), 0.062, 3.8),
    ((-0.26, -0.013), (-0.14, -0.013), 0.06, 7.0),
    ((0.19, 0.0), (0.19, 0.0), 0.07, 8.4),
]
# Room around a lamp: two pixels of a picture 512 wide.
CLEAR = 2.0 / 667.0


def in_full_view(x: float, y: float, z: float, radius: float) -> bool:
    """Tell whether nothing stands between the pinhole and a lamp seen at (x, y) with this apparent radius."""
    point = np.array([x, y])
    for start, end, half_width, nearest in IN_THE_WAY:
        a, line = np.array(start), np.array(end) - np.array(start)
        along = np.clip((point - a) @ line / max(line @ line, 1e-12), 0.0, 1.0)
        if z > nearest and np.linalg.norm(point - a - along * line) < half_width + radius + CLEAR:
            return False
    return True


def lamps() -> dict[str, Any]:
    rng = np.random.default_rng(17)
    scene: dict[str, Any] = {}
    while len(scene) < LAMPS:
        # Two in three behind the focus plane, the others in front.
        z = rng.uniform(5.0, 15.5) if len(scene) % 3 else rng.uniform(2.2, 3.6)
        x, y = rng.uniform(-0.36, 0.36), max(rng.uniform(-0.24, 0.26), -0.47 / z)
        diameter_px = rng.uniform(1.0, 6.0)
        if in_full_view(x, y, z, 0.5 * diameter_px / 667.0):
            color = COLORS[rng.integers(len(COLORS))]
            scene[f"lamp{len(scene)}"] = lamp(x * z, y * z, z, diameter_px, rng.uniform(20.0, 80.0), color)
    return scene
