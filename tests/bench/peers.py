"""How fast dofsim renders full HD, beside the plainest blur of the same width; and the memory it takes.

Run `make bench`, or this file with OpenCV installed. The picture is textured planes at several depths with
edges between them, the lens is focused on the middle one. The peer is `cv2.filter2D` with the largest disc:
one blur for all pixels, no depth, no visibility. It shows what a plain blur costs here, in the same run.
Memory is the most held so far, beyond the picture itself.
"""

import argparse
import math
import resource
import sys
import time
from collections.abc import Callable

import cv2
import dofsim
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 1920, 1080
FOCUS_M, FOV_DEG = 4.0, 42.0
DEPTHS_M = (2.0, 2.7, 4.0, 8.0, 40.0)
LARGEST_COC_PX = (4, 20, 64)


def planes() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Make the picture: bars and discs at five depths, each with a texture of its own."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    color = np.empty((HEIGHT, WIDTH, 3), np.float32)
    depth = np.full((HEIGHT, WIDTH), DEPTHS_M[-1], np.float32)
    for layer, z in enumerate(reversed(DEPTHS_M)):
        tint, angle = rng.random(3, np.float32), rng.uniform(0.0, math.pi)
        wave = np.sin((x * math.cos(angle) + y * math.sin(angle)) * 0.15) + np.sin(x * 0.31) * np.sin(
            y * 0.27
        )
        seen = np.ones((HEIGHT, WIDTH), bool)
        if layer:
            period, turn = 260.0 + 90.0 * layer, rng.uniform(0.0, math.pi)
            bars = (x * math.cos(turn) + y * math.sin(turn) + 70.0 * layer) % period < 70.0
            centre = rng.uniform((200, 200), (WIDTH - 200, HEIGHT - 200))
            seen = bars | (np.hypot(x - centre[0], y - centre[1]) < 150.0)
        color[seen] = (tint * (0.6 + 0.25 * wave[..., None]))[seen]
        depth[seen] = z
    return color, depth


def lens_of(largest_px: float) -> dofsim.Lens:
    """Give the lens whose largest circle of confusion over the picture has this radius."""
    lens = dofsim.Lens(aperture_radius=0.01, focus_distance=FOCUS_M, fov=FOV_DEG)
    reached = np.abs(dofsim.coc(np.array([DEPTHS_M], np.float32), lens)).max()
    # A row of that many pixels is all that `coc` knew of the picture's width.
    return lens.replace(aperture_radius=0.01 * largest_px / float(reached) * len(DEPTHS_M) / WIDTH)


def disc(radius: float) -> NDArray[np.float32]:
    """Give a disc as the kernel of a filter."""
    reach = math.ceil(radius)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    kernel = (np.hypot(x, y) <= radius).astype(np.float32)
    return kernel / kernel.sum()


def best_of(runs: int, work: Callable[[], object]) -> float:
    """Give the least time in seconds that some work took."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def peak_mib() -> float:
    """Give the most memory that this process has held."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def main() -> None:
    """Print a row for every width of blur."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--runs", type=int, default=3, help="the best of so many is taken")
    parser.add_argument("--threads", type=int, help="threads of both; all by default")
    arguments = parser.parse_args()
    if arguments.threads:
        cv2.setNumThreads(arguments.threads)
    color, depth = planes()
    before = peak_mib()
    megapixels = WIDTH * HEIGHT / 1e6
    print(f"{WIDTH} x {HEIGHT}, {cv2.getNumThreads()} threads, best of {arguments.runs}")
    print(
        f"{'largest CoC':>12}{'render':>10}{'':>13}{'plain disc blur':>18}{'':>8}{'ratio':>8}{'memory':>13}"
    )
    for largest in LARGEST_COC_PX:
        lens = lens_of(largest)

        def render(lens: dofsim.Lens = lens) -> object:
            return dofsim.render(color, depth, lens, threads=arguments.threads)

        seconds = best_of(arguments.runs, render)
        memory = peak_mib() - before
        kernel = disc(largest)
        peer = best_of(arguments.runs, lambda kernel=kernel: cv2.filter2D(color, -1, kernel))
        print(
            f"{largest:>9} px{seconds:>8.2f} s{megapixels / seconds:>8.2f} Mpx/s"
            f"{peer:>10.2f} s{megapixels / peer:>8.2f} Mpx/s{seconds / peer:>7.1f}x{memory:>9.0f} MiB"
        )


if __name__ == "__main__":
    main()
