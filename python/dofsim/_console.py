"""What the commands say on the standard error stream, and when."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

import dofsim

from ._names import printable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["FASTER", "patience", "set_level", "taken", "to_stderr", "wake", "without_noise"]

log = logging.getLogger("dofsim")

# A render that takes longer says how far it is, and again after this many times as long. So often it is
# looked at.
_FIRST_WORD_S = 2.0
_NEXT_WORD = 4.0
_LOOK_S = 0.1
_SAMPLES = 4096
# What blurs widely in less time than the default, which knows what each point of the lens sees.
FASTER = ("gaussian", "levels", "hexagonal")


class _Lines(logging.Handler):
    """Write each record as a line on the standard error stream of the moment; warnings as those of errors."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record.

        Parameters
        ----------
        record : LogRecord
            The record.
        """
        text = printable(record.getMessage())
        print(f"dofsim: {text}" if record.levelno >= logging.WARNING else text, file=sys.stderr)


@contextmanager
def to_stderr() -> Iterator[None]:
    """Show what the logger named dofsim is told while a command runs."""
    # The commands say what was rendered themselves, with the names of the files.
    renders = logging.getLogger("dofsim.render")
    handler, levels = _Lines(), (log.level, renders.level)
    log.addHandler(handler)
    set_level()
    renders.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(levels[0])
        renders.setLevel(levels[1])


def set_level(*, quiet: bool = False, verbose: bool = False) -> None:
    """Choose what is shown: warnings alone, what was done, or all."""
    log.setLevel(logging.WARNING if quiet else logging.DEBUG if verbose else logging.INFO)


def taken(seconds: float) -> str:
    """Write how long something took."""
    if seconds < 0.1:
        return f"{1e3 * seconds:.0f} ms"
    return f"{seconds:.2f} s" if seconds < 10.0 else f"{seconds:.0f} s"


@contextmanager
def patience(
    what: str, *, out: NDArray[np.float32] | None = None, faster: Sequence[str] = ()
) -> Iterator[None]:
    """Say how far long work is, how long the rest will take, and what would be faster.

    Parameters
    ----------
    what : str
        The work.
    out : ndarray, optional
        What is rendered into, of which NaN is not rendered yet.
    faster : sequence of str, optional
        Methods that would take less time.
    """
    over = threading.Event()
    watcher = threading.Thread(target=_watch, args=(what, out, faster, over), daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()


def _watch(what: str, out: NDArray[np.float32] | None, faster: Sequence[str], over: threading.Event) -> None:
    import numpy as np

    # Enough of the picture to know the share that is done to a few per cent.
    some = None if out is None else out.reshape(-1)[:: max(1, out.size // _SAMPLES)]
    start, first, due = time.perf_counter(), None, _FIRST_WORD_S
    while not over.wait(_LOOK_S):
        elapsed = time.perf_counter() - start
        done = 0.0 if some is None else 1.0 - float(np.isnan(some).mean())
        if first is None and done > 0.0:
            # What comes before is preparation.
            first = elapsed
        if elapsed < due:
            continue
        text = f"{what}: {elapsed:.0f} s so far"
        if first is not None and first < elapsed and 0.0 < done < 1.0:
            text += f", {done:.0%} done, about {(elapsed - first) * (1.0 - done) / done:.0f} s to go"
        if faster:
            text += f"; faster, with less detail: --method {', '.join(faster)}"
        log.info("%s", text)
        due = _NEXT_WORD * elapsed


def wake(device: str, *, verbose: bool) -> None:
    """Look for GPUs before they are needed, and keep what their drivers say about it from the terminal."""
    if device != "cpu":
        with without_noise(verbose):
            dofsim.devices()


@contextmanager
def without_noise(verbose: bool) -> Iterator[None]:
    """Keep what graphics drivers write on the standard error stream by themselves from it."""
    stream: TextIO | None = sys.__stderr__
    try:
        number = -1 if verbose or stream is None else stream.fileno()
    except (OSError, ValueError):
        number = -1
    if number < 0:
        yield
        return
    sys.stderr.flush()
    kept = os.dup(number)
    try:
        with open(os.devnull, "wb") as nothing:  # noqa: PTH123
            os.dup2(nothing.fileno(), number)
        yield
    finally:
        os.dup2(kept, number)
        os.close(kept)
