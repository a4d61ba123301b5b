"""Balls, two of them mirrors: what those show is no place on them, and depends on where one stands."""

from typing import Any

from . import balls
from .shapes import sphere


def shapes() -> dict[str, Any]:
    mirror = {"bsdf": {"type": "conductor"}}
    scene = balls.shapes()
    # One before the plane in focus, and one behind it.
    for i in (1, 2):
        right, up, z, radius, _ = balls.BALLS[i]
        scene[f"ball{i}"] = sphere(right, up, z, radius, mirror)
    return scene
