"""Everything that a fidelity test needs of a scene, rendered once and kept in one file.

Run as `python -m scenes.bundle --help` from the tests' folder to render scenes into a folder.
"""

import argparse
import hashlib
import importlib
import time
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
from PIL import Image

from .camera import Camera

SUPERSAMPLE = 3
LAYERS = 4
CACHE = Path(__file__).parents[2] / "build" / "scenes"


@dataclass(frozen=True)
class Recipe:
    """How a scene is taken: samples a pixel, in squares of whole numbers, and the length of light paths.

    `half_spp` is for each of the reference's two halves; `lamp_spp` counts what lamps send out.
    """

    pinhole_spp: int = 256
    half_spp: int = 1024
    lamp_spp: int = 64
    peel_spp: int = 1
    covered_spp: int = 16
    max_depth: int = 1
    # Other scenes' modules that it is made from.
    uses: tuple[str, ...] = ()


RECIPES = {
    "spheres": Recipe(),
    "balls": Recipe(),
    "fence": Recipe(),
    "hair": Recipe(),
    "lamps": Recipe(lamp_spp=256, uses=("lights",)),
    "lights": Recipe(lamp_spp=256),
    "plane": Recipe(),
    "room": Recipe(pinhole_spp=400, half_spp=784, peel_spp=16, max_depth=4),
}


def load_capture(name: str, recipe: Recipe):
    """Load the scene of a module into Mitsuba, in the variant that is set."""
    # Mitsuba is imported only to render: whoever has the cached files does not need it.
    from .capture import Capture

    module = importlib.import_module(f"{__package__}.{name}")
    lamps = module.lamps() if hasattr(module, "lamps") else None
    return Capture(module.shapes(), Camera(), recipe.max_depth, lamps)


def render_bundle(name: str, width: int, height: int) -> dict[str, np.ndarray]:
    """Render a scene's inputs and its reference.

    Returns
    -------
    dict of arrays
        `color`, `depth`: through the pinhole, colours averaged over pixels, depth at their centres.
        `color_ss3`, `depth_ss3`: three times as wide and high, both sampled at pixel centres.
        `layers_color`, `layers_depth`: the same with four surfaces one behind another, and
        `layers_color_1x`, `layers_depth_1x` at the picture's own size, the first averaged over pixels.
        `covered_color`, `covered_depth`: these with what each covers of its pixel, all averaged over pixels.
        `reference_a`, `reference_b`: two halves of the thin lens's samples with different seeds;
        `reference`: their mean.
        `aperture_radius`, `focus_distance`, `fov`, `fov_axis`: the lens. `seconds`: the time it took.
    """
    from .capture import with_means

    start = time.perf_counter()
    recipe = RECIPES[name]
    capture = load_capture(name, recipe)
    color = capture.pinhole(width, height, recipe.pinhole_spp, recipe.lamp_spp)
    layers_color_1x, layers_depth_1x = capture.peel(width, height, LAYERS, recipe.peel_spp)
    layers_color_1x[0] = with_means(layers_color_1x[0], color)
    layers_color, layers_depth = capture.peel(
        SUPERSAMPLE * width, SUPERSAMPLE * height, LAYERS, recipe.peel_spp
    )
    covered_color, covered_depth = capture.covered(width, height, LAYERS, recipe.covered_spp, color)
    halves = [capture.thin_lens(width, height, recipe.half_spp, recipe.lamp_spp, seed) for seed in (1, 2)]
    return {
        "color": color,
        "depth": layers_depth_1x[0],
        "color_ss3": layers_color[0, ..., :3],
        "depth_ss3": layers_depth[0],
        "layers_color": layers_color,
        "layers_depth": layers_depth,
        "layers_color_1x": layers_color_1x,
        "layers_depth_1x": layers_depth_1x,
        "covered_color": covered_color,
        "covered_depth": covered_depth,
        "reference": 0.5 * (halves[0] + halves[1]),
        "reference_a": halves[0],
        "reference_b": halves[1],
        **{field: np.array(value) for field, value in capture.camera.settings().items()},
        "seconds": np.array(time.perf_counter() - start),
    }


def fingerprint(name: str) -> str:
    """Digest of all that a scene's bundle depends on, to tell a cached one that is out of date."""
    digest = hashlib.sha256(repr((RECIPES[name], SUPERSAMPLE, LAYERS)).encode())
    for module in (name, *RECIPES[name].uses, "bundle", "camera", "capture", "shapes", "textures"):
        digest.update((Path(__file__).parent / f"{module}.py").read_bytes())
    for module in ("_capture", "_coverage", "_peel", "_view"):
        digest.update((resources.files("dofsim") / "mitsuba" / f"{module}.py").read_bytes())
    return digest.hexdigest()


def load_bundle(name: str, width: int, height: int, folder: Path = CACHE) -> dict[str, np.ndarray]:
    """Read a scene's bundle from the cache, rendering it first where it is missing or out of date."""
    path = folder / f"{name}_{width}x{height}.npz"
    if path.exists():
        with np.load(path) as cached:
            if str(cached["fingerprint"]) == fingerprint(name):
                return dict(cached)
    from .variant import choose_variant

    print(f"rendering {path.name} with Mitsuba's {choose_variant()}", flush=True)
    bundle = render_bundle(name, width, height)
    save_bundle(name, bundle, folder)
    return bundle


def contact_sheet(bundle: dict[str, np.ndarray]) -> Image.Image:
    """Lay out the pictures of a bundle as 8-bit sRGB, with depth shown as blur: dark near, light far."""

    def shown(linear: np.ndarray) -> np.ndarray:
        clipped = np.clip(linear, 0.0, 1.0)
        low, high = 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055
        return np.round(255.0 * np.where(clipped <= 0.0031308, low, high)).astype(np.uint8)

    def disparity(depth: np.ndarray) -> np.ndarray:
        return np.repeat((1.0 - np.clip(1.3 / depth, 0.0, 1.0))[..., None], 3, axis=-1)

    rows = [[shown(bundle["color"]), shown(bundle["reference"]), shown(disparity(bundle["depth"]))]]
    if "layers_color_1x" in bundle:
        rows.append([shown(bundle["layers_color_1x"][layer, ..., :3]) for layer in (1, 2, 3)])
    return Image.fromarray(np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0))


def save_bundle(name: str, bundle: dict[str, np.ndarray], folder: Path) -> Path:
    """Write a bundle and its contact sheet; the name says the size."""
    folder.mkdir(parents=True, exist_ok=True)
    height, width = bundle["depth"].shape
    path = folder / f"{name}_{width}x{height}.npz"
    partial = path.with_suffix(".part.npz")
    np.savez(partial, fingerprint=np.array(fingerprint(name)), **bundle)
    partial.replace(path)
    contact_sheet(bundle).save(path.with_suffix(".png"))
    return path


def main() -> None:
    """Render the named scenes, or all of them, and write them."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("scenes", nargs="*", default=list(RECIPES), help="default: all")
    parser.add_argument("--size", default="512x384", help="width x height in pixels")
    parser.add_argument("--folder", type=Path, default=CACHE)
    parser.add_argument(
        "--variant", help="Mitsuba variant; default: LLVM where one is found, else scalar_rgb"
    )
    arguments = parser.parse_args()
    width, height = (int(side) for side in arguments.size.split("x"))
    from .variant import choose_variant

    print(f"Mitsuba variant: {choose_variant(arguments.variant)}", flush=True)
    for name in arguments.scenes:
        bundle = render_bundle(name, width, height)
        path = save_bundle(name, bundle, arguments.folder)
        print(f"{path}: {bundle['seconds']:.0f} s", flush=True)


if __name__ == "__main__":
    main()
