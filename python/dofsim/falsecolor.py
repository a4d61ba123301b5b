"""Circles of confusion as colours: near red, far blue, in focus light; and errors as heat."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _panel

__all__ = ["draw_coc", "false_color", "heat", "round_limit"]

# sRGB code values from nearest to farthest. Lightness falls evenly to both sides, so that the sharp zone is
# seen without colour vision too.
_STOPS = np.array(
    [[0.40, 0.00, 0.05], [0.80, 0.24, 0.20], [0.95, 0.94, 0.92], [0.25, 0.48, 0.78], [0.03, 0.15, 0.42]]
)
# The same from no error to the largest: lightness rises evenly.
_HEAT_STOPS = np.array([[0, 0, 0], [90, 20, 110], [220, 70, 70], [254, 190, 110], [252, 253, 191]]) / 255.0


def false_color(radius: ArrayLike, limit: float) -> NDArray[np.uint8]:
    """Colour signed radii of circles of confusion.

    Parameters
    ----------
    radius : array_like
        Signed radius in pixels, any shape; negative in front of the plane in focus, as from `dofsim.coc`.
    limit : float
        The radius in pixels at which the colours end.

    Returns
    -------
    ndarray of uint8
        The shape of ``radius`` and 3 channels of sRGB code values: red in front, blue behind, light in focus.

    Raises
    ------
    ValueError
        If the limit is not positive.

    Examples
    --------
    >>> from dofsim.falsecolor import false_color
    >>> false_color([-8.0, 0.0, 8.0], limit=8.0).tolist()
    [[102, 0, 13], [242, 240, 235], [8, 38, 107]]
    """
    if not limit > 0 or not math.isfinite(limit):
        raise ValueError(f"limit must be positive and finite, not {limit}")
    return _between(_STOPS, 0.5 + 0.5 * np.asarray(radius, dtype=np.float64) / limit)


def heat(values: ArrayLike) -> NDArray[np.uint8]:
    """Colour errors: black where there is none, light where it is 1.

    Parameters
    ----------
    values : array_like
        Any shape; those outside 0 to 1 have the colours of the ends.

    Returns
    -------
    ndarray of uint8
        The shape of ``values`` and 3 channels of sRGB code values.

    Examples
    --------
    >>> from dofsim.falsecolor import heat
    >>> heat([0.0, 1.0]).tolist()
    [[0, 0, 0], [252, 253, 191]]
    """
    return _between(_HEAT_STOPS, np.asarray(values, dtype=np.float64))


def _between(stops: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Interpolate colours that are evenly spaced from 0 to 1."""
    places = np.linspace(0.0, 1.0, len(stops))
    channels = [np.interp(place, places, stops[:, channel]) for channel in range(3)]
    codes: NDArray[np.uint8] = np.rint(np.stack(channels, axis=-1) * 255).astype(np.uint8)
    return codes


def draw_coc(radius: NDArray[np.float32], *, limit: float | None = None) -> bytes:
    """Draw the radii of a picture with a scale beside it.

    Parameters
    ----------
    radius : ndarray
        Shape (H, W), signed radius in pixels.
    limit : float, optional
        The radius at which the colours end. The default is the next round number above the largest radius.

    Returns
    -------
    bytes
        A PNG file.

    Raises
    ------
    ImportError
        If matplotlib is missing.
    ValueError
        If the limit is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from dofsim.falsecolor import draw_coc
    >>> draw_coc(np.zeros((4, 4), np.float32))[1:4]
    b'PNG'
    """
    if limit is None:
        limit = round_limit(radius)
    ticks = [
        (0.0, f"-{limit:g} px, near"),
        (0.25, f"-{limit / 2:g} px"),
        (0.5, "0 px, in focus"),
        (0.75, f"+{limit / 2:g} px"),
        (1.0, f"+{limit:g} px, far"),
    ]
    scale = _panel.Scale(false_color(np.linspace(-limit, limit, 256), limit), ticks)
    tile = _panel.Tile("Circle of confusion, signed radius", false_color(radius, limit), scale)
    return _panel.draw([tile])


def round_limit(radius: ArrayLike) -> float:
    """Give the next of 1, 2 or 5 times a power of ten above the largest radius; 1 if all is sharp.

    Examples
    --------
    >>> from dofsim.falsecolor import round_limit
    >>> round_limit([-13.0, 4.0])
    20.0
    """
    largest = float(np.max(np.abs(np.asarray(radius, dtype=np.float64))))
    if not largest > 0 or not math.isfinite(largest):
        return 1.0
    power = 10.0 ** math.floor(math.log10(largest))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if largest <= step * power)
