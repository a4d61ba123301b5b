"""A blurred half-size copy laid over the picture by blurriness."""

import numpy as np
from numpy.typing import NDArray
from oracle.fetch import bilinear

OFFSETS = (0.0, 1.3366, 3.4295, 5.4264, 7.4359, 9.4436, 11.4401)
THRESHOLDS = (-0.01, 0.1, 0.3, 0.5, 0.6, 0.7, 0.8)
WEIGHTS = (0.100, 0.080, 0.075, 0.070, 0.065, 0.060, 0.055)


def halved(picture: NDArray) -> NDArray[np.float64]:
    """Average two by two pixels; the mirror image completes odd sizes."""
    odd = [(0, n % 2) for n in picture.shape[:2]] + [(0, 0)] * (picture.ndim - 2)
    even = np.pad(picture.astype(np.float64), odd, mode="symmetric")
    return (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]) / 4.0


def render(color: NDArray, blurriness: NDArray) -> NDArray[np.float64]:
    """Blur an (H, W, C) picture by a blurriness of 0 to 1."""
    small, blur = halved(color), halved(blurriness)
    y, x = np.mgrid[: blur.shape[0], : blur.shape[1]].astype(float)
    # Along x: weighted colours, and the weight as their last channel.
    across = np.zeros((*blur.shape, color.shape[2] + 1))
    for offset, threshold in zip(OFFSETS, THRESHOLDS, strict=True):
        for side in (-offset, offset) if offset else (0.0,):
            weight = np.clip(bilinear(blur, x + side, y) - threshold, 0.0, 1.0)[..., None]
            across += weight * np.concatenate([bilinear(small, x + side, y), np.ones_like(weight)], axis=-1)
    both = np.zeros_like(across)
    for offset, weight in zip(OFFSETS, WEIGHTS, strict=True):
        for side in (-offset, offset) if offset else (0.0,):
            both += weight * bilinear(across, x, y + side)
    blurred = both[..., :-1] / both[..., -1:]
    y, x = np.mgrid[: color.shape[0], : color.shape[1]].astype(float)
    soft = bilinear(blurred, x / 2.0 - 0.25, y / 2.0 - 0.25)
    return color + blurriness[..., None] * (soft - color)
