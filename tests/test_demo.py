"""The demonstration that comes with the package."""

import doctest
import importlib

import numpy as np
import pytest
from dofsim import io
from dofsim.cli import run
from dofsim.demo import run_demo


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    return run_demo(tmp_path_factory.mktemp("demo") / "made" / "here")


def test_demo_comes_close_to_the_ray_tracer(demo):
    assert demo.distance.psnr > 30
    assert demo.distance.ssim > 0.9
    assert demo.distance.flip < 0.1
    assert demo.seconds > 0


def test_demo_writes_the_result_and_a_panel_of_four(demo):
    width, height = demo.size
    result = io.read_color(demo.result)
    assert result.pixels.shape == (height, width, 3)
    panel = io.read_color(demo.panel).pixels[..., :3]
    assert panel.shape[0] > 2 * height
    assert panel.shape[1] > 2 * width
    # The panel shows the result pixel for pixel, beside the pinhole picture and above the difference.
    left, top = 14 + width + 14, 30
    shown = panel[top : top + height, left : left + width]
    io.write_image(demo.result.with_suffix(".codes.png"), result.pixels)
    codes = io.read_color(demo.result.with_suffix(".codes.png")).pixels
    assert np.abs(shown.astype(int) - codes).max() <= 1
    assert sorted(path.suffix for path in demo.panel.parent.iterdir()) == [".exr", ".png", ".png"]


def test_demo_command_prints_what_it_did(tmp_path, capsys):
    assert run(["demo", "-o", str(tmp_path / "out"), "--device", "cpu"]) == 0
    out = capsys.readouterr().out
    for words in ("rendered in", " s\n", "PSNR", "SSIM", "FLIP", "demo.png", "demo.exr"):
        assert words in out
    assert run(["demo", "-o", str(tmp_path), "--device", "abacus"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("module", ["dofsim.demo", "dofsim.falsecolor", "dofsim.cli"])
def test_examples_of_the_docstrings(module):
    result = doctest.testmod(importlib.import_module(module))
    assert result.attempted > 0
    assert result.failed == 0
