"""What plots, panels and the pictures of a notebook share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import metrics
from ._blur import Blur

# The largest radius of the blur in pixels that counts as sharp.
SHARP_RADIUS_PX = 0.5
# Lines of what is in front of the focus.
NEAR_COLOR = "#b5382f"


@dataclass(frozen=True, eq=False)
class Curve:
    """The blur of a lens against distance, as a chart shows it.

    Attributes
    ----------
    distance, radius : ndarray
        Distances in metres and the signed radius of the blur in pixels at each.
    top : float
        The radius at which the chart ends.
    sharp : tuple of float
        The nearest and the farthest distance that are sharp.
    """

    distance: NDArray[np.float64]
    radius: NDArray[np.float64]
    top: float
    sharp: tuple[float, float]

    @classmethod
    def of(cls, blur: Blur, count: int, sharp_radius_px: float) -> Curve:
        """Draw so many points of the blur."""
        distance = blur.distances(count)
        top = max(1.35 * float(blur.radius_px(np.inf)), 4.0 * sharp_radius_px)
        return cls(distance, blur.radius_px(distance), top, blur.limits(sharp_radius_px))


def codes(linear: NDArray[Any]) -> NDArray[np.uint8]:
    """Give the sRGB code values, 0 to 255, of linear light."""
    values: NDArray[np.uint8] = np.rint(255.0 * metrics.srgb(linear)).astype(np.uint8)
    return values
