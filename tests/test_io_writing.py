"""What becomes of light and alpha on the way into a file, and of the file when writing fails."""

import os
import stat
from pathlib import Path

import numpy as np
import pytest
from dofsim import io

# Names


@pytest.mark.parametrize("letter", ["a", "\N{GREEK SMALL LETTER ALPHA}"])
def test_a_name_may_be_as_long_as_the_file_system_has_it(tmp_path, letter):
    name = letter * (248 // len(letter.encode())) + ".exr"
    assert len(name.encode()) == 252
    io.write_image(tmp_path / name, np.ones((2, 3)))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert io.read_color(tmp_path / name).pixels.shape == (2, 3)


# Light and alpha


def test_fields_of_packed_records_are_written_in_order(tmp_path):
    values = np.arange(12, dtype=np.float32).reshape(3, 4)
    records = np.zeros(values.shape, [("label", "u1"), ("z", "f4")])
    records["z"] = values
    unaligned = np.frombuffer(b"." + values.tobytes(), np.uint8)[1:].view(np.float32).reshape(3, 4)
    for given in (records["z"], unaligned, values.astype(">f4")):
        for suffix in ("exr", "pfm", "tif", "npy"):
            path = tmp_path / f"a.{suffix}"
            io.write_depth(path, given)
            np.testing.assert_array_equal(io.read_depth(path), values)
            io.write_image(path, given)
            np.testing.assert_array_equal(io.read_color(path).pixels, values)


def test_linear_floats_become_srgb_integers_and_back(tmp_path):
    # Code values of IEC 61966-2-1: 0.5 is 187.5 and 0.0025 is 8.24 of 255.
    path = tmp_path / "a.png"
    io.write_image(path, np.array([[0.0, 0.0025, 0.5, 1.0, 7.0, -1.0, np.nan]]))
    image = io.read_color(path)
    np.testing.assert_array_equal(image.pixels, [[0, 8, 188, 255, 255, 0, 0]])
    np.testing.assert_allclose(image.to_linear()[0, :4], [0, 0.0025, 0.5, 1.0], rtol=0.04)
    io.write_image(path, np.array([[0.5]]), dtype="uint16")
    np.testing.assert_array_equal(io.read_color(path).pixels, [[48192]])


def test_integers_keep_their_codes_unless_they_are_linear(tmp_path):
    path = tmp_path / "a.png"
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16)
    io.write_image(path, codes)
    np.testing.assert_array_equal(io.read_color(path).pixels, codes)
    io.write_image(path, codes, transfer="linear")
    assert io.read_color(path).pixels[0, 10] == 56
    io.write_image(tmp_path / "a.exr", codes)
    np.testing.assert_allclose(io.read_color(tmp_path / "a.exr").pixels[11, 12], 0.5029, atol=1e-4)


def test_alpha_is_premultiplied_in_exr_and_straight_in_png(tmp_path):
    pixels = np.array([[[0.25, 0.125, 0.0, 0.5], [0.0, 0.0, 0.0, 0.0]]])
    io.write_image(tmp_path / "a.exr", pixels)
    np.testing.assert_array_equal(io.read_color(tmp_path / "a.exr").pixels, pixels)
    io.write_image(tmp_path / "a.png", pixels)
    image = io.read_color(tmp_path / "a.png")
    np.testing.assert_array_equal(image.pixels, [[[188, 137, 0, 128], [0, 0, 0, 0]]])
    np.testing.assert_allclose(image.to_linear(), pixels, atol=3e-3)
    io.write_image(tmp_path / "b.exr", image.pixels)
    np.testing.assert_allclose(io.read_color(tmp_path / "b.exr").pixels, pixels, atol=3e-3)


@pytest.mark.parametrize(
    ("name", "pixels", "options", "message"),
    [
        ("a.bmp", np.zeros((2, 2)), {}, "suffix"),
        ("a.png", np.zeros((2, 2, 5)), {}, "shape"),
        ("a.png", np.zeros((2, 2), np.int32), {}, "int32"),
        ("a.png", np.zeros((0, 2)), {}, "without pixels"),
        ("a.png", np.zeros((2, 2)), {"dtype": "half"}, "uint8 or uint16"),
        ("a.png", np.zeros((2, 2)), {"depth": np.ones((2, 2))}, "write_depth"),
        ("a.exr", np.zeros((2, 2)), {"depth": np.ones((2, 3))}, "depth must have shape"),
        ("a.exr", np.zeros((2, 2)), {"compression": "dwaa"}, "compression"),
        ("a.exr", np.zeros((2, 2)), {"transfer": "srgb"}, "linear light"),
        ("a.pfm", np.zeros((2, 2, 4)), {}, "alpha"),
    ],
)
def test_what_a_format_cannot_hold_is_said(tmp_path, name, pixels, options, message):
    with pytest.raises(ValueError, match=message):
        io.write_image(tmp_path / name, pixels, **options)
    assert list(tmp_path.iterdir()) == []


# Where files go


def test_nothing_is_left_behind_and_the_old_file_stays_when_writing_fails(tmp_path):
    path = tmp_path / "a.exr"
    io.write_depth(path, np.ones((2, 2)))
    before = path.read_bytes()
    with pytest.raises(ValueError, match="ASCII"):
        io.write_exr(path, {"Tiefe\u00fc": np.ones((2, 2))})
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", [".exr", ".png", ".tif", ".pfm", ".npy", ".npz"])
def test_files_are_replaced_whole(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    for value in (0.25, 0.5):
        io.write_image(path, np.full((4, 4), value))
    assert list(tmp_path.iterdir()) == [path]
    np.testing.assert_allclose(io.read_color(path).to_linear(), 0.5, atol=0.01)
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask


def test_writing_follows_a_symbolic_link(tmp_path):
    (tmp_path / "real").mkdir()
    target, link = tmp_path / "real" / "a.png", tmp_path / "link.png"
    target.write_bytes(b"old")
    link.symlink_to(target)
    io.write_image(link, np.zeros((2, 2)))
    assert link.is_symlink()
    assert io.read_color(target).pixels.shape == (2, 2)


@pytest.mark.parametrize("suffix", [".exr", ".png", ".npy"])
def test_errors_of_the_system_keep_their_class(tmp_path, suffix):
    with pytest.raises(FileNotFoundError) as caught:
        io.write_image(tmp_path / "missing" / f"a{suffix}", np.zeros((2, 2)))
    assert caught.value.filename == str(tmp_path / "missing" / f"a{suffix}")
    with pytest.raises(FileNotFoundError):
        io.read_color(tmp_path / f"missing{suffix}")
    with pytest.raises(IsADirectoryError):
        io.read_color(tmp_path)


@pytest.mark.skipif(os.name != "posix", reason="permission bits")
def test_an_unwritable_folder_is_a_permission_error(tmp_path):
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(0o500)
    if os.access(folder, os.W_OK):
        # The superuser may write anywhere but into the process file system.
        with pytest.raises(OSError, match="/proc"):
            io.write_image("/proc/a.png", np.zeros((2, 2)))
    else:
        with pytest.raises(PermissionError):
            io.write_image(folder / "a.png", np.zeros((2, 2)))
    assert list(folder.iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="devices")
def test_a_device_is_not_replaced(tmp_path):
    link = tmp_path / "null.png"
    link.symlink_to("/dev/null")
    with pytest.raises(ValueError, match="device"):
        io.write_image(link, np.zeros((2, 2)))
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
