"""Pictures go where the caller wants them, without a copy, and their memory is used again."""

import gc
import os
import subprocess
import sys

import dofsim
import numpy as np
import pytest

H, W = 48, 64
LENS = dofsim.Lens(aperture_radius=0.1, focus_distance=2.0, fov=42.0)
SEED = np.random.default_rng(7)
COLOR = SEED.random((H, W, 3), dtype=np.float32)
DEPTH = np.repeat(np.linspace(1.0, 6.0, W, dtype=np.float32)[None], H, axis=0)


@pytest.mark.parametrize("method", ["lens", "poisson", "gaussian", "hexagonal", "levels", "taps", "sprites"])
def test_out_holds_the_picture_and_is_returned(method):
    expected = dofsim.render(COLOR, DEPTH, LENS, method=method)
    out = np.full_like(COLOR, np.nan)
    assert dofsim.render(COLOR, DEPTH, LENS, method=method, out=out) is out
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, np.uint8, np.uint16])
@pytest.mark.parametrize(
    "frame", [{}, {"overscan": 4}, {"supersample": 2}, {"overscan": 3, "supersample": 2}]
)
def test_every_dtype_and_frame(dtype, frame):
    integer = np.issubdtype(dtype, np.integer)
    color = (COLOR * (np.iinfo(dtype).max if integer else 1)).astype(dtype)
    scene = dofsim.Scene(color, DEPTH, transfer="srgb" if integer else None, **frame)
    expected = scene.render(LENS)
    scale, margin = frame.get("supersample", 1), frame.get("overscan", 0)
    assert expected.shape == (H // scale - 2 * margin, W // scale - 2 * margin, 3)
    out = np.full_like(expected, 7)
    scene.render(LENS, out=out)
    np.testing.assert_array_equal(out, expected)
    stack = np.full((2, *expected.shape), 7, dtype)
    assert scene.focal_stack(LENS, [2.0, 3.0], out=stack) is stack
    np.testing.assert_array_equal(stack[0], expected)
    np.testing.assert_array_equal(stack, scene.focal_stack(LENS, [2.0, 3.0]))


def test_the_margin_is_cut_off():
    lens = dofsim.Lens.from_disparity(strength_px=8, focus=0.3)
    whole = dofsim.render(COLOR, 1 / DEPTH, lens, depth_kind="disparity")
    inner = dofsim.render(COLOR, 1 / DEPTH, lens, depth_kind="disparity", overscan=5)
    np.testing.assert_array_equal(inner, whole[5:-5, 5:-5])


def test_out_may_be_the_picture_itself():
    expected = dofsim.render(COLOR, DEPTH, LENS)
    color = COLOR.copy()
    dofsim.render(color, DEPTH, LENS, out=color)
    np.testing.assert_array_equal(color, expected)


def test_nothing_is_written_beside_out():
    around = np.full((H + 2, W, 3), -1, np.float32)
    dofsim.render(COLOR, DEPTH, LENS, out=around[1:-1])
    assert (around[[0, -1]] == -1).all()
    assert (around[1:-1] >= 0).all()


def read_only():
    array = np.zeros((H, W, 3), np.float32)
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    ("out", "error", "message"),
    [
        ([1, 2], TypeError, "out must be a NumPy array"),
        (np.zeros((H, W, 3)), TypeError, "out must have the dtype of color, float32; got float64"),
        (np.zeros((H, W), np.float32), ValueError, r"out must have shape \[48, 64, 3\]; got \[48, 64\]"),
        (np.zeros((H, W, 6), np.float32)[..., ::2], ValueError, "out must be C-contiguous"),
        (read_only(), ValueError, "out must be writable"),
    ],
)
def test_arrays_that_cannot_be_written_into(out, error, message):
    with pytest.raises(error, match=message):
        dofsim.render(COLOR, DEPTH, LENS, out=out)


def test_pictures_stay_what_they_are_while_others_are_made():
    """Memory is handed on only when its picture is gone."""
    scene = dofsim.Scene(COLOR, DEPTH)
    kept = [scene.render(LENS.replace(focus_distance=f)) for f in (1.5, 2.0, 3.0)]
    copies = [picture.copy() for picture in kept]
    for _ in range(20):
        scene.render(LENS.replace(focus_distance=5.0))
        dofsim.render(COLOR[::-1].copy(), DEPTH, LENS, method="hexagonal")
    gc.collect()
    for picture, copy in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(picture, copy)
        assert picture.flags.writeable
        assert picture.flags.c_contiguous


MEMORY = """
import numpy as np, resource, sys
import dofsim

def rss_mb():
    with open("/proc/self/statm") as f:
        return int(f.read().split()[1]) * resource.getpagesize() / 2**20

lens = dofsim.Lens(aperture_radius=0.05, focus_distance=2.0, fov=42.0)
color = np.random.default_rng(0).random((600, 800, 3), dtype=np.float32)
depth = np.repeat(np.linspace(1.0, 6.0, 800, dtype=np.float32)[None], 600, axis=0)
depth[200:400, 300:500] = 0.8
for _ in range(5):
    dofsim.render(color, depth, lens)
early = rss_mb()
for _ in range(30):
    dofsim.render(color, depth, lens)
late = rss_mb()
# Frames of another size leave what those before needed to the system.
for _ in range(30):
    dofsim.render(color[:100, :100].copy(), depth[:100, :100].copy(), lens)
print(early, late, rss_mb())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_is_flat_and_given_back():
    run = subprocess.run(
        [sys.executable, "-c", MEMORY], capture_output=True, text=True, check=True, env={**os.environ}
    )
    early, late, small = map(float, run.stdout.split())
    assert late - early < 8, run.stdout
    assert late - small > 30, run.stdout
