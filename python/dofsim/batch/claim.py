"""One run at a time over a folder of results."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_NAME = ".dofsim-batch"
# How systems say that another process has the lock.
_HELD = {errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES}


@contextmanager
def claimed(folder: Path) -> Iterator[bool]:
    """Hold a folder for this run alone, until it ends or dies.

    Parameters
    ----------
    folder : Path
        The folder of the results.

    Yields
    ------
    bool
        Whether the run before this one died.

    Raises
    ------
    ValueError
        If another run holds the folder.
    """
    path = folder / _NAME
    file = _locked(path)
    try:
        # Whoever comes to an end leaves no such file, and one who dies leaves it as it was.
        died = os.fstat(file).st_size > 0
        os.ftruncate(file, 0)
        os.write(file, f"{os.getpid()}\n".encode())
        try:
            yield died
        finally:
            _remove(file, path)
    finally:
        os.close(file)


def _locked(path: Path) -> int:
    """Open a file that no other process has locked, and lock it."""
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _lock(file)
        except OSError as error:
            holder = os.read(file, 20).decode(errors="replace").strip()
            os.close(file)
            if error.errno not in _HELD:
                raise OSError(error.errno, error.strerror, str(path)) from error
            raise ValueError(
                f"{path.parent}: another dofsim batch is writing there (process {holder}); wait for its end"
            ) from error
        if _is_at(file, path):
            return file
        # The one who had it before has removed it in between.
        os.close(file)


def _is_at(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def _lock(file: int) -> None:
    """Lock a file until it is closed; an OSError says that another process has it."""
    if sys.platform == "win32":
        import msvcrt

        # A byte beyond the end, so that the others can be read.
        os.lseek(file, 1 << 10, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        os.lseek(file, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _remove(file: int, path: Path) -> None:
    """Remove a file that is still locked; where that cannot be, leave it empty."""
    os.ftruncate(file, 0)
    with suppress(PermissionError):
        path.unlink(missing_ok=True)
