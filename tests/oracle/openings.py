"""Openings by brute force: points of a fine grid, and the discs that they draw."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Inside = Callable[[NDArray, NDArray], NDArray]


def disc(x: NDArray, y: NDArray) -> NDArray:
    """Transmission of the open disc; x runs to the right, y down."""
    return np.hypot(x, y) <= 1.0


def polygon(blades: int, rotation_deg: float) -> Inside:
    """Transmission of a polygon in the unit circle, its first corner `rotation_deg` above the x axis."""
    middles = np.radians(rotation_deg + 360.0 / blades * (np.arange(blades) + 0.5))

    def inside(x: NDArray, y: NDArray) -> NDArray:
        away = [x * np.cos(a) - y * np.sin(a) for a in middles]
        return np.max(away, axis=0) <= np.cos(np.pi / blades)

    return inside


def lens_points(inside: Inside, n: int) -> NDArray[np.float64]:
    """About `n` points of the opening: a low-discrepancy sequence of the square, less what lies outside."""
    golden = np.array([0.754877666246693, 0.569840290998053])
    k = np.arange(1, 64 * n)[:, np.newaxis]
    x, y = (2.0 * ((0.5 + k * golden) % 1.0) - 1.0).T
    passed = inside(x, y).astype(bool)
    return np.stack([x, y], axis=-1)[passed][:n]


def kernel(transmission: Inside, t: float, reach: int, fine: int = 24) -> NDArray[np.float64]:
    """Weights of the pixels around a point of shift `t`, `(2 reach + 1)` squared, of sum 1."""
    at = (np.arange((2 * reach + 1) * fine) + 0.5) / fine - reach - 0.5
    light = transmission(*np.meshgrid(at / t, at / t)).astype(float)
    pixels = light.reshape(2 * reach + 1, fine, 2 * reach + 1, fine).sum(axis=(1, 3))
    return pixels / pixels.sum()
