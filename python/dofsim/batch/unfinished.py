"""Files that a process did not live to finish."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .frames import Frame

# As much of a name as is in that of an unfinished file, and how much less it may be where a character ends.
_PART_BYTES = 200
_LONGEST_CHARACTER = 4


@contextmanager
def without_unfinished(frames: Collection[Frame]) -> Iterator[None]:
    """Remove what earlier runs have left of some frames, and at the end what workers that died have left.

    Parameters
    ----------
    frames : collection of Frame
        The frames; see `remove_unfinished`.
    """
    remove_unfinished(frames)
    try:
        yield
    finally:
        remove_unfinished(frames)


def remove_unfinished(frames: Collection[Frame]) -> None:
    """Remove the unfinished files of these frames whose processes have died.

    Parameters
    ----------
    frames : collection of Frame
        The frames. What a living process writes is left alone, and so is what belongs to other frames.
    """
    known = {path for frame in frames for path in (frame.record, *frame.files.values())}
    for folder in {path.parent for path in known}:
        names = [path.name for path in known if path.parent == folder]
        for part in folder.glob(".*.part"):
            match = re.fullmatch(r"\.(.+)\.\d+-\d+\.part", part.name)
            if match and any(_begins(name, match[1]) for name in names):
                _remove_abandoned(part)


def _begins(name: str, beginning: str) -> bool:
    """Tell whether an unfinished file is one of this name, of which only so much may be in its own."""
    return name == beginning or (
        name.startswith(beginning) and len(beginning.encode()) > _PART_BYTES - _LONGEST_CHARACTER
    )


def _remove_abandoned(part: Path) -> None:
    """Remove an unfinished file unless a process holds the lock that it has while it is written."""
    if sys.platform == "win32":
        # What a living process writes cannot be removed there.
        return
    import fcntl

    try:
        # Some network file systems lock only what is open for writing.
        file = os.open(part, os.O_RDWR)
    except OSError:
        return
    try:
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            part.unlink(missing_ok=True)
    finally:
        os.close(file)
