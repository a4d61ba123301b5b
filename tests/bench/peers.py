"""How fast dofsim renders full HD, beside plainer blurs of the same width; and the memory it takes.

Run `make bench`, or this file with the dependency group `bench` installed. The picture is textured planes at
several depths with edges between them, the lens is focused on the middle one. The peers, in the same run and
on as many threads: the plain gather, where every pixel is the mean over its own disc, without visibility, by
running sums in numba; and `cv2.filter2D` with the largest disc, the same for all pixels. Memory is the most
held so far, beyond the picture itself. The first row is the first render of the process.
"""

import argparse
import math
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import dofsim
import numba
import numpy as np
from gather import gather
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


def traced(name: str) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Make the picture from a scene of the fidelity table, three times its size, cut and mirrored."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from scenes.bundle import load_bundle

    bundle = load_bundle(name, 512, 384)

    def full(plane: NDArray[np.float32]) -> NDArray[np.float32]:
        cut = plane[:HEIGHT]
        return np.ascontiguousarray(np.concatenate([cut, cut[:, ::-1]], axis=1)[:, :WIDTH])

    return full(bundle["color_ss3"]), full(bundle["depth_ss3"])


def lens_of(largest_px: float, depth: NDArray[np.float32] | None = None) -> dofsim.Lens:
    """Give the lens whose largest circle of confusion over a picture has this radius; the planes' if none."""
    if depth is None:
        # A row as wide as the picture.
        depth = np.resize(np.array(DEPTHS_M, np.float32), (1, WIDTH))
    lens = dofsim.Lens(aperture_radius=0.01, focus_distance=FOCUS_M, fov=FOV_DEG)
    reached = float(np.abs(dofsim.coc(depth, lens)).max())
    return lens.replace(aperture_radius=0.01 * largest_px / reached)


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
    parser.add_argument(
        "--scene", help="a scene of tests/fidelity.py in place of the planes; may need Mitsuba"
    )
    arguments = parser.parse_args()
    threads = arguments.threads or cv2.getNumThreads()
    cv2.setNumThreads(threads)
    numba.set_num_threads(threads)
    color, depth = traced(arguments.scene) if arguments.scene else planes()
    before = peak_mib()
    megapixels = WIDTH * HEIGHT / 1e6
    print(f"{WIDTH} x {HEIGHT}, {threads} threads, best of {arguments.runs}")
    print(
        f"{'largest CoC':>12}{'render':>10}{'':>13}{'memory':>11}"
        f"{'plain gather':>16}{'ratio':>8}{'one disc':>12}{'ratio':>8}"
    )
    for largest in LARGEST_COC_PX:
        lens = lens_of(largest, depth)

        def render(lens: dofsim.Lens = lens) -> object:
            return dofsim.render(color, depth, lens, threads=threads)

        if largest == LARGEST_COC_PX[0]:
            first = best_of(1, render)
            print(
                f"{largest:>9} px{first:>8.2f} s{megapixels / first:>8.2f} Mpx/s"
                f"{peak_mib() - before:>7.0f} MiB"
            )
        seconds = best_of(arguments.runs, render)
        memory = peak_mib() - before
        radius_px = dofsim.coc(depth, lens)
        gather(color, radius_px)
        plain = best_of(arguments.runs, lambda radius_px=radius_px: gather(color, radius_px))
        kernel = disc(largest)
        one = best_of(arguments.runs, lambda kernel=kernel: cv2.filter2D(color, -1, kernel))
        print(
            f"{largest:>9} px{seconds:>8.2f} s{megapixels / seconds:>8.2f} Mpx/s{memory:>7.0f} MiB"
            f"{plain:>14.2f} s{seconds / plain:>7.1f}x{one:>10.2f} s{seconds / one:>7.1f}x"
        )


if __name__ == "__main__":
    main()
