"""The picture that the package carries, seen through a lens, beside what a ray tracer made of it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import dofsim

from . import _compare, _dofsim, _options, _panel, io

__all__ = ["Demo", "run_demo"]


@dataclass(frozen=True)
class Demo:
    """What a run of the demonstration came to.

    Attributes
    ----------
    panel : Path
        A PNG file: the pinhole picture, the result, the reference and their difference.
    result : Path
        An OpenEXR file: the result in linear light.
    seconds : float
        Time that the rendering took.
    distance : Distance
        From the result to the reference.
    size : tuple of int
        Width and height of the pictures.
    """

    panel: Path
    result: Path
    seconds: float
    distance: _compare.Distance
    size: tuple[int, int]


def run_demo(folder: Path, *, device: str = "auto") -> Demo:
    """Render the picture that the package carries and compare it with its reference.

    Parameters
    ----------
    folder : Path
        Where ``demo.png`` and ``demo.exr`` are written; made if it is not there.
    device : str, optional
        Where to compute.

    Returns
    -------
    Demo
        The files, the seconds and the distance from the reference.

    Raises
    ------
    ImportError
        If the packages that measure and draw are missing.
    DeviceError
        If the device is not there.
    OSError
        If the folder cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from dofsim.demo import run_demo
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     demo = run_demo(pathlib.Path(folder))
    >>> demo.panel.name, demo.result.name, demo.distance.psnr > 20
    ('demo.png', 'demo.exr', True)
    """
    with resources.as_file(resources.files("dofsim") / "data") as data:
        color, depth = io.read_rgbd(data / "demo.exr")
        reference = _compare.opaque(io.read_color(data / "demo_reference.exr"))
        words, _ = _options.read_settings(data / "demo_lens.toml", {}, {})
    lens = _options.make_lens(words)

    start = time.perf_counter()
    result = dofsim.render(color, depth, lens, device=device)
    seconds = time.perf_counter() - start

    distance = _compare.measure(result, reference)
    tiles = [
        _panel.Tile("Before: the pinhole picture", _compare.shown(color)),
        _panel.Tile(f"After: dofsim, {seconds:.2f} s", _compare.shown(result)),
        _panel.Tile("Reference: ray traced through a thin lens", _compare.shown(reference)),
        _compare.difference_tile(result, reference, f"Difference: {distance}"),
    ]
    folder.mkdir(parents=True, exist_ok=True)
    demo = Demo(folder / "demo.png", folder / "demo.exr", seconds, distance, (color.shape[1], color.shape[0]))
    io.write_image(demo.result, result)
    _dofsim.write_bytes(demo.panel, _panel.draw(tiles))
    return demo
