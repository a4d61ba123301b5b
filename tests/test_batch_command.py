"""The `dofsim batch` command: which frames it finds, which lenses it draws, what it says and how it ends."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import dofsim
import numpy as np
import pytest
from dofsim import io
from dofsim.batch import pair_files, read_manifest
from dofsim.cli import run
from interrupts import HANG_S

LENS = {"aperture_radius": 0.3, "focus_distance": 3.0, "fov": 40.0}
LENS_OPTIONS = ["--aperture-radius", "0.3", "--focus-distance", "3", "--fov", "40"]
HEIGHT, WIDTH = 40, 56
COUNT = 50
TRUNCATED, MISMATCHED, NAN = 7, 20, 33


@pytest.fixture
def data(tmp_path, monkeypatch):
    """Go to a folder with a data set of which three frames are bad."""
    monkeypatch.chdir(tmp_path)
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
    return tmp_path


@pytest.fixture
def few(data):
    """Leave four good frames of the data set."""
    for path in [*data.glob("rgb/*"), *data.glob("depth/*")]:
        if not path.name.startswith(("0000", "0001", "0002", "0003")):
            path.unlink()


def batch(*arguments):
    return run(["batch", *(str(argument) for argument in arguments)])


def contents(folder):
    runs = ("failures.jsonl", "summary.json")
    return {p.name: p.read_bytes() for p in Path(folder).iterdir() if p.name not in runs}


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


def test_pictures_with_depth_and_files_without_partner(few, capsys):
    color, depth = io.read_rgbd("rgb/0000.exr", "depth/0000_depth.pfm")
    Path("both/a").mkdir(parents=True)
    io.write_image("both/a/1.exr", color, depth=depth)
    Path("both/notes.txt").touch()
    assert batch("both", "-o", "both/out", *LENS_OPTIONS) == 0
    np.testing.assert_array_equal(
        io.read_color("both/out/a/1.exr").pixels, dofsim.render(color, depth, dofsim.Lens(**LENS))
    )
    # Results are no frames.
    capsys.readouterr()
    assert batch("both", "-o", "both/out", *LENS_OPTIONS) == 0
    assert "0 written, 1 there already" in capsys.readouterr().err
    Path("depth/0003_depth.pfm").unlink()
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS) == 0
    err = capsys.readouterr().err
    assert err.startswith("dofsim: rgb/0003.exr: has no partner and is left out\n")
    assert "3 written" in err


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


# Manifests


@pytest.mark.parametrize("kind", ["csv", "jsonl"])
def test_a_manifest_has_a_lens_for_each_frame(few, kind):
    Path("lists").mkdir()
    if kind == "csv":
        text = (
            "color,depth,output,focus_distance,focus_at\n"
            "../rgb/0000.exr,../depth/0000_depth.pfm,a/b,4.0,\n"
            '../rgb/0001.exr,../depth/0001_depth.pfm,,,"5,6"\n'
            "../rgb/0002.exr,../depth/0002_depth.pfm,,,\n"
        )
    else:
        rows = [
            {
                "color": "../rgb/0000.exr",
                "depth": "../depth/0000_depth.pfm",
                "output": "a/b",
                "focus_distance": 4,
            },
            {"color": "../rgb/0001.exr", "depth": "../depth/0001_depth.pfm", "focus_at": [5, 6], "fov": None},
            {"color": "../rgb/0002.exr", "depth": "../depth/0002_depth.pfm"},
        ]
        text = "\n".join(json.dumps(row) for row in rows) + "\n\n"
    Path(f"lists/frames.{kind}").write_text(text)
    assert batch("--manifest", f"lists/frames.{kind}", "-o", "out", *LENS_OPTIONS) == 0
    lens = dofsim.Lens(**LENS)
    depths = [io.read_depth(f"depth/{index:04}_depth.pfm") for index in range(3)]
    lenses = [lens.replace(focus_distance=4.0), lens.focused_at(depths[1], 5, 6), lens]
    for index, name in enumerate(["a/b", "0001", "0002"]):
        color = io.read_color(f"rgb/{index:04}.exr").pixels
        expected = dofsim.render(color, depths[index], lenses[index])
        np.testing.assert_array_equal(io.read_color(f"out/{name}.exr").pixels, expected)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "color,colour\na.png,b.png\n", r"a\.csv, line 2: colour is not one of"),
        ("a.csv", "color\na.png,b.png\n", "line 2: None is not one of"),
        ("a.csv", "color,f_number\na.png,\nb.png,wide\n", "line 3: f_number must be a number; got 'wide'"),
        ("a.csv", "color,focus_at\na.png,5\n", "line 2: --focus-at takes a column and a row"),
        ("a.csv", "color,output\na.png,../b\n", "line 2: output must be within"),
        ("a.csv", "depth\na.png\n", "line 2: color is missing"),
        ("a.csv", "color\n", "there is no frame"),
        ("a.csv", b"color\n\xff\n", "not a text file"),
        ("a.jsonl", '{"color": "a.png"}\n{"color"\n', r"a\.jsonl, line 2: "),
        ("a.jsonl", "[]\n", "line 1: expected an object"),
        ("a.jsonl", "[" * 100_000, "line 1: it is nested too deeply"),
        ("a.jsonl", '{"color": 3}\n', "line 1: "),
        ("a.jsonl", b"\xff\n", "not a text file"),
        ("a.txt", "", "a manifest is a .csv or a .jsonl file"),
    ],
)
def test_manifests_that_are_none(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ValueError, match=message):
        read_manifest(path)


# Refusals, before any work


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "out"], "give either COLOR"),
        (["rgb", "--manifest", "a.csv", "-o", "out"], "give either COLOR"),
        (["nowhere", "-o", "out"], "nowhere: No such file or directory"),
        (["rgb", "depth", "-o", "rgb", *LENS_OPTIONS], "is one of the inputs"),
        (["rgb", "depth", "-o", "out"], "the lens is not complete"),
        (["rgb", "depth", "-o", "out", *LENS_OPTIONS, "--random-f-number", "1,2"], "has no --"),
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


# The end of a run


# A shell has its background jobs ignore Ctrl-C, and what they start inherits that.
START = """
import signal
from dofsim.cli import main

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    main()
"""


def start(*arguments):
    command = [sys.executable, "-c", START, "batch", *arguments]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def wait_for(condition):
    deadline = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def records():
    return len(list(Path("out").glob("*.json")))


@pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")
@pytest.mark.parametrize("workers", ["1", "2"])
def test_ctrl_c_ends_cleanly_and_the_next_run_resumes(data, capsys, workers):
    # Views enough that 50 frames take much longer than a look at what is there.
    arguments = ["rgb", "depth", *LENS_OPTIONS, "--set", "views=2048", "--workers", workers]
    child = start(*arguments, "-o", "out")
    wait_for(lambda: records() >= 2)
    # As a terminal does: to all of its processes.
    os.killpg(child.pid, signal.SIGINT)
    _, err = child.communicate(timeout=HANG_S)
    assert child.returncode == 1
    assert err.splitlines()[-1] == "dofsim: interrupted"
    assert "Traceback" not in err
    done = records()
    assert 2 <= done < 47
    assert not list(Path("out").glob(".*"))
    assert batch(*arguments, "-o", "out") == 1
    assert f"{47 - done} written, {done} there already, 3 failed" in capsys.readouterr().err


# A frame whose picture is to end whoever reads it, as one does that takes more memory than there is, while
# another file is being written.
DEADLY = """
import os
from pathlib import Path
from dofsim import io
from dofsim.cli import main

def read_rgbd(color, *arguments, **words):
    if color.name == "0001.exr":
        Path(f"out/.0002.exr.{os.getpid()}-9.part").touch()
        os._exit(1)
    return read(color, *arguments, **words)

read, io.read_rgbd = io.read_rgbd, read_rgbd
if __name__ == "__main__":
    main()
"""


def run_deadly(*arguments):
    Path("deadly.py").write_text(DEADLY)
    command = [sys.executable, "deadly.py", "batch", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANG_S)


def test_a_frame_that_kills_its_worker_is_one_failure(few):
    arguments = ["rgb", "depth", *LENS_OPTIONS, "-o", "out", "--workers", "2"]
    for skipped in (0, 3):
        result = run_deadly(*arguments)
        assert result.returncode == 1
        assert f"{3 - skipped} written, {skipped} there already, 1 failed" in result.stderr
        (failure,) = map(json.loads, Path("out/failures.jsonl").read_text().splitlines())
        assert failure["color"] == str(Path("rgb/0001.exr"))
        assert failure["error"].startswith("the process that computed it was killed")
        assert not list(Path("out").glob(".*"))
    assert batch(*arguments) == 0


def test_a_frame_that_kills_the_run_is_computed_apart_the_next_time(few):
    arguments = ["rgb", "depth", *LENS_OPTIONS, "-o", "out"]
    assert run_deadly(*arguments).returncode == 1
    assert not Path("out/failures.jsonl").exists()
    result = run_deadly(*arguments)
    assert ", 1 failed" in result.stderr
    assert len(list(Path("out").glob("*.exr"))) == 3
    assert not list(Path("out").glob(".*"))


def test_one_run_at_a_time_writes_into_a_folder(data, capsys):
    arguments = ["rgb", "depth", *LENS_OPTIONS, "-o", "out", "--set", "views=2048"]
    child = start(*arguments)
    wait_for(lambda: records() >= 2)
    assert batch(*arguments) == 2
    message = f"out: another dofsim batch is writing there (process {child.pid})"
    assert message in capsys.readouterr().err
    assert child.poll() is None
    child.terminate()
    child.communicate(timeout=HANG_S)


def test_what_a_living_process_writes_is_not_removed(few):
    Path("out").mkdir()
    mine = Path(f"out/.0001.exr.{os.getpid()}-4.part")
    mine.touch()
    assert batch("rgb", "depth", *LENS_OPTIONS, "-o", "out") == 0
    assert mine.exists()


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


@pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")
def test_workers_end_with_a_killed_run_and_its_unfinished_files_go(data, capsys):
    arguments = ["rgb", "depth", *LENS_OPTIONS, "--workers", "2"]
    child = start(*arguments, "-o", "out")
    wait_for(lambda: records() >= 2)
    child.kill()
    # The workers hold the other ends of these pipes.
    child.communicate(timeout=HANG_S)
    left = Path("out/.0040.exr.123-4.part")
    left.touch()
    other = Path("out/.0099.exr.123-4.part")
    other.touch()
    done = records()
    assert batch(*arguments, "-o", "out") == 1
    assert f"{47 - done} written, {done} there already" in capsys.readouterr().err
    assert not left.exists()
    assert other.exists()


# Sequences, and a first look


@pytest.fixture
def shots(tmp_path, monkeypatch):
    """Go to a folder with two sequences in one folder, and with what is not of them."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    Path("shots").mkdir()
    for number in (1, 2, 10, 12345):
        io.write_image(f"shots/shot.beauty.{number:04}.exr", rng.random((HEIGHT, WIDTH, 3), dtype=np.float32))
        io.write_depth(f"shots/shot.depth.{number:04}.exr", rng.uniform(2, 9, (HEIGHT, WIDTH)))
    io.write_image("shots/shot.beauty.still.exr", np.ones((HEIGHT, WIDTH, 3), np.float32))
    return tmp_path


@pytest.mark.parametrize("number", ["####", "%04d", "#", "%d"])
def test_sequences_are_paired_by_number_and_a_word(shots, capsys, number):
    color, depth = (f"shots/shot.{word}.{number}.exr" for word in ("beauty", "depth"))
    assert batch(color, depth, "-o", "out", *LENS_OPTIONS) == 0
    names = [f"shot.beauty.{one}.exr" for one in ("0001", "0002", "0010", "12345")]
    assert sorted(path.name for path in Path("out").glob("*.exr")) == sorted(names)
    record = json.loads(Path("out/shot.beauty.0010.exr.json").read_text())
    assert record["depth"] == "shots/shot.depth.0010.exr"
    assert "4 written" in capsys.readouterr().err


def test_a_number_in_a_pattern_has_so_many_digits(shots):
    found = pair_files("shots/shot.beauty.#####.exr")
    assert list(found.pairs) == ["shot.beauty.12345"]
    assert pair_files("sh*s/shot.beauty.##*.exr").pairs.keys() >= {"shots/shot.beauty.0001"}


def test_names_that_differ_in_a_word_are_paired_only_where_there_is_no_choice(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in ("a", "b"):
        Path(folder).mkdir()
    for name in ("a/x_rgb_01.png", "a/y_01.png", "b/x_depth_01.png", "b/y_depth_01.png", "b/y_left_01.png"):
        Path(name).touch()
    found = pair_files("a", "b")
    assert {name: depth.name for name, (_, depth) in found.pairs.items()} == {"x_rgb_01": "x_depth_01.png"}
    assert [path.name for path in found.unmatched] == ["y_01.png", "y_depth_01.png", "y_left_01.png"]
    # Numbers are no such word.
    for path in (*Path("a").iterdir(), *Path("b").iterdir()):
        path.unlink()
    Path("a/shot_0001.png").touch()
    Path("b/shot_0002.png").touch()
    with pytest.raises(ValueError, match="none of 1 files of a has the name") as caught:
        pair_files("a", "b")
    assert f"the nearest two are {Path('a/shot_0001.png')} and {Path('b/shot_0002.png')}" in str(caught.value)
    assert "manifest" in str(caught.value)


def test_a_dry_run_writes_nothing_and_checks_all(few, capsys):
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, "--dry-run") == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[1] == "rgb/0001.exr + depth/0001_depth.pfm -> out/0001.exr"
    assert len(out.splitlines()) == 4
    assert "4 frames; nothing was written" in err
    assert not Path("out").exists()
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, "--dry-run", "--method", "fast") == 2


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
    assert "largest blur radius of a frame: " in said
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
