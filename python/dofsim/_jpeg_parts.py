"""What phones put into a JPEG beside its picture: XMP in parts, and further pictures behind the first."""

from __future__ import annotations

import base64
import binascii
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

from ._extras import missing
from ._files import StrPath, open_regular

_XMP = b"http://ns.adobe.com/xap/1.0/\0"
_EXTENDED = b"http://ns.adobe.com/xmp/extension/\0"
_START_OF_SCAN = 0xDA
_RDF = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}"
_GDEPTH = "{http://ns.google.com/photos/1.0/depthmap/}"
_DEPTH_MAP = "{http://ns.google.com/photos/dd/1.0/depthmap/}"
_ITEMS = (
    "{http://ns.google.com/photos/1.0/container/item/}",
    "{http://ns.google.com/photos/dd/1.0/item/}",
)


@dataclass
class DepthPart:
    """A depth map of a JPEG.

    Attributes
    ----------
    data : bytes
        A picture file.
    inverse : bool
        Whether codes are even in inverse depth, and not in depth.
    near, far : float
        The depths of code 0 and of the last code.
    """

    data: bytes
    inverse: bool
    near: float
    far: float


@dataclass
class _Packets:
    standard: list[bytes] = field(default_factory=list)
    extended: dict[bytes, dict[int, bytes]] = field(default_factory=dict)


def read_depth_part(path: StrPath) -> DepthPart | None:
    """Read the depth map that a phone has put into a JPEG: Google's GDepth, or Dynamic Depth.

    Parameters
    ----------
    path : str or path-like
        The JPEG.

    Returns
    -------
    DepthPart or None
        The map, if there is one.

    Raises
    ------
    ValueError
        If what is said of a map is damaged, or the map is not where it should be.
    ImportError
        If there is XMP and ``defusedxml`` is not installed.
    """
    with open_regular(path) as file:
        content = file.read()
    packets = _packets(content)
    texts = packets.standard + [
        b"".join(part for _, part in sorted(parts.items())) for parts in packets.extended.values()
    ]
    words: dict[str, str] = {}
    items: list[dict[str, str]] = []
    for text in texts:
        for attributes in _elements(path, text):
            words |= attributes
            for prefix in _ITEMS:
                if item := {
                    name[len(prefix) :]: value
                    for name, value in attributes.items()
                    if name.startswith(prefix)
                }:
                    items.append(item)
    if (data := words.get(_GDEPTH + "Data")) is not None:
        return _of_words(path, words, _GDEPTH, _decoded(path, data))
    if (appended := _appended(path, content, items, words.get(_DEPTH_MAP + "DepthURI"))) is not None:
        return _of_words(path, words, _DEPTH_MAP, appended)
    return None


def _packets(content: bytes) -> _Packets:
    """Find the XMP of a JPEG's header."""
    found = _Packets()
    for segment in _segments(content):
        if segment.startswith(_XMP):
            found.standard.append(segment[len(_XMP) :])
        elif segment.startswith(_EXTENDED) and len(segment) >= len(_EXTENDED) + 40:
            rest = segment[len(_EXTENDED) :]
            # An identifier, the length of all, and where this part of it begins.
            identifier, (_, offset) = rest[:32], struct.unpack(">II", rest[32:40])
            found.extended.setdefault(identifier, {})[offset] = rest[40:]
    return found


def _segments(content: bytes) -> Iterator[bytes]:
    """Give the segments for applications, up to the picture itself."""
    at = 2
    while at + 4 <= len(content) and content[at] == 0xFF:
        marker, length = content[at + 1], int.from_bytes(content[at + 2 : at + 4], "big")
        if marker == _START_OF_SCAN or length < 2:
            return
        if marker == 0xE1:
            yield content[at + 4 : at + 2 + length]
        at += 2 + length


def _elements(path: StrPath, text: bytes) -> Iterator[dict[str, str]]:
    """Give the words of every element of a packet: its attributes, and its children that are text."""
    try:
        from defusedxml import DefusedXmlException
        from defusedxml.ElementTree import ParseError, fromstring
    except ImportError as error:
        raise ImportError(missing("the depth in a photograph needs", "defusedxml", "photo")) from error
    try:
        root = fromstring(text.strip(b"\0 \r\n\t"))
    except (ParseError, DefusedXmlException, ValueError) as error:
        raise ValueError(f"{path}: damaged file: its XMP: {type(error).__name__}") from error
    for element in root.iter():
        words = dict(element.attrib)
        words |= {child.tag: child.text for child in element if child.text and not child.tag.startswith(_RDF)}
        if words:
            yield words


def _decoded(path: StrPath, data: str) -> bytes:
    try:
        # The padding at the end is often missing.
        bare = "".join(data.split()).rstrip("=")
        return base64.b64decode(bare + "=" * (-len(bare) % 4), validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"{path}: damaged file: its depth map is no base64") from error


def _appended(path: StrPath, content: bytes, items: list[dict[str, str]], uri: str | None) -> bytes | None:
    """Give the depth map among the files that follow the picture, as the directory in XMP lists them."""
    lengths = [_whole(path, item.get("Length", "0")) for item in items]
    wanted = [
        index
        for index, item in enumerate(items)
        if item.get("Semantic") == "Depth" or (uri is not None and item.get("DataURI") == uri)
    ]
    if not wanted:
        return None
    # The first is the picture itself; the others end where the file ends.
    index = wanted[0]
    end = len(content) - sum(lengths[index + 1 :])
    if index == 0 or lengths[index] <= 0 or not 0 < end - lengths[index] < end <= len(content):
        raise ValueError(f"{path}: damaged file: its depth map lies outside of it")
    return content[end - lengths[index] : end]


def _whole(path: StrPath, text: str) -> int:
    if not text.strip().isdecimal() or len(text) > 18:
        raise ValueError(f"{path}: damaged file: a part of {text[:20]!r} bytes")
    return int(text)


def _of_words(path: StrPath, words: dict[str, str], prefix: str, data: bytes) -> DepthPart:
    try:
        near, far = (
            float(words.get(prefix + name, default)) for name, default in (("Near", "0"), ("Far", "1"))
        )
    except ValueError as error:
        raise ValueError(f"{path}: damaged file: the range of its depth map") from error
    inverse = words.get(prefix + "Format", "RangeInverse") != "RangeLinear"
    return DepthPart(data, inverse, near, far)
