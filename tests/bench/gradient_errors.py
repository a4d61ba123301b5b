"""Errors of gradients of depth beside differences of the render itself, as a table: a line a case.

Every line is a scene and the width of a bump of depth, and every number the place of one. The weights are how
the picture changes along the bump, with another step, through other lens points and smoothed: else they would
add up the noise of the difference. The noise is by how much the difference is another one with fewer lens
points, and the steps are by how much it is with half and twice the step, all in percent.
"""

import argparse
from collections.abc import Callable

import dofsim
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage as ndi

Array = NDArray[np.float64]

SHAPE = (128, 192)
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
FOCUS, K = 0.5, 50.0


def texture(seed: int) -> Array:
    """Give colours with detail of a few pixels, between 0 and 1."""
    noise = np.random.default_rng(seed).random((*SHAPE, 3))
    smooth = ndi.gaussian_filter(noise, (1.5, 1.5, 0.0), mode="wrap")
    return (smooth - smooth.min()) / np.ptp(smooth)


def card(near_px: float, far_px: float, bulge_px: float = 0.0) -> tuple[Array, Array]:
    """Give a round card before a wall, both textured, and shifts of both; the card may bulge."""
    radius = 36.0
    from_middle = np.hypot(X - 95.5, Y - 63.5)
    coverage = np.clip(radius + 0.5 - from_middle, 0.0, 1.0)[..., None]
    color = coverage * texture(2) + (1.0 - coverage) * texture(1) * [0.5, 0.7, 1.0]
    bulge = bulge_px * np.sqrt(np.maximum(0.0, 1.0 - (from_middle / radius) ** 2))
    return color, np.where(from_middle < radius, near_px + bulge, far_px)


def surface(shift_px: Array) -> tuple[Array, Array]:
    """Give one textured surface of these shifts."""
    return texture(1), shift_px + 0.0 * X


# Colours and shifts, nearer ones greater, relative to the focus; and the places of bumps.
PLACES = [(96.0, 48.0), (64.0, 64.0), (96.0, 64.0), (40.0, 50.0), (150.0, 80.0)]
RIMS = [(95.5 - 36.0, 63.5), (95.5 + 36.0, 63.5), (95.5, 63.5 - 36.0), (95.5, 63.5 + 36.0), (70.0, 38.0)]
AT_FOCUS = [(96.0, 48.0), (90.0, 64.0), (104.0, 40.0), (96.0, 80.0)]
ACROSS = (X - 95.5) / SHAPE[1]
DOWN = (Y - 63.5) / SHAPE[0]
SCENES: dict[str, tuple[Callable[[], tuple[Array, Array]], list[tuple[float, float]]]] = {
    "wall": (lambda: surface(np.full(SHAPE, -5.7)), PLACES),
    "gentle slope": (lambda: surface(-7.0 + 4.0 * ACROSS), PLACES),
    "steep slope": (
        lambda: surface(12.0 - 36.0 * ACROSS),
        [(30.0, 48.0), (40.0, 64.0), (64.0, 64.0), (48.0, 90.0)],
    ),
    "part disc": (
        lambda: surface(-7.0 + 24.0 * ACROSS),
        [(20.0, 40.0), (32.0, 64.0), (40.0, 80.0), (64.0, 50.0)],
    ),
    "gently through the focus": (lambda: surface(6.0 * ACROSS), AT_FOCUS),
    "through the focus": (lambda: surface(16.0 * ACROSS), AT_FOCUS),
    "steeply through the focus": (lambda: surface(50.0 * DOWN), AT_FOCUS),
    "ball": (lambda: card(4.2, -2.7, 3.5), PLACES[:3]),
    "rim in front": (lambda: card(7.7, 0.0), RIMS),
    "rim in front, before a wall": (lambda: card(7.7, -5.7), RIMS),
    "rim behind": (lambda: card(-2.2, -7.7), RIMS),
    "rim near the focus": (lambda: card(1.2, -7.7), RIMS),
    "rim of a ball": (lambda: card(4.2, -5.7, 3.5), RIMS),
}
WIDTHS = (2.0, 4.0, 8.0, 16.0)
# Numbers of lens points, of which the mean is taken.
VIEWS = (3000, 4096)


def lens_of(k: float) -> dofsim.Lens:
    """Give the lens that shifts by `k` pixels for each dioptre."""
    lens = dofsim.Lens(aperture_radius=0.01, focus_distance=1.0 / FOCUS, fov=42.0)
    own = abs(float(dofsim.coc(np.ones(SHAPE), lens)[0, 0])) / (1.0 - FOCUS)
    return lens.replace(aperture_radius=0.01 * k / own)


def change(color: Array, disparity: Array, lens: dofsim.Lens, bump: Array, step: float, views: int) -> Array:
    """Give how the render changes along a bump of disparity: the central difference."""
    ends = [
        dofsim.render(
            color,
            disparity + sign * step * bump,
            lens,
            depth_kind="inverse_z",
            device="cpu",
            resolution="full",
            views=views,
        ).astype(float)
        for sign in (1.0, -1.0)
    ]
    return (ends[0] - ends[1]) / (2.0 * step)


def errors(scene: str, step_px: float, widths: list[float], steps: bool) -> None:
    """Print a line for each width of bumps: errors over all places of a scene."""
    make, places = SCENES[scene]
    color, shift_px = make()
    color = color.astype(np.float32)
    lens, disparity = lens_of(K), FOCUS + shift_px / K
    for width in widths:
        found, expected, noise, other = [], [], [], []
        for x, y in places:
            bump = np.exp(-((X - x) ** 2 + (Y - y) ** 2) / (2.0 * width**2)) / K

            def along(step: float, views: int, bump: Array = bump) -> Array:
                return change(color, disparity, lens, bump, step, views)

            weights = ndi.gaussian_filter(along(0.3, 1000), (1.0, 1.0, 0.0)).astype(np.float32)
            gradient = dofsim.vjp(
                color, disparity, lens, weights, wrt="disparity", depth_kind="inverse_z", views=1024
            )["disparity"]
            found.append(np.vdot(gradient, bump))
            of_views = [np.vdot(along(step_px, views), weights) for views in VIEWS]
            expected.append(np.mean(of_views))
            if steps:
                noise.append(of_views[0])
                other.append([np.vdot(along(by * step_px, 4096), weights) for by in (0.5, 2.0)])
        off = np.array(found) / np.array(expected) - 1.0
        line = " ".join(f"{100.0 * one:+6.1f}" for one in off)
        more = ""
        if steps:
            of_noise = np.abs(np.array(noise) / expected - 1.0).mean()
            of_steps = np.abs(np.array(other).T / expected - 1.0).mean(axis=1)
            half, twice = 100.0 * of_steps
            more = f"  noise {100.0 * of_noise:4.1f}, steps {half:4.1f} {twice:4.1f}"
        mean = 100.0 * np.abs(off).mean()
        print(f"{scene:<28} {width:4.0f}  {mean:5.1f} %: {line}{more}", flush=True)


def main() -> None:
    """Measure how far gradients are off."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("scenes", nargs="*", help=f"of {', '.join(SCENES)}; all by default")
    parser.add_argument("--widths", type=float, nargs="+", default=list(WIDTHS), help="deviations of bumps")
    parser.add_argument(
        "--step", type=float, default=0.15, help="of the height of a bump, in pixels of shift"
    )
    parser.add_argument("--steps", action="store_true", help="also the noise, and other steps")
    arguments = parser.parse_args()
    for scene in arguments.scenes or SCENES:
        errors(scene, arguments.step, arguments.widths, arguments.steps)


if __name__ == "__main__":
    main()
