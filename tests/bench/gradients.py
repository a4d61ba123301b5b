"""Time and memory of gradients beside those of the render, as a table.

Run this file with the dependency group `bench` installed. The picture is the planes of `pictures.py`, or
with `--traced` a scene of the fidelity table. Times are those of all threads together, which vary least.
Memory is the greatest of a process that does nothing else, less that of one that renders.
"""

import argparse
import multiprocessing
import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor

import dofsim
import numpy as np
from pictures import HEIGHT, WIDTH, lens_of, planes, traced

WRT = ((), ("color",), ("depth",), ("color", "depth", "aperture_radius", "focus_distance"))


def work_of(wrt: tuple[str, ...], radius: float, scene: str | None, threads: int) -> Callable[[], object]:
    """Give a render, or the gradients by something."""
    color, depth = traced(scene) if scene else planes()
    lens = lens_of(radius, depth)
    if not wrt:
        return lambda: dofsim.render(color, depth, lens, device="cpu", threads=threads)
    weights = np.random.default_rng(1).standard_normal(color.shape).astype(np.float32)
    return lambda: dofsim.vjp(color, depth, lens, weights, wrt=wrt, threads=threads)


def peak_of(wrt: tuple[str, ...], radius: float, scene: str | None, threads: int) -> float:
    """Give the most memory that this process takes for some work, in bytes a pixel of the picture."""
    work = work_of(wrt, radius, scene, threads)
    work()
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (WIDTH * HEIGHT)


def cpu_seconds(work: Callable[[], object]) -> float:
    """Give the time that all threads together take for some work."""
    start = time.process_time()
    work()
    return time.process_time() - start


def main() -> None:
    """Measure what gradients cost."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--radius", type=float, default=20.0, help="the largest, in pixels")
    parser.add_argument("--runs", type=int, default=3, help="the median of so many is taken")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--traced", help="a scene of the fidelity table instead of the planes")
    arguments = parser.parse_args()
    words = (arguments.radius, arguments.traced, arguments.threads)
    spawned = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawned, max_tasks_per_child=1) as pool:
        peaks = [pool.submit(peak_of, wrt, *words).result() for wrt in WRT]
    works = [work_of(wrt, *words) for wrt in WRT]
    for work in works:
        work()
    # In turn, so that what else the machine does meets all of them.
    seconds = np.median([[cpu_seconds(work) for work in works] for _ in range(arguments.runs)], axis=0)
    for wrt, of_all, peak in zip(WRT, seconds, peaks, strict=True):
        name = ", ".join(wrt) or "render"
        print(
            f"{name:<48} {of_all:6.2f} s {of_all / seconds[0]:5.1f} times, {peak - peaks[0]:4.0f} bytes a "
            f"pixel above the render's {peaks[0]:.0f}"
        )


if __name__ == "__main__":
    main()
