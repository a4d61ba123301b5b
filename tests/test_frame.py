"""Windows, pixel aspect and attributes of OpenEXR files, from the command line."""

from pathlib import Path

import dofsim
import numpy as np
import pytest
from dofsim import io
from dofsim._frame import squeezed
from dofsim.batch import Frame, map_frames
from dofsim.cli import run

OpenEXR = pytest.importorskip("OpenEXR", reason="files are written with the reference library")

MARGIN, HEIGHT, WIDTH = 16, 48, 64
LENS = {"aperture_radius": 0.03, "focus_distance": 1.5, "fov": 40.0}
OPTIONS = ["--aperture-radius", "0.03", "--focus-distance", "1.5", "--fov", "40"]


@pytest.fixture
def picture(tmp_path, monkeypatch):
    """Go to an empty folder; give a picture and its depth, with a margin."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    size = (HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN)
    return rng.random((*size, 3)).astype(np.float32), rng.uniform(2, 9, size).astype(np.float32)


def save(path, color, depth, **header):
    channels = {name: color[..., index].copy() for index, name in enumerate("RGB")}
    channels["Z"] = depth.copy()
    with OpenEXR.File([OpenEXR.Part({"type": OpenEXR.scanlineimage, **header}, channels, "")]) as file:
        file.write(str(path))


def window(x, y, width, height):
    return np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32)


def header(path):
    return OpenEXR.File(str(path)).header()


def corners(path):
    return [
        tuple(int(number) for end in header(path)[name] for number in end)
        for name in ("dataWindow", "displayWindow")
    ]


def overscanned(path, color, depth, origin=(0, 0)):
    x, y = origin
    save(
        path,
        color,
        depth,
        dataWindow=window(x - MARGIN, y - MARGIN, WIDTH + 2 * MARGIN, HEIGHT + 2 * MARGIN),
        displayWindow=window(x, y, WIDTH, HEIGHT),
    )


@pytest.mark.parametrize(
    ("options", "margin"),
    [
        ([], 0),
        (["--window", "display"], 0),
        (["--window", "data"], MARGIN),
        (["--overscan", "10"], 10),
        (["--window", "data", "--overscan", "10"], 10),
    ],
)
def test_what_is_beyond_the_display_window_is_overscan(picture, capsys, options, margin):
    color, depth = picture
    overscanned("a.exr", color, depth, origin=(100, -7))
    assert run(["render", "a.exr", "-o", "o.exr", *OPTIONS, *options]) == 0
    cut = slice(MARGIN - margin, HEIGHT + MARGIN + margin), slice(MARGIN - margin, WIDTH + MARGIN + margin)
    expected = dofsim.render(color[cut], depth[cut], dofsim.Lens(**LENS), overscan=margin)
    np.testing.assert_array_equal(io.read_color("o.exr").pixels, expected)
    assert corners("o.exr") == [(100, -7, 100 + WIDTH - 1, -7 + HEIGHT - 1)] * 2
    unused = MARGIN - margin
    assert (f"{unused} pixels beyond the display window are not used" in capsys.readouterr().err) == (
        unused > 0
    )


def test_a_margin_that_is_not_there(picture, capsys):
    color, depth = picture
    overscanned("a.exr", color, depth)
    words = ["--window", "data", "--overscan", "17"]
    assert run(["render", "a.exr", "-o", "o.exr", *OPTIONS, *words]) == 2
    assert "--overscan must be at most 16" in capsys.readouterr().err
    # Without the window, a margin that is not stored beyond the display window is part of it.
    assert run(["render", "a.exr", "-o", "o.exr", *OPTIONS, "--overscan", "17"]) == 0
    said = capsys.readouterr().err
    assert f"stores {MARGIN} pixels beyond the display window, fewer than --overscan 17" in said
    assert "the margin is cut from the display window, and the output is smaller" in said
    assert "--window data does" not in said
    inner = slice(MARGIN, -MARGIN), slice(MARGIN, -MARGIN)
    expected = dofsim.render(color[inner], depth[inner], dofsim.Lens(**LENS), overscan=17)
    np.testing.assert_array_equal(io.read_color("o.exr").pixels, expected)
    io.write_image("a.png", color)
    np.save("z.npy", depth)
    assert run(["render", "a.png", "z.npy", "-o", "o.exr", *OPTIONS, "--window", "data"]) == 2
    assert "--window" in capsys.readouterr().err


@pytest.mark.parametrize("options", [[], ["--window", "data"]])
def test_a_crop_has_its_windows_and_no_dark_edge(picture, options):
    color, depth = picture
    even = np.full_like(color[:20, :30], 0.5)
    save(
        "a.exr",
        even,
        depth[:20, :30],
        dataWindow=window(10, 5, 30, 20),
        displayWindow=window(0, 0, WIDTH, HEIGHT),
    )
    assert run(["render", "a.exr", "-o", "o.exr", *OPTIONS, *options]) == 0
    assert corners("o.exr") == [(10, 5, 39, 24), (0, 0, WIDTH - 1, HEIGHT - 1)]
    result = np.stack([io.read_exr("o.exr")[name] for name in "RGB"], axis=-1)
    assert result.shape == even.shape
    np.testing.assert_allclose(result, 0.5, atol=1e-5)


def test_the_lens_of_a_crop_is_that_of_the_whole(picture):
    """A crop blurs as the same pixels of the whole do, away from its edges, on one surface exactly."""
    color, depth = picture[0][:HEIGHT, :WIDTH], np.full((HEIGHT, WIDTH), 6.0, np.float32)
    save("whole.exr", color, depth)
    part = slice(8, 44), slice(20, 60)
    save(
        "crop.exr",
        color[part],
        depth[part],
        dataWindow=window(20, 8, 40, 36),
        displayWindow=window(0, 0, WIDTH, HEIGHT),
    )
    for name in ("whole", "crop"):
        assert run(["render", f"{name}.exr", "-o", f"o-{name}.exr", *OPTIONS]) == 0
    whole = io.read_color("o-whole.exr").pixels[part]
    crop = np.stack([io.read_exr("o-crop.exr")[name] for name in "RGB"], axis=-1)
    np.testing.assert_allclose(crop[12:-12, 12:-12], whole[12:-12, 12:-12], atol=1e-5)


def test_attributes_are_kept(picture):
    color, depth = picture
    primaries = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    save(
        "a.exr", color, depth, chromaticities=primaries, comments="shot 12", owner="us",
        # A standard name with a type that is not its own, as this library writes it.
        framesPerSecond=(24, 1), **{"studio/take": "seven", "studio/gain": 2.5},
    )  # fmt: skip
    arguments = ["a.exr", "-o", "o.exr", *OPTIONS, "--dtype", "half"]
    assert run(["render", *arguments]) == 0
    assert run(["batch", "a.exr", "-o", "out", *OPTIONS, "--dtype", "half"]) == 0
    for path in ("o.exr", "out/a.exr"):
        kept = header(path)
        assert kept["chromaticities"] == pytest.approx(primaries)
        assert (kept["comments"], kept["owner"]) == ("shot 12", "us")
        assert (kept["studio/take"], kept["studio/gain"]) == ("seven", 2.5)
    assert run(["render", "a.exr", "-o", "o.png", *OPTIONS]) == 0


@pytest.mark.parametrize("aspect", [2.0, 0.5, 1.6])
@pytest.mark.parametrize("axis", ["x", "y"])
def test_discs_are_round_where_pixels_are_not_square(tmp_path, monkeypatch, aspect, axis):
    """A point behind the focus is an ellipse in pixels, as high over wide as a pixel is wide over high."""
    monkeypatch.chdir(tmp_path)
    side = 161
    color = np.zeros((side, side, 3), np.float32)
    color[side // 2, side // 2] = 1.0
    save("a.exr", color, np.full((side, side), 9.0, np.float32), pixelAspectRatio=aspect)
    lens = {"aperture_radius": 0.08, "focus_distance": 1.0, "fov": 40.0, "fov_axis": axis}
    words = [word for name, value in lens.items() for word in (f"--{name.replace('_', '-')}", str(value))]
    assert run(["render", "a.exr", "-o", "o.exr", *words]) == 0
    assert header("o.exr")["pixelAspectRatio"] == pytest.approx(aspect)
    light = io.read_color("o.exr").pixels[..., 0].astype(float)
    assert light.sum() == pytest.approx(1.0, abs=1e-3)
    rows, columns = np.indices(light.shape) - side // 2
    # Of an ellipse, a quarter of the squares of its half-axes.
    high, wide = (2.0 * np.sqrt((light * offset**2).sum()) for offset in (rows, columns))
    assert high / wide == pytest.approx(aspect, rel=0.02)
    square = float(abs(dofsim.coc(np.full((side, side), 9.0), dofsim.Lens(**lens))[0, 0]))
    # The axis of the field of view has the radius of square pixels.
    assert {"x": wide, "y": high}[axis] == pytest.approx(square, rel=0.02)


def test_the_aspect_of_pixels_and_an_aperture_of_its_own():
    lens = dofsim.Lens(**LENS)
    assert squeezed(lens, None, 1.0) == (lens, None)
    both = dofsim.Aperture(blades=6, ratio=2.0)
    wide, opening = squeezed(lens, both, 2.0)
    assert (opening.ratio, opening.blades) == (4.0, 6)
    assert wide.aperture_radius == pytest.approx(0.06)
    flat, opening = squeezed(lens, both, 0.5)
    assert opening.ratio == 1.0
    assert flat.aperture_radius == pytest.approx(0.015)
    with pytest.raises(ValueError, match="neither depth along rays"):
        squeezed(lens, None, 2.0, "distance")


def test_frames_of_a_batch_take_the_margin(picture):
    color, depth = picture
    overscanned("a.exr", color, depth)
    frame = Frame(color="a.exr", output="out.exr", lens=LENS, reading={"window": "data"})
    (result,) = map_frames([frame])
    assert (result.status, result.error) == ("written", None)
    expected = dofsim.render(color, depth, dofsim.Lens(**LENS), overscan=MARGIN)
    np.testing.assert_array_equal(io.read_color("out.exr").pixels, expected)
    assert run(["batch", "a.exr", "-o", "out", *OPTIONS, "--window", "data"]) == 0
    assert Path("out/a.exr").read_bytes() == Path("out.exr").read_bytes()


def test_a_pixel_to_focus_on_is_one_of_the_output(picture):
    color, depth = picture
    overscanned("a.exr", color, depth)
    words = ["--aperture-radius", "0.03", "--fov", "40", "--focus-at", "3,4"]
    assert run(["render", "a.exr", "-o", "o.exr", *words, "--window", "data"]) == 0
    lens = dofsim.Lens(**LENS).replace(focus_distance=float(depth[MARGIN + 4, MARGIN + 3]))
    expected = dofsim.render(color, depth, lens, overscan=MARGIN)
    np.testing.assert_allclose(io.read_color("o.exr").pixels, expected, atol=1e-5)


def test_depth_is_refined_with_its_margin(picture):
    color, _ = picture
    column = np.arange(color.shape[1])[None, :] * np.ones((color.shape[0], 1))
    depth = np.where(column < 40, 2.0, 6.0).astype(np.float32)
    overscanned("in.exr", color, depth)
    arguments = ["render", "in.exr", "-o", "out.exr", *OPTIONS, "--window", "data", "--refine-depth"]
    assert run(arguments) == 0
    whole = dofsim.render(color, depth, dofsim.Lens(**LENS), overscan=MARGIN, refine=True)
    np.testing.assert_allclose(io.read_color("out.exr").pixels, whole, atol=1e-5)
    frame = Frame(
        color=Path("in.exr"),
        depth=None,
        output=Path("b.exr"),
        lens=LENS,
        reading={"window": "data"},
        options={"refine": True},
    )
    (result,) = map_frames([frame])
    assert result.status == "written", result.error
    np.testing.assert_allclose(io.read_color("b.exr").pixels, whole, atol=1e-5)


def test_the_margin_of_a_coarse_map_is_another_one(picture, capsys):
    color, depth = picture
    overscanned("in.exr", color, depth)
    small = window(-MARGIN, -MARGIN, WIDTH // 2 + 2 * MARGIN, HEIGHT // 2 + 2 * MARGIN)
    coarse = np.full((HEIGHT // 2 + 2 * MARGIN, WIDTH // 2 + 2 * MARGIN), 3.0, np.float32)
    save(
        "z.exr",
        np.repeat(coarse[..., None], 3, -1),
        coarse,
        dataWindow=small,
        displayWindow=window(0, 0, WIDTH // 2, HEIGHT // 2),
    )
    arguments = ["render", "in.exr", "z.exr", "-o", "out.exr", *OPTIONS, "--refine-depth"]
    assert run([*arguments, "--window", "data"]) == 2
    assert "the data window of the depth is another one" in capsys.readouterr().err
    assert run(arguments) == 0
    assert io.read_color("out.exr").pixels.shape == (HEIGHT, WIDTH, 3)
