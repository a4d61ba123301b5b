"""How fast an adapter is: every method that has a GPU path, as a table for the documentation.

Run this file on a machine with a GPU, with the dependency group `bench`. Times are medians over some runs: on
the device as its own timestamps have them, and from NumPy arrays to NumPy arrays with the scene prepared and
with everything anew. For comparison, the same on the CPU.
"""

import argparse
import statistics
import time

import dofsim
import numpy as np
from dofsim._dofsim import methods_available
from peers import lens_of, planes

SIZES = {"1080p": (1920, 1080), "4K": (3840, 2160)}
RADII_PX = (4, 16, 64)


def resized(plane, width, height):
    """Give a picture another size; every pixel is one of its pixels."""
    rows, columns = (np.arange(n) * have // n for n, have in ((height, len(plane)), (width, plane.shape[1])))
    return np.ascontiguousarray(plane[rows][:, columns])


def median_ms(runs, work):
    """Give the median time of a call, and what the last one returned."""
    times = []
    for _ in range(runs):
        began = time.perf_counter()
        result = work()
        times.append(1e3 * (time.perf_counter() - began))
    return statistics.median(times), result


def measured(runs, color, depth, lens, device, method):
    """Measure one method on one scene: on the device, prepared, anew and on the CPU."""
    scene = dofsim.Scene(color, depth, device=device)
    # The first render compiles the shaders and takes the scene to the device.
    scene.render(lens, method=method)
    on_device = statistics.median(
        sum(ms for _, ms in scene.profile(lens, method=method)) for _ in range(runs)
    )
    prepared, _ = median_ms(runs, lambda: scene.render(lens, method=method))
    anew, _ = median_ms(runs, lambda: dofsim.render(color, depth, lens, device=device, method=method))
    host = dofsim.Scene(color, depth, device="cpu")
    host.render(lens, method=method)
    on_cpu, _ = median_ms(runs, lambda: host.render(lens, method=method))
    return on_device, prepared, anew, on_cpu


def main() -> None:
    """Measure all methods at all sizes and radii."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--device", default="gpu", help="as `dofsim devices` lists it")
    parser.add_argument("--runs", type=int, default=9)
    parser.add_argument("--size", action="append", choices=[*SIZES, "small"], help="all by default")
    parser.add_argument("--radius", action="append", type=int, help="largest radius in pixels; 4, 16 and 64")
    arguments = parser.parse_args()
    sizes = SIZES | {"small": (192, 108)}
    found = {device.id: device for device in dofsim.devices()}
    print(
        f"{found.get(arguments.device, arguments.device)}, medians of {arguments.runs} runs, milliseconds\n"
    )
    print("| method | size | radius | on the device | prepared scene | from NumPy | CPU | CPU / prepared |")
    print("|---|---|---:|---:|---:|---:|---:|---:|")
    for name in arguments.size or SIZES:
        width, height = sizes[name]
        color, depth = (resized(plane, width, height) for plane in planes())
        for radius in arguments.radius or RADII_PX:
            lens = lens_of(radius, depth)
            for method in methods_available():
                try:
                    times = measured(arguments.runs, color, depth, lens, arguments.device, method)
                except dofsim.DeviceError as error:
                    print(f"| {method} | {name} | {radius} | {error} |", flush=True)
                    continue
                shown = " | ".join(f"{ms:.2f}" for ms in times)
                print(f"| {method} | {name} | {radius} | {shown} | {times[3] / times[1]:.2f} |", flush=True)


if __name__ == "__main__":
    main()
