"""Sprites, written down plainly: every blurred pixel drawn as a picture of the opening, at half the size."""

import numpy as np
from numpy.typing import NDArray

from .levels import enlarge

Array = NDArray[np.float64]


def drawn_radius(coc_px: float) -> float:
    """Round a signed radius to a sixteenth of a pixel below 4 px, to a quarter above."""
    size = abs(coc_px)
    small, large = np.floor(size * 16.0 + 0.5) / 16.0, np.floor(size * 4.0 + 0.5) / 4.0
    rounded = small if size < 4.0 else large
    return float(np.copysign(rounded, coc_px))


def texture(picture: NDArray[np.floating], radius_px: float) -> Array:
    """Share of each pixel in a picture that spans the square around a circle of this signed radius."""
    reach = int(np.ceil(abs(radius_px) + 0.5))
    edges = np.arange(-reach, reach + 2) - 0.5

    def shared(n: int) -> Array:
        texels = np.linspace(-abs(radius_px), abs(radius_px), n + 1)
        low, high = np.maximum(edges[:-1, None], texels[:-1]), np.minimum(edges[1:, None], texels[1:])
        return np.maximum(high - low, 0.0)

    share = shared(picture.shape[0]) @ picture @ shared(picture.shape[1]).T
    # In front of the focus, points are drawn turned by half.
    return (share if radius_px > 0 else share[::-1, ::-1]) / share.sum()


def render(
    color: NDArray[np.floating],
    coc_px: NDArray[np.floating],
    sprite: NDArray[np.floating],
    *,
    coc_threshold_px: float = 1.0,
    max_coc_px: float = 64.0,
) -> Array:
    """Draw an (H, W, C) picture by signed CoC radii; beyond the border lies its mirror image."""
    height, width, channels = color.shape
    coc = np.clip(coc_px.astype(np.float64), -max_coc_px, max_coc_px)
    drawn = np.clip(np.abs(coc) / coc_threshold_px - 1.0, 0.0, 1.0)
    light = np.concatenate([color.astype(np.float64), np.ones((height, width, 1))], axis=-1)

    # Both layers at full size, on an even margin, then the means of 2 x 2 pixels.
    margin = 2 * int(np.ceil(np.abs(coc).max()) + 2)
    odd = (height % 2, width % 2)
    layers = np.zeros((2, height + odd[0] + 2 * margin, width + odd[1] + 2 * margin, channels + 1))
    rows = np.pad(np.arange(height), margin, mode="symmetric")
    columns = np.pad(np.arange(width), margin, mode="symmetric")
    for y in range(len(rows)):
        for x in range(len(columns)):
            at = rows[y], columns[x]
            if drawn[at] == 0.0:
                continue
            shares = texture(sprite, drawn_radius(coc[at]))
            reach = len(shares) // 2
            # What reaches the picture from so far away is cut off with the margin.
            if not (reach <= y < layers.shape[1] - reach and reach <= x < layers.shape[2] - reach):
                continue
            target = layers[int(coc[at] > 0), y - reach : y + reach + 1, x - reach : x + reach + 1]
            target += drawn[at] * shares[..., None] * light[at]
    layers = layers[:, margin : margin + height + odd[0], margin : margin + width + odd[1]]
    halves = layers.reshape(2, (height + 1) // 2, 2, (width + 1) // 2, 2, -1).mean(axis=(2, 4))
    front, back = (enlarge(half, 2)[:height, :width] for half in halves)

    rest = light.copy()
    lit = (coc > 0.0) & (back[..., -1] > 0.0)
    rest[lit] += drawn[lit, None] * (back[lit] / back[lit][:, -1:] - light[lit])
    coverage = front[..., -1:]
    out = front / np.maximum(coverage, 1.0) + (1.0 - np.minimum(coverage, 1.0)) * rest

    surroundings = rest * np.where(coc < 0.0, 1.0 - drawn, 1.0)[..., None]
    for y, x in np.argwhere((coc < 0.0) & (drawn > 0.0) & (coverage[..., 0] > 0.0)):
        half = -coc[y, x] * np.sqrt(np.pi) / 2.0
        wy, wx = (
            np.clip(np.minimum(i + 1.0, c + half) - np.maximum(i, c - half), 0.0, 1.0)
            for i, c in ((np.arange(height), y + 0.5), (np.arange(width), x + 0.5))
        )
        seen = np.einsum("y,x,yxc->c", wy, wx, surroundings) / (wy.sum() * wx.sum())
        silhouette = (front[y, x] + seen) / (front[y, x] + seen)[-1]
        out[y, x] += drawn[y, x] * (silhouette - out[y, x])
    return out[..., :-1]
