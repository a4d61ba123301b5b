"""Which depth belongs to which picture, by their names."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dofsim._files import StrPath
from dofsim.io import READABLE_SUFFIXES

# Words that tell the picture and the depth of one frame apart.
_ROLE = r"(?:colou?r|rgb|image|img|left|depth(?:_meters)?|disp(?:arity)?|z)"
_LEADING = re.compile(rf"^{_ROLE}[-_.]", re.IGNORECASE)
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
    """Find the files of frames.

    A file's name in its frame is its path from the folder given (of a pattern: from the part before the first
    wildcard), without the suffix, and without one of the words color, rgb, image, img, left, depth,
    depth_meters, disp, disparity or z where such a word begins or ends the file's name and ``-``, ``_`` or
    ``.`` sets it apart. Picture and depth of equal names are a frame. So ``rgb/a/0001.png`` belongs to
    ``depth/a/0001.pfm`` for the folders ``rgb`` and ``depth``, and ``0001_rgb.png`` to ``0001_depth.exr``.

    Parameters
    ----------
    color : str or path-like
        A folder, searched with those below it for files with one of `dofsim.io.READABLE_SUFFIXES`; a pattern
        such as ``"scenes/*/rgb/*.png"``; or a file.
    depth : str or path-like, optional
        The same for the depth; without it each file holds picture and depth.
    exclude : str or path-like, optional
        A folder that is not searched, such as that of the results, unless it is ``color`` or ``depth``
        itself.

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
    if not pairs:
        raise ValueError(
            f"none of {len(pictures)} files of {color} has the name of one of {len(depths)} of {depth}"
        )
    unmatched = [path for name, path in (pictures | depths).items() if name not in pairs]
    return Pairing(pairs=pairs, unmatched=unmatched)


def _named(where: StrPath, exclude: StrPath | None) -> dict[str, Path]:
    """Find the files of a folder or a pattern, by their names in their frames, in the order of these."""
    found: dict[str, Path] = {}
    out = None if exclude is None or os.fspath(exclude) == os.fspath(where) else Path(exclude).resolve()
    for path, relative in _listed(os.fspath(where)):
        if out is not None and path.resolve().is_relative_to(out):
            continue
        stem = relative.stem
        stem = _TRAILING.sub("", stem) if _TRAILING.search(stem) else _LEADING.sub("", stem)
        name = relative.with_name(stem).as_posix()
        if name in found:
            raise ValueError(f"{path}: is frame {name!r}, and so is {found[name]}")
        found[name] = path
    return dict(sorted(found.items()))


def _listed(where: str) -> Iterator[tuple[Path, Path]]:
    """Yield the visible files, each as it is and from where its name begins."""
    if not glob.has_magic(where) or Path(where).exists():
        base = Path(where)
        # A missing folder raises here, as does anything that cannot be looked at.
        base.stat()
        paths = [base]
        if not base.is_file():
            paths = [path for path in base.rglob("*") if path.suffix.lower() in READABLE_SUFFIXES]
        base = base.parent if base.is_file() else base
    else:
        parts = Path(where).parts
        fixed = next(index for index, part in enumerate(parts) if glob.has_magic(part))
        base = Path(*parts[:fixed])
        paths = list(base.glob(str(Path(*parts[fixed:]))))
    for path in sorted(paths):
        relative = path.relative_to(base)
        if path.is_file() and not any(part.startswith(".") for part in relative.parts):
            yield path, relative
