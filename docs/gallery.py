"""The picture that comes with dofsim, through one lens, by every method.

Run `make gallery`, or this file with the folder to write into: a PNG for every method, and `gallery.png` with
all of them beside the pinhole picture and the ray traced reference. Methods are used as they are by default.
"""

import argparse
from importlib import resources
from pathlib import Path

import dofsim
from dofsim import _dofsim, _options, _panel, io, metrics
from dofsim._compare import shown


def main() -> None:
    """Draw the gallery."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("folder", type=Path, help="where to write; made if it is not there")
    folder = parser.parse_args().folder
    with resources.as_file(resources.files("dofsim") / "data") as data:
        color, depth = io.read_rgbd(data / "demo.exr")
        reference = io.read_color(data / "demo_reference.exr").pixels[..., :3]
        words, _ = _options.read_settings(data / "demo_lens.toml", {}, {})
    lens = _options.make_lens(words)
    scene = dofsim.Scene(color, depth)
    pictures = {method: scene.render(lens, method=method) for method in _dofsim.methods_available()}

    folder.mkdir(parents=True, exist_ok=True)
    tiles = [
        _panel.Tile("The pinhole picture", shown(color)),
        _panel.Tile("Ray traced through a thin lens", shown(reference)),
    ]
    for method, picture in pictures.items():
        io.write_image(folder / f"{method}.png", picture)
        title = f'method="{method}": {metrics.psnr(picture, reference):.1f} dB'
        tiles.append(_panel.Tile(title, shown(picture)))
    _dofsim.write_bytes(folder / "gallery.png", _panel.draw(tiles, columns=3))
    print(folder / "gallery.png")


if __name__ == "__main__":
    main()
