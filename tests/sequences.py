"""Sequences: how close a camera that slides past a scene stays to Mitsuba's thin lens, and how steady it is.

Run `python tests/sequences.py`. The frames are rendered with Mitsuba the first time and kept under
build/scenes/. Flicker is the change of the error from frame to frame, root mean square in codes of 0 to 255:
an error that stays is not seen to move, and what the truth does itself is none.
"""

import argparse

import dofsim
import numpy as np
from dofsim import metrics
from numpy.typing import NDArray
from scenes.around import intrinsics, poses
from scenes.bundle import CACHE, load_capture
from scenes.camera import Camera

# Neighbours on either side.
BESIDE = 2
SAMPLES, LENS_SAMPLES = 36, 256


def slide(name: str, frames: int, step_m: float, width: int, height: int) -> dict[str, NDArray]:
    """Read a sequence with `BESIDE` frames more at both ends, rendering it first where it is missing."""
    path = CACHE / f"slide_{name}_{width}x{height}_{frames}x{step_m:g}.npz"
    if path.exists():
        with np.load(path) as cached:
            return dict(cached)
    from scenes.variant import choose_variant

    print(f"rendering {path.name} with Mitsuba's {choose_variant()}", flush=True)
    capture = load_capture(name)
    along = step_m * (np.arange(frames + 2 * BESIDE) - 0.5 * (frames + 2 * BESIDE - 1))
    at = np.stack([along, np.zeros_like(along), np.zeros_like(along)], axis=-1)
    seen = [capture.seen_from(place, width, height, SAMPLES, 64, seed=i) for i, place in enumerate(at)]
    truth = [
        capture.lens_from(place, width, height, LENS_SAMPLES, 64, seed=100 + i)
        for i, place in enumerate(at[BESIDE:-BESIDE])
    ]
    out = {
        "colors": np.stack([color for color, _ in seen]),
        "depths": np.stack([depth for _, depth in seen]),
        "truth": np.stack(truth),
        "at": at,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **out)
    return out


def codes(picture: NDArray) -> NDArray:
    """Give sRGB codes from 0 to 255, not rounded."""
    return 255.0 * metrics.srgb(picture)


def flicker(pictures: NDArray, truth: NDArray, border: int) -> float:
    """Give the root mean square of the change of the error between neighbouring frames, in codes."""
    error = (codes(pictures) - codes(truth))[:, border:-border, border:-border]
    return float(np.sqrt(np.mean(np.diff(error, axis=0) ** 2)))


def rendered(shot: dict[str, NDArray], lens: dofsim.Lens, beside: int) -> NDArray:
    """Render the frames, each with so many neighbours on either side."""
    height, width = shot["depths"].shape[1:]
    out = []
    for i in range(BESIDE, len(shot["colors"]) - BESIDE):
        if beside == 0:
            out.append(dofsim.render(shot["colors"][i], shot["depths"][i], lens))
            continue
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


def main() -> None:
    """Print how close and how steady one layer and neighbours are."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--scene", default="fence")
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument(
        "--step", type=float, default=Camera.aperture_radius / 2, help="metres from frame to frame"
    )
    parser.add_argument("--size", default="192x144", help="width x height in pixels")
    arguments = parser.parse_args()
    width, height = (int(side) for side in arguments.size.split("x"))
    shot = slide(arguments.scene, arguments.frames, arguments.step, width, height)
    lens = dofsim.Lens(**Camera().settings())
    border = 30 * width // 512
    for beside in range(BESIDE + 1):
        pictures = rendered(shot, lens, beside)
        psnr = np.mean(
            [metrics.psnr(*pair, border=border) for pair in zip(pictures, shot["truth"], strict=True)]
        )
        steady = flicker(pictures, shot["truth"], border)
        print(f"{2 * beside} neighbours: {psnr:.2f} dB, flicker {steady:.2f} codes", flush=True)


if __name__ == "__main__":
    main()
