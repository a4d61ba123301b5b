"""A data set for `dofsim batch`, of which three frames are bad."""

from pathlib import Path

import numpy as np
from dofsim import io
from dofsim.cli import run

LENS = {"aperture_radius": 0.3, "focus_distance": 3.0, "fov": 40.0}
LENS_OPTIONS = ["--aperture-radius", "0.3", "--focus-distance", "3", "--fov", "40"]
HEIGHT, WIDTH = 40, 56
COUNT = 50
TRUNCATED, MISMATCHED, NAN = 7, 20, 33


def write_data():
    """Write a data set into the folder, of which three frames are bad."""
    rng = np.random.default_rng(8)
    for folder in ("rgb", "depth"):
        Path(folder).mkdir()
    for index in range(COUNT):
        color = rng.random((HEIGHT, WIDTH, 3), dtype=np.float32)
        depth = rng.uniform(2, 9, (HEIGHT - (index == MISMATCHED), WIDTH))
        io.write_image(f"rgb/{index:04}.exr", color)
        io.write_depth(f"depth/{index:04}_depth.pfm", np.nan * depth if index == NAN else depth)
    truncated = Path(f"rgb/{TRUNCATED:04}.exr")
    truncated.write_bytes(truncated.read_bytes()[:1500])


def keep_few():
    """Leave four good frames of the data set."""
    for path in [*Path().glob("rgb/*"), *Path().glob("depth/*")]:
        if not path.name.startswith(("0000", "0001", "0002", "0003")):
            path.unlink()


def batch(*arguments):
    return run(["batch", *(str(argument) for argument in arguments)])


def contents(folder):
    runs = ("failures.jsonl", "summary.json")
    return {p.name: p.read_bytes() for p in Path(folder).iterdir() if p.name not in runs}
