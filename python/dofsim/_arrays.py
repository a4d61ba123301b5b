"""NPY and NPZ files, read with the same care as the others: no pickles, no claims beyond the file."""

from __future__ import annotations

import errno
import io
import lzma
import math
import os
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tokenize import TokenError
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from . import _dofsim
from ._names import listed

StrPath = str | os.PathLike[str]


def read_npy(path: StrPath) -> NDArray[Any]:
    """Read the array of an NPY file."""
    with Path(path).open("rb") as file, _damage(path):
        return _read_member(file, Path(path).stat().st_size)


def npz_names(path: StrPath) -> list[str]:
    """List the names of the arrays in an NPZ file."""
    with _damage(path), zipfile.ZipFile(path) as archive:
        return [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]


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
    with _damage(path), zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as file:
        return _read_member(file, archive.getinfo(f"{name}.npy").file_size)


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
    version = np.lib.format.read_magic(stream)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read_header is None:
        raise ValueError(f"version {version} of NPY is not 1.0 or 2.0")
    shape, fortran_order, dtype = read_header(stream)
    if dtype.hasobject:
        raise ValueError("it holds Python objects, which are never loaded")
    if any(axis < 0 for axis in shape):
        raise ValueError(f"its header claims the shape {shape}")
    count = math.prod(shape)
    if count * dtype.itemsize > size:
        raise ValueError(f"its header claims {count * dtype.itemsize} bytes, which {size} bytes cannot hold")
    data = stream.read(count * dtype.itemsize)
    if len(data) < count * dtype.itemsize:
        raise ValueError("it ends too early")
    array: NDArray[Any] = np.frombuffer(data, dtype).reshape(shape, order="F" if fortran_order else "C")
    return array.astype(dtype.newbyteorder("="))
