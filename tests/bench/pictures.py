"""What is measured: a picture, lenses that blur it by so much, and how."""

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import dofsim
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 1920, 1080
FOCUS_M, FOV_DEG = 4.0, 42.0
DEPTHS_M = (2.0, 2.7, 4.0, 8.0, 40.0)


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
