"""Gradients beside finite differences of Mitsuba's thin lens, as a table.

Run this file with Mitsuba installed. The loss is the squared difference to the picture that another lens
takes. Mitsuba's is the product of the differences of two pictures with other random numbers each, so that
noise has no mean; all lenses are rendered with the same two.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import dofsim
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
SIZE = (160, 120)
STEP = 0.03
WRT = ("aperture_radius", "focus_distance")


def derivatives(name: str, spp: int) -> dict[str, tuple[float, float]]:
    """Give dofsim's and Mitsuba's derivatives of the loss by the logarithm of each parameter of the lens."""
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

    def loss(setting: str, factor: float) -> float:
        capture.camera = replace(own, **{setting: factor * getattr(own, setting)})
        taken = (capture.thin_lens(*SIZE, spp, recipe.lamp_spp, seed) for seed in (3, 4))
        return float(np.vdot(*(one - target for one in taken)))

    return {
        setting: (
            gradient[setting] * getattr(own, setting),
            (loss(setting, 1.0 + STEP) - loss(setting, 1.0 - STEP)) / (2.0 * STEP),
        )
        for setting in WRT
    }


def main() -> None:
    """Compare derivatives by the logarithms of aperture and focus."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("scenes", nargs="*", default=["balls", "spheres", "plane"])
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--variant", help="of Mitsuba")
    arguments = parser.parse_args()
    from scenes.variant import choose_variant

    choose_variant(arguments.variant)
    for name in arguments.scenes:
        for setting, (own, traced) in derivatives(name, arguments.spp).items():
            print(
                f"{name:<8} {setting:<16} dofsim {own:9.2f}  Mitsuba {traced:9.2f}  {own / traced - 1:+6.1%}"
            )


if __name__ == "__main__":
    main()
