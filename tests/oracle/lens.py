"""A lens by brute force: every layer a plane facing the camera, every lens point marched front to back."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage


def lens_points(rings: int) -> NDArray[np.float64]:
    """Points (x, y) of a square grid inside the unit disc."""
    axis = (np.arange(2 * rings) + 0.5) / rings - 1.0
    x, y = np.meshgrid(axis, axis)
    inside = np.hypot(x, y) <= 1.0
    return np.stack([x[inside], y[inside]], axis=-1)


def render(layers: list[tuple[NDArray[np.floating], float]], rings: int = 24) -> NDArray[np.float64]:
    """Render (premultiplied (H, W, 4) colour, shift in pixels) layers, nearest first, one shift a layer."""
    out = np.zeros(layers[0][0].shape)
    points = lens_points(rings)
    for x, y in points:
        passed = np.ones(out.shape[:2])
        for color, shift in layers:
            # The ray through pixel p and lens point l meets the layer at p + shift * l.
            moved = [
                ndimage.shift(plane, (-shift * y, -shift * x), order=1, mode="reflect")
                for plane in np.moveaxis(color.astype(np.float64), -1, 0)
            ]
            for c, plane in enumerate(moved):
                out[..., c] += passed * plane
            passed = passed * (1.0 - moved[3])
    return out / len(points)
