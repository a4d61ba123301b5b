"""Colour profiles of pictures, as ICC files describe them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _dofsim

# The greatest difference in linear light from sRGB's curve of what is sRGB, in tables of 1024 steps, too.
_SAME = 5e-4
# CIE XYZ of D50 of the primaries of Rec. 709, which are those of sRGB, as ICC's own sRGB profile has them.
_REC709 = np.array([[0.43607, 0.38515, 0.14307], [0.22249, 0.71687, 0.06061], [0.01392, 0.09708, 0.71410]])


@dataclass(frozen=True, eq=False)
class ColorProfile:
    """What the integers of a picture mean: the curves and the primaries of an ICC profile.

    Attributes
    ----------
    icc : bytes
        The profile as a file holds it.
    name : str
        What it calls itself.
    curves : ndarray of float32
        Shape (1, 65536) for grey and (3, 65536) for colour: linear light of every 16-bit code.
    to_xyz : ndarray of float64
        Shape (3, 3): from linear light of its primaries to CIE XYZ of D50.
    """

    icc: bytes
    name: str
    curves: NDArray[np.float32]
    to_xyz: NDArray[np.float64]

    @classmethod
    def parse(cls, icc: bytes, lights: int) -> ColorProfile:
        """Parse a profile.

        Parameters
        ----------
        icc : bytes
            The profile.
        lights : int
            Channels of light of the picture, 1 or 3.

        Returns
        -------
        ColorProfile
            What it says.

        Raises
        ------
        ValueError
            If it is damaged, of another kind of colour, or has no tone curves.
        """
        name, curves, to_xyz = _dofsim.parse_profile(icc, lights)
        return cls(icc, name, curves.reshape(lights, -1), np.array(to_xyz))

    @cached_property
    def is_srgb_coded(self) -> bool:
        """Whether the codes stand for light as those of sRGB do; Display P3's do."""
        codes = np.arange(1 << 16, dtype=np.uint16).reshape(1, -1)
        srgb = _dofsim.decode_codes(codes, srgb=True, alpha=False)
        return bool(np.abs(self.curves - srgb).max() < _SAME)

    @property
    def to_rec709(self) -> NDArray[np.float64]:
        """The matrix from linear light of these primaries to that of Rec. 709; the identity for grey."""
        if len(self.curves) == 1:
            return np.eye(3)
        return np.linalg.solve(_REC709, self.to_xyz)

    def decode(self, codes: NDArray[Any]) -> NDArray[np.float32]:
        """Give the linear light of uint8 or uint16; coverage behind the light stays as it is."""
        return _dofsim.decode_by_curves(np.ascontiguousarray(codes), self.curves)

    def encode(self, values: NDArray[Any], *, sixteen: bool) -> NDArray[Any]:
        """Give the codes of linear light as uint8, or as uint16."""
        plain = np.ascontiguousarray(values, np.float32)
        return _dofsim.encode_by_curves(plain, self.curves, sixteen=sixteen)

    def __repr__(self) -> str:
        """Say which it is."""
        return f"<ColorProfile {self.name!r}>"
