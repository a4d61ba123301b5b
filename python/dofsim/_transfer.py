"""The sRGB transfer function and the 8- and 16-bit integers that go with it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def decode(values: NDArray[np.integer[Any]], *, srgb: bool) -> NDArray[np.float32]:
    """Integers to floats from 0 to 1, from sRGB code values to linear light if ``srgb``.

    The domain is small, so the function is tabulated: one value for every code.
    """
    largest = np.iinfo(values.dtype).max
    table = np.arange(largest + 1) / largest
    if srgb:
        table = np.where(table <= 0.04045, table / 12.92, ((table + 0.055) / 1.055) ** 2.4)
    decoded: NDArray[np.float32] = table.astype(np.float32)[values]
    return decoded


def encode(values: NDArray[Any], dtype: type[np.integer[Any]], *, srgb: bool) -> NDArray[Any]:
    """Floats to integers, clipped to 0 to 1, from linear light to sRGB code values if ``srgb``.

    NaN becomes 0: it has no place among integers.
    """
    values = np.clip(np.nan_to_num(values.astype(np.float32), nan=0.0), 0.0, 1.0)
    if srgb:
        values = np.where(values <= 0.0031308, values * 12.92, 1.055 * values ** (1 / 2.4) - 0.055)
    codes: NDArray[Any] = np.rint(values * np.iinfo(dtype).max).astype(dtype)
    return codes


def premultiply(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Colour times alpha, where alpha is the last channel."""
    return np.concatenate([values[..., :-1] * values[..., -1:], values[..., -1:]], axis=-1)


def unpremultiply(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Colour divided by alpha, where alpha is the last channel; 0 where alpha is 0."""
    color, alpha = values[..., :-1], values[..., -1:]
    color = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
    return np.concatenate([color, alpha], axis=-1)
