"""How blurred a lens shows what lies on its optical axis, by distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._dofsim import AxialBlur, Lens


@dataclass(frozen=True)
class Blur:
    """The circle of confusion on the optical axis, as the optics have it.

    Attributes
    ----------
    axial : AxialBlur
        The optics of the lens on its axis.
    """

    axial: AxialBlur

    @classmethod
    def of(cls, lens: Lens, size: tuple[int, int]) -> Blur:
        """Ask the optics about a picture of this width and height.

        Raises
        ------
        ValueError
            If the lens is one over relative disparity, which knows no distances, or the size is none.
        """
        width, height = size
        if width < 1 or height < 1:
            raise ValueError(f"size must be a width and a height in pixels greater than 0; got {size}")
        return cls(AxialBlur(lens, width, height))

    @property
    def focus_disparity(self) -> float:
        """The inverse of the distance in focus, in 1/m."""
        return self.axial.focus_disparity

    def radius_px(self, distance: ArrayLike) -> NDArray[np.float64]:
        """Give the signed radius at distances in metres."""
        distances = np.asarray(distance, dtype=np.float64)
        return np.reshape(self.axial.radii_px(distances.ravel().tolist()), distances.shape)

    def limits(self, radius_px: float) -> tuple[float, float]:
        """Give the nearest and the farthest distance no more blurred than that."""
        return self.axial.limits(radius_px)

    def hyperfocal(self, radius_px: float) -> float:
        """Give the nearest distance in focus that leaves infinity no more blurred than that."""
        return self.axial.hyperfocal(radius_px)

    def distances(self, count: int) -> NDArray[np.float64]:
        """Give distances that show the curve, evenly spaced by their logarithms."""
        focus, slope_px = self.axial.focus_disparity, self.axial.slope_px
        centre = 1.0 / focus if focus > 0.0 else slope_px or 1.0
        return np.geomspace(centre / 6.0, centre * 12.0, count)


def in_focus(lens: Lens) -> str:
    """Write what a lens has in focus: a distance or a disparity, or the ends of a range."""
    planes = [focus for focus in (lens.focus_distance, lens.focus) if focus is not None]
    ends = lens.in_focus or planes
    if lens.focus is None:
        return " to ".join(metres(end) for end in ends)
    return "disparity " + " to ".join(f"{end:.3g}" for end in ends)


def metres(distance: float) -> str:
    """Write a distance to three digits."""
    if np.isinf(distance):
        return "\N{INFINITY}"
    if distance < 1.0:
        return f"{100.0 * distance:.3g} cm"
    return f"{distance:.0f} m" if distance >= 100.0 else f"{distance:.3g} m"
