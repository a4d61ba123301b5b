"""How the time of a method grows with the radius of the blur, as a table and a plot.

Run this file with the dependency group `bench` and matplotlib installed. The picture is the planes of
`pictures.py`; the lens is opened until the largest circle of confusion has the radius asked for. The peer in
the same run is `cv2.GaussianBlur` with 25 x 25 pixels, whose time does not depend on it.
"""

import argparse
from pathlib import Path

import cv2
import dofsim
import matplotlib as mpl
from dofsim._dofsim import methods_available
from matplotlib.figure import Figure
from pictures import HEIGHT, WIDTH, best_of, lens_of, planes

RADII_PX = (4, 8, 16, 32, 64)


def main() -> None:
    """Measure one method at every radius."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--method", default="hexagonal", choices=methods_available())
    parser.add_argument("--runs", type=int, default=5, help="the best of so many is taken")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--plot", type=Path, help="PNG to draw")
    arguments = parser.parse_args()
    cv2.setNumThreads(arguments.threads)
    color, depth = planes()
    scene = dofsim.Scene(color, depth)
    options = {"method": arguments.method, "threads": arguments.threads}
    seconds = []
    for radius in RADII_PX:
        lens = lens_of(radius)
        seconds.append(best_of(arguments.runs, lambda lens=lens: scene.render(lens, **options)))
        peer = best_of(arguments.runs, lambda: cv2.GaussianBlur(color, (25, 25), 0))
        print(
            f"{radius:>4} px {1e3 * seconds[-1]:8.1f} ms {seconds[-1] / peer:6.1f}x cv2.GaussianBlur 25 x 25"
        )
    if arguments.plot:
        mpl.use("agg")
        figure = Figure(figsize=(5.0, 3.5), dpi=100, layout="constrained")
        axes = figure.add_subplot()
        times = [1e3 * s for s in seconds]
        axes.loglog(RADII_PX, times, "o-", label=f'method="{arguments.method}"')
        linear = [1e3 * seconds[0] * radius / RADII_PX[0] for radius in RADII_PX]
        axes.loglog(RADII_PX, linear, "--", color="grey", label="linear in the radius")
        axes.minorticks_off()
        axes.set_xticks(RADII_PX, [str(radius) for radius in RADII_PX])
        axes.set_yticks(times, [f"{milliseconds:.0f}" for milliseconds in times])
        axes.set_xlabel("largest radius of the circle of confusion in pixels")
        axes.set_ylabel("milliseconds")
        axes.set_title(f"{WIDTH} x {HEIGHT}, threads: {arguments.threads}")
        axes.legend()
        figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
