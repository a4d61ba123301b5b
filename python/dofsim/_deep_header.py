"""What a deep OpenEXR file claims, held against its length before the OpenEXR library believes it."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from mmap import ACCESS_READ, mmap

from ._files import StrPath, open_regular

# A stored pixel takes two bytes at the least (a deep one four, for its number of samples), and deflate makes
# no more than this of one byte.
_STORED_PER_BYTE = 1032 // 2
# What any file may claim is seen, and what each of its bytes adds, as the readers of flat pictures have it.
_ALWAYS_SEEN = 1 << 24
_SEEN_PER_BYTE = 96

_SEVERAL_PARTS = 1 << 12

Box = tuple[int, int, int, int]


def check_claims(path: StrPath) -> None:
    """Refuse a file whose windows are larger than its length allows.

    Parameters
    ----------
    path : str or path-like
        An OpenEXR file.

    Raises
    ------
    ValueError
        If a part claims pixels that the file cannot hold, or if its header is damaged.
    """
    with open_regular(path) as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        most = {
            b"dataWindow": _STORED_PER_BYTE * len(data),
            b"displayWindow": _ALWAYS_SEEN + _SEEN_PER_BYTE * len(data),
        }
        try:
            for name, (x0, y0, x1, y1) in _windows(data):
                width, height = x1 - x0 + 1, y1 - y0 + 1
                if width < 1 or height < 1 or width * height > most[name]:
                    raise ValueError(
                        f"{path}: damaged file: its header claims {width} x {height} pixels, which a file of "
                        f"{len(data)} bytes cannot hold"
                    )
        except (struct.error, IndexError) as error:
            raise ValueError(f"{path}: damaged file: its header ends too early") from error


def _windows(data: mmap) -> Iterator[tuple[bytes, Box]]:
    """Yield the windows of all parts: a header is attributes and an empty name; an empty one ends several."""
    (version,) = struct.unpack_from("<I", data, 4)
    at = 8
    while data[at]:
        while data[at]:
            name, at = _word(data, at)
            _, at = _word(data, at)
            (size,) = struct.unpack_from("<I", data, at)
            if name in (b"dataWindow", b"displayWindow"):
                x0, y0, x1, y1 = struct.unpack_from("<4i", data, at + 4)
                yield name, (x0, y0, x1, y1)
            at += 4 + size
        at += 1
        if not version & _SEVERAL_PARTS:
            return


def _word(data: mmap, start: int) -> tuple[bytes, int]:
    """Read the bytes before the next zero, and where those after it begin."""
    end = data.find(b"\0", start)
    if end < 0:
        raise IndexError
    return data[start:end], end + 1
