"""Files whose channels are rendered: flat OpenEXR, deep OpenEXR and NPZ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from . import _arrays, _deep, _dofsim, io
from ._channel_kinds import Kind
from ._channels import Channel
from ._exr import ExrFile
from ._frame import framed_values
from ._names import listed

SampleType = Literal["half", "float", "uint"]
Size: TypeAlias = tuple[int, ...]
Planes: TypeAlias = dict[str, NDArray[np.float32]]

_TYPES: dict[str, SampleType] = {"float16": "half", "float32": "float", "float64": "float"}


class Source(Protocol):
    """A file whose channels are rendered."""

    @property
    def path(self) -> Path:
        """The file."""

    @property
    def channels(self) -> list[Channel]:
        """The channels that it has."""

    @property
    def like(self) -> Path | None:
        """The OpenEXR file whose attributes the output keeps."""

    def part_name(self, part: int) -> str | None:
        """Give the name of a part."""

    def type_of(self, channel: Channel) -> SampleType:
        """Give the type of a channel's samples."""

    def read(
        self, kinds: Sequence[tuple[Channel, Kind]], sets: Sequence[Sequence[Channel]], size: Size
    ) -> Planes:
        """Read channels that hold these kinds, and sets of ids, laid out as a picture of this size is."""


def source_of(path: Path) -> Source | None:
    """Open a file that has named channels; None if it is of another kind."""
    kind = _dofsim.file_kind(path)
    if kind == "npz":
        return NpzSource.of(path)
    if kind != "exr":
        return None
    return DeepSource.of(path) if _deep.exr_kind(path) == "deep" else FlatSource(path, ExrFile.of(path))


@dataclass(frozen=True)
class FlatSource:
    """A flat OpenEXR file; see `Source`."""

    path: Path
    file: ExrFile

    @property
    def channels(self) -> list[Channel]:
        """The channels of all parts."""
        return self.file.channels

    @property
    def like(self) -> Path:
        """The file itself."""
        return self.path

    def part_name(self, part: int) -> str | None:
        """Give the name of a part."""
        return self.file.parts[part].name

    def type_of(self, channel: Channel) -> SampleType:
        """Give the type of a channel's samples."""
        return _type_in(self.file.parts[channel.part], channel)

    def read(
        self, kinds: Sequence[tuple[Channel, Kind]], sets: Sequence[Sequence[Channel]], size: Size
    ) -> Planes:
        """Read channels, with the margin that the picture has."""
        channels = _all(kinds, sets)
        planes: Planes = {}
        for number in sorted({channel.part for channel in channels}):
            own = [channel for channel in channels if channel.part == number]
            stored = self.file.read(own, data=True, fill=0.0)
            stored = stored[..., None] if len(own) == 1 else stored
            margin = (size[1] - self.file.parts[number].display_window[2]) // 2
            laid_out = framed_values(stored, self.file.beyond(number), margin)
            if laid_out.shape[:2] != size:
                raise ValueError(
                    f"{self.path}: {own[0].full} has {laid_out.shape[0]} x {laid_out.shape[1]} pixels, "
                    f"and the picture {size[0]} x {size[1]}; all parts must be of one size"
                )
            planes |= {channel.full: laid_out[..., i] for i, channel in enumerate(own)}
        return planes


@dataclass(frozen=True)
class DeepSource:
    """The part of a deep OpenEXR file that is read as layers; see `Source`.

    Channels are merged as the samples are. Z is the depth of the layers. ZBack is left out: layers have none.
    """

    path: Path
    number: int
    part: _dofsim.ExrPart

    @classmethod
    def of(cls, path: Path) -> DeepSource:
        """Find the part."""
        if (found := _dofsim.deep_exr_part(path)) is None:
            raise ValueError(f"{path}: no deep part has a channel Z")
        return cls(path, *found)

    @property
    def channels(self) -> list[Channel]:
        """The channels of the part."""
        return [Channel(self.number, name, name) for name in self.part.channels if name != "ZBack"]

    @property
    def like(self) -> Path:
        """The file itself."""
        return self.path

    def part_name(self, part: int) -> str | None:
        """Give the name of the part."""
        return self.part.name

    def type_of(self, channel: Channel) -> SampleType:
        """Give the type of a channel's samples."""
        return _type_in(self.part, channel)

    def read(
        self, kinds: Sequence[tuple[Channel, Kind]], sets: Sequence[Sequence[Channel]], size: Size
    ) -> Planes:
        """Merge the samples of channels to layers."""
        return _deep.read_deep_channels(
            self.path,
            [
                (channel.full, "light" if kind in ("light", "matte") else "data")
                for channel, kind in kinds
                if channel.full != "Z"
            ],
            [[channel.full for channel in one] for one in sets],
        )


@dataclass(frozen=True)
class NpzSource:
    """The arrays of an NPZ file that have the pixels of its picture; see `Source`.

    ``color`` is R G B A, or as many of these as it has, and ``depth`` is Z. Any other array gives its name to
    a channel, or to a layer of several.
    """

    path: Path
    arrays: dict[str, _arrays.Header]
    # By full names: the array, and the number of the channel in it.
    places: dict[str, tuple[str, int]]

    @classmethod
    def of(cls, path: Path) -> NpzSource:
        """Find the arrays."""
        arrays = _arrays.npz_headers(path)
        color = next((name for name in io.COLOR_ARRAYS if name in arrays), None)
        if color is None:
            names = " or ".join(io.COLOR_ARRAYS)
            raise ValueError(f"{path}: none of its arrays is called {names}; arrays: {listed(arrays)}")
        shape = arrays[color].shape
        pixels = shape if len(shape) == 2 else shape[:-1]
        places: dict[str, tuple[str, int]] = {}
        for name, header in arrays.items():
            if header.shape[: len(pixels)] == pixels and len(header.shape) <= len(pixels) + 1:
                count = header.shape[len(pixels)] if len(header.shape) > len(pixels) else 1
                places |= {full: (name, i) for i, full in enumerate(_names_in(name, count, color))}
        return cls(path, arrays, places)

    @property
    def channels(self) -> list[Channel]:
        """The channels of all arrays."""
        return [Channel(0, full, full) for full in self.places]

    @property
    def like(self) -> None:
        """There are no attributes."""
        return None

    def part_name(self, part: int) -> str | None:
        """Give no name: all channels are of one part."""
        return None

    def type_of(self, channel: Channel) -> SampleType:
        """Give the type of the array."""
        return _TYPES.get(self.arrays[self.places[channel.full][0]].dtype.name, "uint")

    def read(
        self, kinds: Sequence[tuple[Channel, Kind]], sets: Sequence[Sequence[Channel]], size: Size
    ) -> Planes:
        """Read the arrays."""
        wanted = {self.places[channel.full][0] for channel in _all(kinds, sets)}
        arrays = {name: _arrays.read_npz(self.path, name, ()) for name in wanted}
        planes: Planes = {}
        for channel in _all(kinds, sets):
            name, number = self.places[channel.full]
            array = arrays[name]
            plane = array if array.shape == size else array[..., number]
            if plane.shape != size:
                raise ValueError(f"{self.path}: {name} has shape {array.shape}, and the picture {size}")
            planes[channel.full] = plane.astype(np.float32)
        return planes


def _all(kinds: Sequence[tuple[Channel, Kind]], sets: Sequence[Sequence[Channel]]) -> list[Channel]:
    return [*(channel for channel, _ in kinds), *(channel for one in sets for channel in one)]


def _type_in(part: _dofsim.ExrPart, channel: Channel) -> SampleType:
    return part.sample_types[part.channels.index(channel.name)]


def _names_in(array: str, count: int, color: str) -> list[str]:
    """Name the channels of an array."""
    if array == color:
        return list({1: "Y", 2: "YA", 3: "RGB", 4: "RGBA"}.get(count, ""))
    if count == 1:
        return ["Z" if array in io.DEPTH_ARRAYS else array]
    letters = {2: "UV", 3: "RGB", 4: "RGBA"}.get(count, [str(i) for i in range(count)])
    return [f"{array}.{letter}" for letter in letters]
