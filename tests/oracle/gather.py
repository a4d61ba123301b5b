"""The plainest depth of field: each pixel becomes the mean over the disc of its own circle of confusion."""

from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

# Radii are rounded down and up to multiples of this, and the two means interpolated.
RADIUS_STEP_PX = 0.25


def disc(radius_px: float, strips: int = 256) -> NDArray[np.float64]:
    """Area of each pixel that a disc about the middle pixel's centre covers, as a share of the disc."""
    if radius_px == 0.0:
        return np.ones((1, 1))
    reach = ceil(radius_px - 0.5)
    edges = np.arange(-reach, reach + 2) - 0.5
    # Exact along y on thin strips of x.
    x = (np.arange((2 * reach + 1) * strips) + 0.5) / strips - reach - 0.5
    half_chord = np.sqrt(np.maximum(radius_px**2 - x**2, 0.0))
    below = np.clip(edges[:, None], -half_chord, half_chord)
    area = np.diff(below, axis=0).reshape(2 * reach + 1, 2 * reach + 1, strips).sum(axis=-1)
    return area / area.sum()


def gather(color: NDArray[np.floating], coc_px: NDArray[np.floating]) -> NDArray[np.float64]:
    """Blur an (H, W, C) picture by each pixel's own CoC radius; what lies outside the picture is left out."""
    height, width, _ = color.shape
    radius = np.abs(coc_px) / RADIUS_STEP_PX
    margin = ceil(radius.max() * RADIUS_STEP_PX) + 1
    padded = (height + 2 * margin, width + 2 * margin)
    # The last channel counts the pixels that lie inside.
    counted = np.concatenate([np.asarray(color, np.float64), np.ones((height, width, 1))], axis=-1)
    spectrum = np.fft.rfft2(counted, s=padded, axes=(0, 1))
    out = np.zeros(counted.shape)
    for step in range(floor(radius.min()), ceil(radius.max()) + 1):
        weight = np.maximum(1.0 - np.abs(radius - step), 0.0)
        if not weight.any():
            continue
        kernel = disc(step * RADIUS_STEP_PX)
        reach = kernel.shape[0] // 2
        blurred = np.fft.irfft2(spectrum * np.fft.rfft2(kernel, s=padded)[..., None], s=padded, axes=(0, 1))
        means = blurred[reach : reach + height, reach : reach + width]
        out += weight[..., None] * (means / means[..., -1:])
    return out[..., :-1]
