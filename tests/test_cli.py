"""The `dofsim` command: what it writes, what it prints, what it refuses and how."""

import dataclasses
import json
import os
import re
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import dofsim
import numpy as np
import pytest
import typer
from dofsim import _command_options, _console, cli, io
from dofsim.cli import run

LENS = {"aperture_radius": 0.03, "focus_distance": 3.0, "fov": 40.0}
LENS_OPTIONS = ["--aperture-radius", "0.03", "--focus-distance", "3", "--fov", "40"]
HEIGHT, WIDTH = 48, 64


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """Go to a folder with a small scene in several formats; give its colour and depth."""
    monkeypatch.chdir(tmp_path)
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


# The command itself


def test_version_is_printed_without_numpy():
    script = "import sys; from dofsim.cli import run; run(['--version']); print('numpy' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["dofsim", dofsim.__version__, "False"]


def test_the_script_ends_with_the_status(tmp_path):
    command = [sys.executable, "-c", "from dofsim.cli import main; main()", "render", "no.exr", "-o", "o.exr"]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr == "dofsim: no.exr: No such file or directory\n"


def test_help_lists_the_commands(capsys):
    assert run(["--help"]) == 0
    help_text = capsys.readouterr().out
    assert all(command in help_text for command in ("render", "batch", "coc", "compare", "demo"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rendre"], "No such command"),
        (["render", "a.exr"], "Missing option"),
        (["render", "a.exr", "-o", "o.exr", "--fov", "wide"], "--fov"),
        (["render", "a.exr", "-o", "o.exr", "--sideways"], "--sideways"),
    ],
)
def test_usage_errors(scene, capsys, arguments, message):
    assert message in fails(capsys, 2, *arguments)


# render


def test_render_writes_what_the_function_gives(scene, capsys):
    color, depth = scene
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    seen = "depth 1.5 to 6 m and the background, focus 3 m"
    said = f"o.exr: {WIDTH} x {HEIGHT}, {seen}, blur radius 0.4 to 0.9 px, "
    assert err.startswith(said)
    assert err.count("\n") == 1
    expected = dofsim.render(color, depth, dofsim.Lens(**LENS))
    np.testing.assert_array_equal(io.read_color("o.exr").pixels, expected)
    assert np.abs(expected - color).max() > 0.1


def test_depth_along_the_other_direction_is_negated(scene):
    color, depth = scene
    io.write_image("negative.exr", color, depth=-depth)
    for name, extra in (("a.exr", []), ("negative.exr", ["--depth-scale", "-1"])):
        assert run(["render", name, "-o", f"o-{name}", *LENS_OPTIONS, *extra]) == 0
    np.testing.assert_array_equal(io.read_color("o-a.exr").pixels, io.read_color("o-negative.exr").pixels)


def test_z_buffers_of_any_direction(scene):
    color, depth = scene
    near, far = 0.5, 50.0
    t = (1 / near - 1 / depth) / (1 / near - 1 / far)
    t[~np.isfinite(depth)] = 1.0
    cases = [
        ("zbuffer", t, near, far),
        ("zbuffer", 1 - t, far, near),
        ("opengl_ndc", 2 * t - 1, near, far),
        ("zbuffer", near / depth, "inf", near),
    ]
    results = []
    for kind, values, first, last in cases:
        io.write_image("z.exr", color, depth=values)
        words = ["--depth-kind", kind, "--near", str(first), "--far", str(last)]
        assert run(["render", "z.exr", "-o", "o.exr", *LENS_OPTIONS, *words]) == 0
        results.append(io.read_color("o.exr").pixels)
    for result in results[1:3]:
        np.testing.assert_allclose(result, results[0], atol=2e-3)
    # Here the background is infinitely far, and there at the far plane.
    np.testing.assert_allclose(results[3][8:], results[0][8:], atol=0.1)


def test_render_of_integers_in_two_files(scene):
    _, depth = scene
    assert run(["render", "a.png", "z.pfm", "-o", "o.png", *LENS_OPTIONS]) == 0
    codes = io.read_color("a.png").pixels
    expected = dofsim.render(codes, depth, dofsim.Lens(**LENS), transfer="srgb")
    result = io.read_color("o.png").pixels
    assert result.dtype == np.uint8
    # The function rounds straight to integers, the command on its way through float32 files.
    assert np.abs(result.astype(int) - expected.astype(int)).max() <= 1
    assert run(["render", "a.png", "z.pfm", "-o", "linear.png", *LENS_OPTIONS, "--transfer", "linear"]) == 0
    assert np.abs(io.read_color("linear.png").pixels.astype(int) - result).max() > 5


def test_render_keeps_sixteen_bits(scene):
    color, _ = scene
    io.write_image("deep.png", color, dtype="uint16")
    assert run(["render", "deep.png", "z.pfm", "-o", "o.png", *LENS_OPTIONS]) == 0
    assert io.read_color("o.png").pixels.dtype == np.uint16
    assert run(["render", "deep.png", "z.pfm", "-o", "o8.png", *LENS_OPTIONS, "--dtype", "uint8"]) == 0
    assert io.read_color("o8.png").pixels.dtype == np.uint8


def test_render_passes_every_option_on(scene, monkeypatch):
    color, depth = scene
    calls = []

    def render(*arguments, **options):
        calls.append((arguments, options))
        return color

    monkeypatch.setattr(dofsim, "render", render)
    # The planes of a z-buffer, which a distance does not go with.
    monkeypatch.setattr("dofsim._report.coc", lambda depth, *_, **__: 0.0 * depth)
    extra = {
        "--method": "lens", "--device": "cpu", "--blades": "6", "--rotation": "15", "--near": "0.5",
        "--far": "20", "--depth-kind": "distance", "--invalid": "far", "--overscan": "2",
        "--supersample": "4", "--threads": "3", "--depth-scale": "2", "--set": "views=128",
        "--max-coc-px": "90", "--invalid-color": "fill",
    }  # fmt: skip
    flags = [word for pair in extra.items() for word in pair]
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--fov-axis", "y", *flags]) == 0
    ((arguments, options),) = calls
    assert options.pop("out").shape == (HEIGHT // 4 - 4, WIDTH // 4 - 4, 3)
    np.testing.assert_array_equal(arguments[0], color)
    np.testing.assert_array_equal(arguments[1], 2 * depth)
    assert arguments[2] == dofsim.Lens(**LENS, fov_axis="y")
    assert options == {
        "method": "lens", "device": "cpu", "aperture": dofsim.Aperture(blades=6, rotation=15.0),
        "depth_kind": "distance", "near": 0.5, "far": 20.0, "invalid": "far", "alpha": "none",
        "transfer": "linear", "overscan": 2, "supersample": 4, "threads": 3, "views": 128,
        "max_coc_px": 90.0, "invalid_color": "fill",
    }  # fmt: skip


def test_coc_takes_a_range_in_focus_and_a_bound(scene, capsys):
    _, depth = scene
    words = [
        f"--{name.replace('_', '-')}={value}" for name, value in LENS.items() if name != "focus_distance"
    ]
    arguments = ["z.pfm", "-o", "coc.exr", *words, "--in-focus", "2,inf", "--max-coc-px", "0.4"]
    assert run(["coc", *arguments]) == 0
    lens = dofsim.Lens(**LENS).replace(in_focus=(2.0, np.inf))
    np.testing.assert_array_equal(io.read_exr("coc.exr")["coc"], dofsim.coc(depth, lens, max_coc_px=0.4))
    assert "focus 2 m to infinity" in capsys.readouterr().err


def test_options_of_a_method_are_toml_or_words(scene):
    color, depth = scene
    flags = ["--method", "taps", "--set", "variant=four", "--set", "hyperfocal_factor=0.5"]
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, *flags]) == 0
    expected = dofsim.render(
        color, depth, dofsim.Lens(**LENS), method="taps", variant="four", hyperfocal_factor=0.5
    )
    np.testing.assert_array_equal(io.read_color("o.exr").pixels, expected)


def test_an_input_under_another_name_is_not_overwritten(scene, tmp_path, capsys):
    (tmp_path / "link.exr").symlink_to(tmp_path / "a.exr")
    assert "link.exr: is one of the inputs" in fails(
        capsys, 2, "render", "a.exr", "-o", "link.exr", *LENS_OPTIONS
    )


def test_render_of_alpha(scene, monkeypatch):
    color, depth = scene
    cover = np.full((HEIGHT, WIDTH, 1), 0.5, np.float32)
    cover[10:30, 20:40] = 0.25
    io.write_image("alpha.exr", np.concatenate([color * cover, cover], axis=-1), depth=depth)
    assert run(["render", "alpha.exr", "-o", "o.exr", *LENS_OPTIONS]) == 0
    result = io.read_color("o.exr")
    assert result.alpha == "premultiplied"
    expected = dofsim.render(
        io.read_color("alpha.exr").pixels, depth, dofsim.Lens(**LENS), alpha="premultiplied"
    )
    np.testing.assert_array_equal(result.pixels, expected)
    stated = []
    real = dofsim.render
    monkeypatch.setattr(dofsim, "render", lambda *a, **o: (stated.append(o["alpha"]), real(*a, **o))[1])
    assert run(["render", "alpha.exr", "-o", "s.exr", *LENS_OPTIONS, "--alpha", "straight"]) == 0
    assert stated == ["premultiplied"]
    straight = io.read_color("s.exr").pixels
    np.testing.assert_allclose(straight[34:, :, :3], result.pixels[34:, :, :3] / 2, atol=1e-3)


def test_depth_channel_and_layer(scene):
    color, depth = scene
    layers = {f"sharp.{name}": color[..., index] for index, name in enumerate("RGB")}
    layers |= {f"dull.{name}": np.zeros_like(depth) for name in "RGB"}
    io.write_exr("layers.exr", {**layers, "left.Z": depth, "right.Z": depth * 2})
    arguments = ["render", "layers.exr", *LENS_OPTIONS, "--layer", "sharp", "--depth-channel", "left.Z"]
    assert run([*arguments, "-o", "o.exr"]) == 0
    expected = dofsim.render(color, depth, dofsim.Lens(**LENS))
    np.testing.assert_array_equal(io.read_color("o.exr").pixels, expected)


def test_ambiguous_files_list_their_channels(scene, capsys):
    io.write_exr("two.exr", {"Y": np.ones((2, 2)), "left.Z": np.ones((2, 2)), "right.Z": np.ones((2, 2))})
    message = fails(capsys, 2, "render", "two.exr", "-o", "o.exr", *LENS_OPTIONS)
    assert "two.exr: several channels may be the depth: left.Z, right.Z" in message


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["a.exr", "-o", "a.exr"], 2, "a.exr: is one of the inputs"),
        (["a.png", "z.pfm", "-o", "./z.pfm"], 2, "is one of the inputs"),
        (["a.exr", "-o", "o.jpg"], 2, "suffix '.jpg' is not one of .exr"),
        (["a.exr", "-o", "no/o.exr"], 2, "no: there is no such folder"),
        (["a.png", "-o", "o.exr"], 2, "holds no depth"),
        (["a.exr", "no.pfm", "-o", "o.exr"], 2, "no.pfm: No such file"),
        (["a.exr", "-o", "o.exr", "--transfer", "rec709"], 2, "--transfer takes linear, srgb"),
        (["a.exr", "-o", "o.exr", "--dtype", "double"], 2, "--dtype takes half, float"),
        (["a.exr", "-o", "o.exr", "--depth-kind", "meters"], 2, "--depth-kind must be one of"),
        (["a.exr", "-o", "o.exr", "--blades", "2"], 2, "--blades must be 0"),
        (["a.exr", "-o", "o.exr", "--threads", "-1"], 2, "--threads must be a whole number"),
        (["a.exr", "-o", "o.exr", "--overscan", str(2**63)], 2, "--overscan must be a whole number"),
        (["a.exr", "-o", "o.exr", "--supersample", str(10**400)], 2, "--supersample must be a whole"),
        (["a.exr", "-o", "o.exr", "--depth-scale", "0"], 2, "--depth-scale must be finite and not 0"),
        (["a.exr", "-o", "o.exr", "--depth-scale", "-1"], 2, "negate them (--depth-scale -1)"),
        (["a.exr", "-o", "o.exr", "--lens", "deep.toml"], 2, "deep.toml: not a TOML file: it is nested too"),
        (
            ["a.exr", "-o", "o.exr", "--lens", "odd.toml"],
            2,
            'odd.toml: [aperture] has no "wings"; it has blades',
        ),
        (["a.exr", "-o", "o.exr", "--set", f"views={'[' * 9999}"], 2, "views must be a whole number"),
        (["a.exr", "-o", "iris.png", "--lens", "iris.toml"], 2, "iris.png: is one of the inputs"),
        (["a.exr", "-o", "o.exr", "--supersample", "7"], 2, "supersample"),
        (["a.exr", "-o", "o.exr", "--method", "fast"], 2, 'method must be one of "lens"'),
        (["a.exr", "-o", "o.exr", "--set", "variant=six"], 2, "variant is not an option of --method lens"),
        (["a.exr", "-o", "o.exr", "--method", "taps", "--set", "variant=ten"], 2, "variant must be one of"),
        (["a.exr", "-o", "o.exr", "--set", "views"], 2, "--set takes NAME=VALUE; got 'views'"),
        (["a.exr", "-o", "o.exr", "--set", "views=64", "--set", "views=32"], 2, "views is given twice"),
        (
            ["a.exr", "-o", "o.exr", "--set", "overscan=1"],
            2,
            "--set overscan: it is an option of its own, --overscan",
        ),
        (["a.exr", "-o", "o.exr", "--focus-at", "3"], 2, "--focus-at takes a column and a row"),
        (["a.exr", "-o", "o.exr", "--focus-at", "64,0"], 2, "--focus-at: x must lie within 64"),
    ],
)
def test_what_render_refuses(scene, tmp_path, capsys, arguments, status, message):
    (tmp_path / "deep.toml").write_text("a = " + "[" * 100_000)
    (tmp_path / "odd.toml").write_text("[aperture]\nwings = 3\n")
    (tmp_path / "iris.toml").write_text('[aperture]\nimage = "iris.png"\n')
    io.write_image("iris.png", np.ones((5, 5)))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert message in fails(capsys, status, "render", *arguments, *LENS_OPTIONS)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_machine_at_fault_is_status_one(scene, capsys, monkeypatch):
    def render(*_, **__):
        raise dofsim.DeviceError("there is no GPU")

    monkeypatch.setattr(dofsim, "render", render)
    message = fails(capsys, 1, "render", "a.exr", "-o", "o.exr", "--device", "gpu", *LENS_OPTIONS)
    assert "there is no GPU" in message
    monkeypatch.setattr(dofsim, "render", lambda *_, **__: 1 / 0)
    assert "internal error: ZeroDivisionError" in fails(
        capsys, 1, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS
    )


# The lens


def lens_of(monkeypatch, *arguments):
    """Give the lens and the aperture that a command comes to."""
    calls = []

    def render(color, depth, lens, *, aperture=None, **_):
        calls.append((lens, aperture))
        return color

    monkeypatch.setattr(dofsim, "render", render)
    assert run(["render", "a.exr", "-o", "o.exr", *arguments]) == 0
    return calls[0]


def test_lens_of_a_camera(scene, monkeypatch):
    arguments = ["--focal-length-mm", "50", "--f-number", "1.8", "--focus-distance", "3"]
    lens, _ = lens_of(monkeypatch, *arguments)
    assert lens == dofsim.Lens.from_camera(focal_length_mm=50, f_number=1.8, focus_distance=3.0)
    lens, _ = lens_of(monkeypatch, *arguments, "--sensor-width-mm", "24")
    assert lens == dofsim.Lens.from_camera(
        focal_length_mm=50, f_number=1.8, focus_distance=3.0, sensor_width_mm=24
    )


def test_lens_of_a_file_and_options_beside_it(scene, tmp_path, monkeypatch):
    path = tmp_path / "lens.toml"
    path.write_text('aperture_radius = 0.03\nfocus_distance = 3\nfov = 40.0\nfov_axis = "y"\n')
    lens, aperture = lens_of(monkeypatch, "--lens", "lens.toml")
    assert lens == dofsim.Lens(**LENS, fov_axis="y")
    # Without a word of it, the method chooses its own.
    assert aperture is None
    lens, _ = lens_of(monkeypatch, "--lens", "lens.toml", "--focus-distance", "5")
    assert lens.focus_distance == 5.0
    path.write_text(path.read_text() + "[aperture]\nblades = 5\nrotation = 10.0\n")
    _, aperture = lens_of(monkeypatch, "--lens", "lens.toml", "--rotation", "20")
    assert aperture == dofsim.Aperture(blades=5, rotation=20.0)


def test_a_file_has_all_words_of_a_lens_and_an_aperture(scene, tmp_path, monkeypatch):
    path = tmp_path / "lens.toml"
    path.write_text(
        "focal_length_mm = 50\nf_number = 2\nfocus_distance = 3\nsensor = 'aps-c'\nbreathing = true\n"
        "tilt = [20.0, -5.0]\naxial_color = [-0.1, 0.0, 0.1]\ncat_eye = 0.5\nvignetting = 'full'\n"
        "[aperture]\nimage = 'a.png'\nratio = 2.0\n"
    )
    lens, aperture = lens_of(monkeypatch, "--lens", "lens.toml")
    camera = dofsim.Lens.from_camera(
        focal_length_mm=50, f_number=2, focus_distance=3.0, sensor="aps-c", breathing=True
    )
    flaws = {"axial_color": (-0.1, 0.0, 0.1), "cat_eye": 0.5, "vignetting": "full"}
    assert lens == camera.replace(tilt=(20.0, -5.0), **flaws)
    assert aperture == dofsim.Aperture(image="a.png", ratio=2.0)
    lens, _ = lens_of(monkeypatch, "--lens", "lens.toml", "--focus-at", "25,15")
    assert abs(dofsim.coc(scene[1], lens)[15, 25]) < 1e-4


def test_lens_over_relative_disparity(scene, tmp_path, monkeypatch):
    (tmp_path / "lens.toml").write_text("strength_px = 20.0\nfocus = 0.5\n")
    lens, _ = lens_of(monkeypatch, "--lens", "lens.toml", "--depth-kind", "disparity")
    assert lens == dofsim.Lens.from_disparity(strength_px=20.0, focus=0.5)
    (tmp_path / "lens.toml").write_text("strength_percent = 2.0\nfocus = 0.5\n")
    lens, _ = lens_of(monkeypatch, "--lens", "lens.toml", "--depth-kind", "relative")
    assert lens == dofsim.Lens.from_disparity(strength_percent=2.0, focus=0.5)


def test_focus_at_a_pixel(scene, monkeypatch):
    lens, _ = lens_of(monkeypatch, "--aperture-radius", "0.03", "--fov", "40", "--focus-at", "25,15")
    assert lens.focus_distance == pytest.approx(1.5)
    assert lens == dofsim.Lens(**LENS).replace(focus_distance=lens.focus_distance)
    # The field of view of a camera depends on its focus.
    lens, _ = lens_of(monkeypatch, "--focal-length-mm", "50", "--f-number", "2", "--focus-at", "25,15")
    camera = dofsim.Lens.from_camera(focal_length_mm=50, f_number=2.0, focus_distance=1.5)
    assert (lens.focus_distance, lens.fov) == pytest.approx((1.5, camera.fov))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--aperture-radius --focus-distance --fov missing"),
        (["--fov", "40", "--focus-distance", "3"], "--aperture-radius missing"),
        (["--f-number", "2", "--focus-distance", "3"], "--focal-length-mm missing"),
        ([*LENS_OPTIONS, "--f-number", "2"], "has no --aperture-radius --fov"),
        (["--lens", "no.toml"], "no.toml: No such file"),
        (["--lens", "a.exr"], "a.exr: not a TOML file"),
    ],
)
def test_lenses_that_are_none(scene, capsys, arguments, message):
    assert message in fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *arguments)


# coc


def test_coc_as_numbers(scene, capsys):
    _, depth = scene
    expected = dofsim.coc(depth, dofsim.Lens(**LENS))
    assert run(["coc", "a.exr", "-o", "coc.exr", *LENS_OPTIONS]) == 0
    low, high = expected.min(), expected.max()
    out, err = capsys.readouterr()
    assert out == ""
    assert err.endswith(f"signed radius {low:+.2f} px (near) to {high:+.2f} px (far)\n")
    np.testing.assert_array_equal(io.read_exr("coc.exr")["coc"], expected)
    assert run(["coc", "z.pfm", "-o", "coc.npy", *LENS_OPTIONS]) == 0
    np.testing.assert_array_equal(np.load("coc.npy"), expected)


def test_coc_as_colors(scene):
    assert run(["coc", "z.pfm", "-o", "coc.png", *LENS_OPTIONS, "--focus-at", "0,40"]) == 0
    picture = io.read_color("coc.png").pixels[..., :3].astype(int)
    # The picture is drawn enlarged, and there is a title above it and a scale on its right.
    assert picture.shape[0] > HEIGHT
    assert picture.shape[1] > WIDTH + 100
    light = (picture > 230).all(axis=-1) & (picture < 250).all(axis=-1)
    zoom = 4
    red = picture[..., 0] > picture[..., 2] + 60
    blue = picture[..., 2] > picture[..., 0] + 60
    assert light.sum() > 0.5 * HEIGHT * WIDTH * zoom**2
    assert red.sum() >= 20 * 20 * zoom**2
    assert blue[:, WIDTH * zoom :].any()
    # The red square is where the near surface is: right of the left edge, below the top.
    rows, columns = np.nonzero(red[:, : WIDTH * zoom])
    assert columns.min() == pytest.approx(14 + 20 * zoom, abs=1)
    assert rows.min() == pytest.approx(30 + 10 * zoom, abs=1)


def test_coc_limit_sets_the_scale(scene):
    assert run(["coc", "z.pfm", "-o", "a1.png", *LENS_OPTIONS, "--limit", "0.01"]) == 0
    assert run(["coc", "z.pfm", "-o", "a2.png", *LENS_OPTIONS, "--limit", "1000"]) == 0
    strong, weak = io.read_color("a1.png").pixels, io.read_color("a2.png").pixels
    assert strong[60:200, 30:250, :3].mean() < weak[60:200, 30:250, :3].mean() - 80


def test_coc_refuses_a_bad_limit(scene, capsys):
    assert "limit" in fails(capsys, 2, "coc", "z.pfm", "-o", "o.png", *LENS_OPTIONS, "--limit", "-1")


# compare


def test_compare_prints_the_metrics(scene, capsys):
    from dofsim import metrics

    color, _ = scene
    other = np.clip(color + 0.05, 0, 1)
    io.write_image("b.exr", other)
    assert run(["compare", "a.exr", "b.exr", "--border", "4"]) == 0
    values = [f(color, other, border=4) for f in (metrics.psnr, metrics.ssim, metrics.flip)]
    expected = "PSNR {:.2f} dB, SSIM {:.4f}, FLIP {:.4f}\n".format(*values)
    assert capsys.readouterr().out == expected
    assert run(["compare", "a.exr", "a.exr"]) == 0
    assert capsys.readouterr().out == "PSNR inf dB, SSIM 1.0000, FLIP 0.0000\n"


def test_compare_of_pictures_with_alpha(scene, capsys):
    color, _ = scene
    cover = np.full((HEIGHT, WIDTH, 1), 0.5, np.float32)
    io.write_image("cover.exr", np.concatenate([color, cover], axis=-1))
    assert run(["compare", "a.exr", "cover.exr"]) == 0
    assert capsys.readouterr().out == "PSNR inf dB, SSIM 1.0000, FLIP 0.0000\n"


def test_compare_draws_the_difference(scene):
    color, _ = scene
    other = color.copy()
    other[20:30, 20:30] = 1 - other[20:30, 20:30]
    io.write_image("b.exr", other)
    assert run(["compare", "a.exr", "b.exr", "-o", "d.png"]) == 0
    panel = io.read_color("d.png").pixels[..., :3].astype(int)
    top = 30 + 4 * HEIGHT + 14 + 30
    difference = panel[top : top + 4 * HEIGHT, 14 : 14 + 4 * WIDTH]
    assert (difference[:60] == 0).all()
    assert difference[100:110, 100:110].sum() > 0


def test_compare_of_names_with_dollars(scene):
    color, _ = scene
    for name in ("a$b.exr", "$x^$.exr", "\\frac$.exr"):
        io.write_image(name, color)
        assert run(["compare", "a.exr", name, "-o", "d.png"]) == 0


def test_names_that_a_terminal_would_obey_are_escaped(scene, capsys):
    name = "\x1b[2J\n.exr"
    assert fails(capsys, 2, "render", name, "-o", "o.exr", *LENS_OPTIONS).startswith(
        "dofsim: \\x1b[2J\\n.exr: "
    )
    io.write_exr(name, {"R": np.ones((4, 5))})
    assert "\\x1b[2J\\n.exr" in fails(capsys, 2, "render", name, "-o", "o.exr", *LENS_OPTIONS)


def test_compare_refuses(scene, capsys):
    assert "different shapes" in fails(capsys, 2, "compare", "a.exr", "z.pfm")
    assert "is one of the inputs" in fails(capsys, 2, "compare", "a.exr", "a.png", "-o", "a.png")
    assert "'.exr' is not one of .png" in fails(capsys, 2, "compare", "a.exr", "a.png", "-o", "o.exr")


def test_missing_packages_are_named(scene, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    message = fails(capsys, 1, "coc", "z.pfm", "-o", "o.png", *LENS_OPTIONS)
    assert "pip install '.[metrics]'" in message


# Options that commands share


@pytest.mark.parametrize(
    ("command", "groups"),
    [
        ("render", ["LensOptions", "ApertureOptions", "DepthOptions", "RenderOptions"]),
        ("batch", ["LensOptions", "ApertureOptions", "DepthOptions", "RenderOptions"]),
        ("coc", ["LensOptions", "DepthOptions"]),
    ],
)
def test_a_command_has_each_option_of_its_groups_once(command, groups):
    found = [parameter.name for parameter in typer.main.get_command(cli.app).commands[command].params]
    assert len(found) == len(set(found))
    for group in groups:
        own = [field.name for field in dataclasses.fields(getattr(_command_options, group))]
        first = found.index(own[0])
        assert found[first : first + len(own)] == own


# Help, and words


def plain(*arguments):
    """Run the command in a process of its own, on a terminal of 80 columns."""
    environment = {**os.environ, "COLUMNS": "80"}
    command = [sys.executable, "-m", "dofsim", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


COMMANDS = ("render", "coc", "batch", "photo", "compare", "devices", "help", "demo")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_fits_a_terminal_and_shows_all_of_itself(command):
    shown = [plain(command, "--help"), plain(command, "-h"), plain("help", command)]
    assert {(one.returncode, one.stdout) for one in shown} == {(0, shown[0].stdout)}
    text = shown[0].stdout
    assert max(map(len, text.splitlines())) <= 80
    # No type of a flag, no markup.
    assert "<" not in text
    assert "bool" not in text
    assert ("[aperture]" in text) == (command in ("render", "coc", "batch"))
    # Lines are as full as their next word allows.
    for paragraph in text.split("\n\n")[1:2]:
        lines = [line.strip() for line in paragraph.splitlines()]
        for line, following in pairwise(lines):
            assert len(line) + 1 + len(following.split()[0]) > 74


def test_without_a_word_the_commands_are_listed():
    shown = plain()
    assert shown.returncode == 2
    assert all(f"\n  {command} " in shown.stderr for command in COMMANDS)
    assert plain("help").stdout == plain("--help").stdout == shown.stderr


def test_completion_can_be_had():
    shown = plain("--show-completion", "bash")
    assert "_dofsim_completion" in shown.stdout
    environment = {
        **os.environ,
        "_DOFSIM_COMPLETE": "complete_bash",
        "COMP_WORDS": "dofsim ren",
        "COMP_CWORD": "1",
    }
    command = [sys.executable, "-m", "dofsim"]
    completed = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert "render" in completed.stdout


def test_a_photograph_with_relative_depth(scene, capsys):
    _, depth = scene
    disparity = np.where(np.isinf(depth), 0.0, 1.0 / depth)
    np.save("d.npy", (40 + 900 * disparity).astype(np.float32))
    words = ["--depth-kind", "relative", "--strength-percent", "8"]
    assert run(["render", "a.png", "d.npy", "-o", "o.png", *words, "--focus", "0.2"]) == 0
    said = capsys.readouterr().err
    assert "relative disparity 40 to 640 (taken as 0 to 1), focus at disparity 0.2, blur radius" in said
    assert " m," not in said
    lens = dofsim.Lens.from_disparity(strength_percent=8, focus=0.2)
    codes = io.read_color("a.png").pixels
    expected = dofsim.render(codes, np.load("d.npy"), lens, depth_kind="relative", transfer="srgb")
    assert np.abs(io.read_color("o.png").pixels.astype(int) - expected.astype(int)).max() <= 1
    message = fails(capsys, 2, "render", "a.png", "d.npy", "-o", "o.png", *words)
    assert "--focus missing. Give it, --focus-at X,Y or --in-focus" in message


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_integers_are_taken_for_nothing_by_themselves(scene, capsys, dtype):
    codes = (np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH) % 200 + 40).astype(dtype)
    io.write_image("z.png", codes, transfer="linear", dtype=dtype)
    codes = io.read_depth("z.png", scale=1)
    arguments = ["render", "a.png", "z.png", "-o", "o.png"]
    message = fails(capsys, 2, *arguments, *LENS_OPTIONS)
    for way in ("--depth-kind relative", "--depth-scale 0.001", "--preset NAME", "kitti"):
        assert way in message
    assert "--depth-kind relative" in fails(capsys, 2, "coc", "z.png", "-o", "c.exr", *LENS_OPTIONS)
    for ways in (["--depth-scale", "0.05"], ["--preset", "kitti"], ["--depth-kind", "z"]):
        assert run([*arguments, *LENS_OPTIONS, *ways]) == 0
    relative = ["--depth-kind", "relative", "--strength-px", "3", "--focus", "0"]
    assert run([*arguments, *relative]) == 0


def test_errors_speak_of_options(scene, capsys):
    io.write_image("nan.exr", np.ones((4, 5, 3)), depth=np.full((4, 5), np.nan))
    message = fails(capsys, 2, "render", "nan.exr", "-o", "o.exr", *LENS_OPTIONS)
    assert "pass --invalid far" in message
    words = ["--depth-kind", "relative"]
    message = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, *words)
    assert "--depth-kind relative" in message
    assert "--strength-percent" in message
    assert "from_disparity" not in message
    message = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--supersample", "7")
    assert "--supersample 7 must divide" in message
    message = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--near", "1")
    assert '--near and --far are for --depth-kind "zbuffer"' in message
    both = ["--strength-px", "3", "--strength-percent", "3", "--focus", "0"]
    message = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *words, *both)
    assert "--strength-px excludes --strength-percent" in message
    message = fails(capsys, 1, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--device", "gpu:99")
    assert message.startswith("dofsim: --device: there is no")
    Path("lens.toml").write_text("colour = 3\n")
    message = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", "--lens", "lens.toml")
    assert 'lens.toml: a lens has no "colour"; it has aperture_radius' in message
    io.write_depth("small.pfm", np.ones((5, 4)))
    message = fails(capsys, 2, "render", "a.png", "small.pfm", "-o", "o.exr", *LENS_OPTIONS)
    assert f"the picture is {WIDTH} x {HEIGHT}, its depth 4 x 5" in message


# What was done, and what is suspicious


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


def test_coarse_depth_is_refined_if_asked(scene, capsys):
    color, depth = scene
    coarse = np.where(np.isinf(depth), 9.0, depth)[::2, ::2]
    io.write_depth("coarse.pfm", coarse)
    arguments = ["render", "a.exr", "coarse.pfm", "-o", "o.exr", *LENS_OPTIONS]
    assert "of another size must be refined (--refine-depth)" in fails(capsys, 2, *arguments)
    assert run([*arguments, "--refine-depth", "--focus-at", "30,20"]) == 0
    assert f"o.exr: {WIDTH} x {HEIGHT}, depth 1.5 to 9 m, focus 1.5 m" in capsys.readouterr().err
    lens = dofsim.Lens(aperture_radius=0.03, fov=40.0, focus_distance=1.5)
    expected = dofsim.render(color, coarse, lens, refine=True)
    np.testing.assert_allclose(io.read_color("o.exr").pixels, expected, atol=1e-5)


def test_one_range_of_depth_for_all_pictures(scene, capsys):
    _, depth = scene
    disparity = (1.0 / depth).astype(np.float32)
    io.write_depth("d.pfm", disparity)
    arguments = ["render", "a.png", "d.pfm", "-o", "o.npy", "--depth-kind", "relative"]
    arguments += ["--strength-px", "6", "--focus", "0.5"]
    assert run([*arguments, "--depth-range", "0,2"]) == 0
    assert "blur radius" in capsys.readouterr().err
    lens = dofsim.Lens.from_disparity(strength_px=6.0, focus=0.5)
    light = io.read_color("a.png").to_linear()
    expected = dofsim.render(light, disparity, lens, depth_kind="relative", depth_range=(0.0, 2.0))
    np.testing.assert_array_equal(np.load("o.npy"), expected)
    assert "--depth-range" in fails(capsys, 2, *arguments, "--depth-range", "0")
    assert "--depth-range" in fails(capsys, 2, *arguments, "--depth-range", "1,1")


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


def test_devices_are_listed_without_the_noise_of_drivers():
    code = (
        "import os, dofsim; from dofsim import cli; "
        "dofsim.devices = lambda: os.write(2, b'MESA: error\\n') and []; cli.run(['devices'{}])"
    )
    for more, noise in (("", ""), (", '-v'", "MESA: error\n")):
        command = [sys.executable, "-c", code.format(more)]
        shown = subprocess.run(command, capture_output=True, text=True, check=True)
        assert shown.stderr == noise
        assert "There is no GPU" in shown.stdout


def test_cameras_of_other_programs_are_lens_files(scene, tmp_path, monkeypatch):
    words = {"lens": 50.0, "fstop": 1.8, "focus_distance": 2.0, "sensor_width": 36.0, "aperture_blades": 7}
    (tmp_path / "camera.json").write_text(json.dumps(words))
    lens, aperture = lens_of(monkeypatch, "--lens", "camera.json")
    assert lens == dofsim.Lens.from_blender(words)
    assert aperture == dofsim.Aperture.from_blender(words)
    lens, aperture = lens_of(monkeypatch, "--lens", "camera.json", "--focus-distance", "3", "--blades", "5")
    assert lens == dofsim.Lens.from_blender(words).replace(focus_distance=3.0)
    assert aperture.blades == 5
    (tmp_path / "scene.xml").write_text(
        '<scene version="3.0.0"><sensor type="thinlens"><float name="fov" value="40"/>'
        '<float name="aperture_radius" value="0.1"/><float name="focus_distance" value="3"/></sensor></scene>'
    )
    lens, aperture = lens_of(monkeypatch, "--lens", "scene.xml")
    assert lens == dofsim.Lens.from_mitsuba(str(tmp_path / "scene.xml"))
    assert aperture is None
