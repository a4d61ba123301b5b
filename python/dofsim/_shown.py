"""Pictures in notebooks: small PNG files of what arrays hold."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _drawing
from ._dofsim import encode_png

__all__ = ["described", "grey", "html", "png"]

# The width of a column of text in notebooks.
_WIDEST_PX = 1000


def described(pixels: NDArray[Any]) -> str:
    """Write the size and the type of a picture, or of layers."""
    shape = pixels.shape
    layers = f"{shape[0]} layers of " if len(shape) == 4 else ""
    height, width = shape[1:3] if len(shape) == 4 else shape[:2]
    channels = shape[-1] if len(shape) > 2 else 1
    return f"{layers}{width} x {height} pixels, {channels} channel{'s' * (channels > 1)} of {pixels.dtype}"


def grey(values: NDArray[Any]) -> NDArray[np.uint8]:
    """Give depth or another measure as codes: light is low, black is high or infinite; the first of layers.

    Parameters
    ----------
    values : ndarray
        Shape (H, W), or (L, H, W).

    Returns
    -------
    ndarray of uint8
        Shape (H, W, 3). Values are spread evenly by their rank, so that no outlier makes the rest look alike.
    """
    plane = values[0] if values.ndim == 3 else values
    finite = np.isfinite(plane)
    codes = np.zeros(plane.shape, np.float64)
    if finite.any():
        edges = np.quantile(plane[finite], np.linspace(0.0, 1.0, 257))
        rank = np.searchsorted(edges[1:-1], plane[finite], side="right")
        codes[finite] = 255 - rank
    return np.repeat(codes.astype(np.uint8)[..., np.newaxis], 3, axis=-1)


def png(pictures: Sequence[NDArray[Any]]) -> bytes:
    """Give a PNG file of some pictures of one size, side by side.

    Parameters
    ----------
    pictures : sequence of ndarray
        Codes of type uint8, or linear light. Shapes (H, W), (H, W, C) or, of layers, (L, H, W, 4), whose
        first is shown. Pictures that are too wide for a page are reduced by leaving out pixels.

    Returns
    -------
    bytes
        The file.
    """
    shown = [_codes(picture) for picture in pictures]
    step = -(-sum(one.shape[1] for one in shown) // _WIDEST_PX)
    return encode_png(np.ascontiguousarray(np.concatenate([one[::step, ::step] for one in shown], axis=1)))


def html(pictures: Sequence[NDArray[Any]]) -> str:
    """Give some pictures side by side as HTML that needs nothing from outside."""
    source = base64.b64encode(png(pictures)).decode()
    return f"<img alt='Pictures side by side' src='data:image/png;base64,{source}'>"


def _codes(picture: NDArray[Any]) -> NDArray[np.uint8]:
    """Give the first three channels as sRGB codes; a single one, or one with coverage, as grey."""
    first = picture[0] if picture.ndim == 4 else picture
    first = first[..., np.newaxis] if first.ndim == 2 else first
    colors = first[..., :3] if first.shape[-1] > 2 else first[..., :1]
    if colors.dtype == np.uint16:
        colors = (colors >> 8).astype(np.uint8)
    if colors.dtype != np.uint8:
        colors = _drawing.codes(np.nan_to_num(colors.astype(np.float32)))
    return colors if colors.shape[-1] == 3 else np.repeat(colors, 3, axis=-1)
