"""Gradients beside finite differences of Mitsuba's thin lens, as a table.

Run this file with Mitsuba installed. The loss is the squared difference to the picture that another lens
takes. Mitsuba's is the product of the differences of two pictures with other random numbers each, so that
noise has no mean; both lenses of a difference are rendered with the same two. Several such pairs say how
much is left of the noise. The differences of dofsim's own renders say how much of what is off is the
picture's, and not the gradient's.
"""

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import dofsim
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))
SIZE = (160, 120)
STEP = 0.03
WRT = ("aperture_radius", "focus_distance")


def derivatives(name: str, spp: int, pairs: int) -> dict[str, tuple[float, float, NDArray[np.float64]]]:
    """Give the derivatives of the loss by the logarithm of each parameter of the lens.

    They are dofsim's, the finite difference of its renders, and those of Mitsuba's, one a pair.
    """
    from scenes.bundle import RECIPES, load_capture

    recipe = RECIPES[name]
    capture = load_capture(name, recipe)
    own = capture.camera
    color = capture.pinhole(*SIZE, recipe.pinhole_spp, recipe.lamp_spp)
    depth = capture.peel(*SIZE, 1)[1][0]
    lens = dofsim.Lens(**own.settings())
    other = lens.replace(aperture_radius=1.3 * own.aperture_radius, focus_distance=1.2 * own.focus_distance)
    target, picture = (dofsim.render(color, depth, one, device="cpu", views=1024) for one in (other, lens))
    gradient = dofsim.vjp(color, depth, lens, 2 * (picture - target), wrt=WRT)

    def difference(loss: Callable[[str, float], float], setting: str) -> float:
        return (loss(setting, 1.0 + STEP) - loss(setting, 1.0 - STEP)) / (2.0 * STEP)

    def rendered(setting: str, factor: float) -> float:
        changed = lens.replace(**{setting: factor * getattr(own, setting)})
        taken = dofsim.render(color, depth, changed, device="cpu", views=4096)
        return float(np.square(taken.astype(float) - target).sum())

    def traced(pair: int) -> Callable[[str, float], float]:
        def loss(setting: str, factor: float) -> float:
            capture.camera = replace(own, **{setting: factor * getattr(own, setting)})
            seeds = (3 + 2 * pair, 4 + 2 * pair)
            taken = (capture.thin_lens(*SIZE, spp, recipe.lamp_spp, seed) for seed in seeds)
            return float(np.vdot(*(one - target for one in taken)))

        return loss

    return {
        setting: (
            gradient[setting] * getattr(own, setting),
            difference(rendered, setting),
            np.array([difference(traced(pair), setting) for pair in range(pairs)]),
        )
        for setting in WRT
    }


def main() -> None:
    """Compare derivatives by the logarithms of aperture and focus."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("scenes", nargs="*", default=["balls", "spheres", "plane"])
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--pairs", type=int, default=2, help="pairs of pictures by Mitsuba")
    parser.add_argument("--variant", help="of Mitsuba")
    arguments = parser.parse_args()
    from scenes.variant import choose_variant

    choose_variant(arguments.variant)
    for name in arguments.scenes:
        found = derivatives(name, arguments.spp, arguments.pairs)
        for setting, (own, rendered, traced) in found.items():
            mean = traced.mean()
            error = traced.std(ddof=1) / math.sqrt(len(traced)) if len(traced) > 1 else math.nan
            print(
                f"{name:<8} {setting:<16} dofsim {own:9.2f} ({own / mean - 1:+6.1%})  its renders "
                f"{rendered:9.2f} ({rendered / mean - 1:+6.1%})  Mitsuba {mean:9.2f} +- {error:.2f}"
            )


if __name__ == "__main__":
    main()
