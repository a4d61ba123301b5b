"""A photograph in memory, and the way between its codes and light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dofsim import _dofsim, io


@dataclass(frozen=True, eq=False)
class Photo:
    """A photograph, upright.

    Attributes
    ----------
    image : dofsim.io.Image
        The pixels, uint8 or uint16, and what they mean.
    depth : ndarray of float32, optional
        Shape (h, w), of any size: relative disparity, larger is nearer. None if the file has no depth.
    gains : ndarray of float32, optional
        Shape (h, w), of any size: how many times as bright as white a white pixel is by the photograph's gain
        map (Ultra HDR, ISO 21496-1, Apple). None if the file has no gain map.
    exif : bytes, optional
        Exif without its orientation.
    focal_length_35mm : float, optional
        The focal length in millimetres of the same view on a frame of 36 x 24 mm.
    f_number : float, optional
        The f-number that the photograph was taken with.
    """

    image: io.Image
    depth: NDArray[np.float32] | None = None
    gains: NDArray[np.float32] | None = None
    exif: bytes | None = None
    focal_length_35mm: float | None = None
    f_number: float | None = None


def opaque(image: io.Image) -> NDArray[np.float32]:
    """Give linear light over black."""
    linear = image.to_linear()
    return linear if image.alpha == "none" else np.ascontiguousarray(linear[..., :-1])


def codes_of(linear: NDArray[Any], image: io.Image, *, sixteen: bool) -> NDArray[Any]:
    values = np.ascontiguousarray(linear, np.float32)
    if image.transfer == "profile" and image.profile is not None:
        return image.profile.encode(values, sixteen=sixteen)
    return _dofsim.encode_codes(values, sixteen=sixteen, alpha=False)


def light_of(codes: NDArray[Any], image: io.Image) -> NDArray[np.float32]:
    return io.Image(codes, image.transfer, "none", profile=image.profile).to_linear()
