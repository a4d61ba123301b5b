"""Relative depth as whole numbers, which pictures of 8 and 16 bits hold."""

import logging

import dofsim
import numpy as np
import pytest
from dofsim import io
from dofsim.batch import Frame, map_frames
from dofsim.cli import run

HEIGHT, WIDTH = 60, 80
LENS = dofsim.Lens.from_disparity(strength_px=8.0, focus=1.0)
TYPES = [np.uint8, np.uint16]


def scene(dtype):
    """Give a picture, and disparity that uses a part of what the type can hold."""
    rng = np.random.default_rng(15)
    greatest = np.iinfo(dtype).max
    codes = np.kron(rng.integers(greatest // 8, greatest // 2, (6, 8)), np.ones((10, 10))).astype(dtype)
    return rng.random((HEIGHT, WIDTH, 3), dtype=np.float32), codes


@pytest.mark.parametrize("dtype", TYPES)
def test_whole_numbers_are_parts_of_their_greatest_value(dtype):
    color, codes = scene(dtype)
    parts = codes.astype(np.float32) / np.float32(np.iinfo(dtype).max)
    for words in ({}, {"depth_range": (0.0, 1.0)}, {"depth_range": (0.0, 1.0), "refine": True}):
        words["depth_kind"] = "relative"
        out = dofsim.render(color, codes, LENS, **words)
        np.testing.assert_array_equal(out, dofsim.render(color, parts, LENS, **words))
    radii = [dofsim.coc(d, LENS, depth_kind="relative") for d in (codes, parts)]
    np.testing.assert_array_equal(*radii)
    focused = [LENS.focused_at(d, 9, 7, depth_kind="relative") for d in (codes, parts)]
    assert focused[0] == focused[1]
    refined = [dofsim.refine_depth(color, d, depth_kind="relative") for d in (codes, parts)]
    np.testing.assert_array_equal(*refined)


@pytest.mark.parametrize("dtype", TYPES)
def test_their_scale_makes_no_difference(dtype):
    """The percentiles of a picture are 0 and 1, whatever the numbers count."""
    color, codes = scene(dtype)
    out = dofsim.coc(codes, LENS, depth_kind="relative")
    np.testing.assert_allclose(out, dofsim.coc(np.float64(codes), LENS, depth_kind="relative"), atol=1e-5)
    # One channel of three, as OpenCV reads a grey picture.
    view = np.dstack([codes] * 3)[..., 1]
    assert not view.flags.c_contiguous
    np.testing.assert_array_equal(
        dofsim.render(color, view, LENS, depth_kind="relative"),
        dofsim.render(color, codes, LENS, depth_kind="relative"),
    )


def test_a_range_is_of_all_that_they_can_be():
    codes = np.array([[0, 51, 255]], np.uint8)
    radius = dofsim.coc(codes, LENS, depth_kind="relative", depth_range=(0.0, 1.0))
    np.testing.assert_allclose(radius, 8.0 * (1.0 - np.array([[0.0, 0.2, 1.0]])), atol=1e-6)


def test_a_report_is_of_them_too(caplog):
    color, codes = scene(np.uint8)
    with caplog.at_level(logging.INFO, "dofsim.render"):
        dofsim.render(color, codes, LENS, depth_kind="relative")
    assert "relative disparity" in caplog.text
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


@pytest.mark.parametrize("dtype", [*TYPES, np.int32, np.int64])
@pytest.mark.parametrize("kind", ["z", "inverse_z", "disparity", "relative"])
def test_where_they_would_need_a_unit_they_are_refused(dtype, kind):
    color, codes = scene(np.uint8)
    if kind == "relative" and dtype in TYPES:
        return
    text = "depth must have dtype float16, float32"
    hint = 'whole numbers, which have no unit, are for depth_kind="relative"'
    words = {"depth_kind": kind}
    metric = dofsim.Lens(aperture_radius=0.1, focus_distance=2, fov=40)
    lens = LENS if kind in ("disparity", "relative") else metric
    for call in (
        lambda depth: dofsim.render(color, depth, lens, **words),
        lambda depth: dofsim.coc(depth, lens, **words),
        lambda depth: lens.focused_at(depth, 3, 3, **words),
        lambda depth: dofsim.Scene(color, depth, **words),
    ):
        with pytest.raises(TypeError, match=text) as caught:
            call(codes.astype(dtype))
        assert (dtype in TYPES) == (hint in str(caught.value))


def test_files_of_them_are_read_by_the_command_line_and_batches(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    color, codes = scene(np.uint8)
    io.write_image("a.exr", color, dtype="float")
    io.write_image("d.png", codes)
    words = ["--depth-kind", "relative", "--strength-px", "8", "--focus", "1", "-q"]
    assert run(["render", "a.exr", "d.png", "-o", "o.npy", *words]) == 0
    expected = dofsim.render(color, codes, LENS, depth_kind="relative")
    # A file holds the numbers themselves: of any scale, and rounded otherwise.
    assert np.sqrt(np.mean((np.load("o.npy") - expected) ** 2)) < 0.01
    frame = Frame(
        color="a.exr",
        depth="d.png",
        output="out/a.npy",
        lens={"strength_px": 8.0, "focus": 1.0},
        options={"depth_kind": "relative"},
    )
    (result,) = map_frames([frame])
    assert result.error is None
    np.testing.assert_array_equal(np.load("out/a.npy"), np.load("o.npy"))
