"""The plain gather, made fast: every pixel is the mean over the disc of its own circle of confusion."""

import math

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(parallel=True, cache=False)
def gather(color: NDArray[np.float32], radius_px: NDArray[np.float32]) -> NDArray[np.float32]:
    """Blur an (H, W, 3) picture by each pixel's own radius; what lies outside the picture is left out.

    Rows of each disc are taken from running sums, so that a pixel costs its radius and not its disc's area.
    """
    height, width, channels = color.shape
    sums = np.zeros((height, width + 1, channels))
    for y in numba.prange(height):
        for x in range(width):
            for c in range(channels):
                sums[y, x + 1, c] = sums[y, x, c] + color[y, x, c]
    out = np.empty_like(color)
    for y in numba.prange(height):
        total = np.empty(channels)
        for x in range(width):
            radius = abs(radius_px[y, x])
            total[:] = 0.0
            count = 0
            for row in range(max(y - int(radius), 0), min(y + int(radius), height - 1) + 1):
                half = int(math.sqrt(radius * radius - (row - y) ** 2))
                first, end = max(x - half, 0), min(x + half + 1, width)
                count += end - first
                for c in range(channels):
                    total[c] += sums[row, end, c] - sums[row, first, c]
            for c in range(channels):
                out[y, x, c] = total[c] / count
    return out
