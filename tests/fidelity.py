"""How close dofsim comes to Mitsuba's thin lens: the table, scene by scene and method by method.

Run `python tests/fidelity.py`. The scenes are rendered with Mitsuba the first time, which takes minutes,
and kept under build/scenes/. A picture is compared with the reference as sRGB code values clipped to
[0, 1]. All of them are left out of the comparison near the border, where the lens sees what the picture
does not hold.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import dofsim
import numpy as np
from dofsim import metrics
from numpy.typing import NDArray
from oracle.gather import gather
from scenes.bundle import RECIPES, SUPERSAMPLE, load_bundle

BORDER_PX = 30

Bundle = dict[str, NDArray]

# What is compared, in the table's order. A further method is a further line.
METHODS: dict[str, Callable[[Bundle, dofsim.Lens], NDArray]] = {
    "no blur": lambda b, lens: b["color"],
    "gather": lambda b, lens: gather(b["color"], dofsim.coc(b["depth"], lens)),
    "poisson": lambda b, lens: dofsim.render(b["color"], b["depth"], lens, method="poisson"),
    "poisson, 128 taps": lambda b, lens: dofsim.render(
        b["color"], b["depth"], lens, method="poisson", taps=128, max_coc_px=32
    ),
    "gaussian": lambda b, lens: dofsim.render(b["color"], b["depth"], lens, method="gaussian"),
    "hexagonal": lambda b, lens: dofsim.render(b["color"], b["depth"], lens, method="hexagonal"),
    "levels": lambda b, lens: dofsim.render(b["color"], b["depth"], lens, method="levels"),
    "taps": lambda b, lens: dofsim.render(b["color"], b["depth"], lens, method="taps"),
    "sprites": lambda b, lens: dofsim.render(b["color"], b["depth"], lens, method="sprites"),
    "lens": lambda b, lens: dofsim.render(b["color"], b["depth"], lens),
    # The first one averaged over pixels, as a renderer's beauty is; those behind, sampled at pixel centres.
    "lens, 2 layers": lambda b, lens: dofsim.render(b["layers_color_1x"][:2], b["layers_depth_1x"][:2], lens),
    "lens, 4 layers": lambda b, lens: dofsim.render(b["layers_color_1x"], b["layers_depth_1x"], lens),
    # What each surface covers of its pixel, and all of them averaged over pixels: as `rgbd` gives layers, and
    # as deep files have them.
    "lens, 4 covered": lambda b, lens: dofsim.render(b["covered_color"], b["covered_depth"], lens),
    "lens, 3x": lambda b, lens: dofsim.render(b["color_ss3"], b["depth_ss3"], lens, supersample=SUPERSAMPLE),
    "lens, 3x, 4 layers": lambda b, lens: dofsim.render(
        b["layers_color"], b["layers_depth"], lens, supersample=SUPERSAMPLE
    ),
    # Half of the reference's own samples against all of them differs as much as the reference does from
    # the truth: no method can measurably do better.
    "reference's noise": lambda b, lens: b["reference_a"],
}

MEASURES = {"psnr": metrics.psnr, "ssim": metrics.ssim, "flip": metrics.flip}


def lens_of(bundle: Bundle) -> dofsim.Lens:
    """Give the lens that a bundle's reference was taken with."""
    return dofsim.Lens(
        aperture_radius=float(bundle["aperture_radius"]),
        focus_distance=float(bundle["focus_distance"]),
        fov=float(bundle["fov"]),
        fov_axis=str(bundle["fov_axis"]),
    )


def noiseless_psnr(picture: NDArray, halves: Sequence[NDArray], border_px: int) -> float:
    """Give the PSNR to the mean of two halves, whose own noise is taken off the squared difference.

    Half of how far the halves are apart is as much as their mean is from the truth.
    """
    inside = np.s_[border_px:-border_px, border_px:-border_px]
    reference = 0.5 * (halves[0] + halves[1])

    def mean_square(a: NDArray) -> float:
        return float(np.mean((metrics.srgb(a) - metrics.srgb(reference))[inside] ** 2))

    return -10.0 * float(np.log10(max(mean_square(picture) - mean_square(halves[0]), 1e-9)))


def measure(bundle: Bundle) -> list[dict]:
    """Run every method on a bundle; one record a method."""
    lens = lens_of(bundle)
    masks = metrics.regions(dofsim.coc(bundle["depth"], lens))
    inside = np.s_[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]
    records = []
    for method, run in METHODS.items():
        start = time.perf_counter()
        picture = run(bundle, lens)
        seconds = time.perf_counter() - start
        regions = {
            region: {
                name: score(picture[..., :3], bundle["reference"], border=BORDER_PX, mask=mask)
                for name, score in MEASURES.items()
            }
            for region, mask in masks.items()
            if mask[inside].any()
        }
        records.append({"method": method, "seconds": seconds, "regions": regions})
    return records


def print_table(scene: str, records: list[dict]) -> None:
    """Print a scene's rows: PSNR in dB, SSIM and FLIP of each region."""
    regions = list(records[0]["regions"])
    print(f"\n{scene:20}" + "".join(f"{region:>21}" for region in regions) + f"{'seconds':>9}")
    print(" " * 20 + f"{'dB   SSIM   FLIP':>21}" * len(regions))
    for record in records:
        cells = (f"{r['psnr']:8.2f} {r['ssim']:.4f} {r['flip']:.3f}" for r in record["regions"].values())
        print(f"{record['method']:20}" + "".join(f"{c:>21}" for c in cells) + f"{record['seconds']:9.2f}")


def main() -> None:
    """Measure dofsim against Mitsuba's thin lens."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--scene", action="append", choices=RECIPES, help="may be repeated; default: all")
    parser.add_argument("--size", default="512x384", help="width x height in pixels")
    parser.add_argument("--json", type=Path, help="also write the numbers to this file")
    arguments = parser.parse_args()
    width, height = (int(side) for side in arguments.size.split("x"))
    results = {}
    for scene in arguments.scene or RECIPES:
        results[scene] = measure(load_bundle(scene, width, height))
        print_table(scene, results[scene])
    if arguments.json:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        arguments.json.write_text(json.dumps({"size": [width, height], "scenes": results}, indent=1))


if __name__ == "__main__":
    main()
