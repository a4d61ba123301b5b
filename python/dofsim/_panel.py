"""Pictures side by side in one PNG, with titles and scales. Drawn by matplotlib, one pixel to a pixel."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ._extras import missing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 100
_TITLE = 30
_GAP = 14
_BAR_ROOM = 150
_BAR_WIDTH = 18
# Narrower pictures are shown larger, so that their titles have room.
_NARROW = 240


@dataclass(frozen=True)
class Scale:
    """Which colours stand for which values.

    Attributes
    ----------
    colors : ndarray of uint8
        Shape (N, 3), the lowest value first.
    ticks : sequence of (float, str)
        Where on the scale, from 0 to 1, and what is written there.
    """

    colors: NDArray[np.uint8]
    ticks: Sequence[tuple[float, str]]


@dataclass(frozen=True)
class Tile:
    """One picture of a panel: its title, its pixels of shape (H, W, 3), and the scale of its colours."""

    title: str
    pixels: NDArray[np.uint8]
    scale: Scale | None = None


def draw(tiles: Sequence[Tile], *, columns: int = 2) -> bytes:
    """Draw pictures of one size in rows.

    Parameters
    ----------
    tiles : sequence of Tile
        The pictures, from the top left.
    columns : int, optional
        How many there are in a row.

    Returns
    -------
    bytes
        A PNG file.

    Raises
    ------
    ImportError
        If matplotlib is missing.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError(missing("drawing needs", "matplotlib", "metrics")) from error
    height, width = tiles[0].pixels.shape[:2]
    zoom = math.ceil(_NARROW / width)
    height, width = zoom * height, zoom * width
    columns = min(columns, len(tiles))
    # Each column is as wide as its picture, and its scale if one of its pictures has one.
    widths = [
        width + _GAP + (_BAR_ROOM if any(tile.scale for tile in tiles[column::columns]) else 0)
        for column in range(columns)
    ]
    full_width = sum(widths) + _GAP
    full_height = math.ceil(len(tiles) / columns) * (_TITLE + height + _GAP)
    figure = Figure(figsize=(full_width / _DPI, full_height / _DPI), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    for index, tile in enumerate(tiles):
        row, column = divmod(index, columns)
        left = _GAP + sum(widths[:column])
        bottom = full_height - (row + 1) * (_TITLE + height + _GAP) + _GAP
        _picture(figure, tile.pixels, left, bottom, width, height)
        figure.text(
            left / full_width,
            (bottom + height + 9) / full_height,
            tile.title,
            fontsize=9,
            color="black",
            verticalalignment="bottom",
            # Titles are names of files, in which a dollar is a dollar.
            parse_math=False,
        )
        if tile.scale:
            _bar(figure, tile.scale, left + width + 8, bottom, height)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI)
    return buffer.getvalue()


def _picture(
    figure: Figure, pixels: NDArray[np.uint8], left: int, bottom: int, width: int, height: int
) -> None:
    """Show pixels in a box given in pixels, without a frame and without smoothing."""
    full_width, full_height = figure.get_size_inches() * _DPI
    axes = figure.add_axes(
        (left / full_width, bottom / full_height, width / full_width, height / full_height)
    )
    axes.imshow(pixels, interpolation="nearest", aspect="auto")
    axes.set_axis_off()


def _bar(figure: Figure, scale: Scale, left: int, bottom: int, height: int) -> None:
    _picture(figure, scale.colors[::-1, np.newaxis], left, bottom, _BAR_WIDTH, height)
    full_width, full_height = figure.get_size_inches() * _DPI
    for place, text in scale.ticks:
        figure.text(
            (left + _BAR_WIDTH + 5) / full_width,
            # Half a line inside the ends, so that no label leaves the picture.
            (bottom + 6 + place * (height - 12)) / full_height,
            text,
            fontsize=8,
            color="black",
            verticalalignment="center",
        )
