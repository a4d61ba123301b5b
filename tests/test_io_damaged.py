"""Files that are not what they claim to be: each is a ValueError that names the file, and cheap."""

import contextlib
import io as bytes_io
import os
import struct
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import OpenEXR
import PIL.Image
import pytest
import tifffile
from dofsim import io
from headers import header_exr, header_hdr, header_npy
from interrupts import HANG_S

READERS = [io.read_color, io.read_depth]


def exr(compression="ZIP", size=(20, 30)):
    rng = np.random.default_rng(3)
    buffer = {"RGB": rng.random((*size, 3)).astype(np.float16), "Z": rng.random(size).astype(np.float32)}
    return {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION")}, buffer


def sound_files(folder):
    """One file of each kind, as bytes."""
    pixels = np.arange(20 * 30, dtype=np.uint16).reshape(20, 30)
    files = {}
    for compression in ("NO", "RLE", "ZIP", "PIZ", "PXR24", "B44A", "DWAA"):
        header, channels = exr(compression)
        with OpenEXR.File(header, channels) as file:
            file.write(str(folder / "sound"))
        files[f"{compression}.exr"] = (folder / "sound").read_bytes()
    for compression in (None, "zlib"):
        tifffile.imwrite(folder / "sound", pixels, compression=compression)
        files[f"{compression}.tif"] = (folder / "sound").read_bytes()
    for suffix in (".png", ".pfm", ".npy", ".npz"):
        path = folder / f"sound{suffix}"
        io.write_image(path, pixels)
        files[suffix] = path.read_bytes()
        path.unlink()
    (folder / "sound").unlink()
    return files


def test_truncated_files(tmp_path):
    path = tmp_path / "cut"
    for data in sound_files(tmp_path).values():
        path.write_bytes(data)
        io.read_depth(path, scale=1)
        for length in (0, 3, 9, len(data) // 2, len(data) - 40):
            path.write_bytes(data[:length])
            with pytest.raises(ValueError, match="cut: "):
                io.read_depth(path, scale=1)


@pytest.mark.filterwarnings("ignore")
def test_files_with_wrong_bytes_are_read_or_refused(tmp_path):
    rng = np.random.default_rng(5)
    path = tmp_path / "mutant"
    files = list(sound_files(tmp_path).values())
    refused = unnamed = 0
    for number in range(1500):
        data = bytearray(files[number % len(files)])
        for _ in range(rng.integers(1, 6)):
            data[rng.integers(min(len(data), rng.choice([400, 10**9])))] = rng.integers(256)
        path.write_bytes(data)
        for read in READERS:
            try:
                read(path)
            except ValueError as error:
                refused += str(path) in str(error)
                unnamed += str(path) not in str(error)
    assert unnamed == 0
    assert refused > 500


def jpeg(**words):
    y, x = np.mgrid[:90, :120]
    pixels = np.stack([2 * x, 2 * y, (x + y) % 256], -1).astype(np.uint8)
    buffer = bytes_io.BytesIO()
    PIL.Image.fromarray(pixels).convert(words.pop("mode", "RGB")).save(buffer, "jpeg", **words)
    return buffer.getvalue()


@pytest.mark.parametrize(
    "words",
    [
        {},
        {"progressive": True},
        {"subsampling": 0},
        {"mode": "L"},
        {"mode": "CMYK"},
        {"quality": 100, "restart_marker_blocks": 3},
        {"restart_marker_rows": 1, "progressive": True},
    ],
)
def test_a_jpeg_that_is_not_whole_is_no_picture(tmp_path, words):
    path = tmp_path / "a.jpg"
    whole = jpeg(**words)
    # What follows the picture is not part of it.
    for end in (b"", b"more"):
        path.write_bytes(whole + end)
        with PIL.Image.open(path) as image:
            expected = np.asarray(image.convert("L" if image.mode == "L" else "RGB"))
        # Decoders round, and filter colours that are stored at half the size, in ways of their own.
        assert np.abs(io.read_color(path).pixels.astype(int) - expected).mean() < 2
    for length in np.linspace(2, len(whole) - 1, 60).astype(int):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=r"a\.jpg: (damaged file|found an unknown)"):
            io.read_color(path)


def test_a_progressive_jpeg_with_wrong_bytes_is_refused_where_its_codes_make_no_sense(tmp_path):
    whole, refused = jpeg(progressive=True, quality=95), 0
    for place in np.linspace(len(whole) // 4, len(whole) - 3, 60).astype(int):
        data = bytearray(whole)
        data[place] ^= 0x55
        (tmp_path / "a.jpg").write_bytes(data)
        try:
            io.read_color(tmp_path / "a.jpg")
        except ValueError:
            refused += 1
    assert refused > 10


@pytest.mark.parametrize("lossless", [False, True])
def test_a_webp_that_is_not_whole_is_no_picture(tmp_path, lossless):
    path = tmp_path / "a.webp"
    pixels = np.arange(90 * 120 * 3).reshape(90, 120, 3).astype(np.uint8)
    PIL.Image.fromarray(pixels).save(path, lossless=lossless)
    whole = path.read_bytes()
    assert io.read_color(path).pixels.shape == (90, 120, 3)
    for cut in (1, 2, 3, 10, len(whole) // 2):
        path.write_bytes(whole[:-cut])
        with pytest.raises(ValueError, match=r"a\.webp: damaged file"):
            io.read_color(path)


def test_pfm_that_was_sent_as_text_is_damaged(tmp_path):
    path = tmp_path / "a.pfm"
    path.write_bytes(b"Pf\r\n2 2\r\n-1.0\r\n" + bytes(16))
    with pytest.raises(ValueError, match=r"a\.pfm: damaged file: its lines end in CR LF"):
        io.read_depth(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes have names on POSIX")
@pytest.mark.parametrize("link", [False, True])
def test_a_pipe_is_refused_before_it_is_opened(tmp_path, monkeypatch, link):
    """Nobody ever writes into it, so whoever opens it waits for ever."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.fifo")
    names = [
        f"pipe{suffix}" for suffix in (".exr", ".npz", ".h5", ".toml", ".jsonl", ".csv", ".xml", ".json")
    ]
    for name in names:
        if link:
            Path(name).symlink_to("pipe.fifo")
        else:
            os.mkfifo(name)
    io.write_image("a.exr", np.ones((4, 5)), depth=np.ones((4, 5)))
    lens = "lens={'aperture_radius': 0.1, 'focus_distance': 1.0, 'fov': 40.0}"
    calls = [
        "io.read_color('pipe.exr')",
        "io.read_depth('pipe.exr')",
        "io.read_rgbd('pipe.exr')",
        "io.read_rgbd('a.exr', 'pipe.npz')",
        "io.list_channels('pipe.npz')",
        "io.read_exr('pipe.exr')",
        "io.read_depth('pipe.h5')",
        "io.write_image('pipe.exr', np.ones((2, 2)))",
        "dofsim.Lens.from_mitsuba('pipe.xml')",
        "dofsim.Lens.from_blender('pipe.json')",
        "dofsim.Aperture.from_blender('pipe.json')",
        "dofsim.Aperture(image='pipe.exr')",
        "read_manifest('pipe.jsonl')",
        "read_manifest('pipe.csv')",
        "read_settings(Path('pipe.toml'), {}, {})",
        f"fail(next(map_frames([Frame(color='pipe.exr', output='o.exr', {lens})])))",
    ]
    script = f"""
import dofsim
import numpy as np
from pathlib import Path
from dofsim import io
from dofsim._options import read_settings
from dofsim.batch import Frame, map_frames, read_manifest

def fail(result):
    raise ValueError(result.error)

for call in {calls!r}:
    try:
        eval(call)
    except ValueError as error:
        assert "a pipe or a device" in str(error), (call, error)
    else:
        raise AssertionError(call)
"""
    subprocess.run([sys.executable, "-c", script], check=True, timeout=HANG_S)


@pytest.mark.parametrize("size", [(0, 9), (9, 0)])
def test_pictures_without_pixels_are_damaged(tmp_path, size):
    path = tmp_path / "empty"
    for data, message in (
        (header_hdr(*size), "it has no pixels"),
        (header_npy(*size), "one channel of numbers"),
    ):
        path.write_bytes(data)
        with pytest.raises(ValueError, match=f"empty: .*{message}"):
            io.read_depth(path)


# What the fuzzer began with, and what it found.
FUZZ = Path(__file__).parent / "fuzz"
SEEDS = sorted((FUZZ / "seeds").glob("[ejr]*/*"))


@pytest.mark.filterwarnings("ignore")
def test_every_file_of_the_fuzzer_is_read_or_refused():
    read = 0
    for path in SEEDS:
        for reader in READERS:
            with contextlib.suppress(ValueError):
                reader(path)
                read += 1
    assert read > 40


@pytest.mark.parametrize(
    "kind", ["npy", "npz", "deep", "hdf5", "dpt", "mitsuba", "blender", "toml", "csv", "jsonl"]
)
def test_wrong_bytes_are_read_or_refused_by_name_and_cheaply(tmp_path, kind):
    """In another process, for some libraries are not written for such files, and its memory is measured."""
    case = ["--first", "0", "--cases", "100"]
    command = [sys.executable, str(FUZZ / "parsers.py"), kind, str(tmp_path), *case]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANG_S)
    assert run.returncode == 0, run.stderr[-3000:]
    assert run.stdout.startswith(f"{kind}: 100 cases")


def test_a_chunk_that_is_shorter_than_its_checksum(tmp_path):
    """In another process, for the library reads beyond it."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("depth", data=np.ones((4, 4), "f4"), chunks=(4, 4), fletcher32=True)
    # An entry of the index: the length of the chunk, which filters it skips, and its place.
    entry = struct.Struct("<II3Q")
    path.write_bytes(path.read_bytes().replace(entry.pack(4 * 16 + 4, 0, 0, 0, 0), entry.pack(2, 0, 0, 0, 0)))
    command = [
        sys.executable,
        "-c",
        "import sys; from dofsim import io; io.read_depth(sys.argv[1])",
        str(path),
    ]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANG_S)
    assert "a.h5: damaged file: a chunk is shorter than its checksum" in run.stderr, run


def test_exr_that_stores_one_block_twice_and_another_never(tmp_path):
    path = tmp_path / "a.exr"
    header, channels = exr("NO")
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))
    data = bytearray(path.read_bytes())
    end = data.index(b"scanlineimage\0") + len(b"scanlineimage\0")
    data[end + 8 : end + 16] = data[end : end + 8]
    path.write_bytes(data)
    with pytest.raises(ValueError, match="stored twice, another one never"):
        io.read_depth(path)


@pytest.mark.parametrize(
    ("start", "found"),
    [
        (b"", "an empty file"),
        (b"GIF89a", "GIF"),
        (b"hello, world", r'begins with "hello, w"'),
        (b"\0\0\0\x18ftypheic", r"HEIC .*dofsim\.photo reads"),
    ],
)
def test_foreign_files_are_called_by_their_names(tmp_path, start, found):
    path = tmp_path / "a.exr"
    path.write_bytes(start)
    with pytest.raises(ValueError, match=rf"a\.exr: found .*{found}.*accepted: OpenEXR, PNG, JPEG"):
        io.read_color(path)


def test_deep_and_subsampled_exr_are_refused(tmp_path):
    path = tmp_path / "a.exr"
    deep = np.empty((2, 2), dtype=object)
    for index in np.ndindex(deep.shape):
        deep[index] = np.array([1.0, 2.0], np.float32)
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    with OpenEXR.File(header, {"Z": deep}) as file:
        file.write(str(path))
    with pytest.raises(ValueError, match=r"deep.*accepted: flat"):
        io.read_depth(path)
    path.write_bytes(header_exr(4, 4, sampling=2))
    with pytest.raises(ValueError, match=r"subsampling.*a sample for every pixel"):
        io.read_color(path)


def test_tiff_of_other_colors_and_types_is_refused(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.zeros((4, 4, 4), np.uint8), photometric="separated")
    with pytest.raises(ValueError, match=r"found CMYK.*accepted: grey"):
        io.read_color(path)
    tifffile.imwrite(path, np.zeros((4, 4), np.int16))
    with pytest.raises(ValueError, match="signed integers"):
        io.read_color(path)
    tifffile.imwrite(path, np.zeros((4, 4), np.bool_))
    with pytest.raises(ValueError, match="samples of 1 bits"):
        io.read_color(path)
    tifffile.imwrite(path, np.zeros((4, 4), np.uint8), extratags=[(274, 3, 1, 6, False)])
    with pytest.raises(ValueError, match="orientation 6"):
        io.read_color(path)


def test_numpy_files_never_run_pickles(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.array([[{"a": 1}]], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match="Python objects"):
        io.read_depth(path)
    np.save(path, np.zeros((3, 3), np.complex64))
    for read in READERS:
        with pytest.raises(ValueError, match="complex64"):
            read(path)
