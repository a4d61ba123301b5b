"""Depth as data sets write it: each in its own kind of file, with its own words for nothing."""

import shutil
import struct
import sys
from pathlib import Path

import dofsim
import h5py
import numpy as np
import pytest
from dofsim import io
from dofsim.cli import run
from dofsim.presets import PRESETS

HEIGHT, WIDTH = 24, 32
METRES = np.random.default_rng(2).integers(4, 40, (HEIGHT, WIDTH)) / 4
HOLE = (5, 9)


def write_dpt(path, depth):
    header = struct.pack("<fii", 202021.25, depth.shape[1], depth.shape[0])
    Path(path).write_bytes(header + depth.astype("<f4").tobytes())


def write_hdf5(path, array, **options):
    with h5py.File(path, "w") as file:
        file.create_dataset("dataset", data=array, **options)


def with_hole(value, scale=1.0):
    codes = METRES / scale
    codes[HOLE] = value
    return codes


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    color = np.random.default_rng(3).random((HEIGHT, WIDTH, 3), dtype=np.float32)
    io.write_image("color.exr", color)
    return color


# Preset, file, writer of the depth with its hole, and what the hole becomes.
CASES = [
    ("hypersim", "d.hdf5", lambda path: write_hdf5(path, with_hole(np.nan).astype(np.float16)), np.nan),
    ("kitti", "d.png", lambda path: io.write_depth(path, with_hole(0, 1 / 256)), np.nan),
    ("nyu", "d.png", lambda path: io.write_depth(path, with_hole(0, 1 / 1000)), np.nan),
    ("scannet", "d.png", lambda path: io.write_depth(path, with_hole(0, 1 / 1000)), np.nan),
    ("tum", "d.png", lambda path: io.write_depth(path, with_hole(0, 1 / 5000)), np.nan),
    ("middlebury", "d.pfm", lambda path: io.write_depth(path, with_hole(np.inf)), np.nan),
    ("sintel", "d.dpt", lambda path: write_dpt(path, METRES), METRES[HOLE]),
    ("mitsuba", "d.exr", lambda path: io.write_depth(path, with_hole(0)), 0.0),
    ("blender", "d.exr", lambda path: io.write_depth(path, with_hole(1e10)), np.inf),
]


def test_every_preset_is_tested():
    assert {case[0] for case in CASES} == set(PRESETS)


@pytest.mark.parametrize(("preset", "path", "write", "hole"), CASES)
def test_depth_is_in_metres_and_holes_are_what_they_mean(folder, preset, path, write, hole):
    write(path)
    _, depth = io.read_rgbd("color.exr", path, **PRESETS[preset].reading)
    expected = METRES.copy()
    expected[HOLE] = hole
    np.testing.assert_allclose(depth, expected, rtol=1e-6)


@pytest.mark.parametrize(("preset", "path", "write", "hole"), CASES)
def test_the_command_reads_it(folder, capsys, preset, path, write, hole):
    write(path)
    near = 0.5 if preset == "mitsuba" else None
    if preset == "middlebury":
        Path("lens.toml").write_text("strength_px = 0.5\nfocus = 4.0\n")
        lens = dofsim.Lens.from_disparity(strength_px=0.5, focus=4.0)
        options = ["--lens", "lens.toml"]
    else:
        lens = dofsim.Lens(aperture_radius=0.3, focus_distance=3.0, fov=40.0)
        options = ["--aperture-radius", "0.3", "--focus-distance", "3", "--fov", "40"]
    options += ["--preset", preset, *([] if near is None else ["--near", str(near)])]
    known = not np.isnan(hole)
    status = run(["render", "color.exr", path, "-o", "out.exr", *options])
    assert status == (0 if known else 2)
    assert known or "invalid" in capsys.readouterr().err
    options += ["--invalid", "far"]
    assert run(["render", "color.exr", path, "-o", "out.exr", *options]) == 0
    depth = METRES.astype(np.float32)
    depth[HOLE] = hole
    kind = PRESETS[preset].depth_kind
    expected = dofsim.render(folder, depth, lens, depth_kind=kind, near=near, invalid="far")
    np.testing.assert_allclose(io.read_color("out.exr").pixels, expected, atol=1e-6)
    shutil.copy(path, f"color_depth{Path(path).suffix}")
    assert run(["batch", "color.exr", f"color_depth{Path(path).suffix}", "-o", "out", *options]) == 0
    assert Path("out/color.exr").read_bytes() == Path("out.exr").read_bytes()
    assert run(["coc", path, "-o", "coc.exr", *options]) == 0
    radius = dofsim.coc(depth, lens, depth_kind=kind, near=near, invalid="far")
    np.testing.assert_allclose(io.read_exr("coc.exr")["coc"], radius, atol=1e-5)


def test_what_is_said_outright_goes_before_the_preset(folder):
    io.write_depth("d.png", np.full((HEIGHT, WIDTH), 700), scale=1.0)
    words = ["--aperture-radius", "0.3", "--focus-distance", "3", "--fov", "40", "--preset", "nyu"]
    assert run(["coc", "d.png", "-o", "a.npy", *words, "--depth-scale", "0.01"]) == 0
    lens = dofsim.Lens(aperture_radius=0.3, focus_distance=3.0, fov=40.0)
    depth = np.full((HEIGHT, WIDTH), 7.0)
    np.testing.assert_allclose(np.load("a.npy"), dofsim.coc(depth, lens), atol=1e-6)
    assert (
        run(["coc", "d.png", "-o", "b.npy", *words, "--depth-scale", "0.01", "--depth-kind", "distance"]) == 0
    )
    np.testing.assert_allclose(np.load("b.npy"), dofsim.coc(depth, lens, depth_kind="distance"), atol=1e-6)
    assert run(["coc", "d.png", "-o", "c.npy", *words, "--depth-missing", "700"]) == 2
    assert run(["coc", "d.png", "-o", "c.npy", *words[:-1], "kinect"]) == 2


def test_hypersim_colour(folder):
    write_hdf5("frame.0000.color.hdf5", folder.astype(np.float16), compression="gzip")
    write_hdf5("frame.0000.depth_meters.hdf5", METRES.astype(np.float16))
    words = ["--aperture-radius", "0.3", "--focus-distance", "3", "--fov", "40", "--preset", "hypersim"]
    assert run(["batch", "*.color.hdf5", "*.depth_meters.hdf5", "-o", "out", *words]) == 0
    lens = dofsim.Lens(aperture_radius=0.3, focus_distance=3.0, fov=40.0)
    color = folder.astype(np.float16).astype(np.float32)
    expected = dofsim.render(color, METRES.astype(np.float32), lens, depth_kind="distance")
    np.testing.assert_array_equal(io.read_color("out/frame.0000.exr").pixels, expected)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"PIEH\x02\x00\x00\x00", "ends too early"),
        (struct.pack("<fii", 202021.25, 3, 2) + bytes(20), "its header claims 3 x 2 pixels"),
        (struct.pack("<fii", 202021.25, -3, -2) + bytes(24), "its header claims -3 x -2 pixels"),
        (struct.pack("<fii", 202021.25, 3, 2) + bytes(48), "optical flow"),
    ],
)
def test_damaged_dpt(tmp_path, data, message):
    path = tmp_path / "a.dpt"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=rf"a\.dpt: .*{message}"):
        io.read_depth(path)


def test_damaged_hdf5(folder, monkeypatch):
    write_hdf5("a.hdf5", METRES)
    whole = Path("a.hdf5").read_bytes()
    for length in (8, 100, 1000, len(whole) - 1):
        Path("cut.hdf5").write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"cut\.hdf5"):
            io.read_depth("cut.hdf5")
    with h5py.File("huge.hdf5", "w") as file:
        file.create_dataset("dataset", (60000, 60000), "f4", chunks=(100, 100))
    with pytest.raises(ValueError, match="it claims 14400000000 bytes"):
        io.read_depth("huge.hdf5")
    with pytest.raises(ValueError, match="no data set 'depth'; data sets: dataset"):
        io.read_depth("a.hdf5", channel="depth")
    with h5py.File("a.hdf5", "a") as file:
        file.create_dataset("second", data=METRES)
    with pytest.raises(ValueError, match="name one: dataset, second"):
        io.read_depth("a.hdf5")
    np.testing.assert_array_equal(io.read_depth("a.hdf5", channel="second"), METRES)


def test_hdf5_names_the_package_it_needs(folder, monkeypatch, capsys):
    write_hdf5("a.hdf5", METRES)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ImportError, match=r"pip install '\.\[hdf5\]' in a clone of dofsim"):
        io.read_depth("a.hdf5")


def test_hdf5_written_by_pytables(tmp_path):
    tables = pytest.importorskip("tables")
    with tables.open_file(tmp_path / "d.hdf5", "w") as file:
        file.create_carray("/", "dataset", obj=METRES.astype(np.float16), filters=tables.Filters(5, "zlib"))
    np.testing.assert_array_equal(io.read_depth(tmp_path / "d.hdf5"), METRES)


def test_hdf5_that_has_its_values_in_other_files(folder):
    write_hdf5("other.hdf5", METRES)
    Path("secret").write_bytes(bytes(4 * METRES.size))
    with h5py.File("raw.hdf5", "w") as file:
        file.create_dataset("depth", METRES.shape, np.float32, external=[("secret", 0, 4 * METRES.size)])
    with h5py.File("virtual.hdf5", "w") as file:
        layout = h5py.VirtualLayout(METRES.shape, METRES.dtype)
        layout[:] = h5py.VirtualSource("other.hdf5", "dataset", METRES.shape)
        file.create_virtual_dataset("depth", layout)
    with h5py.File("linked.hdf5", "w") as file:
        file["depth"] = h5py.ExternalLink("other.hdf5", "dataset")
    for name in ("raw", "virtual", "linked"):
        with pytest.raises(ValueError, match=r"are in other files, which are not followed"):
            io.read_depth(f"{name}.hdf5", channel="depth")
    # Nor is a link to elsewhere taken for the only data set.
    with pytest.raises(ValueError, match="several data sets or none"):
        io.read_depth("linked.hdf5")
    with h5py.File("soft.hdf5", "w") as file:
        file["group/depth"] = METRES
        file["depth"] = h5py.SoftLink("/group/depth")
    np.testing.assert_array_equal(io.read_depth("soft.hdf5"), METRES)
