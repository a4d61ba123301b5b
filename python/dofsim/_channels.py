"""Which channels of an OpenEXR file are the picture and which one is the depth.

A channel is known by its full name, ``layer.layer.channel``. In a file of several parts the name of the part
comes first, unless the channel's own name begins with it already. Case makes no difference. A name is
*depth-named* if it contains "depth" or is one of z, zbuffer, zfiltered, Pz and hitPz.

Mist is not depth: Blender's pass of that name runs from 0 to 1 along a curve. A layer called mist is never
chosen as the depth, and the error says so if nothing else is there.

**Depth**: the first of these rules that finds a channel. A rule that finds several leaves the choice to the
user, and so does a file in which no rule finds any.

====  =============================================================  ==================================
Rule  Channel                                                        Written so by
====  =============================================================  ==================================
1     ``Z``, outside any layer                                       OpenEXR's own name
2     ``Z``, ``V``, ``Y``, ``T`` or ``R`` of a layer whose last      Blender (``ViewLayer.Depth.Z``,
      word is depth or z, the first that it has                      ``Depth.V``), ``depth.Y``
3     the same of a layer whose last word is depth-named             V-Ray (``VRayZDepth.R``), Maxwell
                                                                     (``zbuffer.R``), Unreal
4     a channel whose own name is depth-named                        ``Depth``, ``camera.zdepth``,
                                                                     Mantra (``Pz``), Karma (``hitPz``)
5     ``Z`` of a layer with neither ``X`` nor ``Y``                  stereo files (``left.Z``)
6     ``T`` of a layer that has no other channel                     Mitsuba 3 (``dd.y.T``)
7     ``P.Z``, beside ``dzdx`` and ``dzdy``                          pbrt-v4, in camera space
8     the only channel of the file                                   single-channel files
====  =============================================================  ==================================

**Colour**: likewise. ``A`` of the same layer comes along as alpha.

====  =============================================================  ==================================
Rule  Channels                                                       Written so by
====  =============================================================  ==================================
1     ``R G B``, outside any layer                                   OpenEXR's own names
2     ``R G B`` of the layer ``Composite.Combined``                  Blender, of its compositor
3     ``R G B`` of a layer named combined, composite, beauty,        Blender (``ViewLayer.Combined.R``),
      color, colour, image, main, rgb, rgba, C or Ci                 Nuke, Arnold, Mantra, RenderMan
4     ``R G B`` of a layer that is not depth-named and whose name     any other layer, beside those for
      has none of crypto, normal, position, world, albedo,           compositing
      velocity, motion and vector in it
5     ``R G B`` of a layer that is not depth-named                   likewise, of one such layer alone
6     ``Y``, outside any layer                                       grey pictures
7     ``Y`` of a layer that is not depth-named                       grey layers
====  =============================================================  ==================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from ._names import listed

_COLOR_LAYERS = frozenset(
    {"combined", "composite", "beauty", "color", "colour", "image", "main", "rgb", "rgba", "c", "ci"}
)
# Parts of the names of layers that hold other things in R G B.
_DATA = ("crypto", "normal", "position", "world", "albedo", "velocity", "motion", "vector")
_DEPTH_NAMES = frozenset({"z", "zbuffer", "zfiltered", "pz", "hitpz"})
_DEPTH_OF_A_LAYER = ("z", "v", "y", "t", "r")


class Part(Protocol):
    """What the choice needs to know about a part of a file."""

    @property
    def name(self) -> str | None: ...
    @property
    def channels(self) -> list[str]: ...


@dataclass(frozen=True)
class Channel:
    """A channel of a file: the index of its part, its name there, and its full name."""

    part: int
    name: str
    full: str

    @property
    def layer(self) -> str:
        """The full name without its last word."""
        return self.full.rpartition(".")[0]

    @property
    def word(self) -> str:
        """The last word of the full name, in lower case."""
        return self.full.rpartition(".")[2].lower()


@dataclass(frozen=True)
class _Layer:
    name: str
    channels: dict[str, Channel]

    @property
    def word(self) -> str:
        return self.name.rpartition(".")[2].lower()

    def has(self, *words: str) -> bool:
        return all(word in self.channels for word in words)


def flatten(parts: Sequence[Part]) -> list[Channel]:
    """All channels of all parts under their full names."""

    def full(part: Part, name: str) -> str:
        prefix = f"{part.name}." if part.name and len(parts) > 1 else ""
        return name if name.lower().startswith(prefix.lower()) else prefix + name

    return [
        Channel(index, name, full(part, name)) for index, part in enumerate(parts) for name in part.channels
    ]


def depth(channels: Sequence[Channel], name: str | None = None, layer: str | None = None) -> Channel:
    """Choose the depth: the channel called ``name``, else by the rules, those beside ``layer`` first.

    Raises
    ------
    ValueError
        If there is no such channel, or if several may be meant. The message lists them.
    """
    if name is not None:
        return _named(channels, name)
    beside = layer.rpartition(".")[0] if layer else ""
    mist = [channel for channel in channels if is_mist(channel)]
    layers = _layers([channel for channel in channels if channel not in mist])
    for rule in _DEPTH_RULES:
        found = rule(layers)
        if beside and len(found) > 1:
            found = [c for c in found if c.full.lower().startswith(beside.lower() + ".")] or found
        if len(found) == 1:
            return found[0]
        if found:
            raise ValueError(
                f"several channels may be the depth: {listed(c.full for c in found)}; "
                "name the one that is meant (depth_channel)"
            )
    if mist:
        raise ValueError(
            f"{listed(c.full for c in mist)} is mist, which runs from 0 to 1 along a curve and is not depth; "
            "render the depth (in Blender: the pass called Z or Depth)"
        )
    raise ValueError(
        f"no channel is the depth by its name; channels: {listed(c.full for c in channels)}. Name the "
        "one that is meant (depth_channel), or give the depth in a file of its own"
    )


def color(channels: Sequence[Channel], layer: str | None = None) -> list[Channel]:
    """Choose the picture, R G B or Y with A last: that of ``layer``, else by the rules.

    Raises
    ------
    ValueError
        If there is no such layer, or if several may be meant. The message lists them.
    """
    layers = _layers(channels)
    if layer is not None:
        found = [one for one in layers if one.name.lower() == layer.lower()]
        if not found:
            names = listed(one.name or "(none)" for one in layers)
            raise ValueError(f"there is no layer {layer!r}; layers: {names}")
        if picture := _picture(found[0]):
            return picture
        raise ValueError(
            f"layer {layer!r} has neither R G B nor Y; its channels: "
            f"{listed(c.full for c in found[0].channels.values())}"
        )
    for rule in _COLOR_RULES:
        found = [one for one in layers if rule(one)]
        if len(found) == 1:
            return _picture(found[0])
        if found:
            raise ValueError(
                f"several layers may be the picture: {listed(one.name for one in found)}; "
                "name the one that is meant (layer)"
            )
    raise ValueError(f"no R G B and no Y channel; channels: {listed(c.full for c in channels)}")


def _named(channels: Sequence[Channel], name: str) -> Channel:
    tests: tuple[Callable[[Channel], bool], ...] = (
        lambda c: c.full == name,
        lambda c: c.name == name,
        lambda c: c.full.lower() == name.lower(),
        lambda c: c.name.lower() == name.lower(),
    )
    for test in tests:
        found = [c for c in channels if test(c)]
        if len(found) == 1:
            return found[0]
        if found:
            raise ValueError(f"several channels are called {name!r}: {listed(c.full for c in found)}")
    raise ValueError(f"there is no channel {name!r}; channels: {listed(c.full for c in channels)}")


def _layers(channels: Sequence[Channel]) -> list[_Layer]:
    layers: dict[str, _Layer] = {}
    for channel in channels:
        layers.setdefault(channel.layer, _Layer(channel.layer, {})).channels[channel.word] = channel
    return list(layers.values())


def depth_named(word: str) -> bool:
    """Tell whether a word names a depth."""
    return "depth" in word or word in _DEPTH_NAMES


def is_mist(channel: Channel) -> bool:
    """Tell whether a channel is mist."""
    return "mist" in (channel.word, channel.layer.rpartition(".")[2].lower())


def _picture(layer: _Layer) -> list[Channel]:
    for words in (("r", "g", "b"), ("y",)):
        if layer.has(*words):
            alpha = ("a",) if layer.has("a") else ()
            return [layer.channels[word] for word in words + alpha]
    return []


def _depth_of_layer(layer: _Layer) -> Channel | None:
    return next((layer.channels[word] for word in _DEPTH_OF_A_LAYER if word in layer.channels), None)


def _depths_of(layers: list[_Layer], named: Callable[[str], bool]) -> list[Channel]:
    """Give the depth of every layer whose last word is so named."""
    return [c for one in layers if named(one.word) and (c := _depth_of_layer(one))]


def _of_pbrt(layers: list[_Layer]) -> list[Channel]:
    """Give the third coordinate of pbrt's points, if the changes of depth are beside them."""
    outside = any(not one.name and one.has("dzdx", "dzdy") for one in layers)
    return [one.channels["z"] for one in layers if outside and one.name.lower() == "p" and one.has("z")]


_DEPTH_RULES: tuple[Callable[[list[_Layer]], list[Channel]], ...] = (
    lambda layers: [one.channels["z"] for one in layers if not one.name and one.has("z")],
    lambda layers: _depths_of(layers, lambda word: word in ("depth", "z")),
    lambda layers: _depths_of(layers, depth_named),
    lambda layers: [
        c for one in layers for word, c in one.channels.items() if word != "z" and depth_named(word)
    ],
    lambda layers: [
        one.channels["z"] for one in layers if one.has("z") and not one.has("x") and not one.has("y")
    ],
    lambda layers: [one.channels["t"] for one in layers if one.name and list(one.channels) == ["t"]],
    _of_pbrt,
    lambda layers: [c for one in layers for c in one.channels.values()] if _is_single(layers) else [],
)

_COLOR_RULES: tuple[Callable[[_Layer], bool], ...] = (
    lambda layer: not layer.name and layer.has("r", "g", "b"),
    lambda layer: layer.name.lower() == "composite.combined" and layer.has("r", "g", "b"),
    lambda layer: layer.word in _COLOR_LAYERS and layer.has("r", "g", "b"),
    lambda layer: (
        layer.has("r", "g", "b")
        and not depth_named(layer.word)
        and not any(part in layer.word for part in _DATA)
    ),
    lambda layer: layer.has("r", "g", "b") and not depth_named(layer.word),
    lambda layer: not layer.name and layer.has("y"),
    lambda layer: layer.has("y") and not layer.has("x") and not depth_named(layer.word),
)


def _is_single(layers: list[_Layer]) -> bool:
    return len(layers) == 1 and len(layers[0].channels) == 1
