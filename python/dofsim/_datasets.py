"""Files that data sets come in and that dofsim only reads: Sintel's ``.dpt``, and HDF5."""

from __future__ import annotations

import math
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _dofsim
from ._extras import missing
from ._files import StrPath, check_regular, open_regular
from ._names import listed

# The number 202021.25 as a little-endian float, which begins Sintel's files of depth and of optical flow.
_DPT_START = b"PIEH"
_HDF5_START = b"\x89HDF"

_HDF5_SIGNATURE = _HDF5_START + b"\r\n\x1a\n"

# What a chunk may take beside the values of its data set, for one that grows may still be smaller than that.
_CHUNK_BYTES = 64 << 20
# HDF5's numbers of its filters, and the length of its checksum.
_DEFLATE, _CHECKSUM = 1, 3
_CHECKSUM_BYTES = 4


def file_kind(path: StrPath) -> str:
    """Tell the format of a file from its first bytes, ``"dpt"`` and ``"hdf5"`` among them.

    Parameters
    ----------
    path : str or path-like
        The file.

    Returns
    -------
    str
        The suffix that such files have.

    Raises
    ------
    ValueError
        If it is of no kind that is read.
    OSError
        If it cannot be opened or read.
    """
    try:
        return _dofsim.file_kind(path)
    except ValueError:
        start = first_bytes(path, 4)
        if start == _DPT_START:
            return "dpt"
        if start == _HDF5_START:
            return "hdf5"
        raise


def first_bytes(path: StrPath, count: int) -> bytes:
    """Read how a file begins; nothing of what is no file, for a pipe would be waited for."""
    if not Path(path).is_file():
        return b""
    with open_regular(path) as file:
        return file.read(count)


def read_dpt(path: StrPath) -> NDArray[np.float32]:
    """Read a depth map of the MPI Sintel data set: a tag, the width, the height, and rows of floats."""
    with open_regular(path) as file:
        data = file.read()
    if len(data) < 12:
        raise ValueError(f"{path}: damaged file: it ends too early")
    width, height = (int(side) for side in np.frombuffer(data, "<i4", 2, offset=4))
    size = 12 + 4 * width * height
    if width <= 0 or height <= 0 or len(data) < size:
        raise ValueError(f"{path}: damaged file: its header claims {width} x {height} pixels")
    if len(data) > size:
        raise ValueError(f"{path}: holds more than one float a pixel, as optical flow does; not a depth map")
    return np.frombuffer(data, "<f4", offset=12).reshape(height, width).astype(np.float32)


def read_hdf5(path: StrPath, name: str | None) -> NDArray[Any]:
    """Read the data set called ``name``, or the only one at the top of an HDF5 file."""
    try:
        import h5py  # type: ignore[import-untyped, unused-ignore]
    except ImportError as error:
        raise ImportError(missing("reading HDF5 needs", "h5py", "hdf5")) from error
    try:
        check_regular(path)
        _check_superblock(path)
        with h5py.File(path, "r") as file:
            inside = (h5py.HardLink, h5py.SoftLink)
            links = {key: file.get(key, getlink=True) for key in file}
            here = [key for key, link in links.items() if isinstance(link, inside)]
            names = [key for key in here if isinstance(file.get(key), h5py.Dataset)]
            if name is None:
                if len(names) != 1:
                    raise ValueError(f"{path}: holds several data sets or none, name one: {listed(names)}")
                name = names[0]
            if not isinstance(file.get(name), h5py.Dataset):
                raise ValueError(f"{path}: there is no data set {name!r}; data sets: {listed(names)}")
            dataset = file[name]
            if dataset.external or dataset.is_virtual or dataset.file.filename != file.filename:
                raise ValueError(f"{path}: the values of {name!r} are in other files, which are not followed")
            claimed = math.prod(dataset.shape) * dataset.dtype.itemsize
            # Chunks may be deflated, which no data survive by more than a factor of 1032.
            if claimed > Path(path).stat().st_size * (1 if dataset.chunks is None else 1032):
                raise ValueError(f"{path}: damaged file: it claims {claimed} bytes, which it cannot hold")
            _check_chunks(path, dataset)
            return np.asarray(dataset[()])
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, zlib.error) as error:
        # The library's own errors have no number, and do not name the file; those of the system and ours do.
        if getattr(error, "errno", None) is not None or str(error).startswith(f"{path}: "):
            raise
        raise ValueError(f"{path}: damaged file: {error}") from error


def _check_superblock(path: StrPath) -> None:
    """Refuse a file that says how it is spread over others, which one file alone does not.

    The library takes as much memory as that description claims to be long. The last of four addresses of a
    superblock of version 0 or 1 is that of the description; later ones have a short message.
    """
    head = first_bytes(path, 256)
    if not head.startswith(_HDF5_SIGNATURE):
        raise ValueError(f"{path}: damaged file: it does not begin as an HDF5 file")
    if len(head) > 13 and (version := head[8]) <= 1:
        length = head[13]
        place = 24 + 4 * version + 3 * length
        if head[place : place + length] != length * b"\xff":
            raise ValueError(f"{path}: damaged file: or one of several that are one, which are not read")


def _check_chunks(path: StrPath, dataset: Any) -> None:
    """Refuse chunks that are far larger than the data set, or that inflate beyond their own size.

    The library inflates a whole chunk for a single value, and to wherever its data end.
    """
    if dataset.chunks is None:
        return
    claimed = math.prod(dataset.shape) * dataset.dtype.itemsize
    size = math.prod(dataset.chunks) * dataset.dtype.itemsize
    if size > claimed + _CHUNK_BYTES:
        raise ValueError(
            f"{path}: damaged file: a chunk claims {size} bytes, and the whole data set {claimed}"
        )
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(index)[0] for index in range(properties.get_nfilters())]
    if filters.count(_DEFLATE) > 1:
        raise ValueError(f"{path}: damaged file: its chunks are deflated more than once")
    chunks = [dataset.id.get_chunk_info(index) for index in range(dataset.id.get_num_chunks())]
    # The library takes the length of a checksum from that of its chunk, whatever that is.
    if any(chunk.size < _CHECKSUM_BYTES * filters.count(_CHECKSUM) for chunk in chunks):
        raise ValueError(f"{path}: damaged file: a chunk is shorter than its checksum")
    if _DEFLATE not in filters:
        return
    place = filters.index(_DEFLATE)
    if any(one != _CHECKSUM for one in filters[place + 1 :]):
        raise ValueError(f"{path}: its chunks are changed after they are deflated, which is not read")
    for chunk in chunks:
        skipped, data = dataset.id.read_direct_chunk(chunk.chunk_offset)
        most = size + _CHECKSUM_BYTES
        if not skipped >> place & 1 and len(zlib.decompressobj().decompress(data, most + 1)) > most:
            raise ValueError(
                f"{path}: damaged file: a chunk inflates to more than the {size} bytes it claims"
            )
