"""Files written by other libraries are read, and files written here are read by other libraries."""

import ctypes
import doctest
import importlib
import os
import struct
import sys
import zipfile

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from dofsim import _dofsim, io
from PIL import Image as PillowImage

COMPRESSIONS = ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"]


@pytest.fixture
def rng():
    return np.random.default_rng(2)


def write_with_openexr(path, channels, **header):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def read_with_openexr(path, part=0):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: channel.pixels for name, channel in file.parts[part].channels.items()}


@pytest.mark.parametrize("module", ["dofsim.io", "dofsim._save", "dofsim._exr"])
def test_examples_of_the_docstrings(module):
    result = doctest.testmod(importlib.import_module(module))
    assert result.attempted > 0
    assert result.failed == 0


# OpenEXR, read


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("tiled", [False, True])
def test_exr_of_every_compression_is_read_as_openexr_reads_it(tmp_path, rng, compression, tiled):
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION")}
    if tiled:
        tiles = OpenEXR.TileDescription()
        tiles.xSize, tiles.ySize = 24, 16
        header |= {"type": OpenEXR.tiledimage, "tiles": tiles}
    path = tmp_path / "a.exr"
    color = rng.random((67, 53, 3)).astype(np.float16)
    depth = rng.random((67, 53)).astype(np.float32)
    write_with_openexr(path, {"RGB": color, "Z": depth}, **header)

    expected = read_with_openexr(path)
    rgbd = io.read_rgbd(path)
    # Decoders of the lossy codecs may differ by a rounding of a half float.
    tolerance = 1e-3 if compression.startswith("DWA") else 0.0
    np.testing.assert_allclose(rgbd.depth, expected["Z"], atol=tolerance)
    for index, name in enumerate("RGB"):
        np.testing.assert_allclose(rgbd.color[..., index], expected[name].astype(np.float32), atol=tolerance)
    assert (rgbd.transfer, rgbd.alpha, rgbd.color.dtype) == ("linear", "none", np.float32)


def test_exr_channels_of_different_types_in_one_part(tmp_path, rng):
    path = tmp_path / "a.exr"
    half = rng.random((5, 7)).astype(np.float16)
    single = rng.random((5, 7)).astype(np.float32)
    integer = rng.integers(0, 2**24, (5, 7)).astype(np.uint32)
    write_with_openexr(path, {"h": half, "f": single, "id": integer})
    channels = io.read_exr(path)
    assert list(channels) == ["f", "h", "id"]
    np.testing.assert_array_equal(channels["h"], half.astype(np.float32))
    np.testing.assert_array_equal(channels["f"], single)
    np.testing.assert_array_equal(channels["id"], integer.astype(np.float32))


def test_exr_of_several_parts(tmp_path, rng):
    path = tmp_path / "a.exr"
    color = rng.random((6, 8, 3)).astype(np.float32)
    depth = rng.random((6, 8)).astype(np.float32)
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage}, {"RGB": color}, "beauty"),
        OpenEXR.Part({"type": OpenEXR.scanlineimage}, {"Z": depth}, "depth"),
    ]
    with OpenEXR.File(parts) as file:
        file.write(str(path))
    assert io.list_channels(path) == ["beauty.B", "beauty.G", "beauty.R", "depth.Z"]
    read_color, read_depth = io.read_rgbd(path)
    np.testing.assert_array_equal(read_color, color)
    np.testing.assert_array_equal(read_depth, depth)


def test_exr_whose_stored_pixels_are_not_those_to_be_seen(tmp_path, rng):
    path = tmp_path / "a.exr"
    color = rng.random((6, 10, 4)).astype(np.float32)
    depth = rng.random((6, 10)).astype(np.float32)
    corner = lambda *xy: np.array(xy, np.int32)  # noqa: E731
    write_with_openexr(
        path,
        {"RGBA": color, "Z": depth},
        dataWindow=(corner(-2, 3), corner(7, 8)),
        displayWindow=(corner(0, 0), corner(8, 6)),
    )
    shown = io.read_rgbd(path)
    assert shown.color.shape == (7, 9, 4)
    expected_color = np.zeros((7, 9, 4), np.float32)
    expected_depth = np.full((7, 9), np.inf, np.float32)
    expected_color[3:7, 0:8] = color[0:4, 2:10]
    expected_depth[3:7, 0:8] = depth[0:4, 2:10]
    np.testing.assert_array_equal(shown.color, expected_color)
    np.testing.assert_array_equal(shown.depth, expected_depth)

    stored = io.read_rgbd(path, window="data")
    np.testing.assert_array_equal(stored.color, color)
    np.testing.assert_array_equal(stored.depth, depth)


def opened(path, read):
    """Count how often a call opens a file. Closings are watched so that openings in a row stay apart."""
    libc = ctypes.CDLL(None, use_errno=True)
    open_mask, close_mask = 0x20, 0x10
    watch = libc.inotify_init()
    assert libc.inotify_add_watch(watch, os.fsencode(path), open_mask | close_mask) >= 0
    try:
        read()
        events = os.read(watch, 1 << 16)
    finally:
        os.close(watch)
    return sum(bool(mask & open_mask) for _, mask, _, _ in struct.iter_unpack("iIII", events))


@pytest.mark.skipif(sys.platform != "linux", reason="openings are counted the Linux way")
@pytest.mark.parametrize("window", ["display", "data"])
def test_a_picture_with_its_depth_is_decoded_once(tmp_path, rng, monkeypatch, window):
    path = tmp_path / "a.exr"
    write_with_openexr(path, {"RGB": rng.random((5, 6, 3)).astype(np.float32), "Z": np.ones((5, 6), "f4")})
    decoded = []
    read_exr = _dofsim.read_exr
    monkeypatch.setattr(
        _dofsim, "read_exr", lambda *args, **words: decoded.append(args) or read_exr(*args, **words)
    )
    # Once each for its kind, for its header and for its pixels.
    assert opened(path, lambda: io.read_rgbd(path, window=window)) == 3
    assert len(decoded) == 1


@pytest.mark.parametrize("channels", [{"RGBA": 4, "Z": 1}, {"Y": 1, "Z": 1}, {"Y": 1}])
@pytest.mark.parametrize("window", ["display", "data"])
def test_a_picture_with_its_depth_is_what_both_are_alone(tmp_path, rng, channels, window):
    path = tmp_path / "a.exr"
    planes = {name: rng.random((5, 6, n)).astype(np.float16) for name, n in channels.items()}
    planes = {name: plane if plane.shape[-1] > 1 else plane[..., 0] for name, plane in planes.items()}
    corner = lambda *xy: np.array(xy, np.int32)  # noqa: E731
    box = (corner(-2, 1), corner(3, 5))
    write_with_openexr(path, planes, dataWindow=box, displayWindow=(corner(0, 0), corner(9, 3)))
    both, color = io.read_rgbd(path, window=window), io.read_color(path, window=window)
    np.testing.assert_array_equal(both.color, color.pixels)
    np.testing.assert_array_equal(both.depth, io.read_depth(path, window=window))
    assert (both.transfer, both.alpha) == (color.transfer, color.alpha)
    assert both.color.flags.c_contiguous
    assert both.depth.flags.c_contiguous


def test_exr_with_alpha_is_premultiplied(tmp_path, rng):
    path = tmp_path / "a.exr"
    color = rng.random((3, 4, 4)).astype(np.float32)
    write_with_openexr(path, {"RGBA": color})
    image = io.read_color(path)
    assert image.alpha == "premultiplied"
    np.testing.assert_array_equal(image.pixels, color)
    np.testing.assert_array_equal(image.to_linear(), color)


# OpenEXR, write


@pytest.mark.parametrize("compression", ["none", "rle", "zips", "zip", "piz"])
def test_written_exr_is_read_by_openexr(tmp_path, rng, compression):
    path = tmp_path / "a.exr"
    color = rng.random((37, 53, 4)).astype(np.float32)
    depth = rng.random((37, 53)).astype(np.float32)
    io.write_image(path, color, depth=depth, compression=compression)
    channels = read_with_openexr(path)
    assert sorted(channels) == ["A", "B", "G", "R", "Z"]
    for index, name in enumerate("RGBA"):
        np.testing.assert_array_equal(channels[name], color[..., index])
    np.testing.assert_array_equal(channels["Z"], depth)


def test_written_half_exr_keeps_depth_in_full(tmp_path, rng):
    path = tmp_path / "a.exr"
    color = rng.random((5, 6, 3))
    depth = rng.random((5, 6)).astype(np.float32)
    io.write_image(path, color, depth=depth, dtype="half")
    channels = read_with_openexr(path)
    assert channels["R"].dtype == np.float16
    np.testing.assert_array_equal(channels["G"], color[..., 1].astype(np.float32).astype(np.float16))
    np.testing.assert_array_equal(channels["Z"], depth)
    with pytest.raises(ValueError, match="65504"):
        io.write_image(path, color * 1e6, dtype="half")


def test_written_parts_are_read_by_openexr(tmp_path, rng):
    path = tmp_path / "a.exr"
    color = {name: rng.random((4, 9)).astype(np.float16) for name in "RGB"}
    ids = rng.integers(0, 2**32, (4, 9), dtype=np.uint32)
    io.write_exr(path, {"beauty": color, "id": {"object": ids}})
    for name in "RGB":
        np.testing.assert_array_equal(read_with_openexr(path, 0)[name], color[name])
    np.testing.assert_array_equal(read_with_openexr(path, 1)["object"], ids)


# PNG


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_png_written_by_opencv(tmp_path, rng, dtype, channels):
    path = tmp_path / "a.png"
    pixels = rng.integers(0, np.iinfo(dtype).max, (9, 11, channels), endpoint=True).astype(dtype)
    order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[channels]
    assert cv2.imwrite(str(path), pixels[..., order])
    image = io.read_color(path)
    assert image.pixels.dtype == dtype
    np.testing.assert_array_equal(image.pixels, pixels[..., 0] if channels == 1 else pixels)
    assert image.transfer == "srgb"
    assert image.alpha == ("straight" if channels == 4 else "none")
    assert io.read_color(path, transfer="linear").transfer == "linear"


def test_png_palette_and_bits_written_by_pillow(tmp_path):
    path = tmp_path / "a.png"
    pixels = np.array([[[255, 0, 0], [0, 128, 255]]], np.uint8)
    PillowImage.fromarray(pixels).quantize(2).save(path)
    np.testing.assert_array_equal(io.read_color(path).pixels, pixels)
    PillowImage.fromarray(np.array([[True, False]])).save(path)
    np.testing.assert_array_equal(io.read_color(path).pixels, [[255, 0]])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_written_png_is_read_by_others(tmp_path, rng, dtype, channels):
    path = tmp_path / "a.png"
    pixels = rng.integers(0, np.iinfo(dtype).max, (9, 11, channels), endpoint=True).astype(dtype)
    io.write_image(path, pixels)
    if dtype == np.uint8:
        with PillowImage.open(path) as image:
            assert image.info["srgb"] == 0
            np.testing.assert_array_equal(np.atleast_3d(np.asarray(image)), pixels)
    elif channels != 2:  # OpenCV turns grey with alpha into four channels.
        order = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[channels]
        np.testing.assert_array_equal(np.atleast_3d(cv2.imread(str(path), -1))[..., order], pixels)
    np.testing.assert_array_equal(np.atleast_3d(io.read_color(path).pixels), pixels)


# Photographs


@pytest.mark.parametrize(
    ("suffix", "options"), [("bmp", {}), ("webp", {"lossless": True}), ("jpg", {"quality": 95})]
)
@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_photographs_written_by_pillow(tmp_path, suffix, options, mode):
    path = tmp_path / f"a.{suffix}"
    # Smooth, and the same in all channels, for JPEG loses detail and colour.
    y, x = np.mgrid[:24, :40]
    pixels = np.stack([5 * x + 2 * y] * len(mode), axis=-1).astype(np.uint8).squeeze()
    PillowImage.fromarray(pixels, mode).save(path, **options)
    image = io.read_color(path)
    assert image.transfer == "srgb"
    assert image.alpha == "none"
    # Pillow's WebP is always in colour.
    expected = pixels if image.pixels.ndim == pixels.ndim else np.repeat(pixels[..., None], 3, axis=-1)
    np.testing.assert_allclose(image.pixels, expected, atol=2 if suffix == "jpg" else 0)


def test_radiance_written_by_opencv(tmp_path, rng):
    path = tmp_path / "a.hdr"
    pixels = (100.0 * rng.random((9, 16, 3))).astype(np.float32)
    assert cv2.imwrite(str(path), pixels[..., ::-1])
    image = io.read_color(path)
    assert image.transfer == "linear"
    # One exponent for three channels, eight bits each.
    np.testing.assert_allclose(image.pixels, pixels, atol=pixels.max() / 128.0)


def test_a_turned_photograph_is_refused(tmp_path):
    path = tmp_path / "a.jpg"
    picture = PillowImage.fromarray(np.zeros((8, 8, 3), np.uint8))
    exif = picture.getexif()
    exif[0x0112] = 6
    picture.save(path, exif=exif)
    with pytest.raises(ValueError, match="orientation 6"):
        io.read_color(path)


# TIFF


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16, np.float32, np.float64])
@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_tiff_written_by_tifffile(tmp_path, rng, compression, dtype, planar):
    path = tmp_path / "a.tif"
    pixels = (rng.random((21, 33, 3)) * 200).astype(dtype)
    stored = pixels if planar == "contig" else np.ascontiguousarray(pixels.transpose(2, 0, 1))
    tifffile.imwrite(path, stored, photometric="rgb", planarconfig=planar, compression=compression)
    image = io.read_color(path)
    assert image.pixels.dtype == dtype
    np.testing.assert_array_equal(image.pixels, pixels)
    assert image.transfer == ("srgb" if np.issubdtype(dtype, np.integer) else "linear")


@pytest.mark.parametrize(
    ("stored", "expected"), [("unassalpha", "straight"), ("assocalpha", "premultiplied")]
)
@pytest.mark.parametrize("order", ["<", ">"])
def test_tiff_says_what_its_alpha_is(tmp_path, rng, stored, expected, order):
    path = tmp_path / "a.tif"
    pixels = rng.random((5, 4, 4)).astype(np.float32)
    tifffile.imwrite(path, pixels, photometric="rgb", extrasamples=[stored], byteorder=order)
    image = io.read_color(path)
    assert image.alpha == expected
    np.testing.assert_array_equal(image.pixels, pixels)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_written_tiff_is_read_by_tifffile(tmp_path, rng, dtype, channels):
    path = tmp_path / "a.tiff"
    pixels = (rng.random((9, 300, channels)) * 200).astype(dtype)
    io.write_image(path, pixels)
    np.testing.assert_array_equal(np.atleast_3d(tifffile.imread(path)), pixels)
    if channels in (2, 4):
        with tifffile.TiffFile(path) as file:
            expected = "ASSOCALPHA" if dtype == np.float32 else "UNASSALPHA"
            assert [sample.name for sample in file.pages[0].extrasamples] == [expected]


# PFM


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("channels", [1, 3])
def test_pfm_written_by_hand(tmp_path, rng, order, channels):
    path = tmp_path / "a.pfm"
    pixels = rng.random((4, 5, channels)).astype(np.float32)
    header = f"{'Pf' if channels == 1 else 'PF'}\n5 4\n{'-' if order == '<' else ''}1.0\n"
    path.write_bytes(header.encode() + pixels[::-1].astype(f"{order}f4").tobytes())
    image = io.read_color(path)
    np.testing.assert_array_equal(np.atleast_3d(image.pixels), pixels)
    assert image.transfer == "linear"


@pytest.mark.parametrize("channels", [1, 3])
def test_written_pfm_is_read_by_opencv(tmp_path, rng, channels):
    path = tmp_path / "a.pfm"
    pixels = rng.random((4, 5, channels)).astype(np.float32)
    io.write_image(path, pixels)
    np.testing.assert_array_equal(np.atleast_3d(cv2.imread(str(path), -1))[..., ::-1], pixels)


def test_pfm_scale_is_sign_only(tmp_path):
    path = tmp_path / "a.pfm"
    path.write_bytes(b"Pf\n1 1\n-0.0039\n" + struct.pack("<f", 3.0))
    assert io.read_depth(path)[0, 0] == 3.0


# NPY and NPZ


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_numpy_files_round_trip(tmp_path, rng, suffix):
    path = tmp_path / f"a{suffix}"
    pixels = rng.random((4, 5, 3)).astype(np.float16)
    io.write_image(path, pixels)
    image = io.read_color(path)
    assert image.pixels.dtype == np.float16
    np.testing.assert_array_equal(image.pixels, pixels)
    with np.load(path) if suffix == ".npz" else _Single(np.load(path)) as arrays:
        np.testing.assert_array_equal(arrays["color"], pixels)


class _Single(dict):
    def __init__(self, array):
        super().__init__(color=array)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


def test_numpy_files_written_by_hand(tmp_path, rng):
    depth = rng.random((5, 7)).astype("<f4")
    words = b"{'descr': '<f4', 'fortran_order': False, 'shape': (5, 7), }"
    header = words + b" " * (-(len(words) + 11) % 64) + b"\n"
    data = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + depth.tobytes()
    (tmp_path / "d.npy").write_bytes(data)
    with zipfile.ZipFile(tmp_path / "d.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("depth.npy", data)
    for name in ("d.npy", "d.npz"):
        np.testing.assert_array_equal(io.read_depth(tmp_path / name), depth)


def test_numpy_files_of_other_layouts(tmp_path, rng):
    path = tmp_path / "a.npy"
    depth = rng.random((4, 5))
    np.save(path, np.asfortranarray(depth).astype(">f8"))
    np.testing.assert_array_equal(io.read_depth(path), depth.astype(np.float32))
    assert io.read_depth(path).dtype == np.dtype("=f4")
    image = io.read_color(path)
    assert image.pixels.dtype == np.dtype("=f8")
    np.testing.assert_array_equal(image.pixels, depth)


def test_npz_holds_picture_and_depth(tmp_path, rng):
    path = tmp_path / "a.npz"
    color, depth = rng.random((4, 5, 3)), rng.random((4, 5)).astype(np.float32)
    np.savez_compressed(path, rgb=color, z=depth, pose=np.eye(4))
    rgbd = io.read_rgbd(path)
    np.testing.assert_array_equal(rgbd.color, color)
    np.testing.assert_array_equal(rgbd.depth, depth)
    assert io.list_channels(path) == ["rgb", "z", "pose"]
    np.testing.assert_array_equal(io.read_depth(path, channel="pose"), np.eye(4))
    np.savez(path, left=depth, right=depth)
    with pytest.raises(ValueError, match="left, right"):
        io.read_depth(path)


def test_layers_of_a_numpy_file(tmp_path, rng):
    color, depth = rng.random((2, 4, 5, 4)), rng.random((2, 4, 5))
    np.savez(tmp_path / "a.npz", color=color, depth=depth)
    rgbd = io.read_rgbd(tmp_path / "a.npz")
    assert rgbd.color.shape == (2, 4, 5, 4)
    assert rgbd.depth.shape == (2, 4, 5)
    assert rgbd.alpha == "premultiplied"


# Depth


def test_depth_in_sixteen_bit_png_has_a_scale(tmp_path):
    path = tmp_path / "a.png"
    assert cv2.imwrite(str(path), np.array([[256, 1280]], np.uint16))
    np.testing.assert_array_equal(io.read_depth(path, scale=1 / 256), [[1.0, 5.0]])
    io.write_depth(path, np.array([[1.0, 5.0007]]), scale=0.001)
    np.testing.assert_array_equal(cv2.imread(str(path), -1), [[1000, 5001]])
    with pytest.raises(ValueError, match="65535"):
        io.write_depth(path, np.array([[np.inf]]), scale=0.001)
    with pytest.raises(ValueError, match="scale"):
        io.read_depth(path, scale=0)


@pytest.mark.parametrize("suffix", [".exr", ".tif", ".pfm", ".npy", ".npz"])
def test_depth_round_trips_in_full(tmp_path, rng, suffix):
    path = tmp_path / f"a{suffix}"
    depth = rng.random((7, 3)).astype(np.float32)
    depth[2, 1] = np.inf
    io.write_depth(path, depth)
    np.testing.assert_array_equal(io.read_depth(path), depth)


def test_picture_and_depth_in_two_files_must_agree(tmp_path):
    io.write_image(tmp_path / "a.png", np.arange(72, dtype=np.uint8).reshape(4, 6, 3))
    io.write_depth(tmp_path / "z.pfm", np.ones((4, 6)))
    color, depth = io.read_rgbd(tmp_path / "a.png", tmp_path / "z.pfm")
    assert (color.dtype, depth.dtype) == (np.uint8, np.float32)
    io.write_depth(tmp_path / "z.pfm", np.ones((6, 4)))
    with pytest.raises(ValueError, match="the picture is 6 x 4, its depth 4 x 6"):
        io.read_rgbd(tmp_path / "a.png", tmp_path / "z.pfm")
    with pytest.raises(ValueError, match="no depth beside"):
        io.read_rgbd(tmp_path / "a.png")
    with pytest.raises(ValueError, match="one channel"):
        io.read_depth(tmp_path / "a.png")


@pytest.mark.parametrize(
    ("pixels", "transfer", "alpha"),
    [
        (np.ones((4, 6), np.float32), "linear", "none"),
        (np.ones((4, 6, 3), np.uint8), "srgb", "none"),
        (np.ones((4, 6, 4), np.uint16), "srgb", "straight"),
        (np.full((4, 6, 3), np.nan, np.float32), "linear", "none"),
        (np.ones((4, 2000, 2), np.float32), "linear", "premultiplied"),
    ],
)
def test_pictures_show_themselves(tmp_path, pixels, transfer, alpha):
    image = io.Image(pixels, transfer, alpha)
    text = repr(image)
    assert text.startswith(f"<Image of {pixels.shape[1]} x 4 pixels, ")
    assert "array(" not in text
    path = tmp_path / "shown.png"
    path.write_bytes(image._repr_png_())
    assert io.read_color(path).pixels.shape[1] <= 1000
    depth = np.where(np.arange(pixels.shape[1]) % 3, np.inf, np.arange(pixels.shape[1]) + 1.0)
    both = io.RGBD(pixels, np.broadcast_to(depth, pixels.shape[:2]), transfer, alpha)
    assert "array(" not in repr(both)
    assert both._repr_png_().startswith(b"\x89PNG")
