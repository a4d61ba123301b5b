"""Gain maps: how many times as bright as white a photograph's highlights are.

Phones put a small picture behind the photograph, which says of each pixel by how much it is brighter on a
display that can show it: Ultra HDR and ISO 21496-1 as a logarithm between two bounds, Apple as a share of
what is beyond white. Here each becomes the factor of a white pixel.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dofsim._files import StrPath

from ._jpeg_parts import APP2, Jpeg, segments
from ._packages import load_pillow

_ISO = b"urn:iso:std:iso:ts:21496:-1\0"
_HDRGM = "{http://ns.adobe.com/hdr-gain-map/1.0/}"
_APPLE_KIND = "{http://ns.apple.com/pixeldatainfo/1.0/}AuxiliaryImageType"
_APPLE_HEADROOM = "{http://ns.apple.com/HDRGainMap/1.0/}HDRGainMapHeadroom"
APPLE = "urn:com:apple:photo:2020:aux:hdrgainmap"
"""What Apple calls a gain map among the auxiliary pictures of HEIC."""
# Flags of ISO 21496-1, from the first byte behind two versions.
_CHANNELS_DIFFER, _ONE_DENOMINATOR, _BASE_IS_HDR = 0x80, 0x08, 0x04
# More than these powers of two no display shows and no sensor measures.
_MOST_STOPS = 64.0
_MAKER_NOTE, _EXIF_IFD = 0x927C, 0x8769
_APPLE_NOTE = b"Apple iOS\0"


@dataclass(frozen=True)
class _Channel:
    """What the codes of a channel mean, as ISO 21496-1 has it."""

    least: float
    greatest: float
    gamma: float = 1.0
    base_offset: float = 1 / 64
    alternate_offset: float = 1 / 64

    def __post_init__(self) -> None:
        numbers = (self.least, self.greatest, self.gamma, self.base_offset, self.alternate_offset)
        if not all(math.isfinite(v) and abs(v) <= _MOST_STOPS for v in numbers) or self.gamma <= 0.0:
            raise ValueError("its numbers make no sense")

    def of_white(self, share: NDArray[np.float32]) -> NDArray[np.float32]:
        """Give the light of a white pixel, of the codes' share of the largest one."""
        stops = self.least + (self.greatest - self.least) * share ** (1.0 / self.gamma)
        light: NDArray[np.float32] = (1.0 + self.base_offset) * np.exp2(stops) - self.alternate_offset
        return light


def of_jpeg(jpeg: Jpeg, exif: bytes | None, decode: Any) -> NDArray[np.float32] | None:
    """Read the gain map of a JPEG.

    Parameters
    ----------
    jpeg : Jpeg
        The photograph.
    exif : bytes, optional
        Its Exif.
    decode : callable
        Gives the codes of a JPEG in memory.

    Returns
    -------
    ndarray of float32 or None
        Shape (h, w): the factor of a white pixel. None if there is no gain map.

    Raises
    ------
    ValueError
        If it is damaged.
    """
    for data in jpeg.pictures():
        try:
            part = Jpeg(jpeg.path, data)
            channels = _of_iso(data) or _of_xmp(part.words)
            if channels is None and part.words.get(_APPLE_KIND) != APPLE:
                continue
            share = _shares(decode(data))
            if channels is None:
                return of_apple(share, _positive(part.words.get(_APPLE_HEADROOM)) or headroom(exif))
            lights = [
                channel.of_white(share if share.ndim == 2 else share[..., i % share.shape[-1]])
                for i, channel in enumerate(channels if share.ndim > 2 else channels[:1])
            ]
        except (ValueError, struct.error, ZeroDivisionError) as error:
            raise ValueError(f"{jpeg.path}: damaged file: its gain map: {error}") from error
        # One factor a pixel, for what is beyond white has lost its colour.
        gains: NDArray[np.float32] = np.mean(lights, 0, dtype=np.float32)
        return gains
    return None


def of_apple(share: NDArray[np.float32], headroom: float) -> NDArray[np.float32]:
    """Give the factors of Apple's gain map.

    Parameters
    ----------
    share : ndarray of float32
        Codes, 0 to 1, shape (h, w) or (h, w, c) with equal channels. They stand for light as those of
        Rec. 709.
    headroom : float
        The light of the brightest white.

    Returns
    -------
    ndarray of float32
        Shape (h, w).
    """
    codes = share if share.ndim == 2 else share[..., 0]
    light = np.where(codes < 0.081, codes / 4.5, ((codes + 0.099) / 1.099) ** (1 / 0.45))
    return (1.0 + (headroom - 1.0) * light).astype(np.float32)


def _shares(codes: NDArray[Any]) -> NDArray[np.float32]:
    if codes.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"found {codes.dtype}; a gain map has integers")
    return codes.astype(np.float32) / np.float32(np.iinfo(codes.dtype).max)


def of_heif(path: StrPath, picture: Any, exif: bytes | None) -> NDArray[np.float32] | None:
    """Read Apple's gain map from a HEIC picture of pillow-heif.

    Parameters
    ----------
    path : str or path-like
        The file, for errors.
    picture : pillow_heif.HeifFile
        The photograph.
    exif : bytes, optional
        Its Exif.

    Returns
    -------
    ndarray of float32 or None
        As `of_jpeg`.

    Raises
    ------
    ValueError
        If it is damaged.
    """
    places = (picture.info.get("aux") or {}).get(APPLE) or []
    if not places:
        return None
    try:
        return of_apple(_shares(np.asarray(picture.get_aux_image(places[0]))), headroom(exif))
    except (ValueError, RuntimeError, OSError, EOFError, SyntaxError, LookupError) as error:
        raise ValueError(f"{path}: damaged file: its gain map: {error}") from error


def _of_iso(data: bytes) -> list[_Channel] | None:
    """Read what ISO 21496-1 says of a gain map."""
    bodies = [body[len(_ISO) :] for body in segments(data, APP2) if body.startswith(_ISO)]
    # Of the photograph itself there are the two versions alone.
    whole = [body for body in bodies if len(body) > 5]
    if not whole:
        return None
    body = whole[0]
    (flags,) = struct.unpack(">B", body[4:5])
    if flags & _BASE_IS_HDR:
        return None
    count = 3 if flags & _CHANNELS_DIFFER else 1
    if flags & _ONE_DENOMINATOR:
        # A denominator and two headrooms, then five numerators a channel.
        (denominator,) = struct.unpack(">I", body[5:9])
        rows = [struct.unpack(">iiIii", body[17 + 20 * c : 37 + 20 * c]) for c in range(count)]
        return [_Channel(*(v / denominator for v in row)) for row in rows]
    # Two headrooms, then five fractions a channel.
    rows = [struct.unpack(">iIiIIIiIiI", body[21 + 40 * c : 61 + 40 * c]) for c in range(count)]
    return [_Channel(*(row[i] / row[i + 1] for i in range(0, 10, 2))) for row in rows]


def _of_xmp(words: dict[str, str]) -> list[_Channel] | None:
    """Read what Ultra HDR says of a gain map."""
    if _HDRGM + "Version" not in words or words.get(_HDRGM + "BaseRenditionIsHDR", "").lower() == "true":
        return None
    usual = {"GainMapMin": 0, "GainMapMax": 1, "Gamma": 1, "OffsetSDR": 1 / 64, "OffsetHDR": 1 / 64}
    texts = [words.get(_HDRGM + name, str(number)) for name, number in usual.items()]
    values = [[float(number) for number in text.split()] for text in texts]
    if not all(len(row) in (1, 3) for row in values):
        raise ValueError("its numbers are neither one nor three")
    return [_Channel(*(row[c % len(row)] for row in values)) for c in range(max(map(len, values)))]


def headroom(exif: bytes | None) -> float:
    """Give the light of the brightest white that Apple's notes in Exif tell; 1 if they are not there.

    Parameters
    ----------
    exif : bytes, optional
        Exif.

    Returns
    -------
    float
        At least 1.
    """
    notes = _apple_notes(exif)
    if 33 not in notes or 48 not in notes:
        return 1.0
    # Apple's own article on its gain maps has these lines.
    strong, local = notes[33] >= 1.0, notes[48]
    if local <= 0.01:
        stops = -70.0 * local + 3.0 if strong else -20.0 * local + 1.8
    else:
        stops = -0.303 * local + 2.303 if strong else -0.101 * local + 1.601
    return float(2.0 ** min(max(stops, 0.0), 8.0))


def _apple_notes(exif: bytes | None) -> dict[int, float]:
    """Read the fractions of Apple's notes: a directory of TIFF, whose places count from the notes' start."""
    if not exif:
        return {}
    try:
        tags = load_pillow().Exif()
        tags.load(exif)
        note = tags.get_ifd(_EXIF_IFD).get(_MAKER_NOTE)
    except Exception:
        # Damaged Exif has no notes.
        return {}
    if not isinstance(note, bytes) or not note.startswith(_APPLE_NOTE):
        return {}
    found = {}
    count = int.from_bytes(note[14:16], "big")
    for at in range(16, min(16 + 12 * count, len(note) - 11), 12):
        tag, kind, values, place = struct.unpack(">HHII", note[at : at + 12])
        if kind == 10 and values == 1 and place + 8 <= len(note):
            above, below = struct.unpack(">ii", note[place : place + 8])
            if below != 0:
                found[tag] = above / below
    return found


def _positive(text: str | None) -> float | None:
    try:
        value = float(text or "nan")
    except ValueError:
        return None
    return value if 1.0 <= value <= 2.0**8 else None
