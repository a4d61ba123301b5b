"""The flagship beside what comes as close to the truth: brute force, and Mitsuba's thin lens.

Pictures are compared with two renders through Mitsuba's thin lens; see `fidelity.noiseless_psnr`.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import dofsim
import numpy as np
from dofsim.mitsuba._capture import averaged
from numpy.typing import NDArray
from pictures import lens_of

sys.path.insert(0, str(Path(__file__).parents[1]))

from fidelity import BORDER_PX, noiseless_psnr
from fidelity import lens_of as lens_of_bundle
from scenes import spheres
from scenes.bundle import CACHE, fingerprint, load_bundle
from scenes.camera import Camera
from scenes.capture import Capture
from scenes.variant import choose_variant

Array = NDArray[np.float32]

FULL_HD = 1920, 1080
RADIUS_PX = 20.0
PINHOLE_SPP = 64
HALF_SPP = 15 * 15
FIRST_SIDE = 5


@dataclass(frozen=True)
class Shot:
    """A scene through the pinhole, in two layers, and through the lens, in two halves."""

    lens: dofsim.Lens
    color: Array
    depth: Array
    halves: tuple[Array, Array]

    def render(self, layers: int) -> Array:
        """See it through dofsim's lens."""
        color, depth = self.color[:layers], self.depth[:layers]
        picture = dofsim.render(
            *((color[0, ..., :3], depth[0]) if layers == 1 else (color, depth)), self.lens
        )
        return picture[..., :3]

    def psnr(self, picture: Array) -> float:
        """PSNR to the truth in dB of sRGB code values."""
        return noiseless_psnr(picture, self.halves, BORDER_PX)


def small() -> Shot:
    """Give the spheres of the fidelity table."""
    bundle = load_bundle("spheres", 512, 384)
    color, depth = bundle["layers_color_1x"][:2], bundle["layers_depth_1x"][:2]
    return Shot(lens_of_bundle(bundle), color, depth, (bundle["reference_a"], bundle["reference_b"]))


def capture_through(lens: dofsim.Lens) -> Capture:
    """Load the spheres into Mitsuba, seen through a lens."""
    choose_variant()
    return Capture(spheres.shapes(), replace(Camera(), aperture_radius=lens.aperture_radius))


def full_hd() -> Shot:
    """Give the same at 1920 x 1080, blurred by up to 20 px; rendered once, which takes minutes."""
    path = CACHE / f"equal_{fingerprint('spheres')[:12]}.npz"
    if not path.is_file():
        capture = capture_through(lens_of(RADIUS_PX))
        color, depth = capture.peel(*FULL_HD, layers=2)
        color[0] = averaged(color[0], depth[0], capture.pinhole(*FULL_HD, PINHOLE_SPP))
        capture = capture_through(lens_of(RADIUS_PX, depth[0]))
        halves = [capture.thin_lens(*FULL_HD, HALF_SPP, seed=seed) for seed in (1, 2)]
        partial = path.with_suffix(".part.npz")
        np.savez(partial, color=color, depth=depth, halves=halves)
        partial.replace(path)
    with np.load(path) as kept:
        color, depth, halves = kept["color"], kept["depth"], kept["halves"]
    return Shot(lens_of(RADIUS_PX, depth[0]), color, depth, (halves[0], halves[1]))


class Traced:
    """Mitsuba's thin lens with so many samples a pixel, squares, which its sampler spreads most evenly."""

    def __init__(self, shot: Shot) -> None:
        self.shot = shot
        self.capture = capture_through(shot.lens)
        self.known: dict[int, float] = {}

    def render(self, side: int) -> Array:
        """Trace `side` times `side` samples a pixel."""
        height, width = self.shot.depth.shape[1:]
        picture: Array = self.capture.thin_lens(width, height, side * side, seed=9)
        return picture

    def psnr(self, side: int) -> float:
        """Measure them once."""
        if side not in self.known:
            self.known[side] = self.shot.psnr(self.render(side))
        return self.known[side]

    def fewest(self, psnr_db: float) -> int:
        """Give the side of the fewest samples that come as close."""
        # Squared errors fall at least as fast as samples rise.
        samples = FIRST_SIDE**2 * 10.0 ** (0.1 * (psnr_db - self.psnr(FIRST_SIDE)))
        side = max(2, round(0.9 * samples**0.5))
        while side > 2 and self.psnr(side - 1) >= psnr_db:
            side -= 1
        while self.psnr(side) < psnr_db:
            side += 1
        return side
