"""Exif: the lens that a photograph was taken with, and what is kept of the rest."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from ._packages import load_pillow
from ._shot import Photo

# Tags of Exif.
ORIENTATION = 0x0112
_EXIF_IFD, _F_NUMBER, _FOCAL_LENGTH, _FOCAL_LENGTH_35 = 0x8769, 0x829D, 0x920A, 0xA405


def with_exif(photo: Photo, exif: bytes | None) -> Photo:
    """Read the lens from Exif, and keep the rest without orientation. Damaged Exif is left out."""
    if not exif:
        return photo
    try:
        pillow = load_pillow()
    except ImportError:
        return photo
    try:
        tags = pillow.Exif()
        tags.load(exif)
        inner = tags.get_ifd(_EXIF_IFD)
        tags.pop(ORIENTATION, None)
        focal, f_number = _number(inner.get(_FOCAL_LENGTH_35)), _number(inner.get(_F_NUMBER))
        kept = tags.tobytes()
    except (
        SyntaxError,
        ValueError,
        TypeError,
        KeyError,
        OverflowError,
        OSError,
        EOFError,
        AttributeError,
        IndexError,
    ):
        return photo
    except Exception as error:
        # What Pillow meets in damaged Exif is of many kinds, such as struct.error and ZeroDivisionError.
        if type(error).__module__ in ("struct", "builtins"):
            return photo
        raise
    return replace(photo, exif=kept, focal_length_35mm=focal, f_number=f_number)


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and 0 < number < 1e5 else None
