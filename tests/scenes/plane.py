"""One patterned plane, steeply slanted and rolled, through the focus from near to far."""

from typing import Any

import mitsuba as mi
import numpy as np

from .shapes import X_RIGHT, bitmap, glow
from .textures import blend, checks, scattered, weathered

# Disparity in 1/m at the picture's centre, and its change per unit of (right / z, up / z).
DISPARITY, SLOPE_RIGHT, SLOPE_UP = 0.40, 0.12, -1.05


def shapes() -> dict[str, Any]:
    # Disparity is linear in the picture, so the plane is SLOPE_RIGHT x + SLOPE_UP y + DISPARITY z = 1.
    normal = np.array([X_RIGHT * SLOPE_RIGHT, SLOPE_UP, DISPARITY])
    foot = normal / (normal @ normal)
    towards_lens = -normal / np.linalg.norm(normal)
    away = np.array([0.0, 0.0, 1.0]) - towards_lens[2] * towards_lens
    away /= np.linalg.norm(away)
    half_size = 40.0
    columns = np.eye(4)
    columns[:3, 0] = half_size * np.cross(away, towards_lens)
    columns[:3, 1] = half_size * away
    columns[:3, 2] = towards_lens
    columns[:3, 3] = foot
    picture = 0.75 * weathered(blend(checks(2048, 2048, 10, 10), scattered(2048, 3), (0.85, 0.80, 0.70)), 7)
    look = glow(bitmap(picture, (20.0, 20.0)))
    return {"plane": {"type": "rectangle", "to_world": mi.ScalarTransform4f(columns), **look}}
