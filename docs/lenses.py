"""The picture that comes with dofsim, through fifteen lenses.

Run `make lenses`, or this file with the folder to write into: a PNG for every lens, and `lenses.png` with
all of them.
"""

import argparse
from importlib import resources
from pathlib import Path

import dofsim
import numpy as np
from dofsim import _dofsim, _options, _panel, io
from dofsim._compare import shown
from numpy.typing import NDArray


def heart(texels: int = 128) -> NDArray[np.float64]:
    """Draw a heart, as transmission."""
    x, y = np.meshgrid(*[np.linspace(-1.2, 1.2, texels)] * 2)
    y = 0.15 - y
    return ((x**2 + y**2 - 0.8) ** 3 < 1.2 * x**2 * y**3).astype(float)


def lenses(lens: dofsim.Lens) -> dict[str, tuple[dofsim.Lens, dofsim.Aperture]]:
    """Fifteen lenses out of one, by what they are called on the plate."""
    disc = dofsim.Aperture()
    return {
        "A thin lens": (lens, disc),
        "blades=6": (lens, dofsim.Aperture(blades=6, rotation=15.0)),
        "blades=5, roundness=0.5": (lens, dofsim.Aperture(blades=5, rotation=90.0, roundness=0.5)),
        "ratio=2 (anamorphic)": (lens, dofsim.Aperture(ratio=2.0)),
        "obstruction=0.5 (mirror lens)": (lens, dofsim.Aperture(obstruction=0.5)),
        "image=heart": (lens, dofsim.Aperture(image=heart())),
        "apodization=0.4": (lens, dofsim.Aperture(apodization=0.4)),
        "spherical=0.9": (lens, dofsim.Aperture(spherical=0.9)),
        'cat_eye=1, vignetting="full"': (lens.replace(cat_eye=1.0, vignetting="full"), disc),
        "axial_color=(-0.12, 0, 0.12)": (lens.replace(axial_color=(-0.12, 0.0, 0.12)), disc),
        "lateral_color=(-0.006, 0, 0.006)": (lens.replace(lateral_color=(-0.006, 0.0, 0.006)), disc),
        "tilt=(50, 0)": (lens.replace(tilt=(50.0, 0.0)), disc),
        "coma=0.08": (lens.replace(coma=0.08), disc),
        "astigmatism=0.06": (lens.replace(astigmatism=0.06), disc),
        "barn_doors=(1, 0.35, 0.5)": (lens.replace(barn_doors=(1.0, 0.35, 0.5)), disc),
    }


def main() -> None:
    """Draw the plate."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("folder", type=Path, help="where to write; made if it is not there")
    folder = parser.parse_args().folder
    with resources.as_file(resources.files("dofsim") / "data") as data:
        color, depth = io.read_rgbd(data / "demo.exr")
        words, _ = _options.read_settings(data / "demo_lens.toml", {}, {})
    scene = dofsim.Scene(color, depth)
    folder.mkdir(parents=True, exist_ok=True)
    tiles = []
    for i, (title, (lens, aperture)) in enumerate(lenses(_options.make_lens(words)).items()):
        picture = scene.render(lens, aperture=aperture)
        io.write_image(folder / f"{i + 1:02}.png", picture)
        tiles.append(_panel.Tile(title, shown(picture)))
    _dofsim.write_bytes(folder / "lenses.png", _panel.draw(tiles, columns=3))
    print(folder / "lenses.png")


if __name__ == "__main__":
    main()
