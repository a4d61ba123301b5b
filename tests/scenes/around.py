"""A scene from several places: the pinhole's own, points of the rim of the lens, neighbouring frames."""

import hashlib
import time
from pathlib import Path

import numpy as np

from .bundle import CACHE, LAYERS, RECIPES, Recipe, load_capture
from .camera import Camera

# Fewer samples than the fidelity table's, whose pictures are fewer; the reference's noise is taken off.
PLAIN = Recipe(pinhole_spp=64, half_spp=256)
TRACED = Recipe(pinhole_spp=100, half_spp=196, peel_spp=16, max_depth=4)
# Scenes for views alone: a reflection in them, and what it shows.
MIRRORS = {"mirror": Recipe(max_depth=3, uses=("balls",))}
SCENES = RECIPES | MIRRORS


def rim(count: int, radius: float) -> np.ndarray:
    """Give places (right, down, forward) on the rim of the lens, evenly spread."""
    angle = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=-1)


def places(radius: float = Camera.aperture_radius) -> dict[str, np.ndarray]:
    """Give the sets of other places by name."""
    side = np.array([[-radius, 0.0, 0.0], [radius, 0.0, 0.0]])
    return {"8 on the rim": rim(8, radius), "4 on the rim": rim(4, radius), "2 frames": side}


def poses(at: np.ndarray) -> np.ndarray:
    """Give camera-to-world poses in OpenCV's axes, of cameras that look along +z of the world of the scenes.

    That world has +y up, and its pictures run towards -x.
    """
    out = np.tile(np.diag([-1.0, -1.0, 1.0, 1.0]), (len(at), 1, 1))
    out[:, :3, 3] = at * [-1.0, -1.0, 1.0]
    return out


def intrinsics(width: int, height: int, fov: float = Camera.fov) -> np.ndarray:
    """Give the matrix of a camera whose field of view is along x."""
    focal_px = 0.5 * width / np.tan(np.radians(0.5 * fov))
    return np.array([[focal_px, 0, 0.5 * (width - 1)], [0, focal_px, 0.5 * (height - 1)], [0, 0, 1.0]])


def render_around(name: str, width: int, height: int) -> dict[str, np.ndarray]:
    """Render what the table needs: a reference with its layers, the other places, the thin lens's halves."""
    from .capture import with_means

    start = time.perf_counter()
    capture, recipe = load_capture(name, SCENES[name]), TRACED if SCENES[name].max_depth > 1 else PLAIN
    color = capture.pinhole(width, height, recipe.pinhole_spp, recipe.lamp_spp)
    layers_color, layers_depth = capture.peel(width, height, LAYERS, recipe.peel_spp)
    layers_color[0] = with_means(layers_color[0], color)
    out = {
        "color": color,
        "depth": layers_depth[0],
        "layers_color_1x": layers_color,
        "layers_depth_1x": layers_depth,
    }
    for key, at in places(capture.camera.aperture_radius).items():
        taken = [capture.seen_from(place, width, height, recipe.pinhole_spp, recipe.lamp_spp) for place in at]
        out[f"colors {key}"] = np.stack([color for color, _ in taken])
        out[f"depths {key}"] = np.stack([depth for _, depth in taken])
    halves = [capture.thin_lens(width, height, recipe.half_spp, recipe.lamp_spp, seed) for seed in (1, 2)]
    out |= {"reference_a": halves[0], "reference_b": halves[1], "reference": 0.5 * (halves[0] + halves[1])}
    out |= {field: np.array(value) for field, value in capture.camera.settings().items()}
    return out | {"seconds": np.array(time.perf_counter() - start)}


def load_around(name: str, width: int, height: int, folder: Path = CACHE) -> dict[str, np.ndarray]:
    """Read what `render_around` gives from the cache, rendering it first where that is missing or old."""
    digest = hashlib.sha256(repr((SCENES[name], PLAIN, TRACED, LAYERS)).encode())
    for module in (name, *SCENES[name].uses, "around", "camera", "capture", "shapes", "textures"):
        digest.update((Path(__file__).parent / f"{module}.py").read_bytes())
    path = folder / f"around_{name}_{width}x{height}.npz"
    if path.exists():
        with np.load(path) as cached:
            if str(cached["fingerprint"]) == digest.hexdigest():
                return dict(cached)
    from .variant import choose_variant

    print(f"rendering {path.name} with Mitsuba's {choose_variant()}", flush=True)
    bundle = render_around(name, width, height)
    folder.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".part.npz")
    np.savez(partial, fingerprint=np.array(digest.hexdigest()), **bundle)
    partial.replace(path)
    return bundle
