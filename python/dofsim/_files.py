"""Files of others, opened only if they are files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

StrPath = str | os.PathLike[str]


def check_regular(path: StrPath) -> None:
    """Refuse pipes and devices before they are opened: to open a pipe is to wait for whoever writes into it.

    Parameters
    ----------
    path : str or path-like
        A file, or a link to one.

    Raises
    ------
    ValueError
        If it is a pipe, a device or a socket.
    OSError
        If it is not there.
    """
    there = Path(path)
    there.stat()
    if not there.is_file() and not there.is_dir():
        raise ValueError(f"{path}: found a pipe or a device; accepted: regular files")


def open_regular(path: StrPath) -> BinaryIO:
    """Open a file to read its bytes, unless it is a pipe or a device."""
    check_regular(path)
    return Path(path).open("rb")


def read_text(path: StrPath) -> str:
    """Read a text in UTF-8, unless it is a pipe or a device."""
    with open_regular(path) as file:
        return file.read().decode("utf-8-sig")
