"""What openings and flaws of the lens cost, as multiples of a thin lens with a round opening.

Run this file with the dependency group `bench` installed. The picture is that of `pictures.py`, with edges
everywhere; a ratio is taken between runs that follow each other, and the median of them is printed.
"""

import argparse
import statistics
import time
from collections.abc import Callable

import dofsim
import numpy as np
from pictures import lens_of, planes

RADIUS_PX = 20


def picture(texels: int = 64):
    """Draw a star, as transmission."""
    x, y = np.meshgrid(*[np.linspace(-1.0, 1.0, texels)] * 2)
    return (np.hypot(x, y) < 0.65 + 0.3 * np.cos(5.0 * np.arctan2(y, x))).astype(float)


def cases(lens: dofsim.Lens) -> dict[str, tuple[dofsim.Lens, dofsim.Aperture]]:
    """Name what is measured."""
    disc = dofsim.Aperture()
    return {
        "blades=6": (lens, dofsim.Aperture(blades=6)),
        "roundness=0.5": (lens, dofsim.Aperture(blades=6, roundness=0.5)),
        "ratio=2": (lens, dofsim.Aperture(ratio=2.0)),
        "obstruction=0.5": (lens, dofsim.Aperture(obstruction=0.5)),
        "apodization=0.4": (lens, dofsim.Aperture(apodization=0.4)),
        "spherical=0.7": (lens, dofsim.Aperture(spherical=0.7)),
        "image": (lens, dofsim.Aperture(image=picture())),
        "tilt=(1, 0)": (lens.replace(tilt=(1.0, 0.0)), disc),
        "cat_eye=0.9": (lens.replace(cat_eye=0.9), disc),
        "axial_color": (lens.replace(axial_color=(-0.01, 0.0, 0.01)), disc),
        "lateral_color": (lens.replace(lateral_color=(-0.001, 0.0, 0.001)), disc),
    }


def seconds(work: Callable[[], object]) -> float:
    """Time one run."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def main() -> None:
    """Measure every case beside the round opening."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--radius-px", type=float, default=RADIUS_PX)
    arguments = parser.parse_args()
    color, depth = planes()
    scene, lens = dofsim.Scene(color, depth), lens_of(arguments.radius_px)

    def run(lens: dofsim.Lens, aperture: dofsim.Aperture) -> float:
        return seconds(lambda: scene.render(lens, aperture=aperture, threads=arguments.threads))

    for name, (other, aperture) in cases(lens).items():
        run(other, aperture)
        ratios = []
        for _ in range(arguments.runs):
            run(lens, dofsim.Aperture())
            plain = run(lens, dofsim.Aperture())
            run(other, aperture)
            ratios.append(run(other, aperture) / plain)
        print(f"{name:16} {statistics.median(ratios):5.2f}x")


if __name__ == "__main__":
    main()
