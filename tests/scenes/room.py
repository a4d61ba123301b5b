"""Matt furniture in a room lit by two lamps in the ceiling: soft shadows, bounced light, path traced."""

from typing import Any

import mitsuba as mi
import numpy as np

from .shapes import bitmap, box, floor, paint, rod, side, sphere, wall
from .textures import blend, checks, noise, scattered, wave, weathered


def ceiling_lamp(right: float, z: float, half: float, radiance: tuple[float, float, float]) -> dict[str, Any]:
    place = mi.ScalarTransform4f().translate([-right, 1.59, z]).rotate([1, 0, 0], 90.0).scale([half, half, 1])
    light = {"type": "area", "radiance": {"type": "rgb", "value": list(radiance)}}
    return {"type": "rectangle", "to_world": place, "emitter": light}


def shapes() -> dict[str, Any]:
    boards = weathered(blend(wave(1024, 1024, 12, 0), (0.30, 0.17, 0.09), (0.62, 0.42, 0.25)), 3)
    paper = weathered(blend(wave(1024, 1024, 16, 8), (0.25, 0.40, 0.42), (0.78, 0.76, 0.66)), 7, 0.5)
    fabric = weathered(blend(checks(512, 512, 12, 12), (0.55, 0.10, 0.10), (0.85, 0.75, 0.60)), 11)
    marble = weathered(blend(noise(512, 512, 13, (2.0, 60.0)), (0.20, 0.25, 0.40), (0.90, 0.90, 0.85)), 17)
    scene: dict[str, Any] = {
        "floor": floor(-0.60, 2.6, -1.0, 9.0, paint(bitmap(boards, (3.0, 5.0)))),
        "ceiling": floor(1.60, 2.6, -1.0, 9.0, paint((0.8, 0.8, 0.78))),
        "left": side(-2.5, 1.6, -1.0, 9.0, paint(bitmap(paper, (3.0, 1.0)))),
        "right": side(2.5, 1.6, -1.0, 9.0, paint(bitmap(paper, (3.0, 1.0)))),
        "back": wall(9.0, 2.6, 1.6, paint(paper)),
        "lamp_near": ceiling_lamp(0.5, 2.8, 0.7, (9.0, 8.2, 7.0)),
        "lamp_far": ceiling_lamp(-0.6, 6.8, 0.7, (7.0, 7.6, 9.0)),
        "table": box(0.10, -0.30, 4.10, (0.55, 0.025, 0.35), paint(boards), turn=12.0),
        "bowl": sphere(-0.05, -0.13, 3.95, 0.145, paint(scattered(256, 19)), turn=50.0),
        "book": box(0.38, -0.235, 4.15, (0.15, 0.04, 0.11), paint(fabric), turn=-25.0),
        "sofa": box(-1.50, -0.25, 6.60, (0.75, 0.35, 0.40), paint(fabric), turn=20.0),
        "globe": sphere(1.35, -0.15, 6.00, 0.45, paint(marble), turn=30.0),
        "vase": sphere(-0.36, -0.28, 1.70, 0.10, paint(marble), turn=10.0),
        "stand": rod((-0.36, -0.6, 1.70), (-0.36, -0.37, 1.70), 0.03, paint(boards)),
        "shelf": box(0.52, -0.05, 2.00, (0.10, 0.60, 0.08), paint(fabric), turn=-15.0),
        "string": rod((-0.16, -0.30, 1.50), (-0.08, 0.60, 1.55), 0.006, paint((0.8, 0.7, 0.2))),
    }
    for i, (right, z) in enumerate(np.array([(-0.40, 3.85), (0.52, 3.75), (-0.32, 4.45), (0.60, 4.35)])):
        scene[f"leg{i}"] = rod((right, -0.6, z), (right, -0.32, z), 0.02, paint(boards))
    return scene
