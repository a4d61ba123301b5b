"""What other views are worth, as a plate: one layer, with eight views, the truth.

Run this file with the folder to write into. The scenes are rendered with Mitsuba the first time.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from dofsim import _dofsim, _panel, metrics
from dofsim._compare import shown

TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "bench")]

# A scene and the corner of what is shown of it, column and row, of the pictures of 256 x 192.
SHOWN = {"fence": (20, 40), "spheres": (0, 70)}
SIDE, ENLARGED = (96, 72), 4


def main() -> None:
    """Draw the plate."""
    from scenes.around import load_around

    from views import pictures

    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("folder", type=Path, help="where to write; made if it is not there")
    folder = parser.parse_args().folder
    tiles = []
    for scene, (x, y) in SHOWN.items():
        bundle = load_around(scene, 256, 192)
        found = pictures(bundle)
        columns = {"one layer": found["one layer"], "eight more views": found["8 on the rim"]}
        for name, picture in [*columns.items(), ("the lens itself, by ray tracing", bundle["reference"])]:
            part = np.clip(picture[y : y + SIDE[1], x : x + SIDE[0]], 0.0, None)
            title = name
            if name in columns:
                title = f"{name}: {metrics.psnr(picture, bundle['reference'], border=15):.1f} dB"
            tiles.append(_panel.Tile(title, shown(part.repeat(ENLARGED, 0).repeat(ENLARGED, 1))))
    folder.mkdir(parents=True, exist_ok=True)
    _dofsim.write_bytes(folder / "views.png", _panel.draw(tiles, columns=3))
    print(folder / "views.png")


if __name__ == "__main__":
    main()
