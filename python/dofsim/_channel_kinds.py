"""What the channels of an OpenEXR file hold, told from their names.

Case makes no difference. The first line that fits counts; ``--kind NAME=KIND`` goes before all of them.

==========  =========================================================================================
Kind        Channels
==========  =========================================================================================
``id``      R G B A (or red green blue alpha) of a layer whose name has crypto in it and ends in two
            digits: Cryptomatte's ranks. The layers that differ in these digits are one set
``matte``   A and alpha; layers and channels whose name has mask, matte, opacity or coverage in it
``data``    what is depth-named (see `dofsim._channels`), and mist
``normal``  X Y Z, or R G B, of a layer that is called N or has normal in its name
``data``    layers called P, Pref, N, UV, ST or id, or with position, world, normal, motion, vector,
            velocity, speed or index in their names; and X, Y, Z, U, V of any other layer
``light``   everything else
==========  =========================================================================================
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Literal, get_args

from ._channels import Channel, depth_named, is_mist
from ._names import listed

Kind = Literal["light", "matte", "data", "normal", "id", "none"]

KINDS: tuple[Kind, ...] = get_args(Kind)
_RANKS = re.compile(r"(.*crypto.*?)(\d\d)$", re.IGNORECASE)
_MATTES = ("mask", "matte", "opacity", "coverage")
_DATA_LAYERS = frozenset({"p", "pref", "n", "uv", "st", "id"})
_DATA = ("position", "world", "normal", "motion", "vector", "velocity", "speed", "index")
_AXES = frozenset({"x", "y", "z", "u", "v"})
_ORDER = ("r", "g", "b", "a")


def kinds_of(channels: Sequence[Channel], given: Sequence[tuple[str, Kind]] = ()) -> dict[str, Kind]:
    """Tell what channels hold.

    Parameters
    ----------
    channels : sequence of Channel
        All channels of a file.
    given : sequence of tuple of str and str
        Patterns of full names or of layers, and the kinds of what they fit. The last one counts.

    Returns
    -------
    dict of str to str
        Kinds by full names. ``"none"`` is what is to be left out.

    Raises
    ------
    ValueError
        If a pattern fits nothing, or what is said cannot be.

    Examples
    --------
    >>> from dofsim._channel_kinds import kinds_of
    >>> from dofsim._channels import Channel
    >>> names = ["R", "A", "Z", "N.X", "N.Y", "N.Z", "CryptoObject00.R", "diffuse.R"]
    >>> kinds = kinds_of([Channel(0, name, name) for name in names], [("diffuse", "none")])
    >>> [kinds[name] for name in names]
    ['light', 'matte', 'data', 'normal', 'normal', 'normal', 'id', 'none']
    """
    layers: dict[str, set[str]] = {}
    for channel in channels:
        layers.setdefault(channel.layer, set()).add(channel.word)
    kinds = {channel.full: _kind(channel, layers[channel.layer]) for channel in channels}
    for pattern, kind in given:
        fitting = [c for c in channels if matches(c, pattern)]
        if not fitting:
            raise ValueError(
                f"--kind {pattern}={kind}: there is no such channel; channels: "
                f"{listed(c.full for c in channels)}"
            )
        kinds |= {channel.full: kind for channel in fitting}
    return kinds


def matches(channel: Channel, pattern: str) -> bool:
    """Tell whether a pattern fits a channel: its full name, or the name of its layer."""
    names = (channel.full.lower(), channel.layer.lower())
    return any(name and fnmatchcase(name, pattern.lower()) for name in names)


def id_sets(channels: Sequence[Channel]) -> list[list[Channel]]:
    """Sort channels of ids into sets, each in the order of its ranks: an id and its coverage in turn.

    Raises
    ------
    ValueError
        If a set is no such ranks.
    """
    sets: dict[tuple[int, str], list[tuple[str, int, Channel]]] = {}
    for channel in channels:
        found = _RANKS.match(channel.layer)
        name, rank = (found[1], found[2]) if found else (channel.layer, "")
        place = _ORDER.index(channel.word[0]) if channel.word[:1] in _ORDER else -1
        sets.setdefault((channel.part if not found else -1, name), []).append((rank, place, channel))
    for (_, name), members in sets.items():
        members.sort(key=lambda member: member[:2])
        places = [place for _, place, _ in members]
        if places != list(range(4)) * (len(places) // 4) or not places:
            raise ValueError(
                f"{name or 'channels'}: ids are R G B A of layers, an id and its coverage in turn; got "
                f"{listed(channel.full for *_, channel in members)}"
            )
    return [[channel for *_, channel in members] for members in sets.values()]


def _kind(channel: Channel, words: set[str]) -> Kind:
    layer = channel.layer.rpartition(".")[2].lower()
    names = (layer, channel.word)
    if _RANKS.match(channel.layer) and channel.word[:1] in _ORDER:
        return "id"
    if channel.word in ("a", "alpha") or any(part in name for part in _MATTES for name in names):
        return "matte"
    if channel.word == "z" and words >= {"x", "y"}:
        pass  # The third of three axes, not a depth.
    elif any(depth_named(name) for name in names) or is_mist(channel):
        return "data"
    axes = ({"x", "y", "z"}, {"r", "g", "b"})
    if (layer == "n" or "normal" in layer) and any(words >= own and channel.word in own for own in axes):
        return "normal"
    if layer in _DATA_LAYERS or any(part in name for part in _DATA for name in names):
        return "data"
    return "data" if channel.word in _AXES else "light"
