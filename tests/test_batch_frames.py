"""The frames that `dofsim batch` finds: lists, sequences, and files with and without a partner."""

import json
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
)
from dofsim import io
from dofsim.batch import pair_files, read_manifest


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
        ("a.csv", "color,colour\na.png,b.png\n", r'a\.csv, line 2: a frame has no "colour"; it has color'),
        ("a.csv", "color\na.png,b.png\n", "line 2: the line has more cells than"),
        ("a.csv", "color,f_number\na.png,\nb.png,wide\n", "line 3: f_number must be a number; got 'wide'"),
        ("a.csv", "color,focus_at\na.png,5\n", "line 2: focus_at takes a column and a row"),
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
    with pytest.raises(ValueError, match="no file of a pairs with one of b") as caught:
        pair_files("a", "b")
    assert f"the closest names are {Path('a/shot_0001.png')} and {Path('b/shot_0002.png')}" in str(
        caught.value
    )
    assert "manifest" in str(caught.value)


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
