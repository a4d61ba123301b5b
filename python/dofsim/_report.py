"""What was rendered, in numbers: the depth, the focus and the radius of the blur; and what is suspicious."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._blur import metres
from ._dofsim import Lens, coc
from ._options import UNITS

__all__ = ["Report", "distribution", "log_render", "pixels", "spread"]

# A blur that is smaller than this everywhere cannot be seen, and one beyond this share of the width is rarely
# meant.
_SMALLEST_RADIUS_PX = 0.5
_LARGEST_SHARE = 0.1

# What the values of each kind are, and their unit.
_QUANTITIES = {
    "z": ("depth", "m"),
    "distance": ("distance along the ray", "m"),
    "distance_from_near": ("distance from the near plane", "m"),
    "inverse_z": ("inverse depth", "1/m"),
    "disparity": ("disparity", ""),
    "relative": ("relative disparity", ""),
    "zbuffer": ("z-buffer values", ""),
    "opengl_ndc": ("z-buffer values", ""),
}

_POSITIVE = ("z", "distance", "distance_from_near", "inverse_z")


@dataclass(frozen=True, kw_only=True)
class Report:
    """The numbers of one picture.

    Attributes
    ----------
    kind : str
        What the depth measures.
    depth_range : tuple of float, optional
        Of relative disparity, the values that are taken as 0 and 1; None for those of the picture itself.
    depth : tuple of float, optional
        The least and the greatest value of the depth of a surface, in the unit of its kind; None without any.
    has_background : bool
        Whether some pixels see no surface: they are infinitely far, or invalid and taken for that.
    focus : str
        What is in focus, with its unit.
    is_on_scale : bool
        Whether a focus on relative disparity lies between 0 and 1.
    radius_px : tuple of float
        The least, the median and the greatest radius of the blur, in pixels of the output.
    width : int
        Of the output, in pixels.
    opened : bool
        Whether the lens is no pinhole.
    whole_numbers : bool
        Whether all depth of surfaces is whole numbers, of which there are several.
    """

    kind: str
    depth_range: tuple[float, float] | None
    depth: tuple[float, float] | None
    has_background: bool
    focus: str
    is_on_scale: bool
    radius_px: tuple[float, float, float]
    width: int
    opened: bool
    whole_numbers: bool

    @classmethod
    def of(
        cls,
        depth: NDArray[np.floating[Any]],
        lens: Lens,
        *,
        overscan: int = 0,
        supersample: int = 1,
        max_coc_px: float | None = None,
        **kind: Any,
    ) -> Report:
        """Measure a depth map as a lens sees it.

        Parameters
        ----------
        depth : ndarray
            Shape (H, W), or (L, H, W) of layers.
        lens : Lens
            The lens.
        overscan, supersample, max_coc_px
            As for `dofsim.render`.
        **kind
            ``depth_kind``, ``near``, ``far`` and ``depth_range`` of `dofsim.render`.

        Returns
        -------
        Report
            The numbers.
        """
        margin = overscan * supersample
        height, width = depth.shape[-2:]
        seen = depth[..., margin : height - margin, margin : width - margin]
        radius = np.abs(coc(np.ascontiguousarray(seen), lens, invalid="far", max_coc_px=max_coc_px, **kind))
        radius /= supersample
        # What is not positive is the background, or invalid and taken for it, but for what has any sign.
        is_surface = np.isfinite(seen)
        if kind.get("depth_kind", "z") in _POSITIVE:
            is_surface &= seen > 0.0
        finite = seen[is_surface]
        least, greatest = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        strength = (lens.aperture_radius, lens.strength_px, lens.strength_percent)
        return cls(
            kind=kind.get("depth_kind", "z"),
            depth_range=kind.get("depth_range"),
            depth=(least, greatest) if finite.size else None,
            has_background=finite.size < seen.size,
            focus=_focus(lens),
            is_on_scale=kind.get("depth_kind") != "relative" or 0.0 <= (lens.focus or 0.0) <= 1.0,
            radius_px=(float(radius.min()), float(np.median(radius)), float(radius.max())),
            width=radius.shape[-1] // supersample,
            opened=any(strength),
            whole_numbers=greatest > least + 1.0 and bool((finite == np.rint(finite)).all()),
        )

    def __str__(self) -> str:
        """Return the depth, the focus and the blur on one line."""
        low, _, high = self.radius_px
        return f"{self._depth()}, focus {self.focus}, blur radius {pixels(low)} to {pixels(high)} px"

    def _depth(self) -> str:
        name, unit = self._quantity
        if self.depth is None:
            return f"{name} infinite everywhere"
        far = " and the background" if self.has_background else ""
        return f"{spread(name, unit, self.depth)}{far}{self._scale()}"

    def _scale(self) -> str:
        """Say which relative disparities are taken as 0 and 1."""
        if self.kind != "relative":
            return ""
        if self.depth_range is None:
            return " (taken as 0 to 1, outliers aside)"
        return f" ({' to '.join(map(_number, self.depth_range))} taken as 0 to 1)"

    @property
    def _quantity(self) -> tuple[str, str]:
        """What the depth is, and its unit."""
        return _QUANTITIES.get(self.kind, ("depth", ""))

    def suspicions(self) -> dict[str, str]:
        """Say what is probably not meant.

        Returns
        -------
        dict of str to str
            Sentences by what they are about; empty if nothing is suspicious.
        """
        found = {}
        name, unit = self._quantity
        least, greatest = self.depth or (math.inf, math.inf)
        if unit == "m" and self.whole_numbers:
            found["whole numbers"] = (
                f"the depth holds whole numbers only, {least:g} to {greatest:g}, and is taken for metres. "
                f"{UNITS}"
            )
        if least == greatest < math.inf and not self.has_background:
            found["even depth"] = f"the {spread(f'{name} is', unit, (least, least))} everywhere"
        if not self.is_on_scale:
            found["focus"] = (
                f"the focus is {self.focus}, and relative disparity runs from 0 (far) to 1 (near)"
            )
        largest = self.radius_px[2]
        if self.opened and largest < _SMALLEST_RADIUS_PX:
            found["no blur"] = (
                f"the blur is too small to see: its radius is at most {largest:.2g} px. Is the depth in the "
                "unit that was said, and the aperture wide enough?"
            )
        if largest > _LARGEST_SHARE * self.width:
            found["wide blur"] = (
                f"the blur is very wide: its radius reaches {largest:.0f} px, {largest / self.width:.0%} of "
                "the width. Is the depth in the unit that was said?"
            )
        return found

    def record(self) -> dict[str, Any]:
        """Give the numbers as a batch's record has them.

        Returns
        -------
        dict
            ``depth_range`` (least and greatest finite value), ``depth_quantity`` and ``depth_unit``,
            ``blur_radius_px`` (least, median and greatest) and ``suspicions``.
        """
        names = ("min", "median", "max")
        quantity, unit = self._quantity
        return {
            "depth_range": self.depth,
            "depth_quantity": quantity,
            "depth_unit": unit,
            "blur_radius_px": dict(zip(names, (round(one, 4) for one in self.radius_px), strict=True)),
            "suspicions": self.suspicions(),
        }


def log_render(depth: NDArray[np.floating[Any]], lens: Lens, seconds: float, **words: Any) -> None:
    """Tell the logger ``dofsim.render`` what was rendered.

    Parameters
    ----------
    depth : ndarray
        The depth.
    lens : Lens
        The lens.
    seconds : float
        Time that the render took.
    **words
        As for `Report.of`.
    """
    report = Report.of(depth, lens, **words)
    log = logging.getLogger("dofsim.render")
    log.info("%s, %.2f s", report, seconds)
    for suspicion in report.suspicions().values():
        log.warning("%s", suspicion)


def distribution(values: Sequence[float]) -> dict[str, float]:
    """Give the quantiles of some numbers.

    Parameters
    ----------
    values : sequence of float
        The numbers, at least one.

    Returns
    -------
    dict of str to float
        ``min``, ``p5``, ``median``, ``p95`` and ``max``.
    """
    shares = {"min": 0.0, "p5": 0.05, "median": 0.5, "p95": 0.95, "max": 1.0}
    found = np.quantile(np.asarray(values, np.float64), list(shares.values()))
    return dict(zip(shares, (float(f"{one:.4g}") for one in found), strict=True))


def spread(name: str, unit: str, ends: tuple[float, float]) -> str:
    """Give a range of depth in words.

    Parameters
    ----------
    name, unit : str
        What it is a range of, and its unit.
    ends : tuple of float
        The least and the greatest value.

    Returns
    -------
    str
        Such as ``"depth 1.5 to 6 m"``.
    """
    low, high = map(_number, ends)
    return f"{name} {low if low == high else f'{low} to {high}'}{f' {unit}' if unit else ''}"


def _number(value: float) -> str:
    """Write a number to three digits, with an exponent only where there would be many zeros."""
    if 1e-6 <= abs(value) < 1e7:
        return np.format_float_positional(value, precision=3, fractional=False, trim="-")
    return f"{value:.3g}"


def pixels(radius: float) -> str:
    """Write a radius to a tenth of a pixel."""
    return "0" if radius < 0.05 else f"{radius:.1f}" if radius < 10.0 else f"{radius:.0f}"


def _metres(distance: float) -> str:
    """Write a distance with its unit."""
    return "infinity" if math.isinf(distance) else metres(distance)


def _focus(lens: Lens) -> str:
    planes: list[float] = [focus for focus in (lens.focus_distance, lens.focus) if focus is not None]
    ends: Sequence[float] = lens.in_focus or planes
    if lens.focus is None:
        return " to ".join(_metres(end) for end in ends)
    return "at disparity " + " to ".join(f"{end:.3g}" for end in ends)
