"""Time and memory of gradients beside those of the render, as a table.

Run this file with the dependency group `bench` installed. The picture is the planes of `pictures.py`, or
with `--traced` a scene of the fidelity table. Times are those of all threads together, which vary least.
"""

import argparse
import resource
import time
from collections.abc import Callable

import dofsim
import numpy as np
from pictures import HEIGHT, WIDTH, lens_of, planes, traced

WRT = (("color",), ("depth",), ("color", "depth", "aperture_radius", "focus_distance"))


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
    color, depth = traced(arguments.traced) if arguments.traced else planes()
    lens = lens_of(arguments.radius, depth)
    weights = np.random.default_rng(1).standard_normal(color.shape).astype(np.float32)

    def forward() -> object:
        return dofsim.render(color, depth, lens, device="cpu", threads=arguments.threads)

    def backward(wrt: tuple[str, ...]) -> Callable[[], object]:
        return lambda: dofsim.vjp(color, depth, lens, weights, wrt=wrt, threads=arguments.threads)

    works = [forward, *map(backward, WRT)]
    peaks = []
    for work in works:
        work()
        peaks.append(1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (WIDTH * HEIGHT))
    # In turn, so that what else the machine does meets all of them.
    seconds = np.median([[cpu_seconds(work) for work in works] for _ in range(arguments.runs)], axis=0)
    for name, of_all, peak in zip(("render", *map(", ".join, WRT)), seconds, peaks, strict=True):
        print(
            f"{name:<48} {of_all:6.2f} s {of_all / seconds[0]:5.1f} times, at most {peak:4.0f} bytes a pixel"
        )


if __name__ == "__main__":
    main()
