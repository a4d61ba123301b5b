"""Hash renders of every method, lens and opening, to show that a change of the code changes no bit.

Run it on the parent commit and on the result, on one machine; the two files are equal::

    python tests/same_bits.py --output before.txt
    python tests/same_bits.py --compare before.txt

Each line of the output is the name of a case and the hash of its result: of its type, shape and bytes. A
combination that dofsim refuses has the hash of the error's text, and says so. Pictures are small and
synthetic, with highlights, slopes, edges, thin bars, noise and a background at infinity. Every axis is
covered (methods with their options, lenses, openings, alpha, layers, channels, sample types, kinds of depth,
frames, devices, instruction sets, threads), and those pairs that share code. Hashes of different machines
need not agree: processors differ in their instruction sets, and drivers in how they compile shaders.
"""

from __future__ import annotations

import argparse
import fnmatch
import functools
import hashlib
import itertools
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import dofsim
import numpy as np
from numpy.typing import NDArray

Case = tuple[str, Callable[[], Any]]

HEIGHT, WIDTH = 71, 98
FOCUS_M = 2.5

OPTIONS: dict[str, dict[str, dict[str, Any]]] = {
    "lens": {"default": {}, "views": {"views": 48}},
    "poisson": {
        "default": {},
        "taps": {"taps": 40, "max_coc_px": 12.0},
        "places": {"taps": [[0.5, 0.0, 1.0], [-0.2, 0.7, 0.5], [0.0, -0.9, 2.0]]},
        "leak": {"leak_test": "off"},
        **{bokeh: {"bokeh": bokeh} for bokeh in ("ring", "gaussian", "inverse")},
    },
    "gaussian": {"default": {}, "max_coc": {"max_coc_px": 4.0}, "focal_range": {"focal_range": 2.0}},
    "hexagonal": {"default": {}, "max_coc": {"max_coc_px": 3.0}},
    "levels": {"default": {}, "c0": {"c0_px": 1.0}, "wide": {"c0_px": 9.0}},
    "taps": {
        "default": {},
        **{variant: {"variant": variant} for variant in ("seven", "six", "four", "four_rings")},
        "hyperfocal": {"hyperfocal_factor": 0.3},
    },
    "sprites": {
        "default": {},
        "limits": {"coc_threshold_px": 2.5, "max_coc_px": 4.0},
        "sprite": {"sprite": np.arange(12.0).reshape(3, 4)},
    },
}

# Arguments of `dofsim.Lens` beyond those of a thin lens.
LENSES: dict[str, dict[str, Any]] = {
    "thin": {},
    "pinhole": {"aperture_radius": 0.0},
    "far_focus": {"focus_distance": float("inf")},
    "near_focus": {"focus_distance": 1.3},
    "fov_y": {"fov_axis": "y"},
    "tilt": {"tilt": (10.0, -20.0)},
    "field_curvature": {"field_curvature": 0.3},
    "axial_color": {"axial_color": (0.03, 0.0, -0.02)},
    "lateral_color": {"lateral_color": (0.01, 0.0, -0.02)},
    "breathing": {"sensor_mm": 36.0, "breathing_focal_length_mm": 50.0},
    "natural": {"vignetting": "natural"},
    "off_axis": {"principal_point": (0.1, -0.2)},
    "off_axis_tilt": {"principal_point": (0.1, -0.2), "vignetting": "natural", "tilt": (5.0, 5.0)},
    "all": {
        "tilt": (5.0, 10.0),
        "field_curvature": 0.1,
        "axial_color": (-0.02, 0.0, 0.04),
        "lateral_color": (0.004, 0.0, -0.003),
        "vignetting": "natural",
        "principal_point": (-0.05, 0.1),
    },
}
# Arguments with which the barrel clips the opening.
CLIPPED: dict[str, dict[str, Any]] = {
    "cat_eye": {"cat_eye": 0.7},
    "cat_eye_optical": {"cat_eye": 1.0, "vignetting": "optical"},
    "cat_eye_full": {"cat_eye": 0.5, "vignetting": "full", "tilt": (8.0, 0.0)},
    "cat_eye_color": {"cat_eye": 0.6, "axial_color": (0.02, 0.0, -0.02), "principal_point": (0.1, 0.0)},
}
# Arguments of `dofsim.Lens.from_disparity`.
RELATIVE: dict[str, dict[str, Any]] = {
    "pixels": {"strength_px": 8.0},
    "percent": {"strength_percent": 5.0},
    "colors": {
        "strength_px": 8.0,
        "axial_color": (0.05, 0.0, -0.05),
        "lateral_color": (0.01, 0.0, -0.01),
        "principal_point": (0.1, 0.1),
    },
    "natural": {"strength_px": 8.0, "vignetting": "natural"},
    "cat_eye": {"strength_px": 8.0, "cat_eye": 0.7, "vignetting": "optical"},
}

OPENINGS: dict[str, dict[str, Any]] = {
    "disc": {},
    "hexagon": {"blades": 6, "rotation": 10.0},
    "square": {"blades": 4, "rotation": 45.0},
    "round_blades": {"blades": 5, "roundness": 0.4, "ratio": 1.5},
    "obstruction": {"obstruction": 0.5},
    "apodization": {"obstruction": 0.3, "apodization": 0.6},
    "spherical": {"spherical": 0.6},
    "spherical_blades": {"blades": 7, "spherical": -0.6},
    "image": {"image": np.arange(12.0).reshape(3, 4)},
}

# Channels of the picture and its `alpha`.
COLORS: dict[str, tuple[int, str | None]] = {
    "1": (1, None),
    "2_none": (2, "none"),
    "2_straight": (2, "straight"),
    "3": (3, None),
    "4_default": (4, None),
    "4_none": (4, "none"),
    "4_premultiplied": (4, "premultiplied"),
    "4_straight": (4, "straight"),
}

FRAMES: dict[str, dict[str, Any]] = {
    "supersample": {"supersample": 2},
    "overscan": {"overscan": 6},
    "both": {"supersample": 2, "overscan": 5},
    "odd": {"supersample": 3},
}

DEPTH_KINDS = ("z", "distance", "inverse_z", "disparity", "relative", "zbuffer", "distance_from_near")


def surface(height: int, width: int) -> NDArray[np.float32]:
    """Make the depth in metres: a slope, a box in focus, a ball and bars in front, infinity at the top."""
    y, x = np.mgrid[:height, :width].astype(np.float32)
    depth = 3.0 + 4.0 * (1.0 - y / max(height, 2)) + 0.004 * x
    depth[(x > 0.62 * width) & (y > 0.4 * height) & (x < 0.9 * width)] = FOCUS_M
    ball = (x - 0.3 * width) ** 2 + (y - 0.55 * height) ** 2
    radius_2 = np.float32((0.2 * height) ** 2)
    depth = np.where(ball < radius_2, 1.6 - 0.3 * np.sqrt(np.maximum(1.0 - ball / radius_2, 0.0)), depth)
    depth[(x.astype(int) % 23 < 2) & (y > 0.7 * height)] = 1.3
    depth[y < 0.1 * height] = np.inf
    return np.ascontiguousarray(depth, np.float32)


def coverage(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Make alpha with regions of nothing, of everything and of something between."""
    share = rng.random(shape, dtype=np.float32)
    return np.clip(2.0 * share - 0.4, 0.0, 1.0).astype(np.float32)


@functools.cache
def picture(height: int = HEIGHT, width: int = WIDTH, channels: int = 3, alpha: str | None = None) -> Any:
    """Make colour of (H, W, C) and depth of (H, W)."""
    rng = np.random.default_rng(channels)
    depth = surface(height, width)
    # Each surface has its own colour, with noise on it.
    tone = np.where(np.isinf(depth), 0.5, 0.5 + 0.4 * np.sin(3.0 * np.minimum(depth, 9.0)))[..., None]
    color = (
        tone * np.array([1.0, 0.7, 0.4, 0.8])[:channels] * rng.uniform(0.7, 1.0, (height, width, channels))
    )
    color[5::17, 4::19] *= 60.0
    color[height // 2, width // 2] = 500.0
    if channels in (2, 4) and alpha != "none":
        color[..., -1] = coverage(rng, (height, width))
        if alpha != "straight":
            color[..., :-1] *= color[..., -1:]
    return color.astype(np.float32), depth


@functools.cache
def layers(alpha: str | None = None, count: int = 3, whole: bool = True) -> Any:
    """Make colour of (L, H, W, 4) and depth of (L, H, W), from front to back."""
    rng = np.random.default_rng(11)
    color, depth = picture(channels=4, alpha="none")
    color = np.stack([np.roll(color, 9 * layer, axis=1) for layer in range(count)])
    color[..., 3] = 1.0 if alpha == "none" else coverage(rng, color.shape[:3])
    # Parts of the first layer are whole, and parts are empty.
    color[0, 40:, :, 3] = 1.0
    color[0, :20, :, 3] = 0.0
    if whole:
        color[-1, ..., 3] = 1.0
    if alpha != "straight":
        color[..., :3] *= color[..., 3:]
    return color, np.stack([depth + np.float32(0.8 * layer) for layer in range(count)])


def scene_of(channels: int, alpha: str | None, count: int) -> Any:
    """Make a picture of one layer or of several."""
    return picture(channels=channels, alpha=alpha) if count == 1 else layers(alpha, count)


@functools.cache
def opening_of(name: str) -> dofsim.Aperture:
    """Make an opening once."""
    return dofsim.Aperture(**OPENINGS[name])


def lens_of(**words: Any) -> dofsim.Lens:
    """Make the lens of all cases, with some of its arguments replaced."""
    thin = {"aperture_radius": 0.1, "focus_distance": FOCUS_M, "fov": 40.0}
    return dofsim.Lens(**(thin | words))


def relative_of(**words: Any) -> dofsim.Lens:
    """Make a lens for disparity."""
    return dofsim.Lens.from_disparity(**({"focus": 0.4} | words))


def render(scene: Any, lens: dict[str, Any], device: str, **options: Any) -> Any:
    """Render a scene through a lens of so many arguments."""
    return dofsim.render(*scene, lens_of(**lens), device=device, **options)


def depth_of(kind: str, depth: Any) -> tuple[Any, dict[str, Any]]:
    """Write depth in metres as another kind, and name the clip planes that it needs; not the same surface."""
    near, far = 0.5, 20.0
    planes = {"near": near, "far": far}
    if kind in ("inverse_z", "disparity", "relative"):
        return 1.0 / depth, {}
    if kind == "zbuffer":
        stored = far / (far - near) * (1.0 - near / np.minimum(depth, far))
        return np.minimum(stored, 1.0).astype(np.float32), planes
    if kind == "distance_from_near":
        return np.where(np.isinf(depth), 0.0, depth - near).astype(np.float32), {"near": near}
    return depth, {}


def samples_of(sample_type: str, color: Any) -> tuple[Any, dict[str, Any]]:
    """Write a picture in another type of samples."""
    if sample_type in ("uint8", "uint16"):
        most = np.iinfo(sample_type).max
        return (most * np.clip(color, 0.0, 1.0)).astype(sample_type), {"transfer": "srgb"}
    return color.astype(sample_type), {}


def of_methods(device: str) -> Iterator[Case]:
    """List every method with its options, lenses, openings, colours, frames and sample types."""
    scene = picture()
    for method, choices in OPTIONS.items():
        call = functools.partial(render, device=device, method=method)
        for name, options in choices.items():
            yield f"{method}/option={name}", functools.partial(call, scene, {}, **options)
        for name, words in (LENSES | CLIPPED).items():
            yield f"{method}/lens={name}", functools.partial(call, scene, words)
        for name, words in RELATIVE.items():
            yield f"{method}/relative={name}", functools.partial(relative, words, device, method)
        for name in OPENINGS:
            yield f"{method}/opening={name}", functools.partial(call, scene, {}, aperture=opening_of(name))
        for name, (channels, alpha) in COLORS.items():
            colored = picture(channels=channels, alpha=alpha)
            yield f"{method}/channels={name}", functools.partial(call, colored, {}, alpha=alpha)
        for name, options in FRAMES.items():
            # Sizes that the frame divides.
            framed = picture(72, 102)
            yield f"{method}/frame={name}", functools.partial(call, framed, {}, **options)
        for sample_type in ("float16", "float64", "uint8", "uint16"):
            color, options = samples_of(sample_type, scene[0])
            yield f"{method}/samples={sample_type}", functools.partial(call, (color, scene[1]), {}, **options)
        for height, width in ((1, 1), (1, 9), (9, 1), (3, 131)):
            yield f"{method}/size={height}x{width}", functools.partial(call, picture(height, width), {})
        yield f"{method}/layers", functools.partial(call, layers(), {})


def relative(words: dict[str, Any], device: str, method: str) -> Any:
    """Render a picture whose depth is a disparity without units."""
    color, depth = picture()
    lens = relative_of(**words)
    return dofsim.render(color, 1.0 / depth, lens, depth_kind="disparity", device=device, method=method)


def of_the_flagship(device: str) -> Iterator[Case]:
    """List the flagship's openings with alpha and layers, and its lenses with layers and coverage."""
    call = functools.partial(render, device=device)
    alphas: tuple[tuple[int, str | None], ...] = (
        (3, None),
        (4, "none"),
        (4, "premultiplied"),
        (4, "straight"),
    )
    for name, (channels, alpha), count in itertools.product(OPENINGS, alphas, (1, 3)):
        if count > 1 and channels == 3:
            continue
        scene, aperture = scene_of(channels, alpha, count), opening_of(name)
        case = f"lens/opening={name}/channels={channels}/alpha={alpha}/layers={count}"
        yield case, functools.partial(call, scene, {}, aperture=aperture, alpha=alpha)
    for name, words in (LENSES | CLIPPED).items():
        yield f"lens/lens={name}/layers=3", functools.partial(call, layers(), words)
        yield f"lens/lens={name}/channels=4", functools.partial(call, picture(channels=4), words)
    for name, words in CLIPPED.items():
        aperture = opening_of("round_blades")
        yield f"lens/lens={name}/opening", functools.partial(call, picture(), words, aperture=aperture)
    for name, words in {"wide": {"aperture_radius": 0.25}, "narrow": {"aperture_radius": 0.02}}.items():
        for count in (1, 3):
            yield f"lens/{name}/layers={count}", functools.partial(call, scene_of(4, None, count), words)
    for name, scene in {
        "two": layers(count=2),
        "open": layers(whole=False),
        "straight_open": layers("straight", 2, False),
    }.items():
        alpha = "straight" if "straight" in name else None
        yield f"lens/layers={name}", functools.partial(call, scene, {}, alpha=alpha)
    # More views than a GPU follows in one pass, and tiles of other sizes.
    yield "lens/views=4096", functools.partial(call, picture(24, 40), {}, views=4096)
    yield "lens/size=130x170", functools.partial(call, picture(130, 170), {})
    yield "lens/size=110x150/tilt", functools.partial(call, picture(110, 150), LENSES["tilt"])


def of_scenes(device: str) -> Iterator[Case]:
    """List what `dofsim.Scene` keeps from one render to the next."""

    def stack(method: str, words: dict[str, Any], distances: list[float]) -> Any:
        return dofsim.Scene(*picture(), device=device).focal_stack(lens_of(**words), distances, method=method)

    def again(method: str, words: dict[str, Any]) -> Any:
        scene = dofsim.Scene(*picture(), device=device)
        lenses = (lens_of(), lens_of(**words), lens_of())
        return np.stack([scene.render(lens, method=method) for lens in lenses])

    for method in OPTIONS:
        yield f"{method}/focal_stack", functools.partial(stack, method, {}, [1.2, 2.5, np.inf])
        yield f"{method}/rendered_again", functools.partial(again, method, LENSES["all"])
    yield "lens/focal_stack/tilt", functools.partial(stack, "lens", LENSES["tilt"], [1.5, 4.0])
    yield "lens/focal_stack/cat_eye", functools.partial(stack, "lens", CLIPPED["cat_eye"], [1.5, 4.0])
    yield "lens/focal_stack/breathing", functools.partial(stack, "lens", LENSES["breathing"], [1.5, 4.0])


def of_depth(device: str) -> Iterator[Case]:
    """List every kind of depth, and depth that is missing."""

    def kinds(method: str, kind: str) -> Any:
        color, depth = picture()
        depth, planes = depth_of(kind, depth)
        lens = relative_of(strength_px=7.0) if kind in ("disparity", "relative") else lens_of()
        return dofsim.render(color, depth, lens, depth_kind=kind, method=method, device=device, **planes)

    def missing(method: str, invalid: str) -> Any:
        color, depth = picture()
        depth = depth.copy()
        depth[30:34, 40:60], depth[50, 10:20], depth[60, 80] = np.nan, -1.0, 0.0
        return render((color, depth), {}, device, method=method, invalid=invalid)

    for method in OPTIONS:
        for kind in DEPTH_KINDS:
            yield f"{method}/depth={kind}", functools.partial(kinds, method, kind)
    for method, invalid in itertools.product(("lens", "taps"), ("raise", "far")):
        yield f"{method}/invalid={invalid}", functools.partial(missing, method, invalid)


def of_instructions() -> Iterator[Case]:
    """List every instruction set and number of threads, on the CPU."""

    def chosen(simd: str, scene: Any, words: dict[str, Any], **options: Any) -> Any:
        before = os.environ.get("DOFSIM_SIMD")
        os.environ["DOFSIM_SIMD"] = simd
        try:
            return render(scene, words, "cpu", **options)
        finally:
            del os.environ["DOFSIM_SIMD"]
            if before is not None:
                os.environ["DOFSIM_SIMD"] = before

    def runs(simd: str) -> bool:
        try:
            chosen(simd, picture(1, 1), {})
        except ValueError:
            return False
        return True

    for simd, threads in itertools.product(filter(runs, ("portable", "avx2", "avx512")), (1, 2)):
        suffix = f"simd={simd}/threads={threads}"
        for method in OPTIONS:
            for channels in (1, 2, 3, 4):
                alpha = None if channels in (1, 3) else "straight"
                call = functools.partial(chosen, simd, picture(channels=channels, alpha=alpha), {})
                case = f"{method}/channels={channels}/{suffix}"
                yield case, functools.partial(call, method=method, alpha=alpha, threads=threads)
            for name in ("all", "tilt"):
                call = functools.partial(chosen, simd, picture(), LENSES[name])
                yield (
                    f"{method}/lens={name}/{suffix}",
                    functools.partial(call, method=method, threads=threads),
                )
        call = functools.partial(chosen, simd, threads=threads)
        yield f"lens/layers=3/{suffix}", functools.partial(call, layers(), {})
        for name in ("round_blades", "spherical", "image"):
            aperture = opening_of(name)
            case = f"lens/opening={name}/{suffix}"
            yield case, functools.partial(call, picture(), {}, aperture=aperture)
    for simd in filter(runs, ("portable", "avx2", "avx512")):
        for name in ("cat_eye", "cat_eye_optical"):
            yield f"lens/lens={name}/simd={simd}", functools.partial(chosen, simd, layers(), CLIPPED[name])


def of_arrays() -> Iterator[Case]:
    """List arrays with another order in memory, and results in an array that is given."""

    def into(method: str) -> Any:
        color, depth = picture()
        color = color.copy()
        return dofsim.render(color, depth, lens_of(), method=method, device="cpu", out=color)

    color, depth = picture()
    for method in OPTIONS:
        call = functools.partial(render, device="cpu", method=method)
        yield f"{method}/out", functools.partial(into, method)
        yield f"{method}/reversed", functools.partial(call, (color[::-1, ::-1], depth[::-1, ::-1]), {})
        planar = np.asfortranarray(color), np.asfortranarray(depth)
        yield f"{method}/fortran", functools.partial(call, planar, {})
        yield f"{method}/double_depth", functools.partial(call, (color, depth.astype(np.float64)), {})


def of_coc() -> Iterator[Case]:
    """List the circle of confusion, by lenses, kinds of depth and sample types."""

    def circle(words: dict[str, Any], kind: str, sample_type: str = "float32") -> Any:
        depth, planes = depth_of(kind, picture()[1])
        lens = relative_of(strength_px=7.0) if kind in ("disparity", "relative") else lens_of(**words)
        return dofsim.coc(depth.astype(sample_type), lens, depth_kind=kind, **planes)

    def focused(**pick: Any) -> Any:
        depth = picture()[1]
        return dofsim.coc(depth, getattr(lens_of(**LENSES["tilt"]), pick.pop("method"))(depth, **pick))

    for name, words in (LENSES | CLIPPED).items():
        yield f"lens={name}", functools.partial(circle, words, "z")
    for kind in DEPTH_KINDS:
        yield f"depth={kind}", functools.partial(circle, {}, kind)
    for sample_type in ("float16", "float64"):
        yield f"samples={sample_type}", functools.partial(circle, {}, "z", sample_type)
    for name, words in RELATIVE.items():
        yield (
            f"relative={name}",
            lambda words=words: dofsim.coc(1 / picture()[1], relative_of(**words), depth_kind="disparity"),
        )
    yield "layers", lambda: dofsim.coc(layers()[1], lens_of(**LENSES["all"]))
    yield "focused_at", functools.partial(focused, method="focused_at", x=30, y=40, radius_px=2)
    for target in ("nearest", "farthest", "centre"):
        yield f"focused_on={target}", functools.partial(focused, method="focused_on", target=target)
    pixels = [(10, 60), (70, 50), (40, 20)]
    yield "focused_on_plane", functools.partial(focused, method="focused_on_plane", pixels=pixels)


def cases(adapter: str | None) -> dict[str, Callable[[], Any]]:
    """Name all cases; those of a GPU only where there is an adapter."""
    groups = [("coc", of_coc()), ("cpu", of_arrays()), ("cpu", of_instructions())]
    for name, device in (("cpu", "cpu"), ("gpu", adapter)):
        if device is not None:
            for group in (of_methods, of_the_flagship, of_scenes, of_depth):
                groups.append((name, group(device)))
    found: dict[str, Callable[[], Any]] = {}
    for prefix, group in groups:
        for case, call in group:
            name = f"{prefix}/{case}"
            if name in found:
                raise AssertionError(f"{name} is named twice")
            found[name] = call
    return dict(sorted(found.items()))


def hash_of(call: Callable[[], Any]) -> str:
    """Hash what a case gives: an array, or an error."""
    try:
        result = np.ascontiguousarray(call())
    except (ValueError, TypeError, dofsim.DeviceError) as error:
        text = f"{type(error).__name__}: {error}"
        return "refused:" + hashlib.sha256(text.encode()).hexdigest()[:16]
    digest = hashlib.sha256(f"{result.dtype} {result.shape} ".encode())
    digest.update(result.tobytes())
    return digest.hexdigest()[:16]


def read_hashes(path: Path, pattern: str) -> dict[str, str]:
    """Read the hashes of an earlier run by the names of their cases."""
    lines = (line.split() for line in path.read_text(encoding="utf-8").splitlines())
    return {name: value for name, value in lines if fnmatch.fnmatch(name, pattern)}


def main() -> int:
    """Hash all cases; give 1 if they were compared and differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, help="write the hashes here; to standard output by default")
    parser.add_argument(
        "--compare", type=Path, help="compare with the hashes in this file, and exit 1 if any differ"
    )
    parser.add_argument(
        "--only", default="*", metavar="PATTERN", help="only cases with such names, as 'gpu/lens/*'"
    )
    parser.add_argument("--device", help="the adapter for the GPU's cases; a software rasteriser by default")
    arguments = parser.parse_args()
    software = next((device.id for device in dofsim.devices() if device.kind == "software"), None)
    adapter = arguments.device or software
    if adapter is None:
        print("there is no software rasteriser; the GPU's cases are left out", file=sys.stderr)
    chosen = {name: call for name, call in cases(adapter).items() if fnmatch.fnmatch(name, arguments.only)}
    hashes = {name: hash_of(call) for name, call in chosen.items()}
    text = "".join(f"{name}  {value}\n" for name, value in hashes.items())
    if arguments.output is not None:
        arguments.output.write_text(text, encoding="utf-8")
    if arguments.compare is None:
        if arguments.output is None:
            print(text, end="")
        return 0
    before = read_hashes(arguments.compare, arguments.only)
    differ = [name for name in sorted(before | hashes) if before.get(name) != hashes.get(name)]
    for name in differ:
        print(f"{name}  {before.get(name, 'absent')} -> {hashes.get(name, 'absent')}")
    print(f"{len(differ)} of {len(before | hashes)} cases differ", file=sys.stderr)
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
