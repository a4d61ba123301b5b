"""Photographs with depth: from phones, and with a depth map from a network.

`read` gives the picture upright, with its colour profile, its Exif and its depth; `render` blurs it, and
`write` writes it in the same colours. Reading HEIC and AVIF, and writing JPEG and HEIC, takes
the extra ``photo``.
"""

from ._looks import lens_for, refined, refined_with_coverage, render, subject, with_grain
from ._read import read, read_depth, read_matte
from ._shot import Photo
from ._write import SUFFIXES, write

__all__ = [
    "SUFFIXES",
    "Photo",
    "lens_for",
    "read",
    "read_depth",
    "read_matte",
    "refined",
    "refined_with_coverage",
    "render",
    "subject",
    "with_grain",
    "write",
]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
