"""How fast every method is at full HD, as a ratio to a plain Gaussian blur of the same picture.

Run `make bench`, or this file with OpenCV installed. The peer is `cv2.GaussianBlur` with 25 x 25 pixels, in
the same run: a plain separable blur, all pixels alike. Depth is either a few planes, where circles of
confusion are the same over long stretches, or a slope, where every pixel has its own. "render" reads the
arrays each time, "scene" has read them before. Methods are used as they are by default, which is with the
parameters of their documents.
"""

import argparse
from functools import partial

import cv2
import dofsim
import numpy as np
from dofsim._dofsim import methods_available
from peers import DEPTHS_M, HEIGHT, WIDTH, best_of, lens_of, planes

# The largest radius of the circle of confusion.
LARGEST_COC_PX = 16.0


def main() -> None:
    """Print a row for every method."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--runs", type=int, default=7, help="the best of so many is taken")
    parser.add_argument("--threads", type=int, default=2, help="threads of both")
    parser.add_argument("--method", action="append", choices=methods_available(), help="may be repeated")
    arguments = parser.parse_args()
    runs, threads = arguments.runs, arguments.threads
    cv2.setNumThreads(threads)
    color, steps = planes()
    nearest, farthest = 1.0 / DEPTHS_M[0], 1.0 / DEPTHS_M[-1]
    slope = np.tile(1.0 / np.linspace(nearest, farthest, WIDTH, dtype=np.float32), (HEIGHT, 1))
    lens = lens_of(LARGEST_COC_PX)
    peer = best_of(runs, lambda: cv2.GaussianBlur(color, (25, 25), 0))
    print(
        f"{WIDTH} x {HEIGHT} RGB float32, {threads} threads, best of {runs}, CoC up to {LARGEST_COC_PX:g} px"
    )
    print(f"cv2.GaussianBlur 25 x 25: {1e3 * peer:.1f} ms\n")
    columns = [f"{depth}, {kind}" for depth in ("planes", "slope") for kind in ("render", "scene")]
    print(f"{'':12}" + "".join(f"{column:>22}" for column in columns))
    for method in arguments.method or methods_available():
        cells = []
        for depth in (steps, slope):
            options = {"method": method, "threads": threads}
            render = partial(dofsim.render, color, depth, lens, **options)
            for work in (render, partial(dofsim.Scene(color, depth).render, lens, **options)):
                seconds = best_of(runs, work)
                cells.append(f"{1e3 * seconds:12.1f} ms {seconds / peer:5.2f}x")
        print(f"{method:12}" + "".join(f"{cell:>22}" for cell in cells))


if __name__ == "__main__":
    main()
