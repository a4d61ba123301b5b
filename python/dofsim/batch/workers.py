"""Processes that work for this one and end with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor


def process_pool(workers: int) -> ProcessPoolExecutor:
    """Make a pool of processes for `map_frames`.

    They leave Ctrl-C to this process, which then waits for the frames under way, and end when it is killed.

    Parameters
    ----------
    workers : int
        Number of processes.

    Returns
    -------
    ProcessPoolExecutor
        The pool. Its processes are started anew, not forked: a fork copies locks that other threads hold.
    """
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=_start)


def _start() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A worker waits for work on a pipe that it also holds the other end of, so it would wait for ever.
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
