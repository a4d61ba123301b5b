"""Look-ups at fixed places, mixed with the centre by blur factors."""

import numpy as np
from numpy.typing import NDArray
from oracle.fetch import bilinear


def ring(corners: int, radius_px: float, turn_deg: float = 0.0) -> list[tuple[float, float]]:
    """Corners (x right, y down) of a regular polygon, the first one straight up, going round to the left."""
    angles = np.radians(90.0 + turn_deg + 360.0 / corners * np.arange(corners))
    return [(radius_px * np.cos(a), -radius_px * np.sin(a)) for a in angles]


OFFSETS_PX = {
    "thirteen": ring(6, 1.0) + ring(6, 2.0, 30.0),
    "seven": ring(6, 1.0),
    "six": ring(5, 1.0),
    "four": ring(3, 1.0),
    "four_rings": ring(3, 1.0),
}


def render(color: NDArray, factor: NDArray, variant: str) -> NDArray[np.float64]:
    """Blur an (H, W, C) picture; the blur factor of a pixel is the square of `factor`, at most 0.75."""
    blur = np.minimum(np.asarray(factor, np.float64) ** 2, 0.75)
    y, x = np.mgrid[: color.shape[0], : color.shape[1]].astype(float)
    centre = color.astype(np.float64)
    total = centre.copy()
    for dx, dy in OFFSETS_PX[variant]:
        weight = blur if variant == "four_rings" else blur * bilinear(blur, x + dx, y + dy)
        total += centre + weight[..., None] * (bilinear(centre, x + dx, y + dy) - centre)
    return total / (1 + len(OFFSETS_PX[variant]))
