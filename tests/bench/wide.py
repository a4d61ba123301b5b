"""Time and memory of the flagship by the blur radius, however wide, as a table.

Run this file with dofsim installed. Each picture is rendered in a process of its own, whose peak is
measured. A wall has one depth; of the other scenes a third stands in front, before a wall that is blurred as
much, or that is in focus. Memory is what the process holds beside the picture, its depth and the interpreter.
"""

import argparse
import multiprocessing
import resource
import time

import dofsim
import numpy as np

SCENES = {"wall": (1.0, 1.0), "front before wall": (1.0, 0.0), "front before focus": (1.0, 0.5)}


def measure(width: int, height: int, radius_px: float, scene: str) -> tuple[float, float]:
    """Give the time of a second render in CPU seconds and the peak of both in bytes."""
    rng = np.random.default_rng(0)
    color = rng.random((-(-height // 8), -(-width // 8), 3), np.float32).repeat(8, 0).repeat(8, 1)
    color = np.ascontiguousarray(color[:height, :width])
    front, behind = SCENES[scene]
    disparity = np.full((height, width), behind, np.float32)
    disparity[:, : width // 3] = front
    lens = dofsim.Lens.from_disparity(strength_px=2.0 * radius_px, focus=0.5)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    seconds = 0.0
    for _ in range(2):
        start = time.process_time()
        dofsim.render(color, disparity, lens, depth_kind="disparity", device="cpu")
        seconds = time.process_time() - start
    return seconds, 1024.0 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)


def main() -> None:
    """Measure what the width of the blur costs."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--size", type=int, nargs=2, default=(1000, 1000), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--radius", type=float, nargs="+", default=[20, 64, 256, 1024, 4096, 16384])
    arguments = parser.parse_args()
    width, height = arguments.size
    for scene in SCENES:
        for radius_px in arguments.radius:
            with multiprocessing.get_context("spawn").Pool(1) as alone:
                seconds, held = alone.apply(measure, (width, height, radius_px, scene))
            print(
                f"{scene:<20} {radius_px:6.0f} px: {1e6 * seconds / (width * height):5.2f} CPU s a Mpixel, "
                f"{held / (width * height):4.0f} bytes a pixel"
            )


if __name__ == "__main__":
    main()
