"""Wrong bytes for what is parsed in Python, and by libraries of others: each is read, or refused, cheaply.

``python tests/fuzz/parsers.py KIND FOLDER --seconds 60`` changes small sound files of a kind at random and
gives them to whoever reads them. Case N of a kind has the same bytes every time, so ``--first N --cases 1``
tries it again. Each is in FOLDER before it is read: it still is when a library written in C ends the process.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import io as text_io
import json
import os
import sys
import time
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random

import dofsim
import h5py
import numpy as np
import OpenEXR
from dofsim import io, photo
from dofsim.batch import read_manifest
from dofsim.cli import run

sys.path.insert(0, str(Path(__file__).parents[1]))

from phones import gain_jpeg, iso_gain, segment, with_dynamic_depth, with_further, with_gdepth, xmp

# A case that takes longer hangs: these files have some hundred bytes.
SLOW_S = 10.0
HANG_S = 60.0


# Sound files


def depth() -> np.ndarray:
    return np.linspace(1, 9, 5 * 7, dtype=np.float32).reshape(5, 7)


def seeds_npy(folder: Path) -> list[bytes]:
    files = []
    for dtype, order in (("<f4", "C"), (">f8", "F"), ("<u2", "C"), ("<f2", "C")):
        np.save(folder / "a.npy", np.asarray(depth(), dtype, order))
        files.append((folder / "a.npy").read_bytes())
    return files


def seeds_npz(folder: Path) -> list[bytes]:
    files = []
    for compression in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        with zipfile.ZipFile(folder / "a.npz", "w", compression) as archive:
            for name in ("color", "depth"):
                with archive.open(f"{name}.npy", "w") as file:
                    np.lib.format.write_array(file, depth())
        files.append((folder / "a.npz").read_bytes())
    return files


def seeds_deep(folder: Path) -> list[bytes]:
    samples = np.empty((5, 7), object)
    for y, x in np.ndindex(samples.shape):
        samples[y, x] = np.arange(1, 1 + (x + y) % 3, dtype=np.float32)
    files = []
    for compression in ("NO", "RLE", "ZIPS"):
        header = {"type": OpenEXR.deepscanline, "compression": getattr(OpenEXR, f"{compression}_COMPRESSION")}
        for channels in ("Z", "RGBAZ"):
            part = OpenEXR.Part(dict(header), dict.fromkeys(channels, samples), "a")
            with OpenEXR.File([part]) as file:
                file.write(str(folder / "a.exr"))
            files.append((folder / "a.exr").read_bytes())
    return files


def seeds_hdf5(folder: Path) -> list[bytes]:
    files = []
    for words in (
        {},
        {"chunks": (2, 3)},
        {"chunks": (2, 3), "compression": "gzip", "fletcher32": True},
        {"chunks": (2, 3), "compression": "gzip", "shuffle": True},
        {"chunks": (2, 3), "compression": "lzf", "maxshape": (None, None)},
    ):
        with h5py.File(folder / "a.h5", "w") as file:
            file.create_dataset("depth", data=depth(), **words)
        files.append((folder / "a.h5").read_bytes())
    return files


def seeds_dpt(folder: Path) -> list[bytes]:
    return [b"PIEH" + np.array([7, 5], "<i4").tobytes() + depth().tobytes()]


def seeds_xml(folder: Path) -> list[bytes]:
    return [
        b"""<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE scene [<!ENTITY far "9.5">]>
<scene version="3.0.0"><default name="a" value="0.05"/><default name="ab" value="$a"/>
<sensor type="thinlens"><float name="aperture_radius" value="$ab"/>
<float name="focus_distance" value="&far;"/><float name="fov" value="40"/>
<string name="fov_axis" value="larger"/><film type="hdrfilm"/></sensor></scene>""",
        b"""<scene version="2.1.0"><sensor type="perspective"><string name="focal_length" value="50mm"/>
<float name="principal_point_offset_x" value="0.1"/></sensor></scene>""",
    ]


def seeds_json(folder: Path) -> list[bytes]:
    camera = {"lens": 50.0, "sensor_width": 36.0, "sensor_fit": "AUTO", "fstop": 2.8, "focus_distance": 3.0}
    blades = {"aperture_blades": 6, "aperture_rotation": 0.1, "aperture_ratio": 1.5, "shift_x": 0}
    return [json.dumps(camera).encode(), json.dumps(camera | blades).encode()]


def seeds_toml(folder: Path) -> list[bytes]:
    return [
        b'aperture_radius = 0.05\nfocus_distance = 2.0\nfov = 40.0\nfov_axis = "x"\ntilt = [1.0, 2.0]\n'
        b'cat_eye = 0.5\nvignetting = "natural"\n[aperture]\nblades = 6\nrotation = 12.5\n',
        b'focal_length_mm = 50\nf_number = 1.4\nsensor = "full frame"\nfocus_distance = 3\n'
        b'[aperture]\nimage = "iris.png"\n',
    ]


def seeds_csv(folder: Path) -> list[bytes]:
    return [
        b'color,depth,output,focus_distance,focus_at\na.exr,a.exr,a/b,4.0,\na.exr,,c,,"5,3"\n',
        b"color,output\na.exr,\n",
    ]


def seeds_jsonl(folder: Path) -> list[bytes]:
    rows = [
        {"color": "a.exr", "depth": "a.exr", "output": "a/b", "focus_distance": 4},
        {"color": "a.exr", "focus_at": [5, 3], "fov": None, "output": "c"},
        {"color": "a.exr", "focus_at": "random", "output": "d"},
    ]
    return ["\n".join(map(json.dumps, rows)).encode(), json.dumps({"color": "a.exr"}).encode()]


def seeds_heic(folder: Path) -> list[bytes]:
    import pillow_heif
    from PIL import Image

    pillow_heif.register_heif_opener()
    codes = np.linspace(0, 255, 16 * 24 * 3).reshape(16, 24, 3).astype(np.uint8)
    exif = Image.Exif()
    exif[0x0112] = 6
    files = []
    for words in ({"quality": 90}, {"quality": 50, "exif": exif}):
        Image.fromarray(codes).save(folder / "a.heic", **words)
        files.append((folder / "a.heic").read_bytes())
    with_alpha = np.concatenate([codes, codes[..., :1]], -1)
    Image.fromarray(with_alpha).save(folder / "a.heic", quality=90)
    return [*files, (folder / "a.heic").read_bytes()]


def seeds_phone(folder: Path) -> list[bytes]:
    """JPEG with depth in XMP, and with a gain map in each of its words."""
    from PIL import Image

    codes = np.linspace(0, 255, 16 * 24).reshape(16, 24).astype(np.uint8)
    path = folder / "a.jpg"

    def plain() -> Path:
        Image.fromarray(np.repeat(codes[..., None], 3, -1)).save(path, quality=90)
        return path

    with_gdepth(plain(), codes)
    files = [path.read_bytes()]
    with_dynamic_depth(plain(), codes)
    files.append(path.read_bytes())
    words = 'xmlns:h="http://ns.adobe.com/hdr-gain-map/1.0/" h:Version="1.0" h:GainMapMax="3"'
    said = segment(b"http://ns.adobe.com/xap/1.0/\0" + xmp(words))
    fractions = [(0, 1), (3, 1), (0, 1), (3, 1), (1, 1), (1, 64), (1, 64)]
    for part in (said, iso_gain(*fractions)):
        with_further(plain(), gain_jpeg(codes, part))
        files.append(path.read_bytes())
    return files


# Readers


def read_camera(path: Path) -> None:
    dofsim.Lens.from_blender(path)
    dofsim.Aperture.from_blender(path)


def read_depth(path: Path) -> None:
    # Integers need a scale.
    io.read_depth(path, scale=1.0)


def command(path: Path, *arguments: str) -> None:
    """Run the command, which says in lines of its own what is wrong and writes nothing but its output."""
    before = {one for one in path.parent.iterdir() if one.name not in ("o.exr", "out")}
    said = text_io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(text_io.StringIO()):
        status = run(list(arguments))
    lines = said.getvalue().splitlines()
    assert status in (0, 1, 2), status
    assert bool(status) <= bool(lines)
    for line in lines:
        assert line.startswith("dofsim: "), line
        assert line.isprintable() or "\t" in line, line
        assert "internal error" not in line, line
    after = {one for one in path.parent.iterdir() if one.name not in ("o.exr", "out")}
    assert before == after, after - before
    if status:
        raise Refused(lines[-1])


class Refused(Exception):
    """What the command refuses, it refuses without naming a file where an argument is at fault."""


def render(path: Path) -> None:
    picture = str(path.parent / "a.exr")
    command(
        path,
        "render",
        picture,
        "-o",
        str(path.parent / "o.exr"),
        "--lens",
        str(path),
        "--device",
        "cpu",
        "-q",
    )


def batch(path: Path) -> None:
    read_manifest(path)
    lens = ("--aperture-radius", "0.05", "--focus-distance", "2", "--fov", "40", "--device", "cpu", "-q")
    command(path, "batch", "--manifest", str(path), "-o", str(path.parent / "out"), *lens)


@dataclass(frozen=True)
class Kind:
    """How files of a kind are made and read, and the most memory that one of them may take.

    They have some hundred bytes, which inflate to less than a mebibyte; the rest is what is loaded.
    """

    suffix: str
    seeds: Callable[[Path], list[bytes]]
    read: Callable[[Path], object]
    most_mib: int = 32


KINDS = {
    "npy": Kind(".npy", seeds_npy, read_depth),
    "npz": Kind(".npz", seeds_npz, io.read_rgbd),
    # A window of 4096 x 4096 pixels is always believed to be seen: four layers of five floats.
    "deep": Kind(".exr", seeds_deep, io.read_rgbd, 32 + 16 * 4 * 5 * 4),
    # A chunk may take 64 MiB, and is inflated once to be looked at, and once to be read.
    "hdf5": Kind(".h5", seeds_hdf5, read_depth, 32 + 2 * 64),
    "dpt": Kind(".dpt", seeds_dpt, io.read_depth),
    "mitsuba": Kind(".xml", seeds_xml, dofsim.Lens.from_mitsuba),
    "blender": Kind(".json", seeds_json, read_camera),
    "toml": Kind(".toml", seeds_toml, render, 64),
    "csv": Kind(".csv", seeds_csv, batch, 64),
    "jsonl": Kind(".jsonl", seeds_jsonl, batch, 64),
    # A picture of 67 million pixels is always believed; its decoder says no before it takes them.
    "heic": Kind(".heic", seeds_heic, photo.read, 64),
    "phone": Kind(".jpg", seeds_phone, photo.read, 64),
}


# Changes

NUMBERS = [0, 1, 7, 127, 128, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1]
WORDS = [
    *(b"-1", b"0", b"1e400", b"-1e-400", b"nan", b"inf", b"1_0", b"9" * 5000, b"0x10", b"true", b"null"),
    *(b'"', b"'", b"\\", b"$", b"$a", b"&far;", b"<", b"]]>", b"{", b"[", b",", b"=", b"\n", b"\r\n", b"#"),
    *(b"\0", b"\x1b[31m", b"\\ud800", b"\\u0000", "\u202e".encode(), b"\xff\xfe", b"../", b"/", b"~", b"."),
    b'<!ENTITY b "&far;&far;&far;&far;">',
]


def place(data: bytearray, random: Random) -> int:
    """Choose where to change a file: often near its beginning, where it says what it is."""
    return random.randrange(min(len(data), random.choice([64, 400, 1 << 30])) + 1)


def some(data: bytes | bytearray, random: Random) -> bytes:
    start = random.randrange(len(data) + 1)
    return bytes(data[start : start + random.choice([1, 2, 4, 8, 16, 64, 256])])


def set_byte(data: bytearray, random: Random) -> None:
    at = place(data, random)
    data[at : at + 1] = bytes([random.choice([0, 255, random.randrange(256)])])


def flip_bit(data: bytearray, random: Random) -> None:
    at = place(data, random)
    data[at : at + 1] = bytes(byte ^ 1 << random.randrange(8) for byte in data[at : at + 1])


def cut(data: bytearray, random: Random) -> None:
    del data[random.randrange(len(data) + 1) :]


def drop(data: bytearray, random: Random) -> None:
    at = place(data, random)
    del data[at : at + random.choice([1, 2, 4, 8, 64])]


def repeat(data: bytearray, random: Random) -> None:
    at = place(data, random)
    data[at:at] = some(data, random)[:64] * random.choice([1, 2, 50, 1000])


def put_number(data: bytearray, random: Random) -> None:
    at, size = place(data, random), random.choice([2, 4, 8])
    number = random.choice(NUMBERS) % 2 ** (8 * size)
    data[at : at + size] = number.to_bytes(size, random.choice(["little", "big"]))


def put_word(data: bytearray, random: Random) -> None:
    at = place(data, random)
    data[at : at + random.choice([0, 0, 1, 3])] = random.choice(WORDS)


CHANGES = [set_byte, flip_bit, cut, drop, repeat, put_number, put_word]


def mutant(seeds: list[bytes], random: Random) -> bytes:
    data = bytearray(random.choice(seeds))
    for _ in range(random.choice([1, 1, 1, 2, 3])):
        if random.random() < 0.1:
            at = place(data, random)
            data[at : at + 64] = some(random.choice(seeds), random)
        else:
            random.choice(CHANGES)(data, random)
    return bytes(data)


# The law


def forget_peak() -> int:
    """Begin to measure anew the most memory this process has; return what it has now, in KiB."""
    Path("/proc/self/clear_refs").write_text("5")
    return peak()


def peak() -> int:
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0])


def check(kind: Kind, path: Path) -> bool:
    """Tell whether a file was read; what is neither read nor refused as it should be is an AssertionError."""
    before, start = forget_peak() if sys.platform == "linux" else 0, time.process_time()
    read = True
    try:
        with contextlib.redirect_stdout(text_io.StringIO()):
            kind.read(path)
    except Refused:
        read = False
    except (ValueError, TypeError, OSError) as error:
        if str(path) not in str(error):
            raise AssertionError("the file is not named") from error
        read = False
    seconds = time.process_time() - start
    assert seconds < SLOW_S, f"it took {seconds:.1f} s"
    if sys.platform == "linux":
        taken = (peak() - before) >> 10
        assert taken < kind.most_mib, f"it took {taken} MiB"
    return read


def fuzz(name: str, folder: Path, first: int, cases: int | None, seconds: float) -> None:
    kind = KINDS[name]
    # What stands beside a list of frames or a lens.
    color = np.linspace(0, 1, 5 * 7 * 3, dtype=np.float32).reshape(5, 7, 3)
    io.write_image(folder / "a.exr", color, depth=depth())
    io.write_image(folder / "iris.png", np.ones((3, 3)))
    seeds = kind.seeds(folder)
    path = folder / f"case{kind.suffix}"
    for data in seeds:
        path.write_bytes(data)
        kind.read(path)
    read = number = 0
    end = time.process_time() + seconds
    while number < cases if cases is not None else time.process_time() < end:
        path.write_bytes(mutant(seeds, Random(f"{name} {first + number}")))
        faulthandler.dump_traceback_later(HANG_S, exit=True)
        try:
            read += check(kind, path)
        except BaseException:
            print(f"{name}: case {first + number}, {path}:", path.read_bytes()[:2000], file=sys.stderr)
            raise
        finally:
            faulthandler.cancel_dump_traceback_later()
        number += 1
    print(f"{name}: {number} cases, {read} read")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=Random().randrange(10**12))
    parser.add_argument("--cases", type=int)
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="of processor time; unless --cases are given"
    )
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    folder = given.folder.resolve()
    os.chdir(folder)
    warnings.simplefilter("ignore")
    # Libraries in C say what they find past Python, thousands of times.
    sys.stderr = os.fdopen(os.dup(2), "w", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    fuzz(given.kind, folder, given.first, given.cases, given.seconds)


if __name__ == "__main__":
    main()
