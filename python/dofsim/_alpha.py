"""Colour multiplied by alpha or not, where alpha is the last channel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def premultiply(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Multiply colour by alpha."""
    return np.concatenate([values[..., :-1] * values[..., -1:], values[..., -1:]], axis=-1)


def unpremultiply(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Divide colour by alpha; 0 where alpha is 0."""
    color, alpha = values[..., :-1], values[..., -1:]
    color = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0)
    return np.concatenate([color, alpha], axis=-1)
