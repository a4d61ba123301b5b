"""Lens maps from pictures of blurred points, and their files."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dofsim import _arrays
from dofsim._dofsim import LensMap
from dofsim._files import StrPath

_FIELD, _GRID = ("field",), ("field_x", "field_y")
_OFFSETS = ("behind", "in_front", "focused")


def lens_points(points: int) -> NDArray[np.float64]:
    """Give the lens points of a map, of shape (N, N, 2), as columns and rows from -1 to 1."""
    at = np.linspace(-1.0, 1.0, points)
    return np.stack(np.meshgrid(at, at), axis=-1)


def _rank(points: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Give of each lens point the part of a disc's light above it, and that of its row to the left of it."""
    x, y = np.moveaxis(lens_points(points), -1, 0)
    outside = np.hypot(x, y) > 1 + 1e-9
    chord = np.sqrt(np.maximum(1 - y * y, 0.0))
    above = 0.5 + (np.arcsin(y) + y * chord) / np.pi
    left = np.where(chord > 0, 0.5 + 0.5 * x / np.where(chord > 0, chord, 1.0), 0.5)
    above[outside] = left[outside] = np.nan
    return above, np.clip(left, 0.0, 1.0)


def _places(picture: NDArray[np.float64], points: int) -> NDArray[np.float64]:
    """Give the places in the square from -1 to 1 to which a disc's light goes to fill a picture."""
    rows, columns = picture.shape
    above, left = _rank(points)
    by_row = np.concatenate([[0.0], np.cumsum(picture.sum(1))])
    edges = np.linspace(-1.0, 1.0, rows + 1)
    # Where rows are dark, their ends have the same light above them: any of them will do.
    y = np.interp(above * by_row[-1], by_row, edges)
    lit = np.flatnonzero(picture.sum(1) > 0)
    # The cumulated light of each row that has any, between the middles of rows.
    by_column = np.concatenate([np.zeros((len(lit), 1)), np.cumsum(picture[lit], 1)], axis=1)
    by_column /= by_column[:, -1:]
    middle = (edges[lit] + edges[lit + 1]) / 2
    across = np.linspace(-1.0, 1.0, columns + 1)
    # Where a part of a row's light lies, for many parts: then it can be interpolated between rows.
    parts = np.linspace(0.0, 1.0, 4 * columns + 1)
    where = np.stack([np.interp(parts, row, across) for row in by_column])
    row = np.interp(y, middle, np.arange(len(lit)))
    first = np.clip(np.nan_to_num(row).astype(int), 0, max(len(lit) - 2, 0))
    second = np.minimum(first + 1, len(lit) - 1)
    part = np.nan_to_num(left) * (len(parts) - 1)
    column = np.clip(part.astype(int), 0, len(parts) - 2)
    beyond = part - column

    def at(number: NDArray[np.int_]) -> NDArray[np.float64]:
        left, right = where[number, column], where[number, column + 1]
        between: NDArray[np.float64] = left + beyond * (right - left)
        return between

    share = row - first
    x = at(first) + share * (at(second) - at(first))
    return np.stack([x, y], axis=-1)


def _pictures(name: str, given: ArrayLike, places: tuple[int, ...]) -> NDArray[np.float64]:
    """Read pictures at so many places, or rows and columns of places, one after another."""
    pictures = np.asarray(given, np.float64)
    if pictures.shape[:-2] != places or 0 in pictures.shape:
        shape = "(F, H, W)" if len(places) == 1 else "(Y, X, H, W)"
        count = " x ".join(map(str, places))
        raise ValueError(
            f"{name} must have shape {shape} with {count} pictures as field; got {pictures.shape}"
        )
    if not (np.isfinite(pictures).all() and (pictures >= 0).all()):
        raise ValueError(f"{name} must hold light, finite and not negative")
    if not pictures.any(axis=(-2, -1)).all():
        raise ValueError(f"{name} must hold light in every picture; got a dark one")
    return pictures.reshape(-1, *pictures.shape[-2:])


def from_pictures(
    field: ArrayLike,
    behind: ArrayLike,
    in_front: ArrayLike | None,
    focused: ArrayLike | None,
    focused_size: float | None,
    points: int,
) -> LensMap:
    """Make `LensMap.from_pictures`."""
    if isinstance(field, tuple) and len(field) == 2 and all(map(np.ndim, field)):
        places: tuple[int, ...] = (len(field[1]), len(field[0]))
    else:
        field = np.atleast_1d(np.asarray(field, np.float64))
        places = (len(field),)
    if points < 3:
        raise ValueError(f"points must be at least 3; got {points}")
    if (focused is None) != (focused_size is None):
        raise TypeError("from_pictures() takes focused and focused_size together")
    words: dict[str, Any] = {}

    def landings(pictures: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.reshape([_places(picture, points) for picture in pictures], (*places, points, points, 2))

    if in_front is not None:
        words["in_front"] = landings(_pictures("in_front", in_front, places)[:, ::-1, ::-1])
    if focused is not None and focused_size is not None:
        if not (np.isfinite(focused_size) and focused_size > 0):
            raise ValueError(f"focused_size must be a number of half diagonals above 0; got {focused_size}")
        words["focused"] = 0.5 * focused_size * landings(_pictures("focused", focused, places))
    return LensMap(field, landings(_pictures("behind", behind, places)), **words)


def save(lens_map: LensMap, path: StrPath) -> None:
    """Make `LensMap.save`."""
    field = lens_map.field
    names, places = (_GRID, field) if isinstance(field, tuple) else (_FIELD, (field,))
    arrays = dict(zip(names, places, strict=True))
    _arrays.write_npz(path, arrays | {name: getattr(lens_map, name) for name in _OFFSETS})


def load(path: StrPath) -> LensMap:
    """Make `LensMap.load`."""
    try:
        is_grid = set(_GRID).issubset(_arrays.npz_names(path))
        places = [_arrays.read_npz(path, name, ()) for name in (_GRID if is_grid else _FIELD)]
        behind, in_front, focused = (_arrays.read_npz(path, name, ()) for name in _OFFSETS)
    except ValueError as error:
        names = ", ".join((*_FIELD, *_OFFSETS))
        raise ValueError(
            f"{os.fspath(path)}: not a lens map, which is an archive with {names}: {error}"
        ) from error
    return LensMap(tuple(places) if is_grid else places[0], behind, in_front=in_front, focused=focused)
