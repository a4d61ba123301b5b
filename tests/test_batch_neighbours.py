"""Frames of a shot that get what the frames beside them saw."""

import json
from dataclasses import replace

import dofsim
import numpy as np
import pytest
from dofsim import Camera, io
from dofsim.batch import Frame, map_frames, with_neighbours, work
from dofsim.cameras import write_cameras
from dofsim.cli import run
from oracle.cards import Card, Cards, pose, stripes
from scipy.ndimage import gaussian_filter

SCENE = Cards([Card((0, 0, 4), (9, 9)), Card((0.0, 0, 0.8), (0.12, 0.2), stripes)], width=64, height=48)
FOV = float(np.degrees(2 * np.arctan(0.32)))
LENS = {"aperture_radius": 0.04, "focus_distance": 4.0, "fov": FOV}
POSES = [pose(0.04 * (i - 2)) for i in range(5)]
CAMERAS = [
    Camera(one, SCENE.intrinsics, (SCENE.width, SCENE.height), f"shot/{i:04}.exr")
    for i, one in enumerate(POSES)
]


@pytest.fixture
def shot(tmp_path):
    pictures = [SCENE.pinhole(one) for one in POSES]
    for i, (color, depth) in enumerate(pictures):
        io.write_image(tmp_path / f"{i:04}.exr", color.astype(np.float32), depth=depth)
    write_cameras(tmp_path / "cameras.json", CAMERAS)
    return tmp_path


def frames(folder):
    return [
        Frame(color=folder / f"{i:04}.exr", output=folder / "out" / f"{i:04}.exr", lens=LENS, dtype="float")
        for i in range(5)
    ]


def expected(folder, number, others, seen=lambda color, depth: depth):
    pictures = [io.read_rgbd(folder / f"{i:04}.exr") for i in (number, *others)]
    lens = dofsim.Lens(**LENS)
    layers, depths = dofsim.layers_from_views(
        [color for color, _ in pictures],
        [seen(color, depth) for color, depth in pictures],
        np.stack([POSES[i] for i in (number, *others)]),
        SCENE.intrinsics,
        lens=lens,
    )
    assert len(layers) > 1
    return dofsim.render(layers, depths, lens)[..., :3]


def test_each_frame_gets_what_its_neighbours_saw(shot):
    results = list(map_frames(with_neighbours(frames(shot), CAMERAS, 2)))
    assert [one.status for one in results] == ["written"] * 5, results
    for number, others in ((0, (1, 2)), (2, (1, 3)), (4, (3, 2))):
        picture = io.read_color(shot / "out" / f"{number:04}.exr").pixels
        np.testing.assert_array_equal(picture, expected(shot, number, others))
    record = json.loads((shot / "out" / "0002.exr.json").read_text())
    assert record["layers"] > 1
    assert [one["color"][-8:] for one in record["neighbours"]] == ["0001.exr", "0003.exr"]


def test_depth_is_refined_before_layers_are_made(shot, monkeypatch):
    for i, one in enumerate(POSES):
        color, depth = SCENE.pinhole(one)
        soft = 1.0 / gaussian_filter(1.0 / depth, 2.0)
        io.write_image(shot / f"{i:04}.exr", color.astype(np.float32), depth=soft)
    made = []
    original = dofsim.Scene
    monkeypatch.setattr(
        dofsim, "Scene", lambda *given, **words: made.append(words) or original(*given, **words)
    )
    wanted = [replace(one, options={"refine": True}) for one in frames(shot)]
    [result] = map_frames(with_neighbours(wanted, CAMERAS, 2)[2:3])
    assert result.status == "written", result
    picture = io.read_color(shot / "out" / "0002.exr").pixels
    np.testing.assert_array_equal(picture, expected(shot, 2, (1, 3), dofsim.refine_depth))
    # One scene, of the layers.
    assert len(made) == 1


def test_pictures_are_read_once_and_few_are_kept(shot, monkeypatch):
    read = []
    original = work.read_framed

    def counted(color, *others, **words):
        read.append(color.name)
        return original(color, *others, **words)

    monkeypatch.setattr(work, "read_framed", counted)
    monkeypatch.setattr(work, "_PICTURES", work.Pictures())
    results = list(map_frames(with_neighbours(frames(shot), CAMERAS, 2)))
    assert [one.status for one in results] == ["written"] * 5
    assert sorted(read) == [f"{i:04}.exr" for i in range(5)]
    assert len(work._PICTURES._kept) == 4


def test_a_run_is_resumed_unless_a_neighbour_has_changed(shot):
    again = with_neighbours(frames(shot), CAMERAS, 2)
    list(map_frames(again))
    assert [one.status for one in map_frames(again)] == ["skipped"] * 5
    color, depth = SCENE.pinhole(POSES[0])
    io.write_image(shot / "0000.exr", color.astype(np.float32) + 1.0, depth=depth)
    assert [one.status for one in map_frames(again)] == ["written"] * 2 + ["skipped"] * 3
    moved = [one.moved(down=0.001) if i == 4 else one for i, one in enumerate(CAMERAS)]
    changed = map_frames(with_neighbours(frames(shot), moved, 2))
    assert [one.status for one in changed] == ["skipped"] * 3 + ["written"] * 2


def test_the_command_line(shot, tmp_path):
    out = tmp_path / "rendered"
    words = ["--aperture-radius", "0.04", "--focus-distance", "4", "--fov", str(FOV), "--dtype", "float"]
    arguments = ["batch", f"{shot}/####.exr", "-o", str(out), *words]
    shared = [*arguments, "--cameras", str(shot / "cameras.json")]
    assert run([*shared, "--neighbours", "2", "--limit", "1"]) == 0
    assert [path.name for path in out.glob("*.exr")] == ["0000.exr"]
    np.testing.assert_array_equal(io.read_color(out / "0000.exr").pixels, expected(shot, 0, (1, 2)))
    assert run(shared) == 2
    assert run([*arguments, "--neighbours", "2"]) == 2


def test_what_does_not_fit_is_said(shot):
    with pytest.raises(ValueError, match=r"0001.exr: no camera has the name '0001'"):
        with_neighbours(frames(shot), CAMERAS[:1], 2)
    small = [Camera(one.pose, one.intrinsics, (32, 24), one.name) for one in CAMERAS]
    [result, *_] = map_frames(with_neighbours(frames(shot), small, 2))
    assert "is of 64 x 48 pixels, and its camera of 32 x 24" in result.error
    with pytest.raises(ValueError, match="camera must be given with neighbours"):
        Frame(
            **{**vars(frames(shot)[0]), "neighbours": with_neighbours(frames(shot), CAMERAS, 1)[0].neighbours}
        )


def test_a_holdout_goes_with_neighbours(shot):
    matte = np.zeros((SCENE.height, SCENE.width), np.float32)
    matte[:, 30:] = 1.0
    picture = np.dstack([np.zeros((*matte.shape, 3), np.float32), matte])
    io.write_image(shot / "roto.exr", picture, depth=np.full(matte.shape, 0.5), dtype="float")
    wanted = [replace(one, holdout=shot / "roto.exr") for one in frames(shot)]
    [result] = map_frames(with_neighbours(wanted, CAMERAS, 2)[2:3])
    assert result.status == "written", result
    out = io.read_color(shot / "out" / "0002.exr").pixels
    assert not out[:, 50:].any()
    bare = expected(shot, 2, (1, 3))
    np.testing.assert_allclose(out[:, :8], bare[:, :8], atol=2e-2)
    inverse = [replace(one, options={"depth_kind": "inverse_z"}) for one in wanted]
    [result] = map_frames(with_neighbours(inverse, CAMERAS, 2)[2:3])
    assert result.status == "failed"
    assert "holdout goes with neighbours for depth_kind='z'" in result.error
