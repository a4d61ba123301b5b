"""Taps scattered over each pixel's circle of confusion."""

import numpy as np
from numpy.typing import NDArray
from oracle.fetch import bilinear

TWELVE = np.array([
    (-0.326212, -0.40581), (-0.840144, -0.07358), (-0.695914, 0.457137), (-0.203345, 0.620716),
    (0.96234, -0.194983), (0.473434, -0.480026), (0.519456, 0.767022), (0.185461, -0.893124),
    (0.507431, 0.064425), (0.89642, 0.412458), (-0.32194, -0.932615), (-0.791559, -0.59771),
])  # fmt: skip


def render(
    color: NDArray,
    disparity: NDArray,
    coc_px: NDArray,
    taps: NDArray = TWELVE,
    max_coc_px: float = 5.0,
    leak_test: bool = True,
) -> NDArray[np.float64]:
    """Blur an (H, W, C) picture; `coc_px` is the signed radius, positive behind the focus."""
    color, disparity = color.astype(np.float64), disparity.astype(np.float64)
    blurriness = np.minimum(np.abs(coc_px.astype(np.float64)) / max_coc_px, 1.0)
    # The pattern is turned round behind the focus.
    scale = -np.sign(coc_px) * blurriness * max_coc_px
    y, x = np.mgrid[: color.shape[0], : color.shape[1]].astype(float)
    colors, counts = color.copy(), np.ones(disparity.shape)
    for dx, dy, *weight in taps:
        at = x + dx * scale, y + dy * scale
        in_front = bilinear(disparity, *at) > disparity
        count = np.where(in_front & leak_test, bilinear(blurriness, *at), 1.0) * (weight or [1.0])[0]
        colors += count[..., None] * bilinear(color, *at)
        counts += count
    return colors / counts[..., None]
