"""The plots whose looks are kept: run `python tests/plots.py` to draw them anew, and look at them."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import dofsim
import numpy as np
from dofsim import metrics, plot
from matplotlib.figure import Figure

BASELINE = Path(__file__).parent / "baseline"
LENS = dofsim.Lens(aperture_radius=0.05, focus_distance=2.0, fov=42.0)
DISTANCES = [1.2, 2.0, 6.0]


@cache
def scene():
    """Stripes on a floor that goes away, a card before it, and a lamp far behind."""
    y, x = np.mgrid[0:96, 0:144]
    depth = (1.0 + 0.06 * (95 - y)).astype(np.float32)
    color = (0.1 + 0.5 * ((x // 6 + y // 6) % 2)[..., None] * np.array([0.9, 0.7, 0.4])).astype(np.float32)
    color[30:80, 20:50], depth[30:80, 20:50] = [0.1, 0.3, 0.6], 1.2
    color[12:14, 100:102], depth[12:14, 100:102] = 40.0, np.inf
    return color, depth


def compared() -> Figure:
    color, depth = scene()
    result = dofsim.render(color, depth, LENS)
    masks = metrics.regions(dofsim.coc(depth, LENS))
    return plot.compare(result, dofsim.render(color, depth, LENS, method="hexagonal"), masks=masks, border=4)


def stacked() -> Figure:
    return plot.focal_stack(dofsim.Scene(*scene()).focal_stack(LENS, DISTANCES), DISTANCES)


PLOTS: dict[str, Callable[[], Figure]] = {
    "coc": lambda: plot.coc(scene()[1], LENS),
    "depth_of_field": lambda: plot.depth_of_field(
        dofsim.Lens.from_camera(focal_length_mm=50, f_number=8, focus_distance=3.0)
    ),
    "aperture": lambda: plot.aperture(dofsim.Aperture(blades=5, rotation=15.0, spherical=0.6)),
    "compare": compared,
    "focal_stack": stacked,
}


def main() -> None:
    """Draw all plots as they are now."""
    BASELINE.mkdir(exist_ok=True)
    for name, draw in PLOTS.items():
        draw().savefig(BASELINE / f"{name}.png", dpi=60)


if __name__ == "__main__":
    main()
