"""The run of ``dofsim batch``: how its frames are getting on, and what is said of them."""

from __future__ import annotations

import logging
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import _command_options as options
from . import _console
from ._names import printable

if TYPE_CHECKING:
    from .batch import Frame
    from .batch.frames import Output
    from .batch.workers import Workers

log = logging.getLogger("dofsim")

# What failed, in the folder of the results.
FAILURES = "failures.jsonl"


def run(frames: list[Frame], output: Path, *, workers: int, dask: str | None, resume: bool) -> int:
    """Work through the frames and return the exit status."""
    from tqdm import tqdm

    from .batch import map_frames
    from .batch.claim import claimed
    from .batch.records import summarise
    from .batch.unfinished import without_unfinished

    output.mkdir(parents=True, exist_ok=True)
    failures = output / FAILURES
    counts: Counter[str] = Counter()
    start = time.perf_counter()
    with (
        # A run that did not come to its end may have been killed by a frame, which is then computed apart.
        claimed(output) as died,
        without_unfinished(frames),
        _workers(workers, dask, apart=died) as found,
        # Only people are shown how it goes on, not files.
        tqdm(total=len(frames), unit="frame", disable=None) as progress,
    ):
        for result in map_frames(
            [_with_threads(frame, found.threads_each) for frame in frames],
            executor=found.executor,
            in_flight=2 * found.slots,
            resume=resume,
            failures=failures,
        ):
            counts[result.status] += 1
            progress.update()
            if result.error is not None:
                message = printable(f"{result.frame.output}: {options.in_options(result.error)}")
                tqdm.write(f"dofsim: {message}", file=sys.stderr)
            elif result.status == "written" and log.isEnabledFor(logging.DEBUG):
                line = f"{result.frame.output}: {_console.taken(result.seconds)}"
                tqdm.write(printable(line), file=sys.stderr)
    seconds = time.perf_counter() - start
    log.info(
        "%s: %d written, %d there already, %d failed in %.1f s (%.1f frames/s)",
        output,
        *(counts[status] for status in ("written", "skipped", "failed")),
        seconds,
        len(frames) / seconds,
    )
    if summary := summarise(frames, output):
        _say_summary(summary, output)
    if counts["failed"]:
        log.info("%s: what failed, and why", failures)
    return 1 if counts["failed"] else 0


def look_at(frame: Frame) -> None:
    """Say how deep a frame is and how wide its blur is, or what is wrong with it; nothing is rendered."""
    from .batch import Result, work

    # The circle of confusion is where invalid depth is refused. It has no margin.
    outputs: tuple[Output, ...] = () if frame.options["overscan"] else ("coc",)
    found = work.compute(work.read(replace(frame, outputs=outputs, neighbours=()), resume=False))
    if isinstance(found, Result):
        raise ValueError(f"{frame.color}: {found.error}")
    record = found.found
    log.info("%s: %s%s", frame.color, _depth_of(record), _blur_of(record["blur_radius_px"]["max"]))
    for suspicion in record["suspicions"].values():
        log.warning("%s: %s", frame.color, options.in_options(suspicion))


def _depth_of(record: dict[str, Any]) -> str:
    """Write the range of the depth in a record or a summary, if it has one."""
    from ._report import spread

    if (ends := record["depth_range"]) is None:
        return ""
    return f"{spread(record['depth_quantity'], record['depth_unit'], ends)}; "


def _blur_of(radius_px: float) -> str:
    """Write the largest blur radius of one frame."""
    from ._report import pixels

    return f"the largest blur radius is {pixels(radius_px)} px"


def _say_summary(summary: dict[str, Any], output: Path) -> None:
    """Say how deep the frames are and how wide their blur is, and what of it is suspicious."""
    from ._report import pixels

    largest = summary["largest_blur_radius_px"]
    blur = _blur_of(largest["max"])
    if summary["frames"] > 1:
        radius = {name: pixels(value) for name, value in largest.items()}
        blur = (
            f"the largest blur radius of a frame is {radius['median']} px (median), {radius['p5']} to "
            f"{radius['p95']} px from the 5th to the 95th percentile"
        )
    log.info("%s: %s%s", output, _depth_of(summary), blur)
    for found in summary["suspicions"].values():
        log.warning(
            "%d of %d frames, the first is %s: %s",
            found["frames"],
            summary["frames"],
            found["first"],
            options.in_options(found["says"]),
        )


def _with_threads(frame: Frame, threads: int | None) -> Frame:
    """Share the processors among frames that are computed side by side, unless the user has."""
    given = frame.options["threads"]
    return replace(frame, options={**frame.options, "threads": threads if given is None else given})


@contextmanager
def _workers(workers: int, dask: str | None, *, apart: bool) -> Iterator[Workers]:
    """Start those who compute the frames, or find them; if ``apart``, in no case this process."""
    from .batch.workers import Processes, Workers, dask_cluster, share_of_processors

    if dask is not None:
        with dask_cluster(dask, workers) as cluster:
            yield cluster
        return
    if workers == 1 and not apart:
        yield Workers(executor=None, slots=1, threads_each=None)
        return
    with Processes(workers) as pool:
        yield Workers(pool, workers, share_of_processors(workers))
