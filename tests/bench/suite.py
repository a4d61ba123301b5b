"""Everything that is claimed about speed and memory, measured in one run.

Run `make bench`, or this file with the dependency groups `bench` and `reference` installed. Times are
medians. What they are divided by, bandwidth and peers, was measured in the same run and on as many threads.
"""

import argparse
import json
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import dofsim
import numba
import numpy as np
from dofsim._dofsim import methods_available, simd_available
from gather import gather
from march import march
from numpy.typing import NDArray
from pictures import disc, lens_of, planes, traced
from scipy import signal
from skimage import filters

Row = dict[str, Any]
SIZES = {"512 x 512": (512, 512), "1920 x 1080": (1080, 1920), "3840 x 2160": (2160, 3840)}
RADII_PX = (4, 16, 64)
THREADS = (1, 2)
# Bytes that any method has to move for a pixel: colour and depth in, colour out, in float32.
MOVED = 4 * (3 + 1 + 3)


def median_of(runs: int, work: Callable[[], object], most_s: float = 6.0) -> float:
    """Give the median time in seconds of some work, after a run that does not count."""
    start = time.perf_counter()
    work()
    times: list[float] = []
    while len(times) < runs and (not times or time.perf_counter() - start < most_s):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def with_threads(threads: int) -> None:
    """Let the peers use so many."""
    cv2.setNumThreads(threads)
    numba.set_num_threads(threads)


def sized(picture: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Repeat, or cut, a picture to a size; what is repeated is mirrored."""
    rows, columns = (-(-wanted // have) for wanted, have in zip(size, picture.shape[:2], strict=True))
    row = np.concatenate([picture[:, :: 1 - 2 * (i % 2)] for i in range(columns)], axis=1)
    whole = np.concatenate([row[:: 1 - 2 * (i % 2)] for i in range(rows)], axis=0)
    return np.ascontiguousarray(whole[: size[0], : size[1]])


def bandwidth(threads: int) -> float:
    """Measure how many bytes a second memory reads and writes, by a copy."""
    with_threads(threads)
    source = np.ones(1 << 26, np.float32)
    target = np.zeros_like(source)
    return 2 * source.nbytes / median_of(5, lambda: copy(source, target))


@numba.njit(parallel=True)
def copy(source: NDArray[np.float32], target: NDArray[np.float32]) -> None:
    """Copy on all threads."""
    for i in numba.prange(64):
        n = source.size // 64
        target[i * n : (i + 1) * n] = source[i * n : (i + 1) * n]


def by_method(runs: int) -> Iterator[Row]:
    """Measure every method at every size, width of blur and number of threads, from NumPy to NumPy."""
    planes_color, planes_depth = planes()
    for name, size in SIZES.items():
        color, depth = sized(planes_color, size), sized(planes_depth, size)
        pixels = size[0] * size[1]
        for threads in THREADS:
            with_threads(threads)
            floor = pixels * MOVED / bandwidth(threads)
            blur = median_of(runs, lambda color=color: cv2.GaussianBlur(color, (25, 25), 0))
            for radius in RADII_PX:
                lens = lens_of(radius, depth)
                radii = dofsim.coc(depth, lens)
                plain = median_of(3, lambda color=color, radii=radii: gather(color, radii))
                for method in methods_available():

                    def render(c=color, d=depth, lens=lens, m=method, t=threads) -> object:
                        return dofsim.render(c, d, lens, method=m, threads=t)

                    seconds = median_of(runs, render)
                    yield {
                        "method": method,
                        "size": name,
                        "radius_px": radius,
                        "threads": threads,
                        "ms": 1e3 * seconds,
                        "megapixels_per_s": pixels / seconds / 1e6,
                        "to_gaussian_blur": seconds / blur,
                        "to_plain_gather": seconds / plain,
                        "of_bandwidth_floor": floor / seconds,
                    }


def flagship(runs: int) -> Iterator[Row]:
    """Measure the flagship at 1920 x 1080 over traced spheres, with all preparation, and over clutter."""
    color, depth = traced("spheres")
    rng = np.random.default_rng(5)
    clutter = 1 / rng.uniform(1 / 40, 1 / 2, (90, 160)).astype(np.float32)
    clutter = np.ascontiguousarray(np.kron(clutter, np.ones((12, 12), np.float32)))
    for radius in (4, 20, 64):
        lens = lens_of(radius, depth)
        times = {
            t: median_of(runs, lambda t=t, lens=lens: dofsim.render(color, depth, lens, threads=t))
            for t in THREADS
        }
        through = lens_of(radius, clutter)
        cluttered = median_of(
            3, lambda lens=through: dofsim.render(color, clutter, lens, threads=THREADS[-1])
        )
        yield {
            "radius_px": radius,
            **{f"ms_{t}_threads": 1e3 * seconds for t, seconds in times.items()},
            "speedup": times[THREADS[0]] / times[THREADS[-1]],
            "clutter_ms": 1e3 * cluttered,
            "clutter_ratio": cluttered / times[THREADS[-1]],
        }


def one_depth(runs: int) -> Iterator[Row]:
    """Measure a picture of one depth: what a convolution does as well."""
    color, _ = planes()
    depth = np.full(color.shape[:2], 8.0, np.float32)
    for radius in (7, 31):
        lens, kernel = lens_of(radius, depth), disc(radius)
        for threads in THREADS:
            with_threads(threads)
            peers = {
                "filter2D": lambda kernel=kernel: cv2.filter2D(color, -1, kernel),
                "GaussianBlur": lambda r=radius: cv2.GaussianBlur(color, (2 * r + 1, 2 * r + 1), 0),
                "fftconvolve": lambda kernel=kernel: signal.fftconvolve(
                    color, kernel[..., None], "same", axes=(0, 1)
                ),
                "skimage gaussian": lambda r=radius: filters.gaussian(color, sigma=r / 2, channel_axis=-1),
            }
            seconds = median_of(
                runs, lambda t=threads, lens=lens: dofsim.render(color, depth, lens, threads=t)
            )
            yield {
                "radius_px": radius,
                "threads": threads,
                "lens_ms": 1e3 * seconds,
                **{f"{name}_ms": 1e3 * median_of(3, work) for name, work in peers.items()},
            }


def layouts(runs: int) -> Iterator[Row]:
    """Measure arrays of other layouts and types than contiguous float32, 1920 x 1080, by `taps`."""
    color, depth = planes()
    codes = np.rint(255 * color.clip(0.0, 1.0)).astype(np.uint8)
    rgba = np.concatenate([color, np.ones_like(color[..., :1])], axis=-1)
    arrays: dict[str, tuple[NDArray[Any], str]] = {
        "float32": (color, "linear"),
        "the first three channels of four": (rgba[..., :3], "linear"),
        "channels first": (np.ascontiguousarray(color.transpose(2, 0, 1)).transpose(1, 2, 0), "linear"),
        "upside down": (color[::-1], "linear"),
        "float16": (color.astype(np.float16), "linear"),
        "float32, sRGB": (color, "srgb"),
        "uint8, sRGB": (codes, "srgb"),
        "uint8, sRGB, blue first": (codes[..., ::-1], "srgb"),
        "uint16, sRGB": (codes * np.uint16(257), "srgb"),
    }
    lens = lens_of(16, depth)
    for name, (array, transfer) in arrays.items():
        for threads in THREADS:

            def render(a: NDArray[Any] = array, t: str = transfer, n: int = threads) -> object:
                return dofsim.render(a, depth, lens, method="taps", transfer=t, threads=n)

            yield {"color": name, "threads": threads, "ms": 1e3 * median_of(runs, render)}


def few_sprites(runs: int) -> Iterator[Row]:
    """Measure sprites at 1920 x 1080 where one bright pixel in a hundred is blurred, the rest in focus."""
    rng = np.random.default_rng(5)
    color, _ = planes()
    coc_px = rng.uniform(2.0, 32.0, color.shape[:2]) * rng.choice([-1.0, 1.0], color.shape[:2])
    blurred = rng.random(color.shape[:2]) < 0.01
    color[blurred] *= 20.0
    lens = dofsim.Lens.from_disparity(strength_px=1.0, focus=0.0)
    for side, seen in {"in front": coc_px < 0, "behind": coc_px > 0, "both": coc_px != 0}.items():
        disparity = -np.where(blurred & seen, coc_px, 0.0).astype(np.float32)
        for threads in THREADS:
            with_threads(threads)
            blur = median_of(runs, lambda: cv2.GaussianBlur(color, (25, 25), 0))

            def render(d: NDArray[np.float32] = disparity, t: int = threads) -> object:
                return dofsim.render(color, d, lens, depth_kind="disparity", method="sprites", threads=t)

            seconds = median_of(runs, render)
            yield {
                "blurred": side,
                "threads": threads,
                "ms": 1e3 * seconds,
                "to_gaussian_blur": seconds / blur,
            }


def stack(runs: int) -> Iterator[Row]:
    """Measure a focal stack of 32 pictures against 32 renders."""
    color, depth = traced("spheres")
    lens = lens_of(20, depth)
    distances = list(np.linspace(2.5, 8.0, 32))
    scene = dofsim.Scene(color, depth)
    out = np.empty((32, *color.shape), np.float32)
    together = median_of(runs, lambda: scene.focal_stack(lens, distances, out=out), 30.0)

    def one_by_one() -> None:
        for distance in distances:
            dofsim.render(color, depth, lens.replace(focus_distance=distance))

    alone = median_of(runs, one_by_one, 30.0)
    yield {"pictures": 32, "stack_s": together, "single_renders_s": alone, "ratio": together / alone}


FIRST_CALL = """
import time, numpy as np, dofsim
color = np.random.default_rng(0).random((480, 640, 3), dtype=np.float32)
depth = np.full((480, 640), 3.0, np.float32)
depth[100:300, 200:400] = 1.5
lens = dofsim.Lens(aperture_radius=0.02, focus_distance=3.0, fov=40.0)
times = []
for _ in range(9):
    start = time.perf_counter()
    dofsim.render(color, depth, lens)
    times.append(time.perf_counter() - start)
print(times[0], sorted(times)[4])
"""

MEMORY = """
import resource, sys, numpy as np, dofsim
height, width, radius, runs = map(int, sys.argv[1:])
color = np.random.default_rng(0).random((height, width, 3), dtype=np.float32)
depth = np.repeat(np.linspace(2, 10, width, dtype=np.float32)[None], height, axis=0)
depth[height // 4 : height // 2, width // 4 : width // 2] = 1.5
out = np.empty_like(color)
lens = dofsim.Lens(aperture_radius=0.01, focus_distance=4.0, fov=42.0)
lens = lens.replace(aperture_radius=0.01 * radius / np.abs(dofsim.coc(depth, lens)).max())
def peak():
    if sys.platform == "linux":
        # What a process was before it became this one does not count.
        status = open("/proc/self/status").read()
        return 1024 * int(status.split("VmHWM:")[1].split()[0])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
before = peak()
for _ in range(runs):
    dofsim.render(color, depth, lens, out=out)
print((peak() - before) / (height * width))
"""


def in_fresh_process(code: str, *arguments: object) -> list[float]:
    """Run a program, and give the numbers that it prints."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    return [float(word) for word in run.stdout.split()]


def start_up(runs: int) -> Iterator[Row]:
    """Measure the first call of a fresh process against a warm one, 640 x 480."""
    pairs = [in_fresh_process(FIRST_CALL) for _ in range(runs)]
    first, warm = (statistics.median(column) for column in zip(*pairs, strict=True))
    yield {"first_ms": 1e3 * first, "warm_ms": 1e3 * warm, "difference_ms": 1e3 * (first - warm)}


def memory(_runs: int) -> Iterator[Row]:
    """Measure the most memory held beside picture and result in bytes a pixel, and after many."""
    for name, (height, width) in SIZES.items():
        for radius in (4, 64):
            once, often = (in_fresh_process(MEMORY, height, width, radius, n)[0] for n in (1, 8))
            yield {"size": name, "radius_px": radius, "bytes_per_pixel": once, "after_8_renders": often}


def equal_quality(runs: int) -> Iterator[Row]:
    """Measure the flagship against brute force, and against Mitsuba's thin lens that comes as close."""
    try:
        from equal import Traced, full_hd, small
    except ImportError as error:
        print(f"SKIPPED: {error}")
        return
    with_threads(THREADS[-1])
    for size, take in {"512 x 384": small, "1920 x 1080": full_hd}.items():
        shot = take()
        tracer = Traced(shot)
        color = np.ascontiguousarray(shot.color[0, ..., :3])
        shift = -dofsim.coc(shot.depth[0], shot.lens)
        for layers in (1, 2):
            ours = median_of(runs, lambda shot=shot, layers=layers: shot.render(layers))
            reached = shot.psnr(shot.render(layers))

            def row(what: str, seconds: float, psnr_db: float, size: str = size, ours: float = ours) -> Row:
                return {
                    "size": size,
                    "what": what,
                    "s": seconds,
                    "psnr_db": psnr_db,
                    "times_as_long": seconds / ours,
                }

            yield row(f"lens, layers: {layers}", ours, reached)
            if layers == 1:
                seconds = median_of(1, lambda color=color, shift=shift: march(color, shift, 256))
                yield row("every ray marched, 256 views", seconds, shot.psnr(march(color, shift, 256)))
            side = tracer.fewest(reached)
            seconds = median_of(3, lambda tracer=tracer, side=side: tracer.render(side))
            yield row(f"Mitsuba thinlens, {side * side} samples", seconds, tracer.psnr(side))


PARTS = {
    "methods": by_method,
    "flagship": flagship,
    "one depth": one_depth,
    "sprites": few_sprites,
    "layouts": layouts,
    "focal stack": stack,
    "start-up": start_up,
    "memory": memory,
    "equal quality": equal_quality,
}


def shown(value: object) -> str:
    """Write a number with three digits."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def main() -> None:
    """Measure some parts, or all."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument(
        "--part", action="append", choices=list(PARTS), help="may be repeated; all by default"
    )
    parser.add_argument("--runs", type=int, default=7, help="the median of so many")
    parser.add_argument("--json", type=Path, default=Path("build/bench.json"))
    arguments = parser.parse_args()
    rates = {str(threads): bandwidth(threads) / 1e9 for threads in THREADS}
    found: dict[str, Any] = {
        "machine": {
            "processor": platform.processor() or platform.machine(),
            "instructions": simd_available()[-1],
            "bandwidth_gb_per_s": rates,
            "python": platform.python_version(),
        }
    }
    print("copying, GB/s read and written:", {t: round(rate, 1) for t, rate in rates.items()})
    for name in arguments.part or PARTS:
        print(f"\n## {name}\n")
        rows: list[Row] = []
        for row in PARTS[name](arguments.runs):
            if not rows:
                print("| " + " | ".join(row) + " |\n|" + " --- |" * len(row))
            rows.append(row)
            print("| " + " | ".join(map(shown, row.values())) + " |", flush=True)
        found[name] = rows
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        partial = arguments.json.with_suffix(".part")
        partial.write_text(json.dumps(found, indent=1))
        partial.replace(arguments.json)


if __name__ == "__main__":
    main()
