"""The passes of a file through one lens: ``dofsim render --channels``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import dofsim

from . import _dofsim
from ._channel_kinds import KINDS, Kind, id_sets, kinds_of, matches
from ._channel_sources import Source
from ._channels import Channel
from ._ids import render_ids
from ._names import listed

_TYPES: dict[str, type[np.floating[Any]]] = {"half": np.float16, "float": np.float32}
_IN_CHANNEL = re.compile(r"color must be finite where .*; got (\S+) in channel (\d+) at (.*)")


@dataclass(frozen=True)
class Passes:
    """Channels of a file that are rendered, and what they hold.

    Attributes
    ----------
    source : Source
        The file.
    kinds : dict of str to str
        The kinds of the channels by their full names.
    """

    source: Source
    kinds: dict[str, Kind]

    @classmethod
    def choose(cls, source: Source, patterns: Sequence[str], given: Sequence[str]) -> Passes:
        """Choose channels of a file, and tell what they hold.

        Parameters
        ----------
        source : Source
            The file.
        patterns : sequence of str
            Patterns of full names or of layers, of which a channel must fit one.
        given : sequence of str
            ``NAME=KIND``, for patterns of channels.

        Returns
        -------
        Passes
            The channels.

        Raises
        ------
        ValueError
            If the file has no such channels, or holds what has no mean.
        """
        path, channels = source.path, source.channels
        kinds = kinds_of(channels, [_read_kind(text) for text in given])
        for pattern in patterns:
            if not any(matches(channel, pattern) for channel in channels):
                raise ValueError(
                    f"{path}: no channel or layer is called {pattern!r}; channels: "
                    f"{listed(channel.full for channel in channels)}"
                )
        chosen = {
            channel.full: kinds[channel.full]
            for channel in channels
            if kinds[channel.full] != "none" and any(matches(channel, pattern) for pattern in patterns)
        }
        passes = cls(source, chosen)
        for channel in passes.channels:
            if source.type_of(channel) == "uint":
                raise ValueError(
                    f"{path}: {channel.full} holds whole numbers, of which there is no mean; leave it out "
                    f"with --kind {channel.full}=none"
                )
        if not chosen:
            raise ValueError(f"{path}: --kind leaves no channel")
        id_sets(passes._of("id"))
        return passes

    @property
    def channels(self) -> list[Channel]:
        """The channels that are rendered."""
        return [channel for channel in self.source.channels if channel.full in self.kinds]

    def describe(self) -> str:
        """Say what the channels are taken for, in one line."""
        found = {kind: [name for name, own in self.kinds.items() if own == kind] for kind in KINDS}
        return "; ".join(f"{kind}: {listed(names)}" for kind, names in found.items() if names)

    def render(
        self, guide: NDArray[Any], depth: NDArray[Any], lens: dofsim.Lens, **words: Any
    ) -> dict[str, NDArray[np.float32]]:
        """Render all channels by the same picture.

        Parameters
        ----------
        guide, depth, lens
            As for `dofsim.render`.
        **words
            The other arguments of `dofsim.render`.

        Returns
        -------
        dict of str to ndarray of float32
            Planes by the full names of the channels.

        Raises
        ------
        ValueError
            If a channel cannot be rendered.
        """
        out: dict[str, NDArray[np.float32]] = {}
        known = [(channel, self.kinds[channel.full]) for channel in self.channels]
        # What holds ids is no mean, and what is left out is not there.
        kinds = [kind for _, kind in known if kind != "id" and kind != "none"]
        averaged = [channel for channel, kind in known if kind != "id"]
        sets = id_sets(self._of("id"))
        if sets and words.get("supersample", 1) != 1:
            raise ValueError("supersample must be 1 for ids, of which there is no mean")
        planes = self.source.read(list(zip(averaged, kinds, strict=True)), sets, depth.shape)
        if averaged:
            stacked = np.stack([planes[channel.full] for channel in averaged], axis=-1)
            try:
                rendered = dofsim.render(stacked, depth, lens, guide=guide, kinds=kinds, **words)
            except ValueError as error:
                raise self._named(error, averaged) from None
            out |= {channel.full: rendered[..., i] for i, channel in enumerate(averaged)}
        of_ids = signature(render_ids).parameters
        for members in sets:
            own = {name: word for name, word in words.items() if name in of_ids}
            stacked = np.stack([planes[channel.full] for channel in members], axis=-1)
            rendered = render_ids(stacked, depth, lens, guide=guide, **own)
            out |= {channel.full: rendered[..., i] for i, channel in enumerate(members)}
        return out

    def write(
        self, output: Path, planes: dict[str, NDArray[np.float32]], corner: tuple[int, int] | None
    ) -> None:
        """Write channels under their names, in their parts and types, with what the file says of these."""
        numbers = sorted({channel.part for channel in self.channels})
        parts = []
        for number in numbers:
            own = [channel for channel in self.channels if channel.part == number]
            named = [(c.name, _in_type(planes[c.full], self.source.type_of(c))) for c in own]
            parts.append((self.source.part_name(number), named))
        _dofsim.write_exr(
            output, parts, compression="zip", attributes_of=self.source.like, corner=corner, like=numbers
        )

    def _of(self, kind: Kind) -> list[Channel]:
        return [channel for channel in self.channels if self.kinds[channel.full] == kind]

    def _named(self, error: ValueError, channels: list[Channel]) -> ValueError:
        """Name the channel that an error is about."""
        if not (found := _IN_CHANNEL.fullmatch(str(error))):
            return error
        name = channels[int(found[2])].full
        return ValueError(
            f"{self.source.path}: {name} has {found[1]} at {found[3]}; say what it is, as with --kind "
            f"{name}=data, or leave it out with --kind {name}=none"
        )


def _read_kind(text: str) -> tuple[str, Kind]:
    name, _, kind = text.rpartition("=")
    if not name or kind not in KINDS:
        raise ValueError(f"--kind takes NAME=KIND, where KIND is one of {', '.join(KINDS)}; got {text!r}")
    return name, next(known for known in KINDS if known == kind)


def _in_type(plane: NDArray[np.float32], sample_type: str) -> NDArray[Any]:
    to = _TYPES[sample_type]
    limits = np.finfo(to)
    return np.ascontiguousarray(np.clip(plane, limits.min, limits.max), to)
