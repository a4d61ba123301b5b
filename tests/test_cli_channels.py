"""The passes of an OpenEXR file through one lens, from the command line."""

import dofsim
import numpy as np
import pytest
from command_lines import LENS, LENS_OPTIONS, fails
from dofsim import io
from dofsim._channel_kinds import id_sets, kinds_of
from dofsim._channels import Channel
from dofsim.cli import run

OpenEXR = pytest.importorskip("OpenEXR", reason="files are written with the reference library")

SIZE = (48, 64)
RANKS = [f"CryptoObject{rank:02d}.{letter}" for rank in range(2) for letter in "RGBA"]
MANIFEST = {
    "cryptomatte/1a2b3c4/name": "CryptoObject",
    "cryptomatte/1a2b3c4/manifest": '{"ball":"3f4a9b21","wall":"5e6c0d17"}',
}


@pytest.fixture
def passes(tmp_path, monkeypatch):
    """Go to a folder with a file of three parts; give its planes by their full names."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    near = np.zeros(SIZE, bool)
    near[10:30, 20:40] = True
    planes = {f"main.{name}": rng.random(SIZE, dtype=np.float32) for name in ("R", "G", "B")}
    planes["main.A"] = np.ones(SIZE, np.float32)
    for name in "RGB":
        planes[f"main.diffuse.{name}"] = rng.random(SIZE, dtype=np.float32).astype(np.float16)
        planes[f"main.specular.{name}"] = planes[f"main.{name}"] - planes[f"main.diffuse.{name}"]
    planes["data.Z"] = np.where(near, 1.5, 6.0).astype(np.float32)
    for axis in "XYZ":
        planes[f"data.N.{axis}"] = np.full(SIZE, 3**-0.5, np.float32)
        planes[f"data.P.{axis}"] = rng.normal(size=SIZE).astype(np.float32)
    for channel in RANKS:
        planes[f"ids.{channel}"] = np.zeros(SIZE, np.float32)
    planes["ids.CryptoObject00.R"] = np.where(near, 7.25, 9.5).astype(np.float32)
    planes["ids.CryptoObject00.G"] = np.ones(SIZE, np.float32)
    parts = []
    for part in ("main", "data", "ids"):
        own = {name.partition(".")[2]: plane for name, plane in planes.items() if name.startswith(part)}
        header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
        parts.append(OpenEXR.Part(header | (MANIFEST if part == "ids" else {}), own, part))
    with OpenEXR.File(parts) as file:
        file.write("a.exr")
    return planes


def test_all_channels_come_back_in_their_parts_under_their_names_and_types(passes):
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--channels", "*"]) == 0
    assert sorted(io.list_channels("o.exr")) == sorted(passes)
    with OpenEXR.File("o.exr", separate_channels=True) as file:
        assert [part.name() for part in file.parts] == ["main", "data", "ids"]
        assert file.parts[0].channels["diffuse.R"].pixels.dtype == np.float16
        assert file.parts[0].channels["specular.R"].pixels.dtype == np.float32
        kept = [{name: part.header.get(name) for name in MANIFEST} for part in file.parts]
    assert kept[2] == MANIFEST
    assert set(kept[0].values()) == {None}


def test_channels_are_those_of_render(passes):
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--channels", "*"]) == 0
    out = io.read_exr("o.exr")
    guide = np.stack([passes[f"main.{name}"] for name in "RGBA"], axis=-1)
    depth, lens = passes["data.Z"], dofsim.Lens(**LENS)

    def rendered(name, kind):
        plane = passes[name].astype(np.float32)
        return dofsim.render(plane, depth, lens, guide=guide, kinds=kind)

    for name, kind in (("main.specular.G", "light"), ("main.A", "matte"), ("data.P.X", "data")):
        np.testing.assert_array_equal(out[name], rendered(name, kind))
    half = rendered("main.diffuse.B", "light").astype(np.float16)
    np.testing.assert_array_equal(out["main.diffuse.B"], half)
    ids = np.stack([passes[f"ids.{name}"] for name in RANKS], axis=-1)
    ranks = dofsim.render_ids(ids, depth, lens, guide=guide)
    np.testing.assert_array_equal(np.stack([out[f"ids.{name}"] for name in RANKS], axis=-1), ranks)
    length = np.sqrt(sum(out[f"data.N.{axis}"] ** 2 for axis in "XYZ"))
    np.testing.assert_allclose(length, 1.0, atol=1e-5)


def test_lights_add_up_to_the_picture(passes):
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--channels", "main.*"]) == 0
    out = io.read_exr("o.exr")
    # A file of one part has no need of its name before every channel.
    assert sorted(f"main.{name}" for name in out) == sorted(
        name for name in passes if name.startswith("main.")
    )
    for name in "RGB":
        # The half floats of one of them are rounded.
        total = out[f"diffuse.{name}"] + out[f"specular.{name}"]
        np.testing.assert_allclose(total, out[name], atol=1e-3)


def test_what_channels_are_taken_for_is_said_and_can_be_said_otherwise(passes, capsys):
    assert (
        run(
            ["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--channels", "data.*", "--kind", "data.n=data"]
        )
        == 0
    )
    said = capsys.readouterr().err
    assert "a.exr: data: data.N.X, data.N.Y, data.N.Z, data.P.X, data.P.Y, data.P.Z, data.Z" in said
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--kind", "ids.*=none"]) == 0
    assert {name.partition(".")[0] for name in io.list_channels("o.exr")} == {"main", "data"}


def test_a_margin_beyond_the_display_window_is_used_by_every_channel(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    channels = {name: rng.random(SIZE, dtype=np.float32) for name in ("R", "G", "B", "extra.R")}
    channels["Z"] = np.full(SIZE, 6.0, np.float32)
    window = np.array([8, 8], np.int32), np.array([SIZE[1] - 9, SIZE[0] - 9], np.int32)
    header = {"type": OpenEXR.scanlineimage, "displayWindow": window}
    copies = {name: plane.copy() for name, plane in channels.items()}
    with OpenEXR.File([OpenEXR.Part(header, copies, "")]) as file:
        file.write("a.exr")
    arguments = ["a.exr", "-o", "o.exr", *LENS_OPTIONS, "--window", "data", "--channels", "*"]
    assert run(["render", *arguments]) == 0
    guide = np.stack([channels[name] for name in "RGB"], axis=-1)
    expected = dofsim.render(
        channels["extra.R"], channels["Z"], dofsim.Lens(**LENS), guide=guide, overscan=8, kinds="light"
    )
    np.testing.assert_array_equal(io.read_exr("o.exr")["extra.R"], expected)


KINDS = {
    "R": "light", "A": "matte", "Z": "data", "mist.Z": "data", "ViewLayer.Combined.A": "matte",
    "ViewLayer.Normal.X": "normal", "ViewLayer.Normal.Y": "normal", "ViewLayer.Normal.Z": "normal",
    "ViewLayer.Depth.Z": "data", "ViewLayer.Vector.W": "data", "ViewLayer.UV.U": "data",
    "ViewLayer.IndexOB.X": "data", "ViewLayer.DiffCol.R": "light", "P.Z": "data", "P.X": "data",
    "P.Y": "data",
    "crypto_material00.red": "id", "CryptoAsset02.G": "id", "CryptoAsset.G": "light", "matte1.R": "matte",
    "motionvector.R": "data", "emission.R": "light",
}  # fmt: skip


def channels_of(names):
    return [Channel(0, name, name) for name in names]


def test_kinds_are_told_from_names():
    assert kinds_of(channels_of(KINDS)) == KINDS


def test_ids_are_in_the_order_of_their_ranks():
    shuffled = [
        "c/crypto01.B",
        "c/crypto01.A",
        "c/crypto00.G",
        "c/crypto00.R",
        "c/crypto01.R",
        "c/crypto00.A",
    ]
    (own,) = id_sets(channels_of([*shuffled, "c/crypto00.B", "c/crypto01.G"]))
    assert [channel.full[8:] for channel in own] == [
        "00.R",
        "00.G",
        "00.B",
        "00.A",
        "01.R",
        "01.G",
        "01.B",
        "01.A",
    ]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--channels", "nothing*"], "no channel or layer is called 'nothing*'"),
        (
            ["--channels", "*", "--kind", "N=beauty"],
            "--kind takes NAME=KIND, where KIND is one of light, matte",
        ),
        (["--channels", "*", "--kind", "nothing=data"], "--kind nothing=data: there is no such channel"),
        (["--channels", "*", "--kind", "data.Z=id"], "ids are R G B A of layers"),
        (
            ["--channels", "*", "--dtype", "half"],
            "--dtype: --channels gives every channel the type that it has",
        ),
        (["--channels", "*", "--method", "taps"], '--channels is for --method "lens"; got --method'),
        (["--channels", "*", "--supersample", "2"], "--supersample must be 1 for ids"),
        (["--channels", "*", "--profile"], "--profile is for a picture without --channels"),
        (["--channels", "*", "--device", "moon"], '--device must be "auto", "cpu", "gpu" or an adapter'),
        (["--channels", "*", "--kind", "*=none"], "--kind leaves no channel"),
    ],
)
def test_what_cannot_be_done_is_one_line(passes, capsys, arguments, text):
    line = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "-q", *arguments)
    assert text in line


def test_files_that_have_no_channels_are_refused(passes, capsys):
    io.write_image("a.png", np.ones((*SIZE, 3)))
    io.write_depth("z.pfm", np.full(SIZE, 2.0))
    line = fails(capsys, 2, "render", "a.png", "z.pfm", "-o", "o.exr", *LENS_OPTIONS, "--channels", "*")
    assert "--channels takes an OpenEXR or NPZ file and writes an OpenEXR file" in line
    io.write_exr("u.exr", {**{name: np.ones(SIZE) for name in "RGBZ"}, "id": np.ones(SIZE, np.uint32)})
    line = fails(capsys, 2, "render", "u.exr", "-o", "o.exr", *LENS_OPTIONS, "--channels", "*")
    assert "id holds whole numbers, of which there is no mean; leave it out with --kind id=none" in line
    far = np.full(SIZE, 4.0, np.float32)
    io.write_exr("i.exr", {**{name: np.ones(SIZE) for name in "RGB"}, "Z": far, "glow.R": far * np.inf})
    line = fails(capsys, 2, "render", "i.exr", "-o", "o.exr", *LENS_OPTIONS, "-q", "--channels", "*")
    assert "glow.R has inf at row 0, column 0; say what it is, as with --kind glow.R=data" in line
