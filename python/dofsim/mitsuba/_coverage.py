"""Layers with coverage: the surfaces that many rays of a pixel meet, one behind another."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dofsim._dofsim import HIGHLIGHT_RATIO

from ._peel import Layers, peel, peel_rays
from ._view import View

__all__ = ["covered"]

# Neighbours farther apart than this share of a picture's range of disparity are not on one surface. The
# "lens" method tells surfaces apart by a pixel of blur. For a lens that makes 32 pixels of the whole range,
# as wide a blur as most pictures have, this is a pixel.
_SILHOUETTE = 1.0 / 32.0
# What single precision makes of one depth, relative to it, with room to spare.
_ROUNDING = 1e-4
# Hits of all rays of a band of rows together; bounds memory.
_HITS_AT_ONCE = 4_000_000

Floats = NDArray[np.float32]


def covered(scene: Any, view: View, layers: int, *, spp: int, seed: int, means: Floats) -> Layers:
    """Sample the surfaces that the rays of each pixel meet, nearest first, with what each covers of it.

    As many rays as `spp` are spread over the pixel. What they meet at one depth is one surface: its alpha is
    the part of the rays that meet it, and its colour is the mean of these. So an edge covers a part of its
    pixel, and what is sharp is as smooth as a picture that is averaged over pixels.

    Parameters
    ----------
    scene : mitsuba.Scene
        The scene.
    view : View
        The pinhole.
    layers : int
        How many surfaces. If a pixel shows more, the last layer has all that remain, at their mean disparity.
    spp : int
        Rays a pixel.
    seed : int
        Of random numbers.
    means : ndarray
        What the pinhole sees, averaged over pixels, shape (H, W, 3): the colours of pixels that one surface
        covers. It also decides how bright small lamps are, which few rays meet.

    Returns
    -------
    color : (layers, height, width, 4) array
        Premultiplied linear colour; alpha is coverage.
    depth : (layers, height, width) array
        Planar depth in metres, infinite where there is no surface.
    """
    width, height = view.size
    color = np.zeros((layers, height, width, 4), np.float32)
    depth = np.full((layers, height, width), np.inf, np.float32)
    (first,), (nearest,) = peel(scene, view, 1, spp=0, seed=seed)
    gap = _gap(view, 1.0 / nearest[first[..., 3] > 0.0])
    light = means.sum(axis=-1)
    lamp = HIGHLIGHT_RATIO * float(np.median(light[light > 0.0])) if light.any() else 0.0
    step = max(1, _HITS_AT_ONCE // (spp * layers * width))
    for top in range(0, height, step):
        rows = slice(top, min(top + step, height))
        band = range(rows.start, rows.stop)
        colors, depths = peel_rays(
            scene, view, layers, spp=1, seed=seed + top, rows=band, points=_points(spp)
        )
        color[:, rows], depth[:, rows] = merged(colors, depths, gap)
        color[:, rows, :, :3] *= _of_lamps(colors[:, 0, ..., :3].mean(axis=0), means[rows], lamp)
    whole = color[0, ..., 3] >= 1.0
    color[0, whole, :3] = means[whole]
    return color, depth


def merged(color: Floats, depth: Floats, gap: float) -> Layers:
    """Merge the surfaces that N rays of each pixel meet to layers.

    Surfaces whose disparities follow one another by at most `gap` are one. Of each ray, the first hit counts:
    what is behind it on the same surface is hidden by it.

    Parameters
    ----------
    color : (N, L, H, W, 4) array
        Colour and alpha, 0 or 1, of the surfaces that each ray meets, nearest first.
    depth : (N, L, H, W) array
        Their depths.
    gap : float
        In 1/m.

    Returns
    -------
    color : (L, H, W, 4) array
        Premultiplied colour and coverage of the layers.
    depth : (L, H, W) array
        Their depths, by the mean disparity.
    """
    rays, layers, height, width = depth.shape
    there = color[..., 3] > 0.0
    disparity = np.where(there, 1.0 / depth, -np.inf)
    in_a_row = disparity.reshape(rays * layers, height, width)
    order = np.argsort(-in_a_row, axis=0, kind="stable")
    in_order = np.take_along_axis(in_a_row, order, axis=0)
    with np.errstate(invalid="ignore"):
        begins = in_order[:-1] - in_order[1:] > gap
    number = np.zeros(order.shape, np.int16)
    np.minimum(np.cumsum(begins, axis=0), layers - 1, out=number[1:], casting="unsafe")
    surface = np.empty_like(number)
    np.put_along_axis(surface, order, number, axis=0)
    surface = surface.reshape(depth.shape)
    seen = there.copy()
    seen[:, 1:] &= surface[:, 1:] != surface[:, :-1]
    out = np.zeros(color.shape[1:], np.float32)
    out_depth = np.full(depth.shape[1:], np.inf, np.float32)
    for layer in range(layers):
        own = seen & (surface == layer)
        count = own.sum(axis=(0, 1))
        out[layer] = np.einsum("nlyx,nlyxc->yxc", own, color) / rays
        mean = np.where(own, disparity, 0.0).sum(axis=(0, 1)) / np.maximum(count, 1)
        with np.errstate(divide="ignore"):
            out_depth[layer] = 1.0 / mean
    return out, out_depth


def _of_lamps(seen: Floats, means: Floats, limit: float) -> Floats:
    """Give the factors that make lamps as bright as their means, where few rays have met them.

    An error in where a surface ends is made up for by the next pixel, but not one in a lamp's light. Lamps
    are what is brighter than the limit, in part up to twice as bright.
    """
    light = np.maximum(seen.sum(axis=-1), means.sum(axis=-1))[..., None]
    lamp = np.clip(light / max(limit, np.finfo(np.float32).eps) - 1.0, 0.0, 1.0)
    # What no ray has met cannot be scaled.
    met = seen > np.finfo(np.float32).eps * means
    ratio = np.divide(means, seen, out=np.ones_like(means), where=met)
    scale: Floats = 1.0 + lamp * (ratio - 1.0)
    return scale


def _gap(view: View, disparity: Floats) -> float:
    """Give how far apart disparities of one surface may be: a pixel of blur, of this lens or a stronger."""
    if disparity.size == 0:
        return 0.0
    gap = float(np.ptp(disparity)) * _SILHOUETTE
    if view.aperture_radius > 0.0:
        gap = min(gap, 1.0 / (view.aperture_radius * view.intrinsics()[0, 0]))
    return max(gap, _ROUNDING * float(disparity.max()))


def _points(count: int) -> list[tuple[float, float]]:
    """Give points of a pixel, 0 to 1: Hammersley's, of which no two are in one column or row."""
    points = []
    for i in range(count):
        inverse, digit, rest = 0.0, 0.5, i
        while rest:
            inverse += digit * (rest & 1)
            rest, digit = rest >> 1, 0.5 * digit
        points.append(((i + 0.5) / count, inverse + 0.5 / count))
    return points
