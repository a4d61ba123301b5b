"""What other views are worth: one layer, layers from views, and true layers, against Mitsuba's thin lens.

Run `python tests/bench/views.py`. The pictures are rendered with Mitsuba the first time and kept under
build/scenes/.
The noise of the reference is taken off. `--damaged` also makes the other views wrong: there, nothing may be
worse than one layer.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import dofsim
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

sys.path.insert(0, str(Path(__file__).parents[1]))

from fidelity import lens_of, noiseless_psnr
from scenes.around import MIRRORS, intrinsics, load_around, places, poses

SCENES = ("spheres", "balls", "fence", "hair", "lamps", "lights", "room")

Damage = Callable[[NDArray, NDArray], tuple[NDArray, NDArray]]


def turned(poses: NDArray, which: slice) -> NDArray:
    """Turn cameras by half a degree, each about another axis across the view."""
    out = poses.copy()
    for i in range(len(poses))[which]:
        angle, axis = np.radians(0.5), 2.0 * np.pi * i / 8
        x, y = angle * np.sin(axis), angle * np.cos(axis)
        out[i, :3, :3] @= expm(np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]]))
    return out


# What is wrong with the depths and poses, of which the first are the reference's own.
DAMAGE: dict[str, Damage] = {
    "": lambda depths, poses: (depths, poses),
    "poses 0.5 degree off": lambda depths, poses: (depths, turned(poses, np.s_[1:])),
    "one pose 0.5 degree off": lambda depths, poses: (depths, turned(poses, np.s_[1:2])),
    "depths 2 % off": lambda depths, poses: (np.concatenate([depths[:1], 1.02 * depths[1:]]), poses),
    "depths half as far": lambda depths, poses: (np.concatenate([depths[:1], 0.5 * depths[1:]]), poses),
}


def layers_of(bundle: dict[str, NDArray], key: str, damage: Damage = DAMAGE[""]) -> tuple[NDArray, NDArray]:
    """Make layers of the reference and a set of other views."""
    height, width = bundle["depth"].shape
    at = np.concatenate([np.zeros((1, 3)), places(float(bundle["aperture_radius"]))[key]])
    depths, taken_from = damage(np.concatenate([bundle["depth"][None], bundle[f"depths {key}"]]), poses(at))
    return dofsim.layers_from_views(
        np.concatenate([bundle["color"][None], bundle[f"colors {key}"]]),
        depths,
        taken_from,
        intrinsics(width, height, float(bundle["fov"])),
        lens=lens_of(bundle),
    )


def pictures(bundle: dict[str, NDArray], damages: Iterable[str]) -> dict[str, NDArray]:
    """Render a scene from one layer, from views, and from the layers that there are."""
    lens = lens_of(bundle)
    out = {"one layer": dofsim.render(bundle["color"], bundle["depth"], lens)}
    for key in reversed(places()):
        for damage in damages:
            name = f"{key}, {damage}" if damage else key
            out[name] = dofsim.render(*layers_of(bundle, key, DAMAGE[damage]), lens)[..., :3]
    out["four true layers"] = dofsim.render(bundle["layers_color_1x"], bundle["layers_depth_1x"], lens)[
        ..., :3
    ]
    return out


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument(
        "--scene",
        action="append",
        choices=(*SCENES, *MIRRORS),
        help="may be repeated; default: all but mirrors",
    )
    parser.add_argument("--damaged", action="store_true", help="also make the other views wrong")
    parser.add_argument("--size", default="256x192", help="width x height in pixels")
    parser.add_argument("--json", type=Path, help="also write the numbers to this file")
    parser.add_argument("--pictures", type=Path, help="also save the pictures into this folder, as npz")
    arguments = parser.parse_args()
    width, height = (int(side) for side in arguments.size.split("x"))
    table = {}
    for scene in arguments.scene or SCENES:
        bundle = load_around(scene, width, height)
        start = time.perf_counter()
        rendered = pictures(bundle, DAMAGE if arguments.damaged else [""])
        halves = bundle["reference_a"], bundle["reference_b"]
        border = 30 * width // 512
        table[scene] = {name: noiseless_psnr(one, halves, border) for name, one in rendered.items()}
        print(f"{scene} ({time.perf_counter() - start:.1f} s)", flush=True)
        for name, db in table[scene].items():
            print(f"    {name:40}{db:6.2f} dB", flush=True)
        if arguments.pictures:
            arguments.pictures.mkdir(parents=True, exist_ok=True)
            np.savez(arguments.pictures / f"{scene}.npz", reference=bundle["reference"], **rendered)
    if arguments.json:
        arguments.json.write_text(json.dumps(table, indent=1))


if __name__ == "__main__":
    main()
