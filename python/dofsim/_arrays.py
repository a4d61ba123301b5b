"""NPY and NPZ files, read with the same care as the others: no pickles, no claims beyond the file."""

from __future__ import annotations

import errno
import io
import lzma
import math
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tokenize import TokenError
from typing import Any, BinaryIO, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from . import _dofsim
from ._files import StrPath, open_regular
from ._names import listed

# The most that deflate makes of one byte.
_DEFLATED = 1032
# Bytes that are inflated at a time.
_AT_ONCE = 1 << 20
# NumPy itself parses no longer headers.
_LONGEST_HEADER = 10_000


def read_npy(path: StrPath) -> NDArray[Any]:
    """Read the array of an NPY file."""
    with open_regular(path) as file, _damage(path):
        return _read_member(file, Path(path).stat().st_size)


def npz_names(path: StrPath) -> list[str]:
    """List the names of the arrays in an NPZ file."""
    with open_regular(path) as file, _damage(path), zipfile.ZipFile(file) as archive:
        return [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]


class Header(NamedTuple):
    """What the header of an array says."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]


def npz_headers(path: StrPath) -> dict[str, Header]:
    """Read the headers of all arrays of an NPZ file, by their names."""
    headers = {}
    with open_regular(path) as whole, _damage(path), zipfile.ZipFile(whole) as archive:
        for member in archive.namelist():
            if member.endswith(".npy"):
                with archive.open(member) as file:
                    shape, _, dtype = _read_header(cast("BinaryIO", file))
                headers[member.removesuffix(".npy")] = Header(shape, dtype)
    return headers


def read_npz(path: StrPath, name: str | None, expected: Sequence[str]) -> NDArray[Any]:
    """Read the array called ``name``; else the first ``expected`` name that is there; else the only array."""
    names = npz_names(path)
    if name is None:
        known = [one for one in expected if one in names]
        if not known and len(names) != 1:
            raise ValueError(
                f"{path}: none of its arrays is called {' or '.join(expected)}; arrays: {listed(names)}"
            )
        name = known[0] if known else names[0]
    if name not in names:
        raise ValueError(f"{path}: there is no array {name!r}; arrays: {listed(names)}")
    with open_regular(path) as whole, _damage(path), zipfile.ZipFile(whole) as archive:
        member = archive.getinfo(f"{name}.npy")
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"its array {name!r} is neither stored nor deflated")
        most = _DEFLATED * min(member.compress_size, Path(path).stat().st_size)
        with archive.open(member) as file:
            return _read_member(file, min(member.file_size, most))


def write_npy(path: StrPath, array: NDArray[Any]) -> None:
    """Write one array; the file appears when it is whole."""
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    _dofsim.write_bytes(path, buffer.getvalue())


def write_npz(path: StrPath, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write named arrays, deflated; the file appears when it is whole."""
    buffer = io.BytesIO()
    # Not savez_compressed(**arrays): its keyword arguments are not for names alone.
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)
    _dofsim.write_bytes(path, buffer.getvalue())


# How the parsers of archives, of literals and of types refuse what they were not made for. RuntimeError is an
# archive that is encrypted, or compressed in a way that the zipfile module does not know.
_REFUSALS = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    EOFError,
    OverflowError,
    RuntimeError,
    SyntaxError,
    TokenError,
    TypeError,
    ValueError,
)


@contextmanager
def _damage(path: StrPath) -> Iterator[None]:
    """Make what goes wrong inside a file an error that names the file."""
    try:
        yield
    except _REFUSALS as error:
        raise ValueError(f"{path}: damaged file: {error}") from error
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
        # A seek to where no file reaches, by an offset that the file gave.
        raise ValueError(f"{path}: damaged file: it points outside itself") from error


def _read_member(file: Any, size: int) -> NDArray[Any]:
    """Read an array whose header is believed only as far as ``size`` bytes go."""
    stream: BinaryIO = file
    shape, fortran_order, dtype = _read_header(stream)
    if dtype.hasobject:
        raise ValueError("it holds Python objects, which are never loaded")
    if any(axis < 0 for axis in shape):
        raise ValueError(f"its header claims the shape {shape}")
    count = math.prod(shape)
    if count * dtype.itemsize > size:
        raise ValueError(f"its header claims {count * dtype.itemsize} bytes, which {size} bytes cannot hold")
    array: NDArray[Any] = np.empty(count, dtype)
    rest = array.view(np.uint8).data
    while rest:
        if not (got := file.readinto(rest[:_AT_ONCE])):
            raise ValueError("it ends too early")
        rest = rest[got:]
    array = array.reshape(shape, order="F" if fortran_order else "C")
    return array.astype(dtype.newbyteorder("="), copy=False)


def _read_header(stream: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read the shape, the order and the type of an array, from no more bytes than NumPy writes."""
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version} of NPY is not 1.0 or 2.0")
    size_bytes = stream.read(2 if version == (1, 0) else 4)
    size = int.from_bytes(size_bytes, "little")
    if size > _LONGEST_HEADER:
        raise ValueError(f"its header claims to be {size} bytes long")
    header = io.BytesIO(size_bytes + stream.read(size))
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    try:
        return read(header)
    except (MemoryError, RecursionError) as error:
        # So Python's parser refuses brackets within brackets.
        raise ValueError("its header is nested too deeply") from error
