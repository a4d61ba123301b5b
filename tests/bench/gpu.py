"""How fast an adapter is: every method, as a table for the documentation.

Run this file on a machine with a GPU, with the dependency group `bench`. Times are medians over some runs: on
the device as its own timestamps have them, also as a multiple of what copying the picture takes; with the
scene prepared, from and to NumPy arrays; with everything anew; and for comparison, the same on the CPU.
"""

import argparse
import statistics
import time
from pathlib import Path

import dofsim
import numpy as np
from dofsim._dofsim import methods_available
from pictures import lens_of, planes

SIZES = {"1080p": (1920, 1080), "4K": (3840, 2160), "small": (192, 108)}
# Sizes with largest radii in pixels.
CASES = [("1080p", 4), ("1080p", 16), ("1080p", 64), ("4K", 16)]

HEADER = (
    "| method | size | radius | on the device | copies | prepared scene | from NumPy | CPU "
    "| CPU / prepared |\n"
    "|---|---|---:|---:|---:|---:|---:|---:|---:|\n"
)


def resized(plane, width, height):
    """Give a picture another size; every pixel is one of its pixels."""
    rows, columns = (np.arange(n) * have // n for n, have in ((height, len(plane)), (width, plane.shape[1])))
    return np.ascontiguousarray(plane[rows][:, columns])


def median_ms(runs, work):
    """Give the median time of a call."""
    times = []
    for _ in range(runs):
        began = time.perf_counter()
        work()
        times.append(1e3 * (time.perf_counter() - began))
    return statistics.median(times)


def spelled(value):
    """Write a number with two places, and a small one with two digits, so that it is not written as none."""
    return f"{value:.2f}" if value >= 0.1 else f"{value:.2g}"


def device_ms(runs, scene, lens, method):
    """Give the median time on the device."""
    return statistics.median(sum(ms for _, ms in scene.profile(lens, method=method)) for _ in range(runs))


def measured(runs, color, depth, lens, device, method):
    """Measure one method on one scene, as the columns of the table."""
    scene = dofsim.Scene(color, depth, device=device)
    # The first renders compile the shaders and take the scene to the device. What is in focus is copied.
    closed = lens.replace(aperture_radius=0.0)
    scene.render(closed)
    copy = device_ms(runs, scene, closed, "lens")
    scene.render(lens, method=method)
    on_device = device_ms(runs, scene, lens, method)
    prepared = median_ms(runs, lambda: scene.render(lens, method=method))
    anew = median_ms(runs, lambda: dofsim.render(color, depth, lens, device=device, method=method))
    host = dofsim.Scene(color, depth, device="cpu")
    host.render(lens, method=method)
    on_cpu = median_ms(runs, lambda: host.render(lens, method=method))
    return on_device, on_device / copy, prepared, anew, on_cpu, on_cpu / prepared


def table(arguments):
    """Yield the table, piece by piece."""
    found = {device.id: device for device in dofsim.devices()}
    device = found.get(arguments.device, arguments.device)
    yield f"{device}, medians of {arguments.runs} runs, milliseconds\n\n{HEADER}"
    cases = [case for case in CASES if case[0] in (arguments.size or SIZES)]
    if arguments.radius:
        cases = [(name, radius) for name in arguments.size or ["1080p"] for radius in arguments.radius]
    for name, radius in cases:
        width, height = SIZES[name]
        color, depth = (resized(plane, width, height) for plane in planes())
        lens = lens_of(radius, depth)
        for method in methods_available():
            try:
                times = measured(arguments.runs, color, depth, lens, arguments.device, method)
                shown = " | ".join(map(spelled, times))
            except dofsim.DeviceError as error:
                shown = str(error)
            yield f"| {method} | {name} | {radius} | {shown} |\n"


def main() -> None:
    """Measure all methods at all sizes and radii."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--device", default="gpu", help="as `dofsim devices` lists it")
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--size", action="append", choices=[*SIZES], help="1080p and 4K by default")
    parser.add_argument("--radius", action="append", type=int, help="4, 16 and 64 by default, 16 at 4K")
    parser.add_argument("-o", "--output", type=Path, help="a Markdown file for the table")
    arguments = parser.parse_args()
    pieces = []
    for piece in table(arguments):
        print(piece, end="", flush=True)
        pieces.append(piece)
    if arguments.output:
        arguments.output.write_text("".join(pieces))


if __name__ == "__main__":
    main()
