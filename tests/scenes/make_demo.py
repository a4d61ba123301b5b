"""Render the picture that `dofsim demo` starts from: chessmen on a window sill above a city at nightfall.

Run as `python -m scenes.make_demo` from the tests' folder. It writes, into the package's data,

* `demo.exr`: the pinhole picture, linear half floats, with planar depth in metres as `Z`, infinite for sky;
* `demo_reference.exr`: what Mitsuba's thin lens makes of the same scene;
* `demo_lens.toml`: the lens.
"""

import argparse
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import OpenEXR

from .bundle import contact_sheet
from .camera import Camera
from .capture import Capture
from .shapes import X_RIGHT, bitmap, box, floor, glow, paint, rod, sphere, tubes, turned
from .textures import blend, checks, noise, wave, weathered
from .variant import choose_variant

WIDTH, HEIGHT = 480, 320
DATA = Path(__file__).parents[2] / "python" / "dofsim" / "data"

# About a 50 mm lens at f/1.4 on a full-frame camera.
CAMERA = Camera(aperture_radius=0.018, focus_distance=0.55, fov=40.0)

BOARD_Y = -0.088
SQUARE = 0.06

# (radius, height) of the chessmen's outlines, in metres.
PAWN = [
    (0.000, 0.000), (0.021, 0.000), (0.022, 0.006), (0.018, 0.010), (0.017, 0.014), (0.010, 0.022),
    (0.008, 0.038), (0.008, 0.044), (0.014, 0.048), (0.009, 0.051), (0.012, 0.055), (0.0145, 0.063),
    (0.012, 0.071), (0.006, 0.076), (0.000, 0.077),
]  # fmt: skip
BISHOP = [
    (0.000, 0.000), (0.024, 0.000), (0.025, 0.007), (0.020, 0.012), (0.019, 0.017), (0.011, 0.028),
    (0.008, 0.060), (0.008, 0.066), (0.017, 0.070), (0.009, 0.074), (0.013, 0.082), (0.015, 0.091),
    (0.011, 0.103), (0.005, 0.109), (0.006, 0.113), (0.004, 0.117), (0.000, 0.118),
]  # fmt: skip
KING = [
    (0.000, 0.000), (0.027, 0.000), (0.028, 0.008), (0.022, 0.013), (0.021, 0.019), (0.013, 0.032),
    (0.009, 0.070), (0.009, 0.080), (0.020, 0.085), (0.010, 0.090), (0.013, 0.098), (0.018, 0.124),
    (0.014, 0.130), (0.006, 0.135), (0.000, 0.136),
]  # fmt: skip

# (outline, light or dark, right, z)
CHESSMEN = [
    (KING, 0, 0.050, 0.550),
    (BISHOP, 1, -0.075, 0.640),
    (PAWN, 0, -0.020, 0.500),
    (PAWN, 1, 0.160, 0.660),
    (PAWN, 0, 0.090, 0.800),
    (PAWN, 1, -0.190, 0.780),
    (BISHOP, 0, 0.270, 0.860),
    (PAWN, 1, -0.030, 0.900),
    (PAWN, 1, -0.098, 0.305),
]


def smooth(outline: list[tuple[float, float]], steps: int = 6) -> np.ndarray:
    """Round an outline off, with Catmull and Rom's splines."""
    points = np.array([outline[0], *outline, outline[-1]])
    t = np.linspace(0.0, 1.0, steps, endpoint=False)[:, None]
    pieces = []
    for p0, p1, p2, p3 in zip(points, points[1:], points[2:], points[3:], strict=False):
        linear, square, cube = p2 - p0, 2 * p0 - 5 * p1 + 4 * p2 - p3, 3 * (p1 - p2) + p3 - p0
        pieces.append(0.5 * (2 * p1 + linear * t + square * t**2 + cube * t**3))
    curve = np.concatenate([*pieces, points[-1:]])
    return np.maximum(curve, [0.0, 0.0])


def dusk() -> dict[str, Any]:
    """Make a sky that glows orange at the horizon and is deep blue above, the same all around."""
    up = np.linspace(1.0, -1.0, 128)[:, None] * np.ones((1, 256))
    above = np.clip(up, 0.0, 1.0)
    low = blend(np.clip(above / 0.12, 0, 1).astype(np.float32), (0.62, 0.24, 0.09), (0.17, 0.11, 0.16))
    sky = blend(np.clip((above - 0.06) / 0.4, 0, 1).astype(np.float32), low, (0.02, 0.035, 0.09))
    ground = np.array([0.010, 0.011, 0.016], np.float32)
    picture = np.where(up[..., None] < -0.02, ground, sky).astype(np.float32)
    return {"type": "envmap", "bitmap": mi.Bitmap(picture)}


def lamp(right: float, up: float, z: float, diameter_px: float, radiance: np.ndarray) -> dict[str, Any]:
    """Make a lamp of the given apparent size."""
    focal_px = 0.5 * WIDTH / np.tan(np.radians(0.5 * CAMERA.fov))
    return {
        "type": "sphere",
        "center": [X_RIGHT * right, up, z],
        "radius": 0.5 * diameter_px * z / focal_px,
        **glow(tuple(float(c) for c in radiance)),
    }


def shapes() -> dict[str, Any]:
    """Build the scene."""
    rng = np.random.default_rng(12)
    grain = noise(512, 512, 1, (3.0, 120.0))
    squares = weathered(
        blend(checks(1024, 1024, 4, 4, 12.0), (0.10, 0.050, 0.030), (0.62, 0.46, 0.29)), 3, 0.35
    )
    maple = weathered(blend(wave(256, 256, 3, 9, 0.6), (0.55, 0.38, 0.20), (0.78, 0.62, 0.40)), 5, 0.3)
    walnut = weathered(blend(grain, (0.035, 0.018, 0.012), (0.16, 0.075, 0.045)), 7, 0.4)
    woods = [
        {"bsdf": {"type": "roughplastic", "alpha": 0.25, "diffuse_reflectance": bitmap(wood)}}
        for wood in (maple, walnut)
    ]
    board = {
        "bsdf": {"type": "roughplastic", "alpha": 0.3, "diffuse_reflectance": bitmap(squares, (4.0, 4.0))}
    }
    iron = paint((0.02, 0.02, 0.022))
    concrete = paint((0.05, 0.05, 0.075))
    scene: dict[str, Any] = {
        "sky": dusk(),
        "board": floor(BOARD_Y, 16 * SQUARE, 1.15 - 32 * SQUARE, 1.15, board),
        "key": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f()
            .look_at([0.75, 0.65, -0.10], [0.0, -0.05, 0.55], [0, 1, 0])
            .scale(0.22),
            "emitter": {
                "type": "area",
                "radiance": {"type": "rgb", "value": [24.0, 16.5, 10.0]},
            },
        },
    }
    for i, (outline, wood, right, z) in enumerate(CHESSMEN):
        place = mi.ScalarTransform4f().translate([X_RIGHT * right, BOARD_Y, z])
        scene[f"man{i}"] = turned(smooth(outline), place.rotate([0, 1, 0], 41.0 * i), woods[wood])
    # The king's cross.
    scene["cross_up"] = box(0.05, BOARD_Y + 0.145, 0.55, (0.0025, 0.011, 0.002), woods[0])
    scene["cross_over"] = box(0.05, BOARD_Y + 0.147, 0.55, (0.0085, 0.0025, 0.002), woods[0])

    # The window behind the sill, and lights of the city beyond it.
    for i, right in enumerate((-0.36, 0.02, 0.40)):
        scene[f"bar{i}"] = rod((right, -0.5, 1.25), (right, 1.0, 1.25), 0.006, iron)
    scene["bar_across"] = rod((-1.5, 0.16, 1.25), (1.5, 0.16, 1.25), 0.006, iron)
    for i in range(11):
        z = rng.uniform(18.0, 40.0)
        right = z * (-0.40 + 0.08 * i + rng.uniform(-0.02, 0.02))
        top = z * rng.uniform(0.01, 0.14)
        scene[f"tower{i}"] = box(right, top - 6.0, z, (0.045 * z, 6.0, 1.0), concrete)

    # Fairy lights on thin wires close to the lens, one of them lit.
    wires = []
    for right, sway, z in [(0.062, 0.006, 0.300), (0.079, -0.009, 0.290), (0.092, 0.004, 0.330)]:
        t = np.linspace(-1.0, 1.0, 24)
        wires.append(
            np.stack([right + sway * np.sin(3.0 * t), 0.15 * t + 0.02, z + 0.01 * np.cos(4.0 * t)], -1)
        )
    scene["wires"] = tubes(wires, 0.0004, iron)
    scene["bulb"] = sphere(0.060, 0.012, 0.298, 0.0035, paint((0.75, 0.12, 0.08)))
    return scene


def lamps() -> dict[str, Any]:
    """Make the lights of the city, and the lit one of the fairy lights."""
    rng = np.random.default_rng(34)
    scene: dict[str, Any] = {}
    colors = np.array(
        [(1.0, 0.62, 0.28), (1.0, 0.78, 0.50), (0.60, 0.80, 1.0), (1.0, 0.25, 0.12), (0.35, 1.0, 0.6)]
    )
    for i in range(34):
        z = rng.uniform(6.0, 17.0)
        right, up = z * rng.uniform(-0.36, 0.36), z * (-0.075 + 0.17 * rng.beta(1.2, 2.2))
        color = colors[rng.choice(len(colors), p=[0.38, 0.28, 0.14, 0.12, 0.08])]
        scene[f"lamp{i}"] = lamp(right, up, z, rng.uniform(1.6, 3.4), rng.uniform(35.0, 120.0) * color)
    scene["fairy"] = lamp(0.081, 0.045, 0.285, 4.0, 55.0 * np.array([1.0, 0.70, 0.36]))
    return scene


def write_exr(path: Path, color: np.ndarray, depth: np.ndarray | None = None) -> None:
    """Write half float colour, and depth as Z."""
    # Two of a half's ten bits are spent on noise alone; without them the file is a fifth smaller.
    bits = np.minimum(color, 60000.0).astype(np.float16).view(np.uint16)
    halves = ((bits + 2) & ~np.uint16(3)).view(np.float16)
    channels = {name: np.ascontiguousarray(halves[..., i]) for i, name in enumerate("RGB")}
    if depth is not None:
        # A half's 11 bits put the circle of confusion wrong by a fiftieth of a pixel at most.
        channels["Z"] = depth.astype(np.float16)
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


def main() -> None:
    """Render the demo's picture and its reference."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--spp", type=int, default=1024, help="samples a pixel")
    parser.add_argument("--lamp-spp", type=int, default=1024, help="the same of what the lamps send out")
    parser.add_argument("--folder", type=Path, default=DATA)
    parser.add_argument("--preview", type=Path, help="also write the two as an 8-bit picture")
    arguments = parser.parse_args()
    print(f"Mitsuba variant: {choose_variant()}", flush=True)
    capture = Capture(shapes(), CAMERA, max_depth=5, lamps=lamps())
    color = capture.pinhole(WIDTH, HEIGHT, arguments.spp, arguments.lamp_spp)
    reference = capture.thin_lens(WIDTH, HEIGHT, arguments.spp, arguments.lamp_spp)
    _, layers_depth = capture.peel(WIDTH, HEIGHT, layers=1)
    depth = layers_depth[0]
    arguments.folder.mkdir(parents=True, exist_ok=True)
    write_exr(arguments.folder / "demo.exr", color, depth)
    write_exr(arguments.folder / "demo_reference.exr", reference)
    settings = "".join(f"{name} = {value!r}\n".replace("'", '"') for name, value in CAMERA.settings().items())
    (arguments.folder / "demo_lens.toml").write_text(
        f"# Lengths in metres, angles in degrees, as in Mitsuba's thinlens.\n{settings}"
    )
    if arguments.preview:
        contact_sheet({"color": color, "reference": reference, "depth": depth}).save(arguments.preview)


if __name__ == "__main__":
    main()
