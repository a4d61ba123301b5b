"""OpenEXR files by the names of their channels."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _channels, _dofsim
from ._files import StrPath
from ._names import listed

Compression = Literal["none", "rle", "zips", "zip", "piz"]


def list_channels(path: StrPath) -> list[str]:
    """Return the names of the channels of an OpenEXR file, or of the arrays of an NPZ file.

    Parameters
    ----------
    path : str or path-like
        The file.

    Returns
    -------
    list of str
        Full names: layers before dots, and the name of the part first if there are several. Empty for
        files of other kinds, whose channels have no names.

    Raises
    ------
    ValueError
        If the file is damaged or of a kind that is not read.
    OSError
        If the file cannot be opened or read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from dofsim.io import list_channels, write_exr
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "layers.exr")
    ...     write_exr(path, {"left.Z": np.ones((2, 2)), "left.Y": np.ones((2, 2))})
    ...     list_channels(path)
    ['left.Y', 'left.Z']
    """
    kind = _dofsim.file_kind(path)
    if kind == "exr":
        return [channel.full for channel in ExrFile.of(path).channels]
    return _arrays.npz_names(path) if kind == "npz" else []


def read_exr(path: StrPath, channels: list[str] | None = None) -> dict[str, NDArray[np.float32]]:
    """Return channels of an OpenEXR file, by their names.

    Parameters
    ----------
    path : str or path-like
        The file.
    channels : list of str, optional
        Names as `list_channels` gives them. Without it, all.

    Returns
    -------
    dict of str to ndarray of float32
        Each of shape (H, W), the pixels that are stored (the data window of the part).

    Raises
    ------
    ValueError
        If the file is damaged or not OpenEXR, or if there is no such channel.
    OSError
        If the file cannot be opened or read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from dofsim.io import read_exr, write_exr
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "id.exr")
    ...     write_exr(path, {"id": np.array([[7, 9]], dtype=np.uint32)})
    ...     read_exr(path)["id"]
    array([[7., 9.]], dtype=float32)
    """
    file = open_exr(path)
    known = {channel.full: channel for channel in file.channels}
    names = list(known) if channels is None else channels
    for name in names:
        if name not in known:
            raise ValueError(f"{path}: there is no channel {name!r}; channels: {listed(known)}")
    return {name: file.read([known[name]], data=True, fill=0.0) for name in names}


def write_exr(
    path: StrPath,
    channels: Mapping[str, ArrayLike] | Mapping[str, Mapping[str, ArrayLike]],
    *,
    compression: Compression = "zip",
) -> None:
    """Write named channels to an OpenEXR file of one part or of several.

    Parameters
    ----------
    path : str or path-like
        The file. What was there is replaced.
    channels : mapping
        Arrays of shape (H, W) by the names of the channels; or such mappings by the names of the parts.
        float16 and uint32 are stored as they are, everything else as float32.
    compression : {"none", "rle", "zips", "zip", "piz"}, optional
        All are lossless.

    Raises
    ------
    ValueError
        If the arrays of a part differ in size, have another number of axes than two, or have no pixels.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from dofsim.io import list_channels, write_exr
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "parts.exr")
    ...     write_exr(path, {"main": {"Y": np.ones((2, 2))}, "depth": {"Z": np.ones((2, 2))}})
    ...     list_channels(path)
    ['main.Y', 'depth.Z']
    """
    single: list[tuple[str, NDArray[Any]]] = []
    parts: list[tuple[str | None, list[tuple[str, NDArray[Any]]]]] = []
    for name, value in channels.items():
        if isinstance(value, Mapping):
            parts.append((name, [(channel, _plane(channel, array)) for channel, array in value.items()]))
        else:
            single.append((name, _plane(name, value)))
    if single and parts:
        raise ValueError("either all channels are in named parts or none is")
    _dofsim.write_exr(path, parts or [(None, single)], compression=compression)


def open_exr(path: StrPath) -> ExrFile:
    """Read the header of a file, if it is an OpenEXR file."""
    if (kind := _dofsim.file_kind(path)) != "exr":
        raise ValueError(f"{path}: found a file of kind {kind}; accepted: OpenEXR")
    return ExrFile.of(path)


@dataclass(frozen=True)
class ExrFile:
    """An OpenEXR file whose header has been read.

    Attributes
    ----------
    path : str or path-like
        The file.
    parts : list of ExrPart
        What the header says of each part.
    """

    path: StrPath
    parts: list[_dofsim.ExrPart]

    @classmethod
    def of(cls, path: StrPath) -> ExrFile:
        """Read the header of a file."""
        return cls(path, _dofsim.exr_parts(path))

    @property
    def channels(self) -> list[_channels.Channel]:
        """The channels of all parts."""
        return _channels.flatten(self.parts)

    def color_channels(self, layer: str | None) -> list[_channels.Channel]:
        """Choose the channels of the picture."""
        with self._about():
            return _channels.color(self.channels, layer)

    def depth_channel(self, name: str | None, layer: str | None) -> _channels.Channel:
        """Choose the channel of the depth."""
        with self._about():
            return _channels.depth(self.channels, name, layer)

    def depth_channels(self, name: str | None, layer: str | None) -> list[_channels.Channel]:
        """Choose the channel of the depth, or those of a file that holds nothing else than colours."""
        colours = [channel for channel in self.channels if channel.full.lower() in ("r", "g", "b")]
        if name is None and len(colours) == 3 and len(self.channels) == 3:
            return self.color_channels("")
        return [self.depth_channel(name, layer)]

    def read(self, channels: list[_channels.Channel], *, data: bool, fill: float) -> NDArray[np.float32]:
        """Read channels of one part, side by side, `fill` where the display window has no stored pixels."""
        names = [channel.name for channel in channels]
        return _dofsim.read_exr(self.path, channels[0].part, names, data=data, fill=fill)

    def read_both(
        self, color: list[_channels.Channel], depth: _channels.Channel, *, data: bool
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Read a picture and its depth, decoding a part that has both only once.

        What is not stored is transparent black and infinitely far.
        """
        if depth.part != color[0].part:
            return self.read(color, data=data, fill=0.0), self.read([depth], data=data, fill=math.inf)
        both = self.read([*color, depth], data=data, fill=0.0)
        pixels, plane = both[..., : len(color)], both[..., len(color)].copy()
        if not data:
            plane[~self._is_stored(depth.part, plane.shape)] = math.inf
        return np.ascontiguousarray(pixels[..., 0] if len(color) == 1 else pixels), plane

    def beyond(self, part: int) -> tuple[int, int, int, int]:
        """Give how many pixels are stored beyond the display window: left, top, right, bottom.

        Negative numbers are pixels of the display window that are not stored.
        """
        x, y, width, height = self.parts[part].data_window
        left, top, seen_width, seen_height = self.parts[part].display_window
        return left - x, top - y, x + width - left - seen_width, y + height - top - seen_height

    def _is_stored(self, part: int, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """Tell which pixels of the display window are in the data window."""
        left, top, _, _ = self.parts[part].display_window
        x, y, width, height = self.parts[part].data_window
        stored = np.zeros(shape, bool)
        stored[max(y - top, 0) : max(y - top + height, 0), max(x - left, 0) : max(x - left + width, 0)] = True
        return stored

    @contextmanager
    def _about(self) -> Iterator[None]:
        """Put the name of the file before what is wrong with its channels."""
        try:
            yield
        except ValueError as error:
            raise ValueError(f"{self.path}: {error}") from None


def _plane(name: str, values: ArrayLike) -> NDArray[Any]:
    plane = np.asarray(values)
    if plane.ndim != 2:
        raise ValueError(f"channel {name!r} must have shape (H, W), not {plane.shape}")
    if plane.dtype not in (np.float16, np.uint32):
        plane = plane.astype(np.float32)
    return np.ascontiguousarray(plane, plane.dtype.newbyteorder("="))
