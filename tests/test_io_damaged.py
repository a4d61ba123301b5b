"""Files that are not what they claim to be: each is a ValueError that names the file, and cheap."""

import contextlib
import io as bytes_io
import os
import re
import resource
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import h5py
import numpy as np
import OpenEXR
import PIL.Image
import pytest
import tifffile
from dofsim import io
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


def header_exr(width, height, sampling=1):
    """Make an OpenEXR header without pixels."""

    def attribute(name, kind, value):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value

    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channel = b"Y\0" + struct.pack("<iiii", 2, 0, sampling, sampling) + b"\0"
    return (
        b"\x76\x2f\x31\x01\x02\0\0\0"
        + attribute("channels", "chlist", channel)
        + attribute("compression", "compression", b"\x03")
        + attribute("dataWindow", "box2i", box)
        + attribute("displayWindow", "box2i", box)
        + attribute("lineOrder", "lineOrder", b"\0")
        + attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
        + attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0))
        + attribute("screenWindowWidth", "float", struct.pack("<f", 1))
        + b"\0"
    ).ljust(1024, b"\0")


def header_png(width, height):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    size = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size) + chunk(b"IDAT", zlib.compress(bytes(900)))


def header_tiff(width, height):
    tags = [
        (256, 4, 1, width),
        (257, 4, 1, height),
        (258, 3, 1, 16),
        (259, 3, 1, 1),
        (262, 3, 1, 1),
        (273, 4, 1, 8),
        (277, 3, 1, 1),
        (278, 4, 1, height),
        (279, 4, 1, 2 * width * height & 0xFFFFFFFF),
    ]
    directory = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    return (b"II*\0" + struct.pack("<IH", 8, len(tags)) + directory + bytes(4)).ljust(1024, b"\0")


def header_npy(width, height):
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(header)) + header.encode()


def header_npz(width, height):
    buffer = bytes_io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("depth.npy", header_npy(width, height))
    return buffer.getvalue()


def header_jpeg(width, height):
    def segment(kind, data):
        return b"\xff" + bytes([kind]) + struct.pack(">H", 2 + len(data)) + data

    frame = struct.pack(">BHHB", 8, height, width, 3) + b"".join(bytes([i, 0x11, 0]) for i in (1, 2, 3))
    tables = segment(0xDB, b"\0" + bytes([1] * 64)) + segment(0xC4, b"\0\x01" + bytes(16))
    scan = segment(0xDA, b"\x03" + b"".join(bytes([i, 0]) for i in (1, 2, 3)) + b"\0\x3f\0")
    return (b"\xff\xd8" + tables + segment(0xC0, frame) + scan).ljust(1024, b"\0")


def header_bmp(width, height):
    head = b"BM" + struct.pack("<IHHI", 1024, 0, 0, 54)
    return (head + struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, 0, 1, 1, 0, 0)).ljust(1024, b"\0")


def header_hdr(width, height):
    return f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode().ljust(1024, b"\0")


def header_dpt(width, height):
    return (b"PIEH" + struct.pack("<ii", width, height)).ljust(1024, b"\0")


def header_hdf5(width, height):
    buffer = bytes_io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.create_dataset("depth", (height, width), "f4", chunks=(100, 100))
    return buffer.getvalue()


HUGE = {
    "exr": header_exr,
    "png": header_png,
    "tif": header_tiff,
    "pfm": lambda width, height: f"Pf\n{width} {height}\n-1.0\n".encode().ljust(1024, b"\0"),
    "npy": header_npy,
    "npz": header_npz,
}
# Decoders of these say in words of their own what is wrong; that they are cheap is asked of all.
MORE_HUGE = {"jpg": header_jpeg, "bmp": header_bmp, "hdr": header_hdr, "dpt": header_dpt, "h5": header_hdf5}


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize("kind", list(HUGE))
def test_a_short_file_that_claims_a_huge_picture_is_cheap(tmp_path, read, kind):
    path = tmp_path / f"huge.{kind}"
    path.write_bytes(HUGE[kind](60000, 60000))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match=rf"huge\.{kind}: .*cannot hold"):
        read(path)
    # Kibibytes on Linux, and bytes elsewhere, where this is no test.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 64 * 1024


READ_ALL = """
import resource, sys
from pathlib import Path
from dofsim import io

resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
for path in sorted(Path(sys.argv[1]).iterdir()):
    for read in (io.read_color, io.read_depth, io.read_rgbd):
        try:
            read(path)
        except ValueError as error:
            assert path.name in str(error), error
        else:
            raise AssertionError(f"{path}: was read")
print("done")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are set the Linux way")
def test_no_claim_is_believed_where_memory_is_short(tmp_path):
    for kind, header in (HUGE | MORE_HUGE).items():
        # 16 bits a side is all that JPEG has, and all that is needed.
        (tmp_path / f"huge.{kind}").write_bytes(header(60000, 60000))
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", READ_ALL, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=False,
    )
    assert run.stdout == "done\n", run.stderr


@pytest.mark.parametrize("kind", list(HUGE))
def test_the_same_headers_with_a_small_claim_are_truncated_files(tmp_path, kind):
    path = tmp_path / "small"
    path.write_bytes(HUGE[kind](600, 600))
    with pytest.raises(ValueError, match="small: damaged file"):
        io.read_depth(path)


def test_truncated_files(tmp_path):
    path = tmp_path / "cut"
    for data in sound_files(tmp_path).values():
        path.write_bytes(data)
        io.read_depth(path)
        for length in (0, 3, 9, len(data) // 2, len(data) - 40):
            path.write_bytes(data[:length])
            with pytest.raises(ValueError, match="cut: "):
                io.read_depth(path)


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


def test_pfm_that_was_sent_as_text_is_damaged(tmp_path):
    path = tmp_path / "a.pfm"
    path.write_bytes(b"Pf\r\n2 2\r\n-1.0\r\n" + bytes(16))
    with pytest.raises(ValueError, match=r"a\.pfm: damaged file: its lines end in CR LF"):
        io.read_depth(path)


def bomb_npz(path, size, compression):
    with zipfile.ZipFile(path, "w", compression) as archive, archive.open("depth.npy", "w") as file:
        header = {"descr": "<f4", "fortran_order": False, "shape": (size // 4096, 1024)}
        np.lib.format.write_array_header_1_0(file, header)
        for _ in range(size >> 20):
            file.write(bytes(1 << 20))


def bomb_png(path, size):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    profile = zlib.compressobj()
    packed = b"".join(profile.compress(bytes(1 << 20)) for _ in range(size >> 20)) + profile.flush()
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", 1, 1, 8, 0, 0, 0, 0))
        + chunk(b"iCCP", b"p\0\0" + packed)
        + chunk(b"IDAT", zlib.compress(b"\0\7"))
        + chunk(b"IEND", b"")
    )


def bomb_chunk(path, side):
    with h5py.File(path, "w") as file:
        words = {"maxshape": (None, None), "chunks": (side, side), "compression": "gzip"}
        file.create_dataset("depth", data=np.ones((1, 1), "f4"), **words)


def bomb_inflating_chunk(path, size):
    with h5py.File(path, "w") as file:
        dataset = file.create_dataset("depth", (64, 64), "f4", chunks=(64, 64), compression="gzip")
        dataset.id.write_direct_chunk((0, 0), zlib.compress(bytes(size)))


BOMBS = {
    "lzma.npz": (lambda path: bomb_npz(path, 192 << 20, zipfile.ZIP_LZMA), "neither stored nor deflated"),
    "bzip2.npz": (lambda path: bomb_npz(path, 192 << 20, zipfile.ZIP_BZIP2), "neither stored nor deflated"),
    "profile.png": (lambda path: bomb_png(path, 192 << 20), None),
    "chunk.h5": (lambda path: bomb_chunk(path, 1 << 14), "a chunk claims 1073741824 bytes"),
    "inflating.h5": (lambda path: bomb_inflating_chunk(path, 192 << 20), "a chunk inflates to more"),
    "literal.npy": (
        lambda path: path.write_bytes(
            b"\x93NUMPY\x01\0" + struct.pack("<H", 9000) + (b"-" * 8990).ljust(9000)
        ),
        "nested too deeply|recursion",
    ),
    "header.npy": (
        lambda path: path.write_bytes(b"\x93NUMPY\x02\0" + struct.pack("<I", 2**32 - 1) + b"{" * 300),
        "claims to be 4294967295 bytes long",
    ),
}

COST = """
import re, sys
from pathlib import Path
from dofsim import io

def most():
    # Not that of getrusage, which a process has from the one that started it.
    return int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])

before = most()
try:
    io.read_depth(sys.argv[1])
except ValueError as error:
    print(error, file=sys.stderr)
print(most() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="memory is measured the Linux way")
@pytest.mark.parametrize("name", list(BOMBS))
def test_a_short_file_that_inflates_without_end_is_cheap(tmp_path, name):
    make, message = BOMBS[name]
    path = tmp_path / name
    make(path)
    assert path.stat().st_size < 3 << 20
    run = subprocess.run(
        [sys.executable, "-c", COST, str(path)], capture_output=True, text=True, check=True, timeout=HANG_S
    )
    # In KiB: a profile of colours may have 64 MiB.
    assert int(run.stdout) < 120 << 10
    if message is not None:
        assert re.search(rf"{name}: damaged file: .*({message})", run.stderr), run.stderr


def test_npz_that_claims_more_than_it_can_inflate_to(tmp_path):
    path = tmp_path / "a.npz"
    array = bytes_io.BytesIO()
    header = {"descr": "<f4", "fortran_order": False, "shape": (1 << 15, 1 << 14)}
    np.lib.format.write_array_header_1_0(array, header)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("depth.npy", array.getvalue() + bytes(4096))
        # What the directory says, which is written at the end.
        archive.infolist()[0].file_size = 1 << 31
    with pytest.raises(ValueError, match=r"a\.npz: damaged file: its header claims 2147483648 bytes"):
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
SEEDS = sorted((Path(__file__).parent / "fuzz" / "seeds").glob("[er]*/*"))


@pytest.mark.filterwarnings("ignore")
def test_every_file_of_the_fuzzer_is_read_or_refused():
    read = 0
    for path in SEEDS:
        for reader in READERS:
            with contextlib.suppress(ValueError):
                reader(path)
                read += 1
    assert read > 40


MUTANTS = """
import resource, sys
from pathlib import Path
import numpy as np
from dofsim import io

resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
rng = np.random.default_rng(7)
refused = 0
for path in sorted(Path(sys.argv[1]).iterdir()):
    sound = path.read_bytes()
    read = io.read_rgbd if path.suffix == ".exr" else io.read_depth
    read(path)
    for _ in range(250):
        data = bytearray(sound)
        for _ in range(rng.integers(1, 6)):
            data[rng.integers(min(len(data), rng.choice([400, 1000, 10**9])))] = rng.integers(256)
        path.write_bytes(data)
        try:
            read(path)
        except ValueError as error:
            assert str(path) in str(error), error
            refused += 1
print(refused)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are set the Linux way")
def test_files_of_foreign_libraries_with_wrong_bytes_are_read_or_refused(tmp_path):
    """In another process, for these libraries are not written for such files."""
    pixels = np.arange(600.0, dtype="<f4").reshape(20, 30)
    (tmp_path / "a.dpt").write_bytes(header_dpt(30, 20)[:12] + pixels.tobytes())
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("depth", data=pixels, chunks=(8, 8), compression="gzip")
    samples = np.empty((5, 7), object)
    for y, x in np.ndindex(samples.shape):
        samples[y, x] = np.arange(1, 1 + (x + y) % 3, dtype=np.float32)
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    with OpenEXR.File(header, {"Z": samples, "A": samples}) as file:
        file.write(str(tmp_path / "a.exr"))
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", MUTANTS, str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-2000:]
    assert int(run.stdout.split()[-1]) > 100


@pytest.mark.parametrize("counter", range(1, 10))
def test_dwa_block_that_claims_huge_sections(tmp_path, counter):
    path = tmp_path / "a.exr"
    header, _ = exr("DWAA")
    with OpenEXR.File(header, {"Z": np.zeros((64, 64), np.float16)}) as file:
        file.write(str(path))
    assert io.read_depth(path).shape == (64, 64)
    data = bytearray(path.read_bytes())
    # The header ends with its type. Then come the offsets of the blocks; a block is its row, its length, and
    # the eleven numbers that the decoder sets memory aside by.
    end = data.index(b"scanlineimage\0") + len(b"scanlineimage\0")
    (block,) = struct.unpack_from("<Q", data, end)
    struct.pack_into("<Q", data, block + 8 + 8 * counter, 1 << 52)
    path.write_bytes(data)
    with pytest.raises(ValueError, match="claims more than its pixels need"):
        io.read_depth(path)


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
