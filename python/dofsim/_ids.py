"""Cryptomatte's ranks of ids and coverage through a lens."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _dofsim

_Box = tuple[int, int, int, int]

# Channels that are rendered at a time: what all of them share is then a small part of the time.
_AT_ONCE = 32
# What openings reach beyond the circle of confusion, in radii: the corners of a square.
_OPENING = math.sqrt(2.0)
# Pixels from which a cell may take its value beside those of the blur: of its own surface where lens points
# are sparse, of pure colours, and beyond the edge of what hides it.
_AROUND_PX = 64


def render_ids(
    ids: NDArray[np.floating[Any]],
    depth: NDArray[np.floating[Any]],
    lens: _dofsim.Lens,
    *,
    guide: NDArray[Any],
    device: str = "auto",
    holdout: tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]]] | None = None,
    aperture: _dofsim.Aperture | None = None,
    depth_kind: Any = "z",
    near: float | None = None,
    far: float | None = None,
    depth_range: tuple[float, float] | None = None,
    invalid: Literal["raise", "far"] = "raise",
    invalid_color: Literal["raise", "fill"] = "raise",
    alpha: Literal["premultiplied", "straight", "none"] | None = None,
    transfer: Literal["linear", "srgb"] | None = None,
    overscan: int = 0,
    in_focus: tuple[float, float] | None = None,
    max_coc_px: float | None = None,
    views: int | None = None,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """Return Cryptomatte's ranks of ids and coverage as they are through a lens.

    The coverage of each id goes through the lens as a matte, and every pixel then ranks the ids that it sees.

    Parameters
    ----------
    ids : ndarray
        Shape (H, W, 2 R): an id and its coverage, 0 to 1, for each of R ranks. Ids are told apart by the bits
        of their float32; those without coverage count for nothing. Of a picture in layers, (L, H, W, 2 R):
        in each layer, ids cover as much as its alpha.
    depth, lens
        As for `render`.
    guide : ndarray
        The picture that decides, as for `render`. If it has coverage, that is what the ranks add up to.
    device : str, optional
        Where to compute, as for `render`.
    holdout, aperture, depth_kind, near, far, depth_range, invalid, invalid_color, alpha, transfer, overscan
        As for `render`.
    in_focus, max_coc_px, views, threads
        As for `render`.

    Returns
    -------
    ndarray of float32
        Shape (H, W, 2 R): the R ids that cover most of each pixel, most first, and their coverage. It adds up
        to the guide's coverage through the lens, or to that of all ids if the guide has none; what more than
        R ids cover is shared among these. Pixels that the lens leaves as they were keep every bit, if the
        picture has one layer.

    Raises
    ------
    ValueError, TypeError
        If an argument cannot be used; the text names it, its value and what is accepted.

    Examples
    --------
    >>> import dofsim
    >>> import numpy as np
    >>> beauty = np.ones((32, 48, 3), np.float32)
    >>> ids = np.zeros((32, 48, 4), np.float32)
    >>> ids[:, :24, 0], ids[:, 24:, 0] = 1.5, 2.5
    >>> ids[..., 1] = 1.0
    >>> lens = dofsim.Lens(aperture_radius=0.1, focus_distance=1.0, fov=42.0)
    >>> ranks = dofsim.render_ids(ids, np.full((32, 48), 2.0), lens, guide=beauty)
    >>> [round(float(v), 1) for v in ranks[16, 23]]
    [1.5, 0.6, 2.5, 0.4]
    """
    names, coverage = _read(ids)
    total = _total(guide, alpha, coverage)
    # With the layer before them, if there are several.
    found_at = np.nonzero(coverage > 0)
    *pixels, _ = found_at
    rows, columns = pixels[-2:]
    known, place = np.unique(names[found_at], return_inverse=True)
    covered = coverage[found_at]
    focused = lens if in_focus is None else lens.replace(in_focus=in_focus)
    of_depth: dict[str, Any] = {
        "depth_kind": depth_kind,
        "near": near,
        "far": far,
        "depth_range": depth_range,
        "invalid": invalid,
        "max_coc_px": max_coc_px,
    }
    height, width = coverage.shape[-3:-1]
    reach = _reach(_dofsim.coc(depth, focused, **of_depth)) if len(known) else 0
    # The field of view is that of the output, whose pixels are larger than those of all of the picture.
    reach = math.ceil(reach * width / max(width - 2 * overscan, 1))
    boxes = _boxes(rows, columns, place, len(known), reach)
    channel_of = np.array(_channels(boxes), np.intp)
    count = int(channel_of.max()) + 1 if len(known) else 0

    inner = ..., slice(overscan, height - overscan), slice(overscan, width - overscan), slice(None)
    found = _Ranks((height - 2 * overscan, width - 2 * overscan), coverage.shape[-1])
    for first in range(0, max(count, 1), _AT_ONCE):
        last = min(first + _AT_ONCE, count)
        planes = np.zeros((*total.shape, last - first + (first == 0)), np.float32)
        own = (channel_of[place] >= first) & (channel_of[place] < last)
        np.add.at(planes, (*(at[own] for at in pixels), channel_of[place[own]] - first), covered[own])
        if first == 0:
            planes[..., -1] = total
        seen = _dofsim.render(
            planes,
            depth,
            focused,
            guide=guide,
            kinds="matte",
            device=device,
            holdout=holdout,
            aperture=aperture,
            invalid_color=invalid_color,
            alpha=alpha,
            transfer=transfer,
            overscan=overscan,
            views=views,
            threads=threads,
            **of_depth,
        )
        # What several layers show of a pixel is none of its own values.
        found.moved |= np.any(seen != planes[inner], axis=-1) if planes.ndim == 3 else True
        if first == 0:
            found.total = np.clip(seen[..., -1], 0.0, None)
        for k in np.flatnonzero((channel_of >= first) & (channel_of < last)):
            top, left, bottom, right = (int(v) - overscan for v in boxes[k])
            area = slice(max(top, 0), max(bottom, 0)), slice(max(left, 0), max(right, 0))
            found.add(known[k], seen[(*area, channel_of[k] - first)], area)
    ranked = found.ranked()
    if coverage.ndim == 4:
        return ranked
    # By their bits: an id may be that of no number.
    given = np.ascontiguousarray(np.asarray(ids)[inner], np.float32)
    kept: NDArray[np.uint32] = np.where(found.moved[..., None], ranked.view(np.uint32), given.view(np.uint32))
    return kept.view(np.float32)


class _Ranks:
    """The ids that cover most of each pixel so far, most first."""

    def __init__(self, size: tuple[int, ...], ranks: int) -> None:
        self.names = np.zeros((ranks, *size), np.uint32)
        self.coverage = np.zeros((ranks, *size), np.float32)
        self.moved = np.zeros(size, np.bool_)
        self.total = np.zeros(size, np.float32)

    def add(self, name: np.uint32, coverage: NDArray[np.float32], area: tuple[slice, slice]) -> None:
        """Rank one more id in a part of the picture. What has as much coverage as another comes after it."""
        left, names = coverage.copy(), np.full(coverage.shape, name)
        for rank in range(len(self.names)):
            there, ids = self.coverage[(rank, *area)], self.names[(rank, *area)]
            more = left > there
            left[more], there[more] = there[more], left[more]
            names[more], ids[more] = ids[more], names[more]

    def ranked(self) -> NDArray[np.float32]:
        """Give ids and coverage side by side."""
        all_ranks = self.coverage.sum(axis=0)
        share = np.divide(self.total, all_ranks, out=np.zeros_like(all_ranks), where=all_ranks > 0)
        out = np.empty((*self.total.shape, 2 * len(self.names)), np.float32)
        out[..., 0::2] = np.moveaxis(self.names, 0, -1).view(np.float32)
        out[..., 1::2] = np.moveaxis(self.coverage * share, 0, -1)
        return out


def _read(ids: NDArray[np.floating[Any]]) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    pairs = np.asarray(ids)
    if pairs.ndim not in (3, 4) or pairs.shape[-1] == 0 or pairs.shape[-1] % 2:
        raise ValueError(
            "ids must have shape (H, W, 2 R), or (L, H, W, 2 R) of layers: ids and coverage in turn; got "
            f"{pairs.shape}"
        )
    if pairs.dtype not in (np.float32, np.float64):
        raise TypeError(f"ids must have dtype float32 or float64, which hold ids; got {pairs.dtype}")
    pairs = pairs.astype(np.float32)
    names, coverage = np.ascontiguousarray(pairs[..., 0::2]), np.ascontiguousarray(pairs[..., 1::2])
    wrong = np.argwhere(~((coverage >= 0) & (coverage <= 1 + 1e-3)))
    if len(wrong):
        *layer, row, column, rank = (int(v) for v in wrong[0])
        raise ValueError(
            f"ids must have coverage from 0 to 1; got {coverage[tuple(wrong[0])]:g} in rank {rank} at row "
            f"{row}, column {column}" + (f" of layer {layer[0]}" if layer else "")
        )
    return names.view(np.uint32), coverage


def _total(guide: NDArray[Any], alpha: str | None, coverage: NDArray[np.float32]) -> NDArray[np.float32]:
    """Give what the ranks of each pixel add up to."""
    picture = np.asarray(guide)
    if picture.shape[:-1] != coverage.shape[:-1] and picture.shape != coverage.shape[:-1]:
        raise ValueError(
            "guide must have the rows and columns of ids, and as many layers; got "
            f"{picture.shape} beside {(*coverage.shape[:-1], 2 * coverage.shape[-1])}"
        )
    channels = picture.shape[-1] if picture.ndim == coverage.ndim else 1
    if alpha == "none" or not (channels == 4 or (alpha is not None and channels == 2)):
        total: NDArray[np.float32] = coverage.sum(axis=-1)
        return total
    whole = np.iinfo(picture.dtype).max if np.issubdtype(picture.dtype, np.integer) else 1
    return (picture[..., -1] / whole).astype(np.float32)


def _reach(radii_px: NDArray[np.float32]) -> float:
    """Give how far a pixel's value may come: across the opening, and from beside what hides it."""
    nearest, farthest = float(radii_px.max()), float(radii_px.min())
    return _OPENING * max(abs(nearest), abs(farthest)) + (nearest - farthest) + _AROUND_PX


def _boxes(
    rows: NDArray[np.intp], columns: NDArray[np.intp], place: NDArray[np.intp], count: int, reach: int
) -> NDArray[np.intp]:
    """Give the part of the picture that each id may cover: first and end of rows and columns."""
    boxes = np.empty((count, 4), np.intp)
    order = np.argsort(place, kind="stable")
    starts = np.searchsorted(place[order], np.arange(count))
    for axis, values in enumerate((rows, columns)):
        if count:
            boxes[:, axis] = np.minimum.reduceat(values[order], starts) - reach
            boxes[:, axis + 2] = np.maximum.reduceat(values[order], starts) + reach + 1
    return boxes


def _channels(boxes: NDArray[np.intp]) -> list[int]:
    """Share channels among ids whose boxes do not meet: give each its number."""
    taken: list[list[NDArray[np.intp]]] = []
    numbers = []
    for box in boxes:
        number = next((i for i, others in enumerate(taken) if not _meets(box, np.stack(others))), len(taken))
        if number == len(taken):
            taken.append([])
        taken[number].append(box)
        numbers.append(number)
    return numbers


def _meets(box: NDArray[np.intp], others: NDArray[np.intp]) -> bool:
    return bool(np.any(np.all((others[:, :2] < box[2:]) & (box[:2] < others[:, 2:]), axis=1)))
