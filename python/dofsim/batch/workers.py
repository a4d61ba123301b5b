"""Processes that work for this one and end with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any, ParamSpec, TypeVar

from dofsim._extras import missing

P = ParamSpec("P")
T = TypeVar("T")

# How often a frame is tried again on another machine; its own faults are results and not tried again.
_RETRIES = 3
_GPU = "GPU"
# How long a scheduler is waited for.
_TIMEOUT_S = 10


class Processes(Executor):
    """A pool of processes for `map_frames` that can be made anew when one of them was killed.

    Parameters
    ----------
    workers : int
        Number of processes.
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._pool = process_pool(workers)

    def submit(self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a function in a process; that none is left to do so is an error of its result."""
        try:
            return self._pool.submit(function, *args, **kwargs)
        except BrokenExecutor as error:
            future: Future[T] = Future()
            future.set_exception(error)
            return future

    def renew(self) -> None:
        """Take other processes in the place of those there were."""
        self._pool.shutdown(cancel_futures=True)
        self._pool = process_pool(self._workers)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes; see `concurrent.futures.Executor`."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


def process_pool(workers: int) -> ProcessPoolExecutor:
    """Make a pool of processes.

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
    return ProcessPoolExecutor(workers, mp_context=_Context(), initializer=_start)


@dataclass(frozen=True)
class Workers:
    """Who computes frames.

    Attributes
    ----------
    executor : concurrent.futures.Executor, optional
        Where to submit work, if not this process itself.
    slots : int
        How many calls are run at a time.
    threads_each : int, optional
        Threads that one call should use, if not all processors of its machine.
    """

    executor: Executor | None
    slots: int
    threads_each: int | None


def share_of_processors(workers: int) -> int:
    """Return the threads for each of some processes of this machine."""
    return max(1, (os.cpu_count() or 1) // workers)


@contextmanager
def dask_cluster(address: str, workers: int) -> Iterator[Workers]:
    """Connect to a Dask scheduler, or start a cluster on this machine alone.

    Parameters
    ----------
    address : str
        Address of the scheduler, or ``"local"`` for processes of this machine, on the loopback interface.
    workers : int
        Number of processes of a local cluster.

    Yields
    ------
    Workers
        Those of the cluster. Where some of them have a resource called GPU, each call takes one.

    Raises
    ------
    ImportError
        If ``distributed`` is not installed.
    OSError
        If there is no scheduler, if it has no worker, or if workers died too often.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise ImportError(missing("--dask needs", "distributed", "dask")) from error
    with ExitStack() as stack:
        if address == "local":
            local = distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
            )
            client = stack.enter_context(distributed.Client(stack.enter_context(local), set_as_default=False))
        else:
            client = stack.enter_context(
                distributed.Client(address, set_as_default=False, timeout=_TIMEOUT_S)
            )
        known = list(client.scheduler_info(n_workers=-1)["workers"].values())
        if not known:
            raise OSError(f"{address}: the scheduler has no worker")
        gpus = sum(int(worker["resources"].get(_GPU, 0)) for worker in known)
        resources = {"resources": {_GPU: 1}} if gpus else {}
        threads = [worker["nthreads"] for worker in known]
        if address == "local":
            threads_each: int | None = share_of_processors(workers)
        else:
            # A worker with several threads has one for each processor, and runs as many calls.
            threads_each = None if max(threads) == 1 else 1
        try:
            executor = client.get_executor(pure=False, retries=_RETRIES, **resources)
            yield Workers(executor, gpus or sum(threads), threads_each)
        except distributed.KilledWorker as error:
            raise OSError(
                "workers died too often over the same frame, as happens when memory runs out; "
                "run again to go on"
            ) from error


class _Process(SpawnProcess):
    # Inherits that SIGINT is blocked, so that Ctrl-C cannot meet a worker before `_start`.
    def start(self) -> None:
        if sys.platform == "win32":
            super().start()
            return
        # Some versions of Python unblock SIGINT after the start of their resource tracker.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Context(SpawnContext):
    Process = _Process


def _start() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A worker waits for work on a pipe that it also holds the other end of, so it would wait for ever.
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
