"""Sequences: how close a camera that slides past a scene stays to Mitsuba's thin lens, and how steady it is.

Run `python tests/sequences.py`. The frames are rendered with Mitsuba the first time and kept under
build/scenes/. Flicker is the change of the error from frame to frame, root mean square in codes of 0 to 255:
an error that stays is not seen to move, and what the truth does itself is none. The truth's own noise is
taken off both.
"""

import argparse
from collections.abc import Callable

import dofsim
import numpy as np
from dofsim import metrics
from fidelity import noiseless_psnr
from numpy.typing import NDArray
from scenes.around import intrinsics, poses
from scenes.bundle import CACHE, RECIPES, load_capture
from scenes.camera import Camera

# Neighbours on either side.
BESIDE = 2
# Samples a pixel of the pinhole, and of each of the truth's two halves.
SAMPLES, HALF_SAMPLES = 64, 256
SCENES = ("spheres", "balls", "fence", "hair", "room")

Shot = dict[str, NDArray]


def slide(name: str, frames: int, step_m: float, width: int, height: int) -> Shot:
    """Read a sequence with `BESIDE` frames more at both ends, rendering it first where it is missing."""
    path = CACHE / f"slide_{name}_{width}x{height}_{frames}x{step_m:g}_{SAMPLES}_{HALF_SAMPLES}.npz"
    if path.exists():
        with np.load(path) as cached:
            return dict(cached)
    from scenes.variant import choose_variant

    print(f"rendering {path.name} with Mitsuba's {choose_variant()}", flush=True)
    capture = load_capture(name, RECIPES[name])
    along = step_m * (np.arange(frames + 2 * BESIDE) - 0.5 * (frames + 2 * BESIDE - 1))
    at = np.stack([along, np.zeros_like(along), np.zeros_like(along)], axis=-1)
    seen = [capture.seen_from(place, width, height, SAMPLES, 64, seed=i) for i, place in enumerate(at)]
    halves = [
        [
            capture.lens_from(place, width, height, HALF_SAMPLES, 64, seed=100 + 2 * i + half)
            for half in (0, 1)
        ]
        for i, place in enumerate(at[BESIDE:-BESIDE])
    ]
    out = {
        "colors": np.stack([color for color, _ in seen]),
        "depths": np.stack([depth for _, depth in seen]),
        "halves": np.stack(halves, axis=1),
        "at": at,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **out)
    return out


def codes(picture: NDArray) -> NDArray:
    """Give sRGB codes from 0 to 255, not rounded."""
    return 255.0 * metrics.srgb(picture)


def flicker(pictures: NDArray, halves: NDArray, border: int) -> float:
    """Give the root mean square of the change of the error between neighbouring frames, in codes."""
    # The noise of two halves has nothing in common.
    changes = [
        np.diff((codes(pictures) - codes(half))[:, border:-border, border:-border], axis=0) for half in halves
    ]
    return float(np.sqrt(max(np.mean(changes[0] * changes[1]), 0.0)))


def each_frame(shot: Shot, lens: dofsim.Lens, **options) -> NDArray:
    """Render the frames one by one, each of one layer."""
    inner = slice(BESIDE, -BESIDE)
    frames = zip(shot["colors"][inner], shot["depths"][inner], strict=True)
    return np.stack([dofsim.render(*frame, lens, **options) for frame in frames])


def with_neighbours(shot: Shot, lens: dofsim.Lens, beside: int) -> NDArray:
    """Render the frames, each with so many neighbours on either side."""
    height, width = shot["depths"].shape[1:]
    out = []
    for i in range(BESIDE, len(shot["colors"]) - BESIDE):
        frames = [i, *(i + side * far for far in range(1, beside + 1) for side in (-1, 1))]
        layers = dofsim.layers_from_views(
            shot["colors"][frames],
            shot["depths"][frames],
            poses(shot["at"][frames]),
            intrinsics(width, height),
            lens=lens,
        )
        out.append(dofsim.render(*layers, lens)[..., :3])
    return np.stack(out)


# What is compared, in the table's order.
WAYS: dict[str, Callable[[Shot, dofsim.Lens], NDArray]] = {
    "poisson": lambda shot, lens: each_frame(shot, lens, method="poisson"),
    "gaussian": lambda shot, lens: each_frame(shot, lens, method="gaussian"),
    "hexagonal": lambda shot, lens: each_frame(shot, lens, method="hexagonal"),
    "sprites": lambda shot, lens: each_frame(shot, lens, method="sprites"),
    "lens": each_frame,
    "lens, 2 neighbours": lambda shot, lens: with_neighbours(shot, lens, 1),
    "lens, 4 neighbours": lambda shot, lens: with_neighbours(shot, lens, 2),
}


def main() -> None:
    """Print how close and how steady each method is, and the flagship with neighbours."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--scene", action="append", choices=SCENES, help="may be repeated; default: all")
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument(
        "--step", type=float, default=Camera.aperture_radius / 2, help="metres from frame to frame"
    )
    parser.add_argument("--size", default="256x192", help="width x height in pixels")
    arguments = parser.parse_args()
    width, height = (int(side) for side in arguments.size.split("x"))
    lens = dofsim.Lens(**Camera().settings())
    border = 30 * width // 512
    for scene in arguments.scene or SCENES:
        shot = slide(scene, arguments.frames, arguments.step, width, height)
        print(f"\n{scene}", flush=True)
        for name, way in WAYS.items():
            pictures, halves = way(shot, lens), shot["halves"]
            psnr = np.mean(
                [noiseless_psnr(*pair, border) for pair in zip(pictures, halves.swapaxes(0, 1), strict=True)]
            )
            print(
                f"{name:20} {psnr:6.2f} dB, flicker {flicker(pictures, halves, border):5.2f} codes",
                flush=True,
            )


if __name__ == "__main__":
    main()
