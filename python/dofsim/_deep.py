"""Deep OpenEXR files, whose pixels hold any number of samples, as layers from front to back."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ._datasets import first_bytes
from ._dofsim import layers_of_samples, read_deep_exr
from ._files import StrPath

Window = tuple[int, int, int, int]

# The most layers of a file, if nothing else is said.
MAX_LAYERS = 4
Held = Literal["light", "data"]

# What of a file becomes layers.
_CHANNELS = ["R", "G", "B", "Y", "A", "Z", "ZBack"]

_MAGIC = 20000630
# The bit of the version field that says that some part is deep.
_HAS_DEEP = 1 << 11


def exr_kind(path: StrPath) -> Literal["flat", "deep"] | None:
    """Tell whether a file is OpenEXR, and whether it has a deep part.

    Parameters
    ----------
    path : str or path-like
        The file.

    Returns
    -------
    {"flat", "deep"} or None
        What its first bytes say; None for files of other kinds.
    """
    start = first_bytes(path, 8)
    if len(start) < 8:
        return None
    magic, version = struct.unpack("<II", start)
    if magic != _MAGIC:
        return None
    return "deep" if version & _HAS_DEEP else "flat"


def read_deep(
    path: StrPath, max_layers: int, *, data: bool
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Read the deep part of a file as layers.

    Samples are sorted by depth. A volume, from Z to ZBack, is split into pieces of even disparity that
    together stop as much light. Where there are more than `max_layers` samples, neighbours are merged, those
    first whose merging moves the least optical depth by the least disparity. So a pixel looks as it did, and
    what is opaque keeps its depth.

    Parameters
    ----------
    path : str or path-like
        The file.
    max_layers : int
        The most layers.
    data : bool
        Whether to read the pixels that are stored rather than those to be seen.

    Returns
    -------
    color : ndarray of float32
        Shape (L, H, W, 4), premultiplied, L up to `max_layers`.
    depth : ndarray of float32
        Shape (L, H, W); infinite where there is no sample.

    Raises
    ------
    ValueError
        If the file is damaged or has no deep part with depth.
    """
    if max_layers < 1:
        raise ValueError(f"max_layers must be positive; got {max_layers}")
    counts, channels, window = _read_samples(path, _CHANNELS)
    return flatten(counts, channels, max_layers, window=None if data else window)


def read_deep_channels(
    path: StrPath, means: Sequence[tuple[str, Held]], ids: Sequence[Sequence[str]]
) -> dict[str, NDArray[np.float32]]:
    """Read further channels of the deep part of a file as layers: those that `read_deep` gives by default.

    Parameters
    ----------
    path : str or path-like
        The file.
    means : sequence of tuple of str and str
        Names of channels. Where samples are merged, ``"light"`` of one goes over that of the other;
        ``"data"`` are averaged, weighted by what is seen of each sample. What is not finite has no weight.
    ids : sequence of sequence of str
        Sets of channels of ids and their coverage in turn. Of samples that are merged the ids that cover most
        are kept, and cover as much as all of the layer.

    Returns
    -------
    dict of str to ndarray of float32
        Planes of shape (L, H, W), 0 where there is no sample; and Z, the depth of the layers.
    """
    names = [*(name for name, _ in means), *(name for one in ids for name in one)]
    counts, channels, window = _read_samples(path, [*_CHANNELS, *names])
    _, depth, averaged, sets = layers_of_samples(
        counts, channels, MAX_LAYERS, window=window, means=means, ids=ids
    )
    planes = {"Z": depth} | {name: averaged[..., i] for i, (name, _) in enumerate(means)}
    for one, ranks in zip(ids, sets, strict=True):
        planes |= {name: ranks[..., i] for i, name in enumerate(one)}
    return planes


def _read_samples(
    path: StrPath, names: list[str]
) -> tuple[NDArray[np.uint32], dict[str, NDArray[np.float32]], Window]:
    """Read the numbers of samples, the samples of channels, and the window that is to be seen."""
    if (found := read_deep_exr(path, names)) is None:
        raise ValueError(f"{path}: no deep part has a channel Z")
    counts, channels, (left, top, *_), (first, above, width, height) = found
    return counts, channels, (first - left, above - top, width, height)


def flatten(
    counts: NDArray[np.uint32],
    channels: dict[str, NDArray[np.float32]],
    max_layers: int,
    *,
    window: Window | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Turn the samples of every pixel into layers; see `read_deep`.

    Parameters
    ----------
    counts : ndarray of uint32
        The number of samples of each pixel, shape (H, W).
    channels : dict of str to ndarray of float32
        For every channel, the samples of all pixels one after another. ``Z`` is needed; ``R``, ``G``, ``B``
        (or ``Y``), ``A`` and ``ZBack`` are used. Without ``A`` samples are opaque, without ``ZBack`` they
        are thin.
    max_layers : int
        The most layers.
    window : tuple of int, optional
        The pixels that are wanted: the first column and row, and how many; what of them there is not is
        empty. By default all.

    Returns
    -------
    tuple of ndarray of float32
        Colour and depth.
    """
    window = window or (0, 0, counts.shape[1], counts.shape[0])
    color, depth, *_ = layers_of_samples(counts, channels, max_layers, window=window)
    return color, depth
