"""What the commands say on the standard error stream, and when."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

import dofsim

from ._names import printable

__all__ = ["patience", "set_level", "taken", "to_stderr", "wake", "without_noise"]

log = logging.getLogger("dofsim")

# A render that takes longer says that it is alive, and again after this many times as long.
_FIRST_WORD_S = 2.0
_NEXT_WORD = 4.0
# What blurs widely in less time than the default, which knows what each point of the lens sees.
_FASTER = ("gaussian", "levels", "hexagonal")


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
def patience(shape: tuple[int, ...], method: str) -> Iterator[None]:
    """Say that a long render goes on, and what would be faster.

    Parameters
    ----------
    shape : tuple of int
        Of the picture.
    method : str
        How it is rendered.
    """
    done = threading.Event()

    def watch() -> None:
        elapsed = _FIRST_WORD_S
        while not done.wait(elapsed if elapsed == _FIRST_WORD_S else elapsed * (1.0 - 1.0 / _NEXT_WORD)):
            height, width = shape[:2] if len(shape) < 4 else shape[1:3]
            advice = f"; faster, with less detail: --method {', '.join(_FASTER)}" if method == "lens" else ""
            log.info("rendering %d x %d for %.0f s so far%s", width, height, elapsed, advice)
            elapsed *= _NEXT_WORD

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()


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
