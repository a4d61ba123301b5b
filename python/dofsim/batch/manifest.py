"""Lists of frames with a lens for each: CSV or JSON lines."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePath
from typing import Any, Literal, TextIO

from dofsim import _options
from dofsim._files import StrPath, check_regular
from dofsim._names import shortened
from dofsim._save import SUFFIXES

_LENS_WORDS = tuple(
    dict.fromkeys(
        (*_options.THIN_WORDS, *_options.CAMERA_WORDS, *_options.RELATIVE_WORDS, *_options.FOCUS_WORDS)
    )
)
_FILES = ("color", "depth", "holdout")
_WORDS = (*_FILES, "output", "focus_at", *_LENS_WORDS)


@dataclass(frozen=True, kw_only=True)
class Row:
    """A frame of a manifest.

    Attributes
    ----------
    name : str
        Where its result goes, relative to the folder of the results, without suffix.
    suffix : str, optional
        The suffix of its result, where the manifest names one.
    color : Path
        File of the picture.
    depth : Path, optional
        File of the depth.
    holdout : Path, optional
        File of the holdout.
    lens : dict
        Words of the lens.
    focus_at : tuple of int or "random", optional
        Column and row of the pixel to focus on.
    """

    name: str
    color: Path
    depth: Path | None = None
    holdout: Path | None = None
    suffix: str | None = None
    lens: dict[str, Any] = field(default_factory=dict)
    focus_at: tuple[int, int] | Literal["random"] | None = None


def read_manifest(path: StrPath) -> list[Row]:
    r"""Return the frames that a CSV or JSON-lines file lists.

    Parameters
    ----------
    path : str or path-like
        A ``.csv`` file with a line of titles, or a ``.jsonl`` file with one object a line. Titles and keys
        are ``color``, and as wanted ``depth``, ``holdout``, ``output``, ``focus_at`` (``"X,Y"``,
        ``"random"``, in JSON also two numbers) and the words of a lens, such as ``focus_distance`` or
        ``in_focus`` (``"NEAR,FAR"``, likewise). Empty cells and null are not given. Paths are relative to
        the manifest; ``output`` is relative to the folder of the results, and is the path of the picture if
        not given. A suffix of
        `dofsim.io.SUFFIXES` that it has is the format of the result.

    Returns
    -------
    list of Row
        The frames in their order.

    Raises
    ------
    ValueError
        If a line is not as described; the text names the file and the line.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> from pathlib import Path
    >>> from dofsim.batch import read_manifest
    >>> _ = Path("frames.csv").write_text('color,depth,focus_at,f_number\na.png,a.npy,"10,20",2.8\n')
    >>> (row,) = read_manifest("frames.csv")
    >>> row.name, row.focus_at, row.lens
    ('a', (10, 20), {'f_number': 2.8})
    """
    path = Path(path)
    readers = {".csv": _csv_rows, ".jsonl": _json_rows}
    if path.suffix.lower() not in readers:
        raise ValueError(f"{path}: a manifest is a .csv or a .jsonl file")
    check_regular(path)
    with path.open(encoding="utf-8-sig", newline="") as file:
        try:
            rows = list(readers[path.suffix.lower()](file, path))
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: not a text file: {error}") from error
    if not rows:
        raise ValueError(f"{path}: there is no frame")
    return rows


def _csv_rows(file: TextIO, path: Path) -> Iterator[Row]:
    lines = csv.DictReader(file)
    while True:
        with _located(path, lambda: lines.line_num):
            if (words := next(lines, None)) is None:
                return
            row = _row(path.parent, words)
        yield row


def _json_rows(file: TextIO, path: Path) -> Iterator[Row]:
    for number, line in enumerate(file, 1):
        if line.strip():
            with _located(path, partial(int, number)):
                row = _row(path.parent, json.loads(line))
            yield row


@contextmanager
def _located(path: Path, line: Callable[[], int]) -> Iterator[None]:
    """Put the file and the line before what is wrong in it."""
    try:
        yield
    except UnicodeDecodeError:
        raise
    except (ValueError, TypeError, OverflowError, csv.Error) as error:
        raise ValueError(f"{path}, line {line()}: {error}") from error
    except RecursionError as error:
        raise ValueError(f"{path}, line {line()}: it is nested too deeply") from error


def _row(folder: Path, words: Any) -> Row:
    if not isinstance(words, dict):
        raise TypeError("expected an object")
    given = {name: value for name, value in words.items() if value is not None and value != ""}
    # The csv module collects cells beyond the titles under None.
    if None in words:
        raise ValueError("the line has more cells than the first line has titles")
    if alien := [name for name in given if name not in _WORDS]:
        raise ValueError(f'a frame has no "{", ".join(alien)}"; it has {", ".join(_WORDS)}')
    if "color" not in given:
        raise ValueError("color is missing")
    files = {name: folder / given[name] for name in _FILES if name in given}
    lens = {name: _lens_value(name, given[name]) for name in given if name in _LENS_WORDS}
    name, suffix = _name(given)
    return Row(name=name, suffix=suffix, lens=lens, focus_at=_focus_at(given.get("focus_at")), **files)


def _name(given: dict[str, Any]) -> tuple[str, str | None]:
    if "output" in given:
        name = PurePath(given["output"])
        if name.is_absolute() or ".." in name.parts:
            raise ValueError(f"output must be within the folder of the results; got {given['output']!r}")
        if name.suffix.lower() in SUFFIXES:
            return name.with_suffix("").as_posix(), name.suffix
    else:
        name = PurePath(given["color"]).with_suffix("")
        if name.is_absolute() or ".." in name.parts:
            name = PurePath(name.name)
    return name.as_posix(), None


def _lens_value(name: str, value: Any) -> float | str | tuple[float, float]:
    if name in ("fov_axis", "sensor"):
        return str(value)
    if name == "in_focus" and isinstance(value, str):
        return _options.read_range(value)
    if name == "in_focus":
        near, far = value
        return float(near), float(far)
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be a number; got {shortened(repr(value))}") from None


def _focus_at(value: Any) -> tuple[int, int] | Literal["random"] | None:
    if value is None:
        return None
    if value == "random":
        return "random"
    if isinstance(value, str):
        return _options.read_numbers("focus_at", value, int, "a column and a row, X,Y")
    x, y = value
    return int(x), int(y)
