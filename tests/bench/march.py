"""Depth of field by brute force: every ray of every pixel marched through the depth map."""

import math

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(parallel=True, cache=False)
def march(color: NDArray[np.float32], shift: NDArray[np.float32], views: int) -> NDArray[np.float32]:
    """Render an (H, W, 3) picture whose pixels are shifted by so much at the rim of the lens.

    For every lens point the ray of a pixel is followed from the nearest surface to the farthest, a pixel at a
    time, until it meets one. Nothing is known of what the picture hides.
    """
    height, width, channels = color.shape
    nearest, farthest = shift.max(), shift.min()
    out = np.zeros_like(color)
    for y in numba.prange(height):
        for view in range(views):
            # Vogel's spiral: even over the disc.
            r, angle = math.sqrt((view + 0.5) / views), 2.399963229728653 * view
            lx, ly = r * math.cos(angle), r * math.sin(angle)
            step = 1.0 / max(abs(lx), abs(ly), 1e-3)
            for x in range(width):
                t = nearest
                qy, qx = y, x
                while True:
                    qy = min(max(math.floor(y + ly * t + 0.5), 0), height - 1)
                    qx = min(max(math.floor(x + lx * t + 0.5), 0), width - 1)
                    if abs(shift[qy, qx] - t) <= 0.5 * step or t <= farthest:
                        break
                    t -= step
                for c in range(channels):
                    out[y, x, c] += color[qy, qx, c]
    return out / np.float32(views)
