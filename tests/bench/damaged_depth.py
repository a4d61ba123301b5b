"""What damaged depth costs a render, and what refining gives back: the table of the page on photographs.

Run `python tests/bench/damaged_depth.py`. Scenes are those of `tests/fidelity.py`, rendered with Mitsuba the
first time. Their disparity is damaged in eight ways; pictures are compared with the thin lens as sRGB codes,
without the reference's noise. Times are of all processors together, over that of exact depth. OpenCV's
filters need ``opencv-contrib-python-headless``.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import dofsim
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage as ndi

sys.path.insert(0, str(Path(__file__).parents[1]))

from fidelity import BORDER_PX, lens_of, noiseless_psnr
from scenes.bundle import RECIPES, load_bundle

Map = NDArray[np.float32]

# What the table's means are of.
SCENES = ("spheres", "fence", "room", "lamps")


def eight_bits(d: Map) -> Map:
    low, span = d.min(), np.ptp(d)
    return np.rint(255 * (d - low) / span) / 255 * span + low


def quarter(d: Map) -> Map:
    height, width = d.shape
    small = cv2.resize(d, (width // 4, height // 4), interpolation=cv2.INTER_AREA)
    return cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)


def noisy(d: Map) -> Map:
    noise = np.random.default_rng(3).standard_normal(d.shape)
    return np.maximum(d + 0.01 * np.ptp(d) * noise, 0.0)


DAMAGE: dict[str, Callable[[Map], Map]] = {
    "exact": lambda d: d,
    "8 bits": eight_bits,
    "Gaussian blur, deviation 2 px": lambda d: ndi.gaussian_filter(d, 2.0),
    "a quarter of the size, enlarged": quarter,
    "averaged 3 x 3": lambda d: ndi.uniform_filter(d, 3),
    "shifted by 1.5 px": lambda d: ndi.shift(d, (0.0, 1.5), order=1, mode="nearest"),
    "foreground 2 px too large": lambda d: ndi.maximum_filter(d, 5),
    "1 % noise": noisy,
}


def guide(color: NDArray) -> NDArray:
    return np.sqrt(np.clip(color, 0.0, 1.0)).astype(np.float32)


# Settings that are usual for depth of 0 to 1.
METHODS: dict[str, Callable[[NDArray, Map], Map]] = {
    "as it is": lambda color, d: d,
    "refined": lambda color, d: dofsim.refine_depth(color, d, depth_kind="inverse_z"),
    "guided filter": lambda color, d: cv2.ximgproc.guidedFilter(guide(color), d, 8, 1e-3),
    "joint bilateral": lambda color, d: cv2.ximgproc.jointBilateralFilter(guide(color), d, 9, 0.1, 4.0),
    "fast global smoother": lambda color, d: cv2.ximgproc.fastGlobalSmootherFilter(
        np.rint(255 * guide(color)).astype(np.uint8), d, 100.0, 6.0
    ),
}


def main() -> None:
    """Print PSNR in dB and processor time over that of exact depth, the mean of the scenes."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--scene", action="append", choices=RECIPES, help="may be repeated")
    arguments = parser.parse_args()
    rows: dict[str, list[list[float]]] = {name: [] for name in DAMAGE}
    slower: dict[str, list[list[float]]] = {name: [] for name in DAMAGE}
    for scene in arguments.scene or SCENES:
        bundle = load_bundle(scene, 512, 384)
        lens, color = lens_of(bundle), bundle["color"]
        halves = (bundle["reference_a"], 2.0 * bundle["reference"] - bundle["reference_a"])
        exact = (1.0 / bundle["depth"].astype(np.float64)).astype(np.float32)

        def measured(d: Map, lens=lens, color=color, halves=halves) -> tuple[float, float]:
            words = {"depth_kind": "inverse_z", "device": "cpu"}
            plane = np.maximum(d, 0.0).astype(np.float32)
            best = np.inf
            for _ in range(2):
                start = time.process_time()
                out = dofsim.render(color, plane, lens, **words)
                best = min(best, time.process_time() - start)
            return noiseless_psnr(out, halves, BORDER_PX), best

        seconds = measured(exact)[1]
        for name, damage in DAMAGE.items():
            given = damage(exact).astype(np.float32)
            found = [measured(method(color, given)) for method in METHODS.values()]
            rows[name].append([decibels for decibels, _ in found])
            slower[name].append([taken / seconds for _, taken in found])
            print(f"{scene:8} {name:32}" + "".join(f"{v:8.2f}" for v in rows[name][-1]), flush=True)
    print(f"\n{'':41}" + "".join(f"{name:>22}" for name in METHODS))
    for name in DAMAGE:
        decibels, times = np.mean(rows[name], 0), np.mean(slower[name], 0)
        print(
            f"{name:41}" + "".join(f"{d:12.2f} dB {t:4.1f} x" for d, t in zip(decibels, times, strict=True))
        )


if __name__ == "__main__":
    main()
