"""The pictures of the documentation, made by the build that is installed.

Run `make pictures` when what dofsim renders changes, and look at them. Without a folder they are written into
`docs/`, where the pages have them; `tests/test_pictures.py` compares them with the current build.
"""

import argparse
import runpy
import sys
import tempfile
from pathlib import Path

from dofsim.demo import run_demo
from PIL import Image

HERE = Path(__file__).parent
# Their widths in pixels.
WIDTHS = {"demo.png": 800, "gallery.jpg": 1000, "lenses.jpg": 1122, "passes.jpg": 1122}


def draw(folder: Path) -> None:
    """Write the pictures into a folder.

    Parameters
    ----------
    folder : Path
        The folder, which is there.
    """
    with tempfile.TemporaryDirectory() as made:
        large = {"demo.png": run_demo(Path(made), device="cpu").panel}
        for name in ("gallery", "lenses", "passes"):
            before, sys.argv = sys.argv, [f"{name}.py", str(Path(made, name))]
            try:
                runpy.run_path(str(HERE / f"{name}.py"), run_name="__main__")
            finally:
                sys.argv = before
            large[f"{name}.jpg"] = Path(made, name, f"{name}.png")
        for name, path in large.items():
            picture = Image.open(path).convert("RGB")
            height = round(picture.height * WIDTHS[name] / picture.width)
            small = picture.resize((WIDTHS[name], height), Image.Resampling.LANCZOS)
            small.save(folder / name, optimize=True, **({"quality": 88} if name.endswith(".jpg") else {}))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=HERE, help="where to write")
    draw(parser.parse_args().folder)
