"""What phones put into a JPEG beside its picture: XMP in parts, and further pictures behind the first."""

from __future__ import annotations

import base64
import binascii
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from dofsim._extras import missing
from dofsim._files import StrPath, open_regular

_XMP = b"http://ns.adobe.com/xap/1.0/\0"
_EXTENDED = b"http://ns.adobe.com/xmp/extension/\0"
_MULTI_PICTURE = b"MPF\0"
# The tag of the pictures of Multi-Picture Format.
_ENTRIES = 0xB002
_START_OF_SCAN = 0xDA
_APP1 = 0xE1
APP2 = 0xE2
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


class Jpeg:
    """What a JPEG holds beside its picture.

    Parameters
    ----------
    path : str or path-like
        The file, for errors.
    content : bytes
        All of it.

    Raises
    ------
    ValueError
        If its XMP is damaged.
    ImportError
        If there is XMP and ``defusedxml`` is not installed.
    """

    def __init__(self, path: StrPath, content: bytes) -> None:
        self.path = path
        self.content = content
        packets = _packets(content)
        texts = packets.standard + [
            b"".join(part for _, part in sorted(parts.items())) for parts in packets.extended.values()
        ]
        self.words: dict[str, str] = {}
        """The words of its XMP, by their names with their namespaces in braces."""
        self.items: list[dict[str, str]] = []
        """The files in it as its directory lists them, the picture itself first."""
        for text in texts:
            for attributes in _elements(path, text):
                self.words |= attributes
                for prefix in _ITEMS:
                    if item := {
                        name[len(prefix) :]: value
                        for name, value in attributes.items()
                        if name.startswith(prefix)
                    }:
                        self.items.append(item)

    @classmethod
    def read(cls, path: StrPath) -> Jpeg:
        """Read a file.

        Parameters
        ----------
        path : str or path-like
            The JPEG.

        Returns
        -------
        Jpeg
            Its parts.

        Raises
        ------
        ValueError, ImportError
            As of the class.
        """
        with open_regular(path) as file:
            return cls(path, file.read())

    def depth(self) -> DepthPart | None:
        """Find the depth map that a phone has put into it: Google's GDepth, or Dynamic Depth.

        Returns
        -------
        DepthPart or None
            The map, if there is one.

        Raises
        ------
        ValueError
            If what is said of a map is damaged, or the map is not where it should be.
        """
        if (data := self.words.get(_GDEPTH + "Data")) is not None:
            return _of_words(self.path, self.words, _GDEPTH, _decoded(self.path, data))
        uri = self.words.get(_DEPTH_MAP + "DepthURI")
        lengths = [_whole(self.path, item.get("Length", "0")) for item in self.items]
        wanted = [
            index
            for index, item in enumerate(self.items)
            if item.get("Semantic") == "Depth" or (uri is not None and item.get("DataURI") == uri)
        ]
        if not wanted:
            return None
        if (found := self._appended(wanted[0], lengths)) is None:
            raise ValueError(f"{self.path}: damaged file: its depth map lies outside of it")
        return _of_words(self.path, self.words, _DEPTH_MAP, found)

    def pictures(self) -> list[bytes]:
        """Find the pictures behind the first one, by the directories in XMP and of Multi-Picture Format.

        Either is often left by programs that have dropped the pictures themselves, so that those that are not
        there are left out.

        Returns
        -------
        list of bytes
            JPEG files.
        """
        lengths = [_whole(self.path, item.get("Length", "0")) for item in self.items]
        found = [
            self._appended(index, lengths)
            for index, item in enumerate(self.items)
            if item.get("Semantic") == "GainMap"
        ]
        found += [self.content[start : start + length] for start, length in _multi_picture(self.content)]
        return [data for data in found if data is not None and data.startswith(b"\xff\xd8")]

    def _appended(self, index: int, lengths: list[int]) -> bytes | None:
        """Give one of the files that follow the picture; the last of them ends where this file ends."""
        end = len(self.content) - sum(lengths[index + 1 :])
        if index == 0 or lengths[index] <= 0 or not 0 < end - lengths[index] < end <= len(self.content):
            return None
        return self.content[end - lengths[index] : end]


def _packets(content: bytes) -> _Packets:
    """Find the XMP of a JPEG's header."""
    found = _Packets()
    for segment in segments(content, _APP1):
        if segment.startswith(_XMP):
            found.standard.append(segment[len(_XMP) :])
        elif segment.startswith(_EXTENDED) and len(segment) >= len(_EXTENDED) + 40:
            rest = segment[len(_EXTENDED) :]
            # An identifier, the length of all, and where this part of it begins.
            identifier, (_, offset) = rest[:32], struct.unpack(">II", rest[32:40])
            found.extended.setdefault(identifier, {})[offset] = rest[40:]
    return found


def segments(content: bytes, wanted: int) -> Iterator[bytes]:
    """Give the segments of a JPEG that have a marker, up to the picture itself.

    Parameters
    ----------
    content : bytes
        A JPEG.
    wanted : int
        The second byte of the marker.

    Yields
    ------
    bytes
        What a segment holds.
    """
    for at, length in _places(content, wanted):
        yield content[at : at + length]


def _places(content: bytes, wanted: int) -> Iterator[tuple[int, int]]:
    at = 2
    while at + 4 <= len(content) and content[at] == 0xFF:
        marker, length = content[at + 1], int.from_bytes(content[at + 2 : at + 4], "big")
        if marker == _START_OF_SCAN or length < 2:
            return
        if marker == wanted:
            yield at + 4, length - 2
        at += 2 + length


def _multi_picture(content: bytes) -> Iterator[tuple[int, int]]:
    """Give place and length of the pictures that Multi-Picture Format lists behind the first.

    Its directory is that of TIFF, and places are counted from where that begins.
    """
    for at, length in _places(content, APP2):
        segment = content[at : at + length]
        order = {b"II*\0": "little", b"MM\0*": "big"}.get(segment[4:8])
        if not segment.startswith(_MULTI_PICTURE) or order is None:
            continue
        directory = segment[4:]

        def number(start: int, size: int, directory: bytes = directory, order: Any = order) -> int:
            return int.from_bytes(directory[start : start + size], order)

        first = number(4, 4)
        for entry in range(first + 2, min(first + 2 + 12 * number(first, 2), len(directory)), 12):
            if number(entry, 2) != _ENTRIES:
                continue
            start = number(entry + 8, 4)
            for one in range(start, min(start + number(entry + 4, 4), len(directory) - 15), 16):
                size, place = number(one + 4, 4), number(one + 8, 4)
                if place > 0 and size > 0 and at + 4 + place + size <= len(content):
                    yield at + 4 + place, size


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
        texts = {child.tag: _text(child) for child in element if not child.tag.startswith(_RDF)}
        words |= {tag: text for tag, text in texts.items() if text}
        if words:
            yield words


def _text(element: Any) -> str:
    """Give the text of an element; that of a list, with spaces between."""
    listed = [item.text or "" for part in element if part.tag == _RDF + "Seq" for item in part]
    return " ".join(listed).strip() or (element.text or "").strip()


def _decoded(path: StrPath, data: str) -> bytes:
    try:
        # The padding at the end is often missing.
        bare = "".join(data.split()).rstrip("=")
        return base64.b64decode(bare + "=" * (-len(bare) % 4), validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"{path}: damaged file: its depth map is no base64") from error


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
