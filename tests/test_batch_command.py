"""The `dofsim batch` command: which lenses it draws, what it writes and says, and what it refuses."""

import json
import os
import re
from pathlib import Path

import dofsim
import numpy as np
import pytest
from data_set import (
    HEIGHT,
    LENS,
    LENS_OPTIONS,
    WIDTH,
    batch,
    contents,
)
from dofsim import io
from dofsim.cli import run


@pytest.mark.parametrize("workers", [1, 2])
def test_bad_frames_are_named_and_the_others_written(data, capsys, workers):
    options = ["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--workers", workers]
    assert batch(*options) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "out: 47 written, 0 there already, 3 failed" in err
    lines = [line for line in err.splitlines() if line.startswith("dofsim: ")]
    assert [line.split(": ")[1] for line in lines] == ["out/0007.exr", "out/0020.exr", "out/0033.exr"]
    assert len(list(Path("out").glob("*.exr"))) == 47
    failures = [json.loads(line) for line in Path("out/failures.jsonl").read_text().splitlines()]
    assert [Path(failure["output"]).stem for failure in failures] == ["0007", "0020", "0033"]
    assert batch(*options) == 1
    assert "0 written, 47 there already, 3 failed" in capsys.readouterr().err
    assert batch(*options, "--no-resume") == 1
    assert "47 written" in capsys.readouterr().err


def test_workers_give_the_same_bits(few):
    drawn = ["--random-aperture-radius", "0.1,0.5", "--random-focus", "--fov", "40", "--invalid", "far"]
    assert batch("rgb", "depth", "-o", "one", *drawn) == 0
    assert batch("rgb", "depth", "-o", "two", *drawn, "--workers", "2") == 0
    assert contents("one") == contents("two")
    assert len(contents("one")) == 8


def test_a_frame_is_what_render_writes(few, capsys):
    options = [
        *LENS_OPTIONS,
        "--method",
        "hexagonal",
        "--set",
        "max_coc_px=9",
        "--blades",
        "4",
        "--dtype",
        "half",
    ]
    assert batch("rgb", "depth", "-o", "out", *options) == 0
    assert run(["render", "rgb/0002.exr", "depth/0002_depth.pfm", "-o", "one.exr", *options]) == 0
    assert Path("out/0002.exr").read_bytes() == Path("one.exr").read_bytes()
    assert "dofsim: " not in capsys.readouterr().err


def test_random_lenses_are_in_range_recorded_and_seeded(few):
    def lenses(folder, *extra):
        options = ["--focal-length-mm", "50", "--random-f-number", "1.4,8", "--random-focus", *extra]
        assert batch("rgb", "depth", "-o", folder, *options) == 0
        records = [json.loads(path.read_text()) for path in sorted(Path(folder).glob("*.exr.json"))]
        return [(one["lens"]["f_number"], tuple(one["focus_at"])) for one in records], records

    first, records = lenses("a")
    assert len(set(first)) == 4
    assert all(1.4 <= f_number <= 8 for f_number, _ in first)
    for index, record in enumerate(records):
        x, y = record["focus_at"]
        depth = io.read_depth(f"depth/{index:04}_depth.pfm")
        assert record["lens"]["focus_distance"] == pytest.approx(depth[y, x])
    assert lenses("b")[0] == first
    assert not set(lenses("c", "--seed", "1")[0]) & set(first)
    # What is drawn for a frame does not depend on the others.
    Path("rgb/0000.exr").unlink()
    assert lenses("d")[0] == first[1:]


def test_every_output(few):
    flags = [
        "--outputs",
        "picture,coc,mask,stack",
        "--slices",
        "2",
        "--sharp-radius-px",
        "1.5",
        "--format",
        "png",
    ]
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, *flags) == 0
    names = {path.name for path in Path("out").glob("0001*")}
    ends = {"png", "png.json", "coc.exr", "mask.png", "focus-00.png", "focus-01.png"}
    assert names == {f"0001.{end}" for end in ends}
    radius = dofsim.coc(io.read_depth("depth/0001_depth.pfm"), dofsim.Lens(**LENS))
    mask = io.read_color("out/0001.mask.png").pixels
    np.testing.assert_array_equal(mask == 255, np.abs(radius) <= 1.5)
    assert 0 < np.count_nonzero(mask) < mask.size


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "out"], "give either COLOR"),
        (["rgb", "--manifest", "a.csv", "-o", "out"], "give either COLOR"),
        (["nowhere", "-o", "out"], "nowhere: No such file or directory"),
        (["rgb", "depth", "-o", "rgb", *LENS_OPTIONS], "is one of the inputs"),
        (["rgb", "depth", "-o", "out"], "the lens is not complete"),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--random-f-number", "1,2"], "cannot be given with"),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--random-aperture-radius", "1"], "LOW,HIGH"),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--random-focus", "--focus-at", "1,1"], "exclude"),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--format", "gif"], "--format takes .exr"),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--outputs", "photo"], "--outputs must be some of"),
        (
            ["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--outputs", "stack", "--slices", str(10**30)],
            "--slices must be positive and at most 1000",
        ),
        (
            ["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--random-aperture-radius", "nan,1"],
            "--random-aperture-radius takes two numbers",
        ),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--threads", "-1"], "--threads must be a whole number"),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--workers", "0"], "--workers"),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--method", "lense"], 'got "lense"'),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--set", "taps=3"], "taps"),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--preset", "mitsuba"], "near"),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--outputs", "coc", "--overscan", "2"], "--overscan 0"),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--format", "png", "--dtype", "half"], "--dtype half"),
    ],
)
def test_refusals(few, capsys, arguments, message):
    assert batch(*arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("dofsim: ")
    assert message in err
    assert not Path("out").exists()


def test_a_manifest_is_not_overwritten(few, capsys):
    Path("out").mkdir()
    manifest = Path("out/failures.jsonl")
    manifest.write_text('{"color": "../rgb/0000.exr", "depth": "../depth/0000_depth.pfm"}\n')
    before = manifest.read_text()
    assert batch("--manifest", manifest, "-o", "out", *LENS_OPTIONS) == 2
    assert "failures.jsonl: is one of the inputs" in capsys.readouterr().err
    assert manifest.read_text() == before


@pytest.mark.skipif(os.name != "posix", reason="symbolic links")
@pytest.mark.parametrize("link", ["0001.exr", "0001.exr.json", "deeper"])
def test_no_link_leads_out_of_the_folder(few, capsys, link):
    Path("elsewhere").mkdir()
    Path("out").mkdir()
    (Path("elsewhere") / link).write_text("mine")
    Path("out", link).symlink_to(Path("elsewhere", link).absolute())
    arguments = ["rgb", "depth"]
    if link == "deeper":
        Path("elsewhere", link).unlink()
        Path("elsewhere", link).mkdir()
        row = {"color": "rgb/0001.exr", "depth": "depth/0001_depth.pfm", "output": "deeper/a"}
        Path("frames.jsonl").write_text(json.dumps(row))
        arguments = ["--manifest", "frames.jsonl"]
    assert batch(*arguments, "-o", "out", *LENS_OPTIONS) == 2
    assert "a symbolic link leads it out of out" in capsys.readouterr().err
    assert [path.name for path in Path("out").iterdir()] == [link]
    if link == "deeper":
        assert list(Path("elsewhere/deeper").iterdir()) == []
    else:
        assert Path("elsewhere", link).read_text() == "mine"


def test_the_folder_of_the_results_may_be_a_link(few):
    Path("disk").mkdir()
    Path("out").symlink_to("disk")
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS) == 0
    assert len(list(Path("disk").glob("*.exr"))) == 4


@pytest.mark.parametrize(
    ("arguments", "fails"),
    [
        (["rgb", "depth", "-o", "rgb", "--format", "png"], True),
        (["rgb", "depth", "-o", "./rgb/../rgb", "--format", "png"], True),
        (["rgb/*.exr", "depth", "-o", "rgb", "--format", "png"], False),
        (["rgb/*", "depth", "-o", "rgb", "--format", "png"], True),
        (["rgb", "depth", "-o", "depth", "--format", "png"], True),
        (["rgb", "depth", "-o", ".", "--format", "png"], False),
        (["rgb", "depth", "-o", "rgb/out"], False),
    ],
)
def test_results_beside_their_inputs_are_resumed_or_refused(few, capsys, arguments, fails):
    before = {path: path.read_bytes() for path in Path().rglob("*.*") if path.is_file()}
    assert batch(*arguments, *LENS_OPTIONS) == (2 if fails else 0)
    if fails:
        assert "name another folder, such as -o" in capsys.readouterr().err
        assert before == {path: path.read_bytes() for path in Path().rglob("*.*") if path.is_file()}
    else:
        capsys.readouterr()
        assert batch(*arguments, *LENS_OPTIONS) == 0
        assert "0 written, 4 there already" in capsys.readouterr().err


def test_names_as_long_as_the_file_system_has_them(few, capsys):
    name = "n" * 248
    Path("rgb/0000.exr").rename(f"rgb/{name}.exr")
    Path("depth/0000_depth.pfm").rename(f"depth/{name}.pfm")
    arguments = [
        "rgb",
        "depth",
        "-o",
        "out",
        *LENS_OPTIONS,
        "--outputs",
        "picture,mask,stack",
        "--slices",
        "2",
    ]
    assert batch(*arguments) == 0
    assert len(list(Path("out").iterdir())) == 4 * 5 + 1
    assert batch(*arguments) == 0
    assert "0 written, 4 there already" in capsys.readouterr().err


def test_one_bad_pixel_does_not_cost_a_frame(few, capsys):
    rgbd = io.read_color("rgb/0001.exr").pixels
    rgbd[5, 6, 1] = np.nan
    io.write_image("rgb/0001.exr", rgbd)
    arguments = ["rgb", "depth", "-o", "out", *LENS_OPTIONS]
    assert batch(*arguments) == 1
    said = capsys.readouterr().err
    assert "out/0001.exr: color has 1 pixel that is not finite" in said
    assert "row 5, column 6. Pass --invalid-color fill" in said
    assert batch(*arguments, "--invalid-color", "fill") == 0
    assert capsys.readouterr().err.startswith("dofsim: color has 1 pixel that is not finite")
    assert json.loads(Path("out/0001.exr.json").read_text())["filled_pixels"] == 1
    assert "filled_pixels" not in json.loads(Path("out/0002.exr.json").read_text())
    assert batch(*arguments, "--invalid-color", "black") == 2
    assert '--invalid-color must be one of "raise", "fill"; got "black"' in capsys.readouterr().err


def test_one_absurd_depth_does_not_cost_a_frame(few, capsys):
    depth = io.read_depth("depth/0001_depth.pfm")
    depth[5, 6] = 1e-6
    io.write_depth("depth/0001_depth.pfm", depth)
    arguments = ["rgb", "depth", "-o", "out", *LENS_OPTIONS]
    assert batch(*arguments) == 1
    said = capsys.readouterr().err
    assert "out/0001.exr: depth has 1 of " in said
    assert "row 5, column 6. Pass --max-coc-px to bound the radius" in said
    assert batch(*arguments, "--max-coc-px", "30", "--outputs", "picture,coc") == 0
    assert np.abs(io.read_exr("out/0001.coc.exr")["coc"]).max() <= 30.0
    assert batch(*arguments, "--max-coc-px", "-1") == 2
    assert "--max-coc-px must be a radius in pixels" in capsys.readouterr().err
    assert batch(*arguments, "--max-coc-px", "3", "--set", "max_coc_px=3") == 2
    assert "--max-coc-px is given twice" in capsys.readouterr().err


def test_a_range_in_focus_comes_from_the_command_line_a_file_or_a_row(few, capsys):
    words = {name: value for name, value in LENS.items() if name != "focus_distance"}
    ranged = dofsim.Lens(**words, in_focus=(1.5, np.inf))
    rgbd = io.read_rgbd("rgb/0001.exr", "depth/0001_depth.pfm")
    wanted = dofsim.render(*rgbd, ranged)
    stated = [f"--{name.replace('_', '-')}={value}" for name, value in words.items()]
    arguments = ["rgb", "depth", *stated]
    assert batch(*arguments, "-o", "one", "--in-focus=1.5,inf", "--outputs", "picture,coc") == 0
    np.testing.assert_array_equal(io.read_color("one/0001.exr").pixels, wanted)
    np.testing.assert_array_equal(io.read_exr("one/0001.coc.exr")["coc"], dofsim.coc(rgbd.depth, ranged))
    # A focus on the command line goes before that of the file, and that of a row before both.
    lines = [f"{name} = {value}" for name, value in words.items()]
    Path("lens.toml").write_text("\n".join([*lines, "in_focus = [1.5, inf]"]))
    assert batch("rgb", "depth", "-o", "two", "--lens", "lens.toml") == 0
    np.testing.assert_array_equal(io.read_color("two/0001.exr").pixels, wanted)
    row = {"color": "rgb/0001.exr", "depth": "depth/0001_depth.pfm"}
    rows = [{**row, "output": "a", "in_focus": [1.5, 1e9]}, {**row, "output": "b"}]
    Path("rows.jsonl").write_text("\n".join(map(json.dumps, rows)))
    from_rows = ["--manifest", "rows.jsonl", "-o", "three", "--lens", "lens.toml"]
    assert batch(*from_rows, "--focus-distance", "2") == 0
    np.testing.assert_allclose(io.read_color("three/a.exr").pixels, wanted, atol=1e-4)
    plane = dofsim.render(*rgbd, dofsim.Lens(**words, focus_distance=2.0))
    np.testing.assert_array_equal(io.read_color("three/b.exr").pixels, plane)
    capsys.readouterr()
    for value, text in (("2", "NEAR,FAR; got '2'"), ("3,2", "--in-focus must be two distances in metres")):
        assert batch(*arguments, "-o", "four", "--in-focus", value) == 2
        assert text in capsys.readouterr().err
    assert batch(*arguments, "-o", "four", "--focus-distance=2", "--in-focus=2,3") == 2
    assert "--focus-distance and --in-focus exclude each other" in capsys.readouterr().err


def test_the_picture_of_an_opening_is_not_overwritten(few, capsys):
    Path("out").mkdir()
    io.write_image("out/0001.png", np.ones((9, 9)))
    before = Path("out/0001.png").read_bytes()
    Path("lens.toml").write_text('[aperture]\nimage = "out/0001.png"\n')
    arguments = ["rgb", "depth", "-o", "out", "--format", "png", "--lens", "lens.toml"]
    assert batch(*arguments, *LENS_OPTIONS) == 2
    assert "0001.png: is one of the inputs" in capsys.readouterr().err
    assert Path("out/0001.png").read_bytes() == before


def test_a_dry_run_writes_nothing_and_checks_all(few, capsys):
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, "--dry-run") == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[1] == "rgb/0001.exr + depth/0001_depth.pfm -> out/0001.exr"
    assert len(out.splitlines()) == 4
    assert re.search(r"rgb/0000.exr: depth [\d.]+ to [\d.]+ m; the largest blur radius is [\d.]+ px\n", err)
    assert "4 frames; nothing was written" in err
    assert not Path("out").exists()
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, "--dry-run", "--method", "fast") == 2
    # What is wrong with the first frame is wrong with all, as a rule.
    capsys.readouterr()
    arguments = ["rgb", "depth", "-o", "out", "--aperture-radius", "0.1", "--fov", "40", "--dry-run"]
    assert batch(*arguments, "--focus-at", "9000,1") == 2
    out, err = capsys.readouterr()
    assert len(out.splitlines()) == 4
    assert "dofsim: rgb/0000.exr: --focus-at: x must lie within" in err
    tiny = ["--aperture-radius", "1e-6", "--focus-distance", "3", "--fov", "40"]
    assert batch("rgb", "depth", "-o", "out", *tiny, "--dry-run") == 0
    assert "dofsim: rgb/0000.exr: the blur is too small to see" in capsys.readouterr().err
    assert not Path("out").exists()


def test_the_first_frames_alone(few, capsys):
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, "--limit", "2") == 0
    assert sorted(path.name for path in Path("out").glob("*.exr")) == ["0000.exr", "0001.exr"]
    assert "2 written" in capsys.readouterr().err


def test_an_output_keeps_its_suffix(few):
    Path("frames.csv").write_text(
        "color,depth,output\nrgb/0000.exr,depth/0000_depth.pfm,a/b.png\nrgb/0001.exr,depth/0001_depth.pfm,c.d\n"
    )
    assert batch("--manifest", "frames.csv", "-o", "out", *LENS_OPTIONS) == 0
    assert io.read_color("out/a/b.png").transfer == "srgb"
    assert Path("out/c.d.exr").is_file()


def test_the_distribution_of_the_blur_is_said_and_recorded(few, capsys):
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS) == 0
    said = capsys.readouterr().err
    assert re.search(
        r"\nout: depth [\d.]+ to [\d.]+ m; the largest blur radius of a frame is [\d.]+ px \(median\), ", said
    )
    assert re.search(r"\(median\), [\d.]+ to [\d.]+ px from the 5th to the 95th percentile\n", said)
    largest = []
    for index in range(4):
        depth = io.read_depth(f"depth/{index:04}_depth.pfm")
        radius = np.abs(dofsim.coc(depth, dofsim.Lens(**LENS)))
        record = json.loads(Path(f"out/{index:04}.exr.json").read_text())
        assert record["blur_radius_px"]["max"] == pytest.approx(radius.max(), abs=1e-3)
        assert record["blur_radius_px"]["median"] == pytest.approx(np.median(radius), abs=1e-3)
        assert record["depth_range"] == pytest.approx([depth.min(), depth.max()])
        largest.append(radius.max())
    summary = json.loads(Path("out/summary.json").read_text())
    assert summary["frames"] == 4
    assert (summary["depth_unit"], record["depth_unit"]) == ("m", "m")
    assert summary["largest_blur_radius_px"]["median"] == pytest.approx(np.median(largest), rel=1e-2)
    # Frames that were there already count, too.
    Path("out/summary.json").unlink()
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS) == 0
    assert json.loads(Path("out/summary.json").read_text()) == summary


def test_a_batch_without_blur_is_warned_of(few, capsys):
    tiny = ["--aperture-radius", "1e-6", "--focus-distance", "3", "--fov", "40"]
    assert batch("rgb", "depth", "-o", "out", *tiny) == 0
    assert (
        "dofsim: 4 of 4 frames, the first is 0000.exr: the blur is too small to see"
        in capsys.readouterr().err
    )


def test_depth_of_integers_needs_a_meaning_in_a_batch(few, capsys):
    for path in Path("depth").iterdir():
        io.write_depth(f"{path.stem}.png", io.read_depth(path), scale=0.001)
        path.unlink()
        Path(f"{path.stem}.png").rename(f"depth/{path.stem}.png")
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS) == 1
    err = capsys.readouterr().err
    assert err.count("--depth-scale 0.001 for millimetres") == 4
    assert not list(Path("out").glob("*.exr"))
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, "--depth-scale", "0.001") == 0


@pytest.fixture
def sequence(tmp_path, monkeypatch):
    """Write three frames of which the last has a hand before the camera."""
    monkeypatch.chdir(tmp_path)
    wall = np.linspace(3.0, 9.0, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
    for index in range(3):
        depth = wall.copy()
        depth[:12, :14] = 60.0 if index == 2 else 9.0
        io.write_image(f"{index}.png", np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
        np.save(f"{index}.npy", depth)


def blur_of_the_wall(*options):
    lens = ["--strength-percent", "10", "--focus", "1", "--depth-kind", "relative", "--outputs", "coc"]
    assert batch("*.png", "*.npy", "-o", "out", *lens, *options) == 0
    return [io.read_depth(f"out/{index}.coc.exr", channel="coc")[20:] for index in range(3)]


def test_relative_depth_has_one_scale_in_all_frames(sequence, capsys):
    first, _, last = blur_of_the_wall()
    np.testing.assert_array_equal(first, last)
    assert "relative depth from" in capsys.readouterr().err
    # That of frames which are no sequence, if asked for; or a given one.
    first, _, last = blur_of_the_wall("--depth-range", "each")
    assert np.abs(first - last).max() > 0.5
    first, _, last = blur_of_the_wall("--depth-range", "3,9")
    np.testing.assert_array_equal(first, last)


def test_a_scale_that_is_given_may_be_of_any_size(sequence):
    for index in range(3):
        np.save(f"{index}.npy", 1e-5 * np.load(f"{index}.npy"))
    blur_of_the_wall("--depth-range", "3e-5,9e-5")


def test_one_frame_says_its_depth_and_its_blur(few, capsys):
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, "--limit", "1") == 0
    assert re.search(
        r"out: depth [\d.]+ to [\d.]+ m; the largest blur radius is [\d.]+ px\n", capsys.readouterr().err
    )
    relative = ["--depth-kind", "relative", "--strength-px", "3", "--focus", "0", "--depth-range", "each"]
    assert batch("rgb", "depth", "-o", "out2", *relative, "--limit", "1") == 0
    assert re.search(r"out2: relative disparity [\d.]+ to [\d.]+; the largest", capsys.readouterr().err)
    assert json.loads(Path("out2/summary.json").read_text())["depth_unit"] == ""


def test_a_manifest_is_told_of_in_its_own_words(few, capsys):
    Path("m.csv").write_text("color,depth,aperture\nrgb/0000.exr,depth/0000_depth.pfm,1\n")
    assert batch("--manifest", "m.csv", "-o", "out", *LENS_OPTIONS) == 2
    message = capsys.readouterr().err
    assert (
        'm.csv, line 2: a frame has no "aperture"; it has color, depth, holdout, output, focus_at, '
        "aperture_radius" in message
    )
    assert "--" not in message
    Path("m.csv").write_text("color,depth,focus_distance\nrgb/0000.exr,depth/0000_depth.pfm,near\n")
    assert batch("--manifest", "m.csv", "-o", "out", *LENS_OPTIONS) == 2
    assert "m.csv, line 2: focus_distance must be a number; got 'near'" in capsys.readouterr().err
    Path("m.csv").write_text('color,depth,focus_at\nrgb/0000.exr,depth/0000_depth.pfm,"near"\n')
    assert batch("--manifest", "m.csv", "-o", "out", *LENS_OPTIONS) == 2
    assert "m.csv, line 2: focus_at takes a column and a row, X,Y; got 'near'" in capsys.readouterr().err
