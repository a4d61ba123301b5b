"""Deep OpenEXR files, whose pixels hold any number of samples, as layers from front to back."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ._datasets import first_bytes
from ._dofsim import read_deep_exr
from ._files import StrPath

Samples = dict[str, NDArray[np.float32]]
Window = tuple[int, int, int, int]

# What of a file becomes layers.
_CHANNELS = ["R", "G", "B", "Y", "A", "Z", "ZBack"]

_MAGIC = 20000630
# The bit of the version field that says that some part is deep.
_HAS_DEEP = 1 << 11
# The coverage of a sample that gives light and has none: without any it would have no place in a layer.
_GLOW_ALPHA = 1e-3
# Pieces of a pixel's range of disparity for each layer. Two for one leave the merging its choice.
_PIECES_PER_LAYER = 2
# Pixels whose samples are read together, and the samples, padded, that are put in order together.
_CHUNK = 1 << 18
_PADDED = 1 << 20


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
    first whose merging moves the least light by the least disparity: two become one of their colour over each
    other, at their mean disparity by visible coverage. So a pixel looks as it did, and the circle of
    confusion, which is linear in disparity, is right in the mean.

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
    if (found := read_deep_exr(path, _CHANNELS)) is None:
        raise ValueError(f"{path}: no deep part has a channel Z")
    counts, channels, data_window, display_window = found
    color, depth = flatten(counts, channels, max_layers)
    if data:
        return color, depth
    windows = data_window, display_window
    return _displayed(color, *windows, 0.0), _displayed(depth, *windows, np.inf)


def flatten(
    counts: NDArray[np.unsignedinteger], channels: Mapping[str, NDArray[np.float32]], max_layers: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Turn the samples of every pixel into layers; see `read_deep`.

    Parameters
    ----------
    counts : ndarray of int
        The number of samples of each pixel, shape (H, W).
    channels : mapping of str to ndarray of float32
        For every channel, the samples of all pixels one after another. ``Z`` is needed; ``R``, ``G``, ``B``
        (or ``Y``), ``A`` and ``ZBack`` are used. Without ``A`` samples are opaque, without ``ZBack`` they
        are thin.
    max_layers : int
        The most layers.

    Returns
    -------
    tuple of ndarray of float32
        Colour and depth.
    """
    shape = counts.shape
    all_counts = counts.ravel().astype(np.intp)
    grey = "Y" in channels and "R" not in channels
    names = {**dict.fromkeys("RGB", "Y")} if grey else {name: name for name in "RGB"}
    color: list[NDArray[np.float32]] = []
    depth: list[NDArray[np.float32]] = []
    end = 0
    for start in range(0, all_counts.size, _CHUNK):
        of_each = all_counts[start : start + _CHUNK]
        samples = slice(end, end := end + int(of_each.sum()))
        values = {"Z": channels["Z"][samples]}
        for name, source in (*names.items(), ("A", "A")):
            present = channels[source][samples] if source in channels else None
            default = 1.0 if name == "A" else 0.0
            values[name] = np.full_like(values["Z"], default) if present is None else present
        if "ZBack" in channels:
            values, of_each = _in_pieces(values, channels["ZBack"][samples], of_each, max_layers)
        layered = _layered(values, of_each, max_layers)
        color.append(np.stack([layered[name] for name in "RGBA"], axis=-1))
        depth.append(layered["Z"])
    layers = max(part.shape[1] for part in color)
    shaped = (layers, *shape)
    return (
        np.concatenate([_widened(part, layers, 0.0) for part in color]).swapaxes(0, 1).reshape(*shaped, 4),
        np.concatenate([_widened(part, layers, np.inf) for part in depth]).swapaxes(0, 1).reshape(shaped),
    )


def _numbered(counts: NDArray[np.intp]) -> NDArray[np.intp]:
    """Count the members of groups of these sizes, one group after another, each from 0 on."""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)


def _in_pieces(
    values: Samples, back: NDArray[np.float32], counts: NDArray[np.intp], max_layers: int
) -> tuple[Samples, NDArray[np.intp]]:
    """Split volumes into thin samples, where their circles of confusion differ.

    A volume of even density passes the same part of the light on every length of its way, so the piece of it
    that is the share f of its depth stops ``1 - (1 - alpha)^f``. Its colour is to the whole as its alpha is
    (OpenEXR's *Interpreting deep pixels*).
    """
    front = values["Z"]
    is_volume = (back > front) & (front > 0) & np.isfinite(back)
    near, far = _inverse(front), _inverse(np.where(is_volume, back, front))
    # The disparity of a piece, as layers divide that of its pixel.
    pixel = np.repeat(np.arange(counts.size), counts)
    most, least = np.full(counts.size, -np.inf, np.float32), np.full(counts.size, np.inf, np.float32)
    np.maximum.at(most, pixel, near)
    np.minimum.at(least, pixel, far)
    step = ((most - least) / (_PIECES_PER_LAYER * max_layers))[pixel]
    pieces = np.ones(front.size, np.intp)
    pieces[is_volume] = np.ceil((near - far)[is_volume] / step[is_volume])
    sample = np.repeat(np.arange(front.size), pieces)
    number = _numbered(pieces)
    split = {name: plane[sample] for name, plane in values.items()}
    of_volume = is_volume[sample]
    near, far = near[sample][of_volume], far[sample][of_volume]
    number, count = number[of_volume], pieces[sample][of_volume]
    bounds = [near - (near - far) * (number + end) / count for end in (0, 1)]
    share = (1 / bounds[1] - 1 / bounds[0]) / (1 / far - 1 / near)
    split["Z"][of_volume] = 2 / (bounds[0] + bounds[1])
    alpha = np.clip(split["A"][of_volume], 0, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        stopped = -np.expm1(share * np.log1p(-alpha))
        part = np.where(alpha > 0, stopped / alpha, share)
    split["A"][of_volume] = stopped
    for name in "RGB":
        split[name][of_volume] *= part
    return split, np.bincount(pixel, weights=pieces, minlength=counts.size).astype(np.intp)


def _layered(values: Samples, counts: NDArray[np.intp], max_layers: int) -> Samples:
    """Bring samples to layers, shape (pixels, layers), in memory that grows with the number of samples."""
    shape = (counts.size, max(1, min(max_layers, int(counts.max(initial=0)))))
    layered = {name: np.full(shape, np.inf if name == "Z" else 0.0, np.float32) for name in values}
    first = np.cumsum(counts) - counts
    for pixels in _alike(counts):
        of_each = counts[pixels]
        samples = np.repeat(first[pixels], of_each) + _numbered(of_each)
        chosen = {name: plane[samples] for name, plane in values.items()}
        for name, plane in _merged(_in_order(chosen, of_each), max_layers).items():
            layered[name][pixels, : plane.shape[1]] = plane
    return layered


def _alike(counts: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    """Group pixels by their numbers of samples, so that little is wasted on padding the fewer of a group."""
    order = np.argsort(counts, kind="stable")
    start = 0
    while start < order.size:
        padded = np.arange(1, order.size - start + 1) * counts[order[start:]]
        end = start + max(1, int(np.searchsorted(padded, _PADDED, side="right")))
        yield order[start:end]
        start = end


def _in_order(values: Samples, counts: NDArray[np.intp]) -> Samples:
    """Pad the samples to shape (pixels, samples), the nearest first; what is missing has no coverage."""
    pixel = np.repeat(np.arange(counts.size), counts)
    light = np.maximum.reduce([np.abs(values[name]) for name in "RGB"]) > 0
    alpha = np.where(light & (values["A"] <= 0), np.float32(_GLOW_ALPHA), values["A"])
    seen = (alpha > 0) & ~np.isnan(values["Z"])
    kept = {name: plane[seen] for name, plane in {**values, "A": np.minimum(alpha, 1)}.items()}
    pixel = pixel[seen]
    order = np.lexsort((kept["Z"], pixel))
    counts = np.bincount(pixel, minlength=counts.size)
    place = _numbered(counts)
    shape = (counts.size, max(1, int(counts.max(initial=0))))
    padded = {name: np.full(shape, np.inf if name == "Z" else 0.0, np.float32) for name in kept}
    for name, plane in kept.items():
        padded[name][pixel[order], place] = plane[order]
    return padded


def _merged(samples: Samples, max_layers: int) -> Samples:
    """Merge neighbours until no pixel has more than so many samples."""
    counts = np.count_nonzero(samples["A"], axis=1)
    for count in range(samples["A"].shape[1], max_layers, -1):
        rows = np.flatnonzero(counts == count)
        some = {name: plane[rows, :count] for name, plane in samples.items()}
        # Ward's criterion: by how much the variance of disparity grows, each sample counting by its coverage,
        # for what is hidden from the pinhole is not hidden from the lens.
        front, back = some["A"][:, :-1], some["A"][:, 1:]
        disparity = _inverse(some["Z"])
        pair = np.argmin(front * back / (front + back) * np.diff(disparity, axis=1) ** 2, axis=1)
        first, second = (np.arange(rows.size), pair), (np.arange(rows.size), pair + 1)
        through = 1 - some["A"][first]
        # Where the two become one they are seen as from the front.
        share = through * back[first] / (front[first] + through * back[first])
        behind = np.arange(count - 1) > pair[:, None]
        for name, plane in some.items():
            moved = np.where(behind, plane[:, 1:], plane[:, :-1])
            if name == "Z":
                moved[first] = _inverse(disparity[first] + share * (disparity[second] - disparity[first]))
            else:
                moved[first] = plane[first] + through * plane[second]
            samples[name][rows, : count - 1] = moved
            samples[name][rows, count - 1] = np.inf if name == "Z" else 0.0
        counts[rows] -= 1
    return {name: plane[:, :max_layers] for name, plane in samples.items()}


def _inverse(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Disparity of depth, and back; of infinite depth it is 0."""
    with np.errstate(divide="ignore"):
        return np.float32(1.0) / values


def _widened(layers: NDArray[np.float32], count: int, fill: float) -> NDArray[np.float32]:
    """Add layers of nothing."""
    missing = [(0, 0)] * layers.ndim
    missing[1] = (0, count - layers.shape[1])
    return np.pad(layers, missing, constant_values=fill)


def _displayed(layers: NDArray[np.float32], stored: Window, seen: Window, fill: float) -> NDArray[np.float32]:
    """Cut the pixels that are stored to those to be seen."""
    left, top, *_ = stored
    first, above, columns, rows = seen
    count, height, width, *channels = layers.shape
    out = np.full((count, rows, columns, *channels), fill, np.float32)
    y, x = top - above, left - first
    into = out[:, max(y, 0) : max(y + height, 0), max(x, 0) : max(x + width, 0)]
    into[...] = layers[:, max(-y, 0) :, max(-x, 0) :][:, : into.shape[1], : into.shape[2]]
    return out
