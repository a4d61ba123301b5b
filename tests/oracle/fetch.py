"""Reading a picture between its pixels."""

import numpy as np
from numpy.typing import NDArray


def bilinear(picture: NDArray[np.floating], x: NDArray, y: NDArray) -> NDArray[np.float64]:
    """Interpolate an (H, W) or (H, W, C) picture at pixel coordinates; beyond it lies its mirror image."""
    height, width = picture.shape[:2]
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)

    def pixel(i, j):
        i, j = i % (2 * width), j % (2 * height)
        return picture[np.minimum(j, 2 * height - 1 - j), np.minimum(i, 2 * width - 1 - i)].astype(np.float64)

    right, down = (f.reshape(f.shape + (1,) * (picture.ndim - 2)) for f in (x - left, y - top))
    above = pixel(left, top) * (1.0 - right) + pixel(left + 1, top) * right
    below = pixel(left, top + 1) * (1.0 - right) + pixel(left + 1, top + 1) * right
    return above * (1.0 - down) + below * down
