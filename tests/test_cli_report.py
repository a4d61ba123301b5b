"""What the command says of what it did, and of what is suspicious."""

import re
import time

import dofsim
import numpy as np
import pytest
from command_lines import HEIGHT, LENS, LENS_OPTIONS, WIDTH, fails
from dofsim import _console, io
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
    with _console.to_stderr(), _console.patience("rendering 40 x 30", out=out, faster=_console.FASTER):
        # A quarter at once, and then nothing.
        out[:, :10] = 0.0
        time.sleep(0.5)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    said = r"rendering 40 x 30: \d+ s so far, 25% done, about \d+ s to go; faster, with less detail: "
    assert re.fullmatch(said + "--method gaussian, levels, hexagonal", lines[0])
    with _console.to_stderr(), _console.patience("rendering 40 x 30", out=out, faster=_console.FASTER):
        pass
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("scale", "said"),
    [
        (1000.0, "depth 1500 to 6000 m and the background, focus 2000 m"),
        (1e5, "depth 150000 to 600000 m and the background, focus 200000 m"),
        (1e-3, "depth 0.0015 to 0.006 m and the background, focus 0.2 cm"),
    ],
)
def test_depth_is_written_without_exponents(scene, capsys, scale, said):
    words = ["--depth-scale", str(scale), "--focus-distance", str(2 * scale)]
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, *words, "--max-coc-px", "3"]) == 0
    assert said in capsys.readouterr().err


def test_the_scale_of_relative_depth_is_said(scene, capsys):
    np.save("d.npy", np.linspace(4, 255, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH))
    words = ["--depth-kind", "relative", "--strength-px", "3", "--focus", "0.5"]
    arguments = ["render", "a.png", "d.npy", "-o", "o.png", *words]
    assert run(arguments) == 0
    assert "relative disparity 4 to 255 (taken as 0 to 1, outliers aside), focus" in capsys.readouterr().err
    assert run([*arguments, "--depth-range", "0,510"]) == 0
    assert "relative disparity 4 to 255 (0 to 510 taken as 0 to 1), focus" in capsys.readouterr().err


def test_a_focus_beyond_the_scale_of_relative_depth_is_suspicious(scene, capsys):
    np.save("d.npy", np.linspace(4, 255, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH))
    words = ["--depth-kind", "relative", "--strength-px", "3", "--max-coc-px", "3"]
    for focus, suspicious in (("-0.1", True), ("0", False), ("1", False), ("128", True)):
        assert run(["render", "a.png", "d.npy", "-o", "o.png", *words, "--focus", focus]) == 0
        assert ("relative disparity runs from 0 (far) to 1 (near)" in capsys.readouterr().err) == suspicious


def test_errors_of_an_argument_are_in_the_words_of_options(scene, capsys):
    np.save("d.npy", np.ones((HEIGHT, WIDTH), np.float32))
    strength = ["--strength-percent", "3", "--focus", "0"]
    message = fails(capsys, 2, "render", "a.png", "d.npy", "-o", "o.png", *strength)
    assert (
        "the lens is given by --strength-percent or --strength-px, which needs --depth-kind disparity or"
        in message
    )
    assert '"' not in message
    both = ["--f-number", "2", "--focal-length-mm", "50"]
    message = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, *both)
    assert "--aperture-radius --fov cannot be given with --focal-length-mm --f-number" in message
    words = ["--device", "cpu", "--profile"]
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, *words]) == 1
    assert "\ndofsim: --profile: " in capsys.readouterr().err


def test_a_file_without_depth_says_the_way_out(scene, capsys):
    io.write_image("plain.exr", np.ones((HEIGHT, WIDTH, 3), np.float32))
    message = fails(capsys, 2, "render", "plain.exr", "-o", "o.exr", *LENS_OPTIONS)
    assert "give the depth in a file of its own" in message
    assert "--depth-channel" in message
    message = fails(capsys, 2, "render", "a.png", "-o", "o.exr", *LENS_OPTIONS)
    assert "give the depth in a file of its own" in message


def test_negative_depth_is_named_before_the_focus(scene, capsys):
    _, depth = scene
    np.save("d.npy", -np.where(np.isinf(depth), 9.0, depth))
    words = ["--aperture-radius", "0.03", "--fov", "40", "--focus-at", "30,20"]
    message = fails(capsys, 2, "render", "a.png", "d.npy", "-o", "o.exr", *words)
    assert "values are negative" in message
    assert "--depth-scale -1" in message


def test_a_profile_tells_passes_and_what_goes_to_the_device_and_back(scene, gpu, capsys):
    color, _ = scene
    words = ["--device", gpu, "--set", "views=16", "--profile"]
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, *words]) == 0
    lines = capsys.readouterr().out.splitlines()
    table = dict(line.rsplit(maxsplit=2)[:2] for line in lines if line.endswith((" ms", " MiB")))
    assert float(table["lens/cells"]) <= float(table["all passes"])
    height, width = color.shape[:2]
    assert 16 * height * width <= float(table["to the device"]) * 2**20 <= 16 * height * width + 2**20
    assert float(table["back"]) > 0.0
    assert lines[-1].split() == ["readbacks", "1"]
