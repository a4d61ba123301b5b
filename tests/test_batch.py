"""Many frames: what is written, what is recorded, and that nothing is lost."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import weakref
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import count
from multiprocessing import get_context
from pathlib import Path

import dofsim
import numpy as np
import pytest
from dofsim import io
from dofsim.batch import Frame, map_frames, pair_files, work
from dofsim.batch.workers import process_pool

LENS = {"aperture_radius": 0.3, "focus_distance": 3.0, "fov": 40.0}
HEIGHT, WIDTH = 40, 56
COUNT = 50
TRUNCATED, MISMATCHED, NAN = 7, 20, 33


def make_scene(seed):
    """Make a small picture and its depth: a square before a wall before the sky."""
    rng = np.random.default_rng(seed)
    color = rng.random((HEIGHT, WIDTH, 3), dtype=np.float32)
    depth = np.full((HEIGHT, WIDTH), 6.0, np.float32)
    top, left = rng.integers(20, size=2)
    depth[top : top + 20, left : left + 20] = 1.5
    depth[0] = np.inf
    return color, depth


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Make a data set of which three frames are bad."""
    root = tmp_path_factory.mktemp("data")
    for folder in ("rgb", "depth"):
        root.joinpath(folder).mkdir()
    for index in range(COUNT):
        color, depth = make_scene(index)
        if index == MISMATCHED:
            depth = depth[:-1]
        if index == NAN:
            depth = np.full_like(depth, np.nan)
        io.write_image(root / f"rgb/{index:04}.exr", color)
        io.write_depth(root / f"depth/{index:04}.pfm", depth)
    truncated = root / f"rgb/{TRUNCATED:04}.exr"
    whole = truncated.read_bytes()
    truncated.write_bytes(whole[: len(whole) // 2])
    return root


@pytest.fixture
def data(made, tmp_path, monkeypatch):
    """Go to a folder with a copy of the data set."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def frames(output="out", **changes):
    return [
        Frame(color=color, depth=depth, output=f"{output}/{name}.exr", lens=LENS, **changes)
        for name, (color, depth) in pair_files("rgb", "depth").pairs.items()
    ]


def statuses(results):
    return [result.status for result in results]


def contents(folder):
    """Give the bytes of all files by name; hidden ones are what a killed process left."""
    return {p.name: p.read_bytes() for p in Path(folder).iterdir() if not p.name.startswith(".")}


# Good frames, bad frames


def test_bad_frames_are_results_and_the_others_are_written(data):
    results = list(map_frames(frames(), failures="failures.jsonl"))
    bad = [TRUNCATED, MISMATCHED, NAN]
    assert [i for i, result in enumerate(results) if result.status == "failed"] == bad
    assert statuses(results).count("written") == COUNT - 3
    assert len(list(Path("out").glob("*.exr"))) == COUNT - 3
    lines = [json.loads(line) for line in Path("failures.jsonl").read_text().splitlines()]
    assert [Path(line["output"]).stem for line in lines] == [f"{index:04}" for index in bad]
    assert [Path(line["color"]).stem for line in lines] == [f"{index:04}" for index in bad]
    assert "rgb/0007.exr" in lines[0]["error"]
    assert "the picture is 56 x 40, its depth 56 x 39" in lines[1]["error"]
    assert "NaN" in lines[2]["error"]


def test_failures_are_those_of_the_last_run(data):
    list(map_frames(frames()[TRUNCATED : TRUNCATED + 1], failures="failures.jsonl"))
    list(map_frames(frames()[:2], failures="failures.jsonl"))
    assert not Path("failures.jsonl").exists()


def test_a_frame_is_what_render_gives(data):
    frame = frames(options={"method": "gaussian", "aperture": dofsim.Aperture()})[0]
    (result,) = map_frames([frame])
    color, depth = io.read_rgbd(frame.color, frame.depth)
    expected = dofsim.render(color, depth, dofsim.Lens(**LENS), method="gaussian")
    assert result.status == "written"
    np.testing.assert_array_equal(io.read_color(frame.output).pixels, expected)
    assert np.abs(expected - color).max() > 0.1


def test_all_outputs_of_a_frame(data):
    outputs = ("picture", "coc", "mask", "stack")
    frame = frames(outputs=outputs, slices=3, sharp_radius_px=0.4, options={"threads": 1})[0]
    (result,) = map_frames([frame])
    assert result.error is None
    color, depth = io.read_rgbd(frame.color, frame.depth)
    lens = dofsim.Lens(**LENS)
    radius = dofsim.coc(depth, lens)
    np.testing.assert_array_equal(io.read_exr("out/0000.coc.exr")["coc"], radius)
    mask = io.read_color("out/0000.mask.png").pixels
    np.testing.assert_array_equal(mask, np.where(np.abs(radius) <= 0.4, 255, 0))
    # Evenly in disparity between 1.5 m and 6 m, which the sky is behind.
    record = json.loads(frame.record.read_text())
    assert list(record["stack"].values()) == pytest.approx([1.5, 2.4, 6.0])
    for name, distance in record["stack"].items():
        sliced = io.read_color(f"out/0000.{name}.exr").pixels
        expected = dofsim.render(color, depth, lens.replace(focus_distance=distance))
        np.testing.assert_array_equal(sliced, expected)


def test_the_mask_has_both_values(data):
    frame = frames(outputs=("mask",))[0]
    list(map_frames([replace(frame, lens={**LENS, "focus_distance": 6.0})]))
    assert set(np.unique(io.read_color("out/0000.mask.png").pixels)) == {0, 255}


def test_a_random_focus_is_recorded_and_depends_on_the_seed_alone(data):
    first = frames(focus_at="random", seed=5)[0]
    list(map_frames([first]))
    record = json.loads(first.record.read_text())
    x, y = record["focus_at"]
    _, depth = io.read_rgbd(first.color, first.depth)
    assert np.isfinite(depth[y, x])
    assert record["lens"]["focus_distance"] == pytest.approx(depth[y, x])
    again = replace(first, output="again/0000.exr")
    list(map_frames([again]))
    assert again.output.read_bytes() == first.output.read_bytes()
    pixels = set()
    for seed in range(8):
        other = replace(first, output=f"seed/{seed}.exr", seed=seed)
        list(map_frames([other]))
        pixels.add(tuple(json.loads(other.record.read_text())["focus_at"]))
    assert len(pixels) == 8


def of_kind(kind, z):
    """Give metric depth in another kind, roughly: as if all rays were as long as on the axis."""
    near = 0.1
    with np.errstate(divide="ignore"):
        return {
            "z": (z, {}),
            "distance": (z, {}),
            "inverse_z": (1.0 / z, {}),
            "zbuffer": (1.0 - near / z, {"near": near, "far": float("inf")}),
            "distance_from_near": (np.where(np.isinf(z), 0.0, z - near), {"near": near}),
        }[kind]


@pytest.mark.parametrize("kind", ["z", "distance", "inverse_z", "zbuffer", "distance_from_near"])
def test_the_background_is_not_focused_on_in_any_kind_of_depth(tmp_path, kind):
    z = np.full((HEIGHT, WIDTH), np.inf)
    z[10:14, 20:30] = np.linspace(2.0, 4.0, 10)
    depth, words = of_kind(kind, z)
    io.write_image(tmp_path / "a.exr", np.full((HEIGHT, WIDTH, 3), 0.5), depth=depth)
    options = {"depth_kind": kind, **words}
    frame = Frame(color=tmp_path / "a.exr", output=tmp_path / "b.exr", lens=LENS, options=options)
    for seed in range(4):
        (result,) = map_frames([replace(frame, focus_at="random", seed=seed)])
        assert result.error is None
        record = json.loads(frame.record.read_text())
        x, y = record["focus_at"]
        assert record["lens"]["focus_distance"] == pytest.approx(z[y, x], rel=0.1)
    (result,) = map_frames([replace(frame, outputs=("stack",), slices=2)])
    assert result.error is None
    stack = json.loads(frame.record.read_text())["stack"]
    assert list(stack.values()) == pytest.approx([2.0, 4.0], rel=0.1)


@pytest.mark.parametrize("kind", ["relative", "disparity"])
def test_every_relative_disparity_can_be_focused_on(tmp_path, kind):
    disparity = np.random.default_rng(2).uniform(-9.0, 3.0, (HEIGHT, WIDTH)).astype(np.float32)
    io.write_image(tmp_path / "a.exr", np.full((HEIGHT, WIDTH, 3), 0.5), depth=disparity)
    words = {"strength_percent": 1.0, "focus": 0.5}
    frame = Frame(
        color=tmp_path / "a.exr", output=tmp_path / "b.exr", lens=words, options={"depth_kind": kind}
    )
    focused = set()
    for seed in range(6):
        (result,) = map_frames([replace(frame, focus_at="random", seed=seed)])
        assert result.error is None
        x, y = json.loads(frame.record.read_text())["focus_at"]
        focused.add(bool(disparity[y, x] > 0.0))
    assert focused == {False, True}
    (result,) = map_frames([replace(frame, outputs=("stack",), slices=2)])
    assert result.error is None
    lens = dofsim.Lens.from_disparity(**words)
    ends = [divmod(int(i), WIDTH) for i in (disparity.argmax(), disparity.argmin())]
    expected = [lens.focused_at(disparity, x, y, depth_kind=kind).focus for y, x in ends]
    stack = json.loads(frame.record.read_text())["stack"]
    assert list(stack.values()) == pytest.approx(expected)


# Resuming


def test_what_is_done_is_skipped(data):
    few = frames()[:4]
    assert statuses(map_frames(few)) == ["written"] * 4
    before = {path.name: path.stat().st_mtime_ns for path in Path("out").iterdir()}
    assert statuses(map_frames(few)) == ["skipped"] * 4
    assert {path.name: path.stat().st_mtime_ns for path in Path("out").iterdir()} == before
    assert statuses(map_frames(few, resume=False)) == ["written"] * 4


@pytest.mark.parametrize(
    "change",
    [
        {"lens": {**LENS, "fov": 41.0}},
        {"options": {"method": "gaussian"}},
        {"options": {"aperture": dofsim.Aperture(blades=6)}},
        {"reading": {"depth_scale": 2.0}},
        {"dtype": "half"},
        {"focus_at": (3, 3)},
        {"outputs": ("picture", "mask")},
    ],
)
def test_other_parameters_are_another_frame(data, change):
    frame = frames()[0]
    list(map_frames([frame]))
    assert statuses(map_frames([replace(frame, **change)])) == ["written"]
    assert statuses(map_frames([replace(frame, **change)])) == ["skipped"]
    assert statuses(map_frames([frame])) == ["written"]


def test_the_number_of_threads_is_no_parameter(data):
    frame = frames()[0]
    list(map_frames([frame]))
    assert statuses(map_frames([replace(frame, options={"threads": 1})])) == ["skipped"]


@pytest.mark.parametrize("which", ["color", "depth"])
def test_a_changed_input_is_rendered_anew(data, which):
    frame = frames()[0]
    list(map_frames([frame]))
    os.utime(getattr(frame, which), ns=(1, 1))
    assert statuses(map_frames([frame])) == ["written"]


def test_an_output_that_is_gone_or_cut_is_rendered_anew(data):
    frame = frames()[0]
    list(map_frames([frame]))
    whole = frame.output.read_bytes()
    frame.output.write_bytes(whole[:-1])
    assert statuses(map_frames([frame])) == ["written"]
    assert frame.output.read_bytes() == whole
    frame.output.unlink()
    assert statuses(map_frames([frame])) == ["written"]
    frame.record.write_text('{"fingerprint": 3')
    assert statuses(map_frames([frame])) == ["written"]


def test_a_run_that_ends_between_the_outputs_leaves_no_record(data, monkeypatch):
    frame = frames()[0]
    list(map_frames([frame]))
    other = replace(frame, lens={**LENS, "focus_distance": 6.0}, outputs=("picture", "coc"))

    def write_exr(*_):
        raise OSError(errno.EIO, "broken", "out/0000.coc.exr")

    with monkeypatch.context() as patch:
        patch.setattr(io, "write_exr", write_exr)
        (result,) = map_frames([other])
    assert (result.status, result.error) == ("failed", "out/0000.coc.exr: broken")
    # The picture is the other lens's by now.
    assert statuses(map_frames([frame])) == ["written"]


KILLED = """
import sys
from concurrent.futures import ProcessPoolExecutor
from dofsim.batch import Frame, map_frames, pair_files

def work():
    lens = {"aperture_radius": 0.3, "focus_distance": 3.0, "fov": 40.0}
    frames = [
        Frame(color=c, depth=d, output=f"killed/{n}.exr", lens=lens, outputs=("picture", "coc", "mask"))
        for n, (c, d) in pair_files("rgb", "depth").pairs.items()
    ]
    print("started", flush=True)
    for result in map_frames(frames):
        pass

if __name__ == "__main__":
    work()
"""


@pytest.mark.skipif(os.name != "posix", reason="kills the POSIX way")
def test_killed_at_any_moment_and_resumed(data):
    outputs = ("picture", "coc", "mask")
    expected = statuses(map_frames(frames("whole", outputs=outputs)))
    rng = np.random.default_rng()
    done = []
    # On a busy machine more of them end before the first frame is written.
    while len(done) < 20 or (done[-1] == 0 and len(done) < 500):
        child = subprocess.Popen([sys.executable, "-c", KILLED], stdout=subprocess.PIPE, text=True)
        with child:
            assert child.stdout.readline() == "started\n"
            time.sleep(rng.uniform(0.02, 0.25))
            child.send_signal(signal.SIGKILL)
        done.append(len(list(Path("killed").glob("*.json"))) if Path("killed").is_dir() else 0)
    assert done == sorted(done)
    results = list(map_frames(frames("killed", outputs=outputs)))
    assert statuses(results).count("failed") == 3
    assert statuses(results).count("skipped") >= done[-1] > 0
    assert [s.replace("skipped", "written") for s in statuses(results)] == expected
    assert contents("killed") == contents("whole")


# Side by side


@pytest.mark.parametrize("workers", [1, 2])
def test_processes_give_the_same_bits(data, workers):
    here = statuses(map_frames(frames("here")))
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        assert statuses(map_frames(frames("there"), executor=pool, in_flight=4)) == here
        assert statuses(map_frames(frames("there")[:3], executor=pool)) == ["skipped"] * 3
    assert contents("here") == contents("there")


@pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")
def test_workers_leave_ctrl_c_to_the_run():
    with process_pool(1) as pool:
        worker = pool.submit(os.getpid).result()
        frame = pool.submit(time.sleep, 0.6)
        time.sleep(0.3)
        os.kill(worker, signal.SIGINT)
        assert frame.exception() is None


@pytest.mark.parametrize("threads", [1, 2])
def test_threads_give_the_same_bits(data, threads):
    list(map_frames(frames("all")[:8]))
    list(map_frames(frames("some", options={"threads": threads})[:8]))
    pictures = {name: bits for name, bits in contents("some").items() if name.endswith(".exr")}
    assert pictures == {name: contents("all")[name] for name in pictures}
    assert len(pictures) == 7


def test_frames_are_taken_as_there_is_room(data):
    taken = count()

    def endless():
        for index in taken:
            yield replace(frames()[0], output=f"out/{index}.exr")

    results = map_frames(endless())
    for index in range(5):
        assert next(results).status == "written"
        # Two to be read or computed and two to be written, and this one.
        assert next(taken) <= 2 * index + 5
    before = threading.active_count()
    results.close()
    assert threading.active_count() < before


def test_no_more_than_five_frames_are_held(data, monkeypatch):
    held, most = [], []

    def counted(kind):
        def make(**words):
            made = kind(**words)
            held.append(weakref.ref(made))
            most.append(sum(one() is not None for one in held))
            return made

        return make

    monkeypatch.setattr(work, "Loaded", counted(work.Loaded))
    monkeypatch.setattr(work, "Rendered", counted(work.Rendered))
    list(map_frames(frames()))
    assert 2 <= max(most) <= 5


def test_a_full_disk_ends_the_run_and_names_the_frame(data, monkeypatch):
    def write_image(path, *_, **__):
        raise OSError(errno.ENOSPC, "No space left on device", f".{path}.part")

    monkeypatch.setattr(io, "write_image", write_image)
    with pytest.raises(OSError, match="No space left") as caught:
        list(map_frames(frames()))
    assert caught.value.filename == str(Path("out/0000.exr"))


def test_two_frames_of_one_output_are_refused(data):
    first, second = frames()[:2]
    with pytest.raises(ValueError, match=r"out.0000\.exr: an earlier frame"):
        list(map_frames([first, replace(second, output=first.output)]))


def test_one_output_is_one_however_it_is_spelt(data):
    first, second = frames()[:2]
    for spelling in ("out/../out/0000.exr", Path("out/0000.exr").absolute()):
        with pytest.raises(ValueError, match=r"0000\.exr: an earlier frame"):
            list(map_frames([first, replace(second, output=spelling)]))
    assert not Path("out").exists()


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("kind", [list, iter])
def test_no_frame_overwrites_what_another_reads(data, order, kind):
    first, second = frames()[:2]
    before = second.color.read_bytes()
    pair = [replace(first, output="rgb/../rgb/0001.exr"), second][::order]
    with pytest.raises(ValueError, match=r"rgb.0001\.exr: is one of the inputs"):
        list(map_frames(kind(pair)))
    assert second.color.read_bytes() == before


def test_the_last_of_many_frames_is_looked_at_before_the_first_is_written(data):
    first, *others, last = frames()
    with pytest.raises(ValueError, match="is one of the inputs"):
        list(map_frames([replace(first, output=last.color), *others, last]))
    assert not Path("out").exists()


def test_inputs_are_not_overwritten(data):
    frame = replace(frames()[0], output="rgb/0000.exr")
    before = frame.color.read_bytes()
    (result,) = map_frames([frame])
    assert "is one of the inputs" in result.error
    assert frame.color.read_bytes() == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"outputs": ()}, "outputs must be some of picture"),
        ({"outputs": ("photo",)}, "outputs must be some of picture"),
        ({"outputs": ("stack",)}, "slices must be positive"),
        ({"slices": 3}, "slices must be positive"),
        ({"sharp_radius_px": float("nan")}, "sharp_radius_px must be positive"),
    ],
)
def test_frames_that_are_none(words, message):
    with pytest.raises(ValueError, match=message):
        Frame(color="a.exr", output="b.exr", lens=LENS, **words)


# Names


@pytest.mark.parametrize(
    ("color", "depth", "where"),
    [
        ("rgb/a/1.png", "depth/a/1.exr", ("rgb", "depth")),
        ("x/1_rgb.png", "x/1_depth.png", ("x/*_rgb.png", "x/*_depth.png")),
        ("x/color-1.png", "x/depth-1.png", ("x/color-*", "x/depth-*")),
        ("x/f.0.color.png", "y/f.0.depth_meters.npy", ("x", "y")),
        ("s/a/rgb/1.png", "s/a/rgb/1.pfm", ("s/**/*.png", "s/**/*.pfm")),
        ("one.png", "two_one.npy", ("one.png", None)),
    ],
)
def test_pairs(tmp_path, monkeypatch, color, depth, where):
    monkeypatch.chdir(tmp_path)
    for path in (color, depth):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).touch()
    found = pair_files(*where)
    partner = None if where[1] is None else Path(depth)
    assert list(found.pairs.values()) == [(Path(color), partner)]
    assert found.unmatched == []


def test_pairs_that_are_none(data):
    Path("rgb/color_0001.exr").touch()
    with pytest.raises(ValueError, match="is frame '0001', and so is"):
        pair_files("rgb", "depth")
    with pytest.raises(FileNotFoundError):
        pair_files("nowhere")
    with pytest.raises(ValueError, match="there is no file"):
        pair_files("rgb/*.png")
    with pytest.raises(ValueError, match=r"no file of rgb.* pairs with one of depth"):
        pair_files("rgb/000?.exr", "depth/004?.pfm")
    Path("depth/0001.pfm").unlink()
    Path("rgb/color_0001.exr").unlink()
    assert pair_files("rgb", "depth").unmatched == [Path("rgb/0001.exr")]
