"""The scale of relative disparity, as ``depth_kind="relative"`` takes it of one picture."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# The percentiles that become 0 and 1; outliers lie beyond them.
_FAR, _NEAR = 0.01, 0.99


def range_of(disparity: NDArray[Any]) -> tuple[float, float] | None:
    """Give the disparities that are far and near, for ``depth_range``.

    Parameters
    ----------
    disparity : ndarray
        Relative disparity of any shape: of one picture, or of all of a sequence.

    Returns
    -------
    tuple of float or None
        The first and the last percentile of what is finite. None if these are no two values.
    """
    finite = disparity[np.isfinite(disparity)]
    if finite.size == 0:
        return None
    far, near = (float(v) for v in np.quantile(finite, [_FAR, _NEAR], method="lower"))
    return (far, near) if far < near else None
