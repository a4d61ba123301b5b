"""What other views are worth: one layer, layers from views, and true layers, against Mitsuba's thin lens.

Run `python tests/bench/views.py`. The pictures are rendered with Mitsuba the first time and kept under
build/scenes/.
The noise of the reference is taken off.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import dofsim
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

from fidelity import lens_of, noiseless_psnr
from scenes.around import intrinsics, load_around, places, poses

SCENES = ("spheres", "balls", "fence", "hair", "lamps", "lights", "room")


def layers_of(bundle: dict[str, NDArray], key: str) -> tuple[NDArray, NDArray]:
    """Make layers of the reference and a set of other views."""
    height, width = bundle["depth"].shape
    at = np.concatenate([np.zeros((1, 3)), places(float(bundle["aperture_radius"]))[key]])
    return dofsim.layers_from_views(
        np.concatenate([bundle["color"][None], bundle[f"colors {key}"]]),
        np.concatenate([bundle["depth"][None], bundle[f"depths {key}"]]),
        poses(at),
        intrinsics(width, height, float(bundle["fov"])),
        lens=lens_of(bundle),
    )


def pictures(bundle: dict[str, NDArray]) -> dict[str, NDArray]:
    """Render a scene from one layer, from views, and from the layers that there are."""
    lens = lens_of(bundle)
    out = {"one layer": dofsim.render(bundle["color"], bundle["depth"], lens)}
    for key in reversed(places()):
        out[key] = dofsim.render(*layers_of(bundle, key), lens)[..., :3]
    out["four true layers"] = dofsim.render(bundle["layers_color_1x"], bundle["layers_depth_1x"], lens)[
        ..., :3
    ]
    return out


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--scene", action="append", choices=SCENES, help="may be repeated; default: all")
    parser.add_argument("--size", default="256x192", help="width x height in pixels")
    parser.add_argument("--json", type=Path, help="also write the numbers to this file")
    parser.add_argument("--pictures", type=Path, help="also save the pictures into this folder, as npz")
    arguments = parser.parse_args()
    width, height = (int(side) for side in arguments.size.split("x"))
    table = {}
    for scene in arguments.scene or SCENES:
        bundle = load_around(scene, width, height)
        start = time.perf_counter()
        rendered = pictures(bundle)
        halves = bundle["reference_a"], bundle["reference_b"]
        border = 30 * width // 512
        table[scene] = {name: noiseless_psnr(one, halves, border) for name, one in rendered.items()}
        numbers = "".join(f"  {name} {db:.2f}" for name, db in table[scene].items())
        print(f"{scene:8}{numbers}   ({time.perf_counter() - start:.1f} s)", flush=True)
        if arguments.pictures:
            arguments.pictures.mkdir(parents=True, exist_ok=True)
            np.savez(arguments.pictures / f"{scene}.npz", reference=bundle["reference"], **rendered)
    if arguments.json:
        arguments.json.write_text(json.dumps(table, indent=1))


if __name__ == "__main__":
    main()
