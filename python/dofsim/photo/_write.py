"""Photographs into files, as they came."""

from __future__ import annotations

import io as bytes_io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dofsim import _dofsim, io
from dofsim._files import StrPath

from ._packages import load_heif, load_pillow
from ._shot import Photo, codes_of

SUFFIXES = (".jpg", ".jpeg", ".png", ".heic", ".tif", ".tiff")
"""Suffixes of the files that `write` writes."""


def check_writing(path: StrPath, quality: int) -> None:
    """Refuse what `write` could not write, before the work of what is to be written."""
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"{path}: the suffix {suffix!r} is not one of {', '.join(SUFFIXES)}")
    if not 1 <= quality <= 100:
        raise ValueError(f"quality must be from 1 to 100; got {quality}")
    if suffix in (".jpg", ".jpeg", ".heic"):
        load_pillow()
    if suffix == ".heic":
        load_heif()


def write(path: StrPath, pixels: NDArray[Any], photo: Photo, *, quality: int = 95) -> None:
    """Write pixels as a photograph: with its colour profile, its Exif and, where the format can, its bits.

    Parameters
    ----------
    path : str or path-like
        The file: ``.jpg``, ``.jpeg``, ``.png``, ``.heic``, ``.tif`` or ``.tiff``. What was there is replaced.
    pixels : ndarray
        Shape (H, W) or (H, W, C): linear light of the photograph's primaries, as of `render`.
    photo : Photo
        The photograph.
    quality : int, optional
        Of JPEG and HEIC, 1 to 100.

    Raises
    ------
    ValueError
        If the suffix or the quality is another.
    ImportError
        If the format needs a package that is not installed.
    OSError
        If the file cannot be written.
    """
    check_writing(path, quality)
    suffix = Path(path).suffix.lower()
    sixteen = photo.image.pixels.dtype == np.uint16 and suffix in (".png", ".tif", ".tiff")
    if sixteen:
        # Pillow has no colour of 16 bits; nor has what writes it here a place for Exif.
        io.write_image(path, pixels, profile=photo.image.profile, dtype="uint16")
        return
    pillow = load_pillow()
    words: dict[str, Any] = {"icc_profile": photo.image.profile.icc if photo.image.profile else None}
    if photo.exif:
        words["exif"] = photo.exif
    kinds = {".jpg": "JPEG", ".jpeg": "JPEG", ".png": "PNG", ".heic": "HEIF", ".tif": "TIFF", ".tiff": "TIFF"}
    if kinds[suffix] in ("JPEG", "HEIF"):
        words["quality"] = quality
    if kinds[suffix] == "JPEG":
        # Colour at half the size would soften the edges that depth of field leaves sharp.
        words["subsampling"] = 0
    if kinds[suffix] == "HEIF":
        load_heif().register_heif_opener()
    buffer = bytes_io.BytesIO()
    pillow.fromarray(codes_of(pixels, photo.image, sixteen=False)).save(buffer, format=kinds[suffix], **words)
    _dofsim.write_bytes(Path(path), buffer.getvalue())
