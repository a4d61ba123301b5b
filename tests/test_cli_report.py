"""What the command says of what it did, and of what is suspicious."""

import re
import time

import dofsim
import numpy as np
import pytest
from command_lines import HEIGHT, LENS, LENS_OPTIONS, WIDTH
from dofsim import _console
from dofsim.cli import run


@pytest.mark.parametrize(
    ("kind", "values", "said"),
    [
        ("z", [0.0, -1.0, np.nan, 2.0, 3.0], "depth 2 to 3 m and the background, focus 2 m"),
        ("inverse_z", [0.0, 0.25, 0.5, 0.5, 0.5], "inverse depth 0.25 to 0.5 1/m and the background"),
        ("zbuffer", [0.0, 0.25, 0.5, 0.5, 1.0], "z-buffer values 0 to 1, focus"),
    ],
)
def test_the_range_is_that_of_surfaces(scene, capsys, kind, values, said):
    np.save("d.npy", np.resize(np.array(values, np.float32), (HEIGHT, WIDTH)))
    words = ["--depth-kind", kind, "--invalid", "far", "--focus-distance", "2"]
    words += ["--near", "1", "--far", "9"] if kind == "zbuffer" else []
    assert run(["render", "a.png", "d.npy", "-o", "o.png", *LENS_OPTIONS, *words]) == 0
    assert said in capsys.readouterr().err


def test_quiet_and_verbose(scene, capsys):
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "-v"]) == 0
    said = capsys.readouterr().err
    assert repr(dofsim.Lens(**LENS)) in said
    assert "method lens, device auto" in said


@pytest.mark.parametrize(
    ("depth", "lens", "said"),
    [
        (6.0, {"aperture_radius": 1e-5}, "the blur is too small to see: its radius is at most 0.000"),
        (6.0, {"aperture_radius": 0.5}, "the blur is very wide: its radius reaches 7 px, 11% of the width"),
        (6.0, {}, "the depth is 6 m everywhere"),
        (
            "whole",
            {},
            "whole numbers only, 40 to 239, and is taken for metres. Is it millimetres (--depth-scale",
        ),
    ],
)
def test_what_is_suspicious_is_said(scene, capsys, depth, lens, said):
    values = np.full((HEIGHT, WIDTH), 6.0) if depth == 6.0 else np.arange(HEIGHT * WIDTH) % 200 + 40
    np.save("d.npy", values.reshape(HEIGHT, WIDTH).astype(np.float32))
    words = [
        word for name, value in (LENS | lens).items() for word in (f"--{name.replace('_', '-')}", str(value))
    ]
    assert run(["render", "a.png", "d.npy", "-o", "o.png", *words]) == 0
    warned = [line for line in capsys.readouterr().err.splitlines() if line.startswith("dofsim: ")]
    assert any(said in line for line in warned), warned


def test_the_library_tells_its_logger(caplog):
    color, depth = np.ones((24, 32, 3), np.float32), np.linspace(1, 9, 24 * 32).reshape(24, 32)
    lens = dofsim.Lens(**LENS | {"aperture_radius": 0.1})
    dofsim.render(color, depth, lens)
    assert caplog.records == []
    with caplog.at_level("INFO", logger="dofsim"):
        dofsim.render(color, depth, lens, overscan=2, depth_kind="distance")
    (record,) = caplog.records
    assert record.name == "dofsim.render"
    assert "distance along the ray 1." in record.getMessage()
    assert "focus 3 m, blur radius 0 to" in record.getMessage()


def test_the_library_tells_of_the_depth_that_it_used(caplog):
    color = np.ones((24, 32, 3), np.float32)
    coarse = np.linspace(0.1, 0.9, 12 * 16, dtype=np.float32).reshape(12, 16)
    lens = dofsim.Lens.from_disparity(strength_px=8.0, focus=0.0)
    words = {"depth_kind": "relative", "depth_range": (0.0, 2.0), "refine": True}
    with caplog.at_level("INFO", logger="dofsim"):
        dofsim.render(color, coarse, lens, **words)
    sharp = dofsim.refine_depth(color, coarse, depth_kind="relative")
    largest = np.abs(dofsim.coc(sharp, lens, depth_kind="relative", depth_range=(0.0, 2.0))).max()
    assert f"to {largest:.1f} px" in caplog.records[0].getMessage()
    assert largest < 4.0


def test_a_long_render_says_how_far_it_is(monkeypatch, capsys):
    monkeypatch.setattr(_console, "_FIRST_WORD_S", 0.2)
    monkeypatch.setattr(_console, "_LOOK_S", 0.01)
    out = np.full((30, 40, 3), np.nan, np.float32)
    with _console.to_stderr(), _console.patience(out, "lens"):
        # A quarter at once, and then nothing.
        out[:, :10] = 0.0
        time.sleep(0.5)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    said = r"rendering 40 x 30: \d+ s so far, 25% done, about \d+ s to go; faster, with less detail: "
    assert re.fullmatch(said + "--method gaussian, levels, hexagonal", lines[0])
    with _console.to_stderr(), _console.patience(out, "lens"):
        pass
    assert capsys.readouterr().err == ""
