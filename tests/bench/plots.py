"""Draw what `suite.py` measured: time against pixels, against the width of the blur, and against threads.

Run this file with the JSON of the part `methods`, with matplotlib installed. The grey line is the least that
any method could take: the time in which memory reads colour and depth once, and takes the picture.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from suite import MOVED, RADII_PX, SIZES, THREADS

PIXELS = {name: rows * columns for name, (rows, columns) in SIZES.items()}
FULL_HD = "1920 x 1080"


def draw(axes: Axes, rows: list[dict[str, Any]], along: list[tuple[float, dict[str, Any]]]) -> None:
    """Draw a line for each method through the rows that agree with each point."""
    for method in dict.fromkeys(row["method"] for row in rows):
        points = [
            (x, row["ms"])
            for x, wanted in along
            for row in rows
            if row["method"] == method and all(row[key] == value for key, value in wanted.items())
        ]
        axes.loglog(*zip(*points, strict=True), "o-", label=method, linewidth=2.5 if method == "lens" else 1)
    axes.set_xticks([x for x, _ in along])
    axes.minorticks_off()


def main() -> None:
    """Draw the figure."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("json", type=Path, nargs="?", default=Path("build/bench.json"))
    parser.add_argument("--plot", type=Path, default=Path("docs/speed.png"), help="PNG to draw")
    arguments = parser.parse_args()
    found = json.loads(arguments.json.read_text())
    rows, rates = found["methods"], found["machine"]["bandwidth_gb_per_s"]
    mpl.use("agg")
    figure = Figure(figsize=(11.0, 4.2), dpi=100, layout="constrained")
    pixels, radius, threads = figure.subplots(1, 3, sharey=True)
    most = THREADS[-1]

    def floor_ms(name: str, threads: int) -> float:
        return 1e3 * PIXELS[name] * MOVED / (1e9 * rates[str(threads)])

    draw(pixels, rows, [(n, {"size": s, "radius_px": 16, "threads": most}) for s, n in PIXELS.items()])
    pixels.plot(PIXELS.values(), [floor_ms(s, most) for s in PIXELS], "--", color="grey", label="memory")
    pixels.set_xticklabels([name.replace(" ", "") for name in SIZES])
    pixels.set_xlabel(f"pixels, radius 16 px, {most} threads")
    pixels.set_ylabel("milliseconds")
    draw(radius, rows, [(r, {"size": FULL_HD, "radius_px": r, "threads": most}) for r in RADII_PX])
    radius.plot(RADII_PX, [floor_ms(FULL_HD, most)] * len(RADII_PX), "--", color="grey")
    radius.set_xticklabels([str(r) for r in RADII_PX])
    radius.set_xlabel(f"largest radius of the blur in pixels, {FULL_HD}")
    draw(threads, rows, [(t, {"size": FULL_HD, "radius_px": 16, "threads": t}) for t in THREADS])
    threads.plot(THREADS, [floor_ms(FULL_HD, t) for t in THREADS], "--", color="grey")
    threads.set_xticklabels([str(t) for t in THREADS])
    threads.set_xlabel(f"threads, {FULL_HD}, radius 16 px")
    figure.legend(*pixels.get_legend_handles_labels(), loc="outside right center")
    figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
