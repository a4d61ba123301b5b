"""Memory for a file is bounded by its length, before it is taken, whatever the file claims."""

import io as bytes_io
import re
import resource
import struct
import subprocess
import sys
import zipfile
import zlib

import h5py
import numpy as np
import OpenEXR
import pytest
from dofsim import io
from headers import (
    header_bmp,
    header_dpt,
    header_exr,
    header_hdf5,
    header_hdr,
    header_jpeg,
    header_npy,
    header_npz,
    header_png,
    header_tiff,
)
from interrupts import HANG_S

READERS = [io.read_color, io.read_depth]


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


def bomb_driver(path):
    """Write a file that is said to be one of several; the description is where its first bytes are."""
    with h5py.File(path, "w", libver="earliest") as file:
        file["depth"] = np.ones((4, 4), "f4")
    data = bytearray(path.read_bytes())
    assert data[8] == 0
    # The fourth address of the superblock; from there on, the length comes after four bytes.
    data[48:56] = (28).to_bytes(8, "little")
    path.write_bytes(data)


BOMBS = {
    "lzma.npz": (lambda path: bomb_npz(path, 192 << 20, zipfile.ZIP_LZMA), "neither stored nor deflated"),
    "bzip2.npz": (lambda path: bomb_npz(path, 192 << 20, zipfile.ZIP_BZIP2), "neither stored nor deflated"),
    "profile.png": (lambda path: bomb_png(path, 192 << 20), None),
    "chunk.h5": (lambda path: bomb_chunk(path, 1 << 14), "a chunk claims 1073741824 bytes"),
    "driver.h5": (bomb_driver, "or one of several that are one"),
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


@pytest.mark.parametrize("counter", range(1, 10))
def test_dwa_block_that_claims_huge_sections(tmp_path, counter):
    path = tmp_path / "a.exr"
    header = {"compression": OpenEXR.DWAA_COMPRESSION}
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
