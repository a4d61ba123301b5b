"""What wide blur costs at full resolution and in coarser scenes, and by how much the pictures differ.

    python tests/bench/resolution.py [--size 1500] [--radius 60 120 240]

Prints, for each scene and largest radius, CPU seconds a Mpixel with ``resolution="full"`` and ``"adaptive"``,
in turn, and the rms difference in codes of 255.
"""

import argparse
import time

import dofsim
import numpy as np
from dofsim.metrics import srgb
from numpy.typing import NDArray

Scene = tuple[NDArray[np.float32], NDArray[np.float32]]


def squares(size: int, cell: int, seed: int) -> NDArray[np.float32]:
    """Return a square picture of random squares."""
    n = -(-size // cell)
    colors = np.random.default_rng(seed).random((n, n, 3), np.float32)
    return colors.repeat(cell, 0).repeat(cell, 1)[:size, :size]


def floor(size: int) -> Scene:
    """Return a floor that passes through the focus."""
    disparity = np.linspace(0.0, 1.0, size, dtype=np.float32)[:, None].repeat(size, 1)
    return squares(size, 8, 1), disparity


def portrait(size: int) -> Scene:
    """Return a disc in focus, before a wall that is far behind it."""
    y, x = np.mgrid[:size, :size] / size - 0.5
    disc = np.hypot(x, y) < 0.2
    color = np.where(disc[..., None], squares(size, 4, 2), squares(size, 8, 3))
    return color, np.where(disc, 0.5, 0.0).astype(np.float32)


def wires(size: int) -> Scene:
    """Return wires near the camera, before a wall that is far behind the focus."""
    y, x = np.mgrid[:size, :size] / size - 0.5
    random = np.random.default_rng(4)
    color, disparity = squares(size, 8, 5), np.full((size, size), 0.0, np.float32)
    for k in range(14):
        turn, place = random.uniform(0, np.pi), random.uniform(-0.5, 0.5)
        wire = np.abs(x * np.cos(turn) + y * np.sin(turn) - place) < 1.5 / size
        color[wire], disparity[wire] = random.random(3), 0.97 + 0.002 * k
    return color, disparity


SCENES = {"floor": floor, "portrait": portrait, "wires": wires}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", type=int, default=1500)
    parser.add_argument("--radius", type=float, nargs="+", default=[60, 120, 240])
    arguments = parser.parse_args()
    for name, scene in SCENES.items():
        color, disparity = scene(arguments.size)
        for radius in arguments.radius:
            lens = dofsim.Lens.from_disparity(strength_px=2 * radius, focus=0.5)
            seconds: dict[str, list[float]] = {"full": [], "adaptive": []}
            pictures = {}
            for _ in range(2):
                for resolution, times in seconds.items():
                    began = time.process_time()
                    pictures[resolution] = dofsim.render(
                        color, disparity, lens, depth_kind="disparity", resolution=resolution, device="cpu"
                    )
                    times.append((time.process_time() - began) / (disparity.size / 1e6))
            full, adaptive = (min(times) for times in seconds.values())
            error = 255 * (srgb(pictures["full"]) - srgb(pictures["adaptive"]))
            rms = float(np.sqrt(np.mean(error**2)))
            print(
                f"{name:8} {radius:4.0f} px: {full:.2f} -> {adaptive:.2f} CPU s a Mpixel, rms {rms:.2f} codes"
            )


if __name__ == "__main__":
    main()
