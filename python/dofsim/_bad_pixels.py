"""Pixels whose colour is no number, such as a path tracer leaves."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_AROUND = [(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)]


def fill_from_neighbours(pixels: NDArray[Any]) -> NDArray[Any]:
    """Give pixels that are NaN or infinite the mean of those around them.

    Parameters
    ----------
    pixels : ndarray
        Shape (H, W) or (H, W, C).

    Returns
    -------
    ndarray
        The same array if all are finite, else a copy. In a patch, those at its rim come first.

    Raises
    ------
    ValueError
        If no pixel is finite.
    """
    finite = np.isfinite(pixels) if pixels.ndim == 2 else np.isfinite(pixels).all(axis=-1)
    if finite.all():
        return pixels
    if not finite.any():
        raise ValueError("no pixel has a finite colour")
    filled = pixels.copy()
    height, width = finite.shape
    while (bad := np.argwhere(~finite)).size:
        total = np.zeros((len(bad), *pixels.shape[2:]))
        count = np.zeros(len(bad))
        for step in _AROUND:
            y, x = (bad + step).T
            there = (y >= 0) & (y < height) & (x >= 0) & (x < width)
            there[there] = finite[y[there], x[there]]
            total[there] += filled[y[there], x[there]]
            count += there
        rim = count > 0
        y, x = bad[rim].T
        filled[y, x] = (total[rim].T / count[rim]).T
        finite[y, x] = True
    return filled
