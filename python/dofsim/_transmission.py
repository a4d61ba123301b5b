"""The transmission of an opening as a picture."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray


def read_transmission(image: Any) -> NDArray[np.float64]:
    """Read the picture of an opening: an array of shape (H, W), or a file, whose colours are averaged.

    Raises
    ------
    TypeError
        If it is neither.
    """
    plane: Any = image
    if isinstance(image, (str, os.PathLike)):
        from .io import read_color

        plane = read_color(image).to_linear()
        if plane.ndim == 3:
            channels = plane.shape[-1]
            # The second of two channels and the fourth of four are alpha.
            colors = 1 if channels == 2 else min(channels, 3)
            plane = np.mean([plane[..., channel] for channel in range(colors)], axis=0)
    try:
        transmission = np.asarray(plane, np.float64)
    except Exception:
        transmission = None
    if transmission is None or transmission.ndim != 2:
        raise TypeError(
            f"image must be a two-dimensional array of numbers or the path of a picture; got {image!r}"
        )
    return transmission
