"""A small scene for the command line, and commands that must fail."""

import numpy as np
from dofsim import io
from dofsim.cli import run

LENS = {"aperture_radius": 0.03, "focus_distance": 3.0, "fov": 40.0}
LENS_OPTIONS = ["--aperture-radius", "0.03", "--focus-distance", "3", "--fov", "40"]
HEIGHT, WIDTH = 48, 64


def write_scene():
    """Write a small scene in several formats into the folder; give its colour and depth."""
    color = np.random.default_rng(4).random((HEIGHT, WIDTH, 3)).astype(np.float32)
    depth = np.full((HEIGHT, WIDTH), 6.0, np.float32)
    depth[10:30, 20:40] = 1.5
    depth[:4] = np.inf
    io.write_image("a.exr", color, depth=depth)
    io.write_image("a.png", color)
    io.write_depth("z.pfm", depth)
    return color, depth


def fails(capsys, status, *arguments):
    """Run a command that must fail with one line on the standard error stream; give the line."""
    assert run([str(argument) for argument in arguments]) == status
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("dofsim: ")
    assert "Traceback" not in err
    return err
