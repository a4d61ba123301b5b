"""Headers of files whose pixels are missing, for claims of any size."""

import io as bytes_io
import struct
import zipfile
import zlib

import h5py


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
