"""How blurred a lens shows what lies on its optical axis, by distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._dofsim import Lens, coc


@dataclass(frozen=True)
class Blur:
    """The circle of confusion on the optical axis: linear in disparity, so that two numbers say it all.

    Attributes
    ----------
    focus_disparity : float
        The inverse of the distance in focus, in 1/m.
    slope_px : float
        Pixels of radius for each 1/m away from it.
    """

    focus_disparity: float
    slope_px: float

    @classmethod
    def of(cls, lens: Lens, size: tuple[int, int]) -> Blur:
        """Ask the optics about a picture of this width and height.

        Raises
        ------
        ValueError
            If the lens is one over relative disparity, which knows no distances, or the size is none.
        """
        if (focus_distance := lens.focus_distance) is None:
            raise ValueError("the lens must be a metric one: over relative disparity there are no distances")
        width, height = size
        if width < 1 or height < 1:
            raise ValueError(f"size must be a width and a height in pixels greater than 0; got {size}")

        def radius_px(distance: float) -> float:
            return float(coc(np.broadcast_to(distance, (height, width)), lens)[height // 2, width // 2])

        focus = 1.0 / focus_distance
        near = 2.0 * focus if focus > 0.0 else 1.0
        # What a tilt adds beside the axis is the same at both distances.
        return cls(focus, (radius_px(np.inf) - radius_px(1.0 / near)) / near)

    def radius_px(self, distance: ArrayLike) -> NDArray[np.float64]:
        """Give the signed radius at distances in metres."""
        return self.slope_px * (self.focus_disparity - 1.0 / np.asarray(distance, dtype=np.float64))

    def limits(self, radius_px: float) -> tuple[float, float]:
        """Give the nearest and the farthest distance no more blurred than that."""
        if self.slope_px == 0.0:
            return 0.0, np.inf
        apart = radius_px / self.slope_px
        far = self.focus_disparity - apart
        return 1.0 / (self.focus_disparity + apart), 1.0 / far if far > 0.0 else np.inf

    def hyperfocal(self, radius_px: float) -> float:
        """Give the nearest distance in focus that leaves infinity no more blurred than that."""
        return self.slope_px / radius_px

    def distances(self, count: int) -> NDArray[np.float64]:
        """Give distances that show the curve, evenly spaced by their logarithms."""
        centre = 1.0 / self.focus_disparity if self.focus_disparity > 0.0 else self.slope_px or 1.0
        return np.geomspace(centre / 6.0, centre * 12.0, count)


def metres(distance: float) -> str:
    """Write a distance to three digits."""
    if np.isinf(distance):
        return "\N{INFINITY}"
    if distance < 1.0:
        return f"{100.0 * distance:.3g} cm"
    return f"{distance:.0f} m" if distance >= 100.0 else f"{distance:.3g} m"
