"""A lens by brute force: every layer a plane facing the camera, every lens point marched front to back."""

import numpy as np
from numpy.typing import NDArray


def lens_points(rings: int) -> NDArray[np.float64]:
    """Points (x, y) of a square grid inside the unit disc."""
    axis = (np.arange(2 * rings) + 0.5) / rings - 1.0
    x, y = np.meshgrid(axis, axis)
    inside = np.hypot(x, y) <= 1.0
    return np.stack([x[inside], y[inside]], axis=-1)


def moved(planes: NDArray[np.float64], rows: float, columns: float) -> NDArray[np.float64]:
    """Read (H, W, 4) planes so far below and to the right: linear between pixels, mirrored at the borders."""
    for axis, by in enumerate((rows, columns)):
        size, whole = planes.shape[axis], int(np.floor(by))
        at = np.abs(np.arange(size) + whole + 0.5) - 0.5, np.abs(np.arange(size) + whole + 1.5) - 0.5
        first, second = (np.where(i < size, i, 2 * size - 1 - i).astype(int) for i in at)
        share = by - whole
        planes = (1.0 - share) * planes.take(first, axis) + share * planes.take(second, axis)
    return planes


def render(layers: list[tuple[NDArray[np.floating], float]], rings: int = 24) -> NDArray[np.float64]:
    """Render (premultiplied (H, W, 4) colour, shift in pixels) layers, nearest first, one shift a layer."""
    out = np.zeros(layers[0][0].shape)
    points = lens_points(rings)
    for x, y in points:
        passed = np.ones(out.shape[:2])
        for color, shift in layers:
            # The ray through pixel p and lens point l meets the layer at p + shift * l.
            seen = moved(color.astype(np.float64), shift * y, shift * x)
            out += passed[..., None] * seen
            passed = passed * (1.0 - seen[..., 3])
    return out / len(points)
