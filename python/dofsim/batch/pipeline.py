"""Many frames at once, in bounded memory."""

from __future__ import annotations

import json
import os
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from . import work
from .frames import Frame, Result
from .workers import Processes

S = TypeVar("S")
T = TypeVar("T")

# Steps of reading or writing under way or waiting beside the frame that is computed.
_AHEAD = 2


def map_frames(
    frames: Iterable[Frame],
    *,
    executor: Executor | None = None,
    in_flight: int = 32,
    resume: bool = True,
    failures: str | os.PathLike[str] | None = None,
) -> Iterator[Result]:
    """Render frames, write them, and yield what became of each.

    Parameters
    ----------
    frames : iterable of Frame
        The frames, taken one by one as there is room.
    executor : concurrent.futures.Executor, optional
        Where to work: a pool of processes, ``client.get_executor()`` of Dask, and so on. Each call does one
        frame and gives back a small record. Without it this process reads the next frame and writes the last
        one while it computes; no more than one frame is then computed, two read and two written at a time,
        whatever their number: memory for the pixels of five frames (of a stack, all slices).
        Neighbours are read once, and as many pictures are kept as a frame has neighbours, and two.
    in_flight : int, optional
        Frames handed to the executor before the first of them is done. Their pixels are only in its workers.
    resume : bool, optional
        Skip frames that are done: all outputs there, made with the same parameters from inputs of the same
        size and time of change; see `dofsim.batch`.
    failures : str or path-like, optional
        File of one JSON object a failed frame: ``color``, ``depth``, ``output`` and ``error``. What was there
        is replaced; without failures there is no such file.

    Yields
    ------
    Result
        What became of each frame, in their order.

    Raises
    ------
    ValueError
        If a frame would write over the output of an earlier one or over what another reads, or if
        `in_flight` is not positive. Frames that come one by one from an iterator are checked as they come.
    OSError
        If the disk is full; the error names the output that could not be written. Other errors of a frame are
        its result's.
    concurrent.futures.BrokenExecutor
        If a worker of the executor died. Those of `dofsim batch` are replaced, and the frame that killed
        one has failed.

    Examples
    --------
    >>> import numpy as np
    >>> from dofsim.batch import Frame, map_frames
    >>> from dofsim.io import write_image
    >>> write_image("a.exr", np.ones((16, 24, 3), np.float32), depth=np.full((16, 24), 2.0))
    >>> lens = {"aperture_radius": 0.02, "focus_distance": 1.0, "fov": 40.0}
    >>> frames = [Frame(color=name, output=f"out/{name}", lens=lens) for name in ("a.exr", "b.exr")]
    >>> [(result.status, result.error) for result in map_frames(frames)]
    [('written', None), ('failed', 'b.exr: No such file or directory')]
    >>> next(map_frames(frames)).status
    'skipped'
    """
    if in_flight < 1:
        raise ValueError(f"in_flight must be positive; got {in_flight}")
    checked = distinct(frames)
    if executor is None:
        results = _overlapped(checked, resume)
    else:
        task: Callable[[Frame], Result] = partial(work.run, resume=resume)
        if isinstance(executor, Processes):
            results = _surviving(executor, task, checked, in_flight)
        else:
            results = _in_order(executor, task, checked, in_flight)
    return _recorded(results, None if failures is None else Path(failures))


def _overlapped(frames: Iterator[Frame], resume: bool) -> Iterator[Result]:
    """Compute in this thread, which Ctrl-C reaches, and read and write in one thread each."""
    reader, writer = ThreadPoolExecutor(1, "dofsim-read"), ThreadPoolExecutor(1, "dofsim-write")
    try:
        loaded = _in_order(reader, partial(work.read, resume=resume), frames, _AHEAD)
        yield from _in_order(writer, work.write, map(work.compute, loaded), _AHEAD)
    finally:
        reader.shutdown(cancel_futures=True)
        writer.shutdown(cancel_futures=True)


def _in_order(executor: Executor, function: Callable[[S], T], items: Iterator[S], ahead: int) -> Iterator[T]:
    """Apply a function to items in an executor, at most ``ahead`` of them at a time, and keep their order."""
    begun: deque[Future[T]] = deque()
    try:
        begun.extend(executor.submit(function, item) for item in islice(items, ahead))
        while begun:
            yield begun.popleft().result()
            begun.extend(executor.submit(function, item) for item in islice(items, 1))
    finally:
        for future in begun:
            future.cancel()


def _surviving(
    processes: Processes, task: Callable[[Frame], Result], frames: Iterator[Frame], ahead: int
) -> Iterator[Result]:
    """Do as `_in_order` does, and where a process dies find the frame that killed it, and go on."""
    begun: deque[tuple[Frame, Future[Result]]] = deque()
    try:
        begun.extend((frame, processes.submit(task, frame)) for frame in islice(frames, ahead))
        while begun:
            frame, future = begun.popleft()
            try:
                result = future.result()
            except BrokenExecutor:
                # Whichever of those under way it was, it does it again alone.
                suspects = [frame, *(frame for frame, _ in begun)]
                begun.clear()
                processes.renew()
                for suspect in suspects:
                    yield _alone(processes, task, suspect)
                begun.extend((frame, processes.submit(task, frame)) for frame in islice(frames, ahead))
            else:
                yield result
                begun.extend((frame, processes.submit(task, frame)) for frame in islice(frames, 1))
    finally:
        for _, future in begun:
            future.cancel()


def _alone(processes: Processes, task: Callable[[Frame], Result], frame: Frame) -> Result:
    try:
        return processes.submit(task, frame).result()
    except BrokenExecutor:
        processes.renew()
        error = "the process that computed it was killed, as happens when memory runs out"
        return Result(frame=frame, status="failed", error=error)


def distinct(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Pass frames on, and refuse one that would write over another, or over what a frame reads.

    However their paths are spelt, files are known by where they are. All frames of a collection are looked at
    before the first is passed on; those of an iterator as they come.
    """
    if isinstance(frames, Collection):
        deque(_distinct(frames), maxlen=0)
        return iter(frames)
    return _distinct(frames)


def _distinct(frames: Iterable[Frame]) -> Iterator[Frame]:
    written: set[Path] = set()
    read: dict[Path, Path] = {}
    for frame in frames:
        outputs = {path.resolve() for path in (frame.record, *frame.files.values())}
        if not written.isdisjoint(outputs):
            raise ValueError(f"{frame.output}: an earlier frame has the same output")
        inputs = {path.resolve(): path for path in frame.inputs}
        # A frame that would overwrite its own input fails alone.
        both = [inputs[path] for path in inputs if path in written]
        if both := both + [read[path] for path in outputs if path in read]:
            raise ValueError(f"{both[0]}: is one of the inputs, which are not overwritten")
        written |= outputs
        read |= inputs
        yield frame


def _recorded(results: Iterator[Result], path: Path | None) -> Iterator[Result]:
    """Pass results on, and write down those that failed as soon as they are known."""
    if path is not None:
        path.unlink(missing_ok=True)
    for result in results:
        if path is not None and result.status == "failed":
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(_failure(result)) + "\n")
        yield result


def _failure(result: Result) -> dict[str, Any]:
    frame = result.frame
    depth = None if frame.depth is None else str(frame.depth)
    return {"color": str(frame.color), "depth": depth, "output": str(frame.output), "error": result.error}
