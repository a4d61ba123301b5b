"""Which depth belongs to which picture, by their names."""

from __future__ import annotations

import glob
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from difflib import SequenceMatcher
from itertools import dropwhile, islice, takewhile
from pathlib import Path, PurePath

from dofsim._files import StrPath
from dofsim.io import READABLE_SUFFIXES

# A frame's number in a pattern, as of printf and of Nuke, Blender and Houdini.
_NUMBER = re.compile(r"%0?(\d*)d|#+")
# What sets the words of a name apart.
_BETWEEN = re.compile(r"([-_.]+)")
# Words that tell the picture and the depth of one frame apart.
_ROLE = r"(?:colou?r|rgb|image|img|left|depth(?:_meters)?|disp(?:arity)?|z)"
_LEADING = re.compile(rf"^{_ROLE}[-_.]", re.IGNORECASE)
# So many names of each kind are compared for the nearest two.
_COMPARED = 50
_TRAILING = re.compile(rf"[-_.]{_ROLE}$", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """Files that belong together, and files that belong to nothing.

    Attributes
    ----------
    pairs : dict of str to tuple of Path
        The picture and the depth of each frame, by the frame's name; the depth is None if none was asked for.
        A name is a path of the frame relative to its folder, without suffix, with slashes.
    unmatched : list of Path
        Files without a partner.
    """

    pairs: dict[str, tuple[Path, Path | None]]
    unmatched: list[Path]


def pair_files(color: StrPath, depth: StrPath | None = None, *, exclude: StrPath | None = None) -> Pairing:
    """Return the frames whose picture and depth map belong together by their names.

    A file's name in its frame is its path from the folder given (of a pattern: from the part before the first
    wildcard), without the suffix, and without one of the words color, rgb, image, img, left, depth,
    depth_meters, disp, disparity or z where such a word begins or ends the file's name and ``-``, ``_`` or
    ``.`` sets it apart. Picture and depth of equal names are a frame. So ``rgb/a/0001.png`` belongs to
    ``depth/a/0001.pfm`` for the folders ``rgb`` and ``depth``, and ``0001_rgb.png`` to ``0001_depth.exr``.
    Of what is left, names that differ in one word, or by one more, are a frame if there is no other choice
    and the word is no number: ``shot.beauty.0001.exr`` and ``shot.depth.0001.exr``. The frame then has the
    name of the picture.

    Parameters
    ----------
    color : str or path-like
        A folder, searched with those below it for files with one of `dofsim.io.READABLE_SUFFIXES`; a pattern
        such as ``"scenes/*/rgb/*.png"``, ``"shot.beauty.####.exr"`` or ``"%04d.png"``; or a file.
    depth : str or path-like, optional
        The same for the depth; without it each file holds picture and depth.
    exclude : str or path-like, optional
        A folder below those given that is not searched, such as that of the results.

    Returns
    -------
    Pairing
        The frames in the order of their names.

    Raises
    ------
    ValueError
        If two files have one name, or if there is no frame.
    OSError
        If a folder or a file is not there.

    Examples
    --------
    >>> from pathlib import Path
    >>> from dofsim.batch import pair_files
    >>> for name in ("rgb/0001.png", "rgb/0002.png", "depth/0001_depth.pfm"):
    ...     Path(name).parent.mkdir(exist_ok=True)
    ...     Path(name).touch()
    >>> found = pair_files("rgb", "depth")
    >>> {name: depth.name for name, (_, depth) in found.pairs.items()}
    {'0001': '0001_depth.pfm'}
    >>> [path.as_posix() for path in found.unmatched]
    ['rgb/0002.png']
    """
    pictures = _named(color, exclude)
    if depth is None:
        if not pictures:
            raise ValueError(f"{color}: there is no file")
        return Pairing(pairs={name: (path, None) for name, path in pictures.items()}, unmatched=[])
    depths = _named(depth, exclude)
    pairs: dict[str, tuple[Path, Path | None]] = {
        name: (path, depths[name]) for name, path in pictures.items() if name in depths
    }
    left = {name: path for name, path in pictures.items() if name not in pairs}
    by_word = _differing_by_a_word(left, [name for name in depths if name not in pairs])
    pairs |= {name: (left[name], depths[other]) for name, other in by_word.items()}
    pairs = dict(sorted(pairs.items()))
    if not pairs:
        raise ValueError(
            f"no file of {color} pairs with one of {depth} ({len(pictures)} and {len(depths)} files)"
            f"{_nearest(pictures, depths)}. A picture and its depth map have the same name, or names with "
            "the same number that differ in one word; a manifest lists pairs of any names"
        )
    paired = {path for pair in pairs.values() for path in pair}
    unmatched = [path for path in (*pictures.values(), *depths.values()) if path not in paired]
    return Pairing(pairs=pairs, unmatched=unmatched)


def _differing_by_a_word(pictures: Iterable[str], depths: Iterable[str]) -> dict[str, str]:
    """Find the names that are equal but for one word, or without one, where that is the only choice."""
    by_rest: dict[tuple[str, ...], list[str]] = {}
    for name in depths:
        for rest in _without_a_word(name):
            by_rest.setdefault(rest, []).append(name)
    found = {
        name: {other for rest in _without_a_word(name) for other in by_rest.get(rest, [])}
        for name in pictures
    }
    only = {name: others.pop() for name, others in found.items() if len(others) == 1}
    claims = Counter(only.values())
    return {name: other for name, other in only.items() if claims[other] == 1}


def _without_a_word(name: str) -> list[tuple[str, ...]]:
    """Give a name's words as they are, and with each of them but numbers left out."""
    folder, _, last = name.rpartition("/")
    words = [word for word in _BETWEEN.split(last) if word]
    rests = [(folder, *words)]
    for index, word in enumerate(words):
        if not _BETWEEN.fullmatch(word) and not any(letter.isdigit() for letter in word):
            # With the sign before or behind it, so that what is left is a name.
            first = max(index - 1, 0)
            rests.append((folder, *words[:first], *words[first + 2 :]))
    return rests


def _nearest(pictures: dict[str, Path], depths: dict[str, Path]) -> str:
    """Show the two names that are closest to each other."""
    best = max(
        (
            (SequenceMatcher(None, name, other).ratio(), name, other)
            for name in islice(pictures, _COMPARED)
            for other in islice(depths, _COMPARED)
        ),
        default=None,
    )
    if best is None:
        return ""
    _, name, other = best
    return f"; the closest names are {pictures[name]} and {depths[other]}"


def _named(where: StrPath, exclude: StrPath | None) -> dict[str, Path]:
    """Find the files of a folder or a pattern, by their names in their frames, in the order of these."""
    found: dict[str, Path] = {}
    out = None if exclude is None else Path(exclude).resolve()
    base = _base(os.fspath(where)).resolve()
    for path, relative in _listed(os.fspath(where)):
        if out is not None and _is_below(out, base) and path.resolve().is_relative_to(out):
            continue
        stem = relative.stem
        stem = _TRAILING.sub("", stem) if _TRAILING.search(stem) else _LEADING.sub("", stem)
        name = relative.with_name(stem).as_posix()
        if name in found:
            raise ValueError(f"{path}: is frame {name!r}, and so is {found[name]}")
        found[name] = path
    return dict(sorted(found.items()))


def would_find(where: StrPath, path: Path, *, exclude: StrPath) -> bool:
    """Tell whether a search as of `pair_files` comes upon a file, once it is there.

    Parameters
    ----------
    where : str or path-like
        A folder, a pattern or a file.
    path : Path
        The file.
    exclude : str or path-like
        A folder below it that is not searched.

    Returns
    -------
    bool
        Whether it does.
    """
    name = os.fspath(where)
    base = _base(name).resolve()
    file = path.resolve()
    if Path(name).is_file() or _is_below(Path(exclude).resolve(), base) or not _is_below(file, base):
        return False
    if Path(name).is_dir():
        return file.suffix.lower() in READABLE_SUFFIXES
    wild, numbered = _numbers(_wild_part(name))
    relative = PurePath(file.relative_to(base))
    return relative.match(wild) and (numbered is None or bool(numbered.fullmatch(relative.as_posix())))


def _is_below(path: Path, folder: Path) -> bool:
    return path != folder and path.is_relative_to(folder)


def _has_magic(part: str) -> bool:
    return glob.has_magic(part) or _NUMBER.search(part) is not None


def _is_pattern(where: str) -> bool:
    return _has_magic(where) and not Path(where).exists()


def _numbers(wild: str) -> tuple[str, re.Pattern[str] | None]:
    """Give a pattern with a star for the frame's number, and what names with such a number match."""
    if not _NUMBER.search(wild):
        return wild, None

    def digits(found: re.Match[str]) -> str:
        least = int(found[1] or 1) if found[0].startswith("%") else len(found[0])
        return rf"\d{{{least},}}"

    parts, expression, end = [], "", 0
    for found in _NUMBER.finditer(wild):
        between = wild[end : found.start()]
        parts += [between, "*"]
        expression += _as_expression(between) + digits(found)
        end = found.end()
    # Two stars in a name are one.
    star = re.sub(r"(?<=[^/*])\*\*+|\*\*+(?=[^/*])", "*", "".join([*parts, wild[end:]]))
    return star, re.compile(expression + _as_expression(wild[end:]))


def _as_expression(text: str) -> str:
    """Write the stars and question marks of a part of a pattern as a regular expression."""
    return re.escape(text).replace(r"\*\*/", "(?:.*/)?").replace(r"\*", "[^/]*").replace(r"\?", "[^/]")


def _base(where: str) -> Path:
    """Find the folder where a search begins."""
    if _is_pattern(where):
        return Path(*takewhile(lambda part: not _has_magic(part), Path(where).parts))
    return Path(where).parent if Path(where).is_file() else Path(where)


def _wild_part(where: str) -> str:
    """Give a pattern from its first wildcard on."""
    return str(Path(*dropwhile(lambda part: not _has_magic(part), Path(where).parts)))


def _listed(where: str) -> Iterator[tuple[Path, Path]]:
    """Yield the visible files, each as it is and from where its name begins."""
    base = _base(where)
    if not _is_pattern(where):
        # A missing folder raises here, as does anything that cannot be looked at.
        Path(where).stat()
        paths = [Path(where)]
        if not Path(where).is_file():
            paths = [path for path in base.rglob("*") if path.suffix.lower() in READABLE_SUFFIXES]
    else:
        wild, numbered = _numbers(_wild_part(where))
        paths = [
            path
            for path in base.glob(wild)
            if numbered is None or numbered.fullmatch(path.relative_to(base).as_posix())
        ]
    for path in sorted(paths):
        relative = path.relative_to(base)
        if path.is_file() and not any(part.startswith(".") for part in relative.parts):
            yield path, relative
