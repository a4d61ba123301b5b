"""`dofsim coc` and `dofsim compare`: numbers and pictures of blur and of differences."""

import sys

import dofsim
import numpy as np
import pytest
from command_lines import HEIGHT, LENS, LENS_OPTIONS, WIDTH, fails
from dofsim import io
from dofsim.cli import run


def test_coc_as_numbers(scene, capsys):
    _, depth = scene
    expected = dofsim.coc(depth, dofsim.Lens(**LENS))
    assert run(["coc", "a.exr", "-o", "coc.exr", *LENS_OPTIONS]) == 0
    low, high = expected.min(), expected.max()
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(
        f"coc.exr: {WIDTH} x {HEIGHT}, depth 1.5 to 6 m and the background, focus 3 m, blur radius "
    )
    assert err.endswith(f"; signed radius {low:+.2f} to {high:+.2f} px, negative in front of the focus\n")
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


def test_compare_can_be_quiet(scene, capsys):
    pytest.importorskip("skimage")
    pytest.importorskip("flip_evaluator")
    assert run(["compare", "a.png", "a.png", "-o", "c.png"]) == 0
    assert "c.png: " in capsys.readouterr().err
    assert run(["compare", "a.png", "a.png", "-o", "c.png", "-q"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("PSNR ")
    assert err == ""
