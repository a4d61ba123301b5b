"""Channels of deep OpenEXR files and of arrays in layers through one lens, from the command line."""

import dofsim
import numpy as np
import pytest
from command_lines import LENS, LENS_OPTIONS, fails
from dofsim import io
from dofsim._deep import flatten, read_deep_channels
from dofsim._dofsim import layers_of_samples
from dofsim.cli import run
from test_io_deep import cells, joined

OpenEXR = pytest.importorskip("OpenEXR", reason="files are written with the reference library")

SIZE = (24, 32)
RANKS = [f"crypto{rank:02d}.{letter}" for rank in range(2) for letter in "RGBA"]
MANIFEST = {
    "cryptomatte/1a2b3c4/name": "crypto",
    "cryptomatte/1a2b3c4/manifest": '{"fog":"3f4a9b21","wall":"5e6c0d17"}',
}
FOG, LEFT, RIGHT = 1.5, 2.5, 3.5


def samples_of(y, x, pieces=1):
    """Give fog in so many equal pieces before a wall of two halves, with lights, places and ids."""
    rng = np.random.default_rng(1000 * y + x)
    alpha = np.append(np.full(pieces, 1 - 0.7 ** (1 / pieces)), 1.0)
    color = rng.random(3)
    own = {"A": alpha, "Z": [*np.linspace(1.0, 2.0, pieces), 4.0 + 0.1 * x]}
    for c, name in enumerate("RGB"):
        own[name] = [*(0.5 * alpha[:-1]), color[c]]
        own[f"diffuse.{name}"] = 0.25 * np.asarray(own[name])
        own[f"specular.{name}"] = 0.75 * np.asarray(own[name])
    own["P.X"] = [*np.full(pieces, -3.0), float(x)]
    own |= {name: np.zeros(pieces + 1) for name in RANKS}
    own["crypto00.R"] = [*np.full(pieces, FOG), LEFT if x < SIZE[1] // 2 else RIGHT]
    # Some programs write 1 here, and others the alpha of the sample.
    own["crypto00.G"] = np.ones(pieces + 1)
    return own


def write_deep(path, pixels, header=None, types=None):
    """Write a deep file whose channels are float32, or of the types that are named."""
    kinds = {name: (types or {}).get(name, np.float32) for name in pixels}
    stored = {}
    for name, plane in pixels.items():
        stored[name] = np.empty(plane.shape, object)
        for place in np.ndindex(plane.shape):
            stored[name][place] = np.asarray(plane[place], kinds[name])
    header = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.deepscanline} | (header or {})
    with OpenEXR.File(header, stored) as file:
        file.write(str(path))


@pytest.fixture
def deep(tmp_path, monkeypatch):
    """Go to a folder with a deep file of two samples a pixel; give its channels."""
    monkeypatch.chdir(tmp_path)
    pixels = cells(SIZE, samples_of)
    write_deep("d.exr", pixels, MANIFEST, {"diffuse.R": np.float16, "diffuse.G": np.float16})
    return {name: np.stack(list(plane.ravel())).reshape(*SIZE, -1) for name, plane in pixels.items()}


def layered(plane):
    """Give samples as layers."""
    return np.ascontiguousarray(np.moveaxis(plane, -1, 0))


def test_channels_of_deep_files_are_those_of_render_in_layers(deep):
    assert run(["render", "d.exr", "-o", "o.exr", *LENS_OPTIONS, "--channels", "*"]) == 0
    out = io.read_exr("o.exr")
    assert sorted(out) == sorted(deep)
    guide = np.stack([layered(deep[name]) for name in "RGBA"], axis=-1)
    depth, lens = layered(deep["Z"]), dofsim.Lens(**LENS)
    for name, kind in (("specular.G", "light"), ("A", "matte"), ("P.X", "data"), ("Z", "data")):
        expected = dofsim.render(layered(deep[name]), depth, lens, guide=guide, kinds=kind)
        np.testing.assert_array_equal(out[name], expected)
    ids = np.stack([layered(deep[name]) for name in RANKS], axis=-1)
    ids[..., 1] *= guide[..., 3]
    ranks = dofsim.render_ids(ids, depth, lens, guide=guide)
    np.testing.assert_array_equal(np.stack([out[name] for name in RANKS], axis=-1), ranks)
    with OpenEXR.File("o.exr", separate_channels=True) as file:
        assert {name: file.header()[name] for name in MANIFEST} == MANIFEST
        assert file.channels()["diffuse.R"].pixels.dtype == np.float16
        assert file.channels()["specular.R"].pixels.dtype == np.float32


def test_lights_add_up_to_the_beauty_however_many_samples_are_merged(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_deep("d.exr", cells(SIZE, lambda y, x: samples_of(y, x, 3 + (x + y) % 9)))
    assert run(["render", "d.exr", "-o", "o.exr", *LENS_OPTIONS, "--channels", "*"]) == 0
    out = io.read_exr("o.exr")
    for name in "RGB":
        np.testing.assert_allclose(out[f"diffuse.{name}"] + out[f"specular.{name}"], out[name], atol=1e-5)
    ranks = np.stack([out[name] for name in RANKS], axis=-1)
    np.testing.assert_allclose(ranks[..., 1::2].sum(axis=-1), out["A"], atol=1e-5)
    assert {FOG, LEFT, RIGHT} == set(ranks[..., 0::2][ranks[..., 1::2] > 0])


def test_data_of_merged_samples_are_a_mean_of_what_is_seen(tmp_path, monkeypatch):
    """Fog covers 0.3 of everything, and its place is -3."""
    monkeypatch.chdir(tmp_path)
    write_deep("d.exr", cells(SIZE, lambda y, x: samples_of(y, x, 9)))
    assert run(["render", "d.exr", "-o", "o.exr", *LENS_OPTIONS, "--channels", "P"]) == 0
    expected = 0.3 * -3.0 + 0.7 * np.arange(SIZE[1])
    np.testing.assert_allclose(io.read_exr("o.exr")["P.X"][12, 8:-8], expected[8:-8], atol=0.05)


def over(samples, alpha):
    """Give samples over each other, near to far, in f64."""
    through = np.cumprod(np.append(1.0, 1.0 - np.asarray(alpha, float)))[:-1]
    return float(np.sum(through * samples))


@pytest.mark.parametrize("pieces", [1, 4, 5, 17])
def test_merged_samples_are_over_each_other_and_data_a_mean_of_what_is_seen(tmp_path, pieces):
    """One pixel: what all its layers show together is what all its samples do."""
    rng = np.random.default_rng(pieces)
    own = {"A": np.append(rng.uniform(0.05, 0.6, pieces), 1.0), "Z": np.sort(rng.uniform(1, 9, pieces + 1))}
    own |= {name: rng.random(pieces + 1) * own["A"] for name in ("R", "G", "B", "glow")}
    own["place"] = rng.normal(size=pieces + 1)
    write_deep(tmp_path / "d.exr", cells((1, 1), lambda *_: own))
    means = [("glow", "light"), ("place", "data"), ("A", "light")]
    merged = read_deep_channels(tmp_path / "d.exr", means, [])
    alpha = merged["A"][:, 0, 0]
    assert len(alpha) == min(pieces + 1, 4)
    assert over(merged["glow"][:, 0, 0], alpha) == pytest.approx(over(own["glow"], own["A"]), rel=1e-5)
    seen = own["place"] * own["A"]
    assert over(merged["place"][:, 0, 0] * alpha, alpha) == pytest.approx(over(seen, own["A"]), rel=1e-5)
    # The layers are those that lead.
    color, depth = io.read_rgbd(tmp_path / "d.exr")
    np.testing.assert_array_equal(merged["Z"], depth)
    np.testing.assert_allclose(merged["A"], color[..., 3], rtol=1e-6)
    if pieces < 4:
        np.testing.assert_array_equal(merged["place"][:, 0, 0], np.float32(own["place"]))


def test_pieces_of_a_volume_share_its_light_and_have_its_place(tmp_path):
    own = {"A": [0.8, 1.0], "Z": [1.0, 5.0], "ZBack": [4.0, 5.0], "R": [0.4, 0.1], "G": [0, 0], "B": [0, 0]}
    own |= {"fire.R": [1.5, 0.25], "P.X": [7.0, -2.0]}
    write_deep(tmp_path / "d.exr", cells((1, 1), lambda *_: own))
    merged = read_deep_channels(
        tmp_path / "d.exr", [("fire.R", "light"), ("P.X", "data"), ("A", "light")], []
    )
    alpha = merged["A"][:, 0, 0]
    assert len(alpha) == 4
    assert over(merged["fire.R"][:, 0, 0], alpha) == pytest.approx(1.5 + 0.2 * 0.25, rel=1e-5)
    np.testing.assert_allclose(merged["P.X"][:, 0, 0], [7, 7, 7, -2], rtol=1e-6)


def test_ids_of_merged_samples_cover_as_much_as_the_layer(tmp_path):
    """Three things of which two are kept, and coverage that some programs write as 1 and others as alpha."""
    for coverage in (np.ones(6), np.full(6, 0.5)):
        own = {"A": [0.5] * 6, "Z": [1.0, 1.0, 1.0, 2.0, 3.0, 4.0]}
        own |= {name: np.zeros(6) for name in ("R", "G", "B", "c00.B", "c00.A")}
        own |= {"c00.R": [7.0, 8.0, 9.0, 7.0, 7.0, 7.0], "c00.G": coverage}
        write_deep(tmp_path / "d.exr", cells((1, 1), lambda *_, own=own: own))
        merged = read_deep_channels(tmp_path / "d.exr", [], [["c00.R", "c00.G", "c00.B", "c00.A"]])
        ranks = np.stack([merged[f"c00.{letter}"][:, 0, 0] for letter in "RGBA"], axis=-1)
        total = 0.5 + 0.25 + 0.125
        share = total / 0.75
        np.testing.assert_allclose(ranks[0], [7.0, 0.5 * share, 8.0, 0.25 * share], rtol=1e-6)
        np.testing.assert_allclose(ranks[1:], [[7.0, 0.5, 0.0, 0.0]] * 3, rtol=1e-6)


def test_what_has_no_value_has_no_weight_where_samples_are_merged(tmp_path):
    own = {"A": [0.5, 0.5, 0.5, 0.5, 1.0], "Z": [1.0, 1.0, 2.0, 2.0, 2.0]}
    own |= {name: np.zeros(5) for name in "RGB"} | {"P.X": [np.inf, 3.0, np.nan, np.nan, 5.0]}
    write_deep(tmp_path / "d.exr", cells((1, 1), lambda *_: own))
    place = read_deep_channels(tmp_path / "d.exr", [("P.X", "data")], [])["P.X"][:, 0, 0]
    assert place[0] == 3.0
    assert place[-1] == 5.0


def test_merging_does_not_change_with_what_is_carried():
    pixels = cells(SIZE, lambda y, x: samples_of(y, x, 1 + (3 * y + x) % 7))
    counts, channels = joined(pixels)
    window = (0, 0, SIZE[1], SIZE[0])
    alone = flatten(counts, channels, 3)
    together = layers_of_samples(
        counts, channels, 3, window=window, means=[("R", "light"), ("P.X", "data")], ids=[RANKS]
    )
    for ours, theirs in zip(together[:2], alone, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_allclose(together[2][..., 0], alone[0][..., 0], rtol=1e-5, atol=1e-7)


def test_arrays_in_layers_are_channels(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    depth = np.stack([np.full(SIZE, 2.0), np.full(SIZE, 6.0)]).astype(np.float32)
    alpha = np.stack([rng.random(SIZE) < 0.4, np.ones(SIZE)]).astype(np.float32)
    color = rng.random((*depth.shape, 3), dtype=np.float32) * alpha[..., None]
    arrays = {
        "color": np.concatenate([color, alpha[..., None]], axis=-1),
        "depth": depth,
        "diffuse": (0.5 * color).astype(np.float16),
        "P": rng.normal(size=(*depth.shape, 3)).astype(np.float32),
        "mask": alpha * np.float32(0.5),
        "crypto00": np.stack([np.full_like(depth, 1.5), alpha, 0 * depth, 0 * depth], axis=-1),
        "intrinsics": np.eye(3),
    }
    np.savez("a.npz", **arrays)
    assert run(["render", "a.npz", "-o", "o.exr", *LENS_OPTIONS, "--channels", "*"]) == 0
    out = io.read_exr("o.exr")
    names = [*"RGBAZ", "mask", *(f"{name}.{c}" for name in ("diffuse", "P") for c in "RGB")]
    assert sorted(out) == sorted([*names, *(f"crypto00.{c}" for c in "RGBA")])
    lens, guide = dofsim.Lens(**LENS), arrays["color"]

    def rendered(plane, kind):
        return dofsim.render(np.ascontiguousarray(plane), depth, lens, guide=guide, kinds=kind)

    np.testing.assert_array_equal(out["R"], rendered(color[..., 0], "light"))
    np.testing.assert_array_equal(out["P.G"], rendered(arrays["P"][..., 1], "data"))
    np.testing.assert_array_equal(out["mask"], rendered(arrays["mask"], "matte"))
    half = rendered(arrays["diffuse"][..., 2].astype(np.float32), "light").astype(np.float16)
    np.testing.assert_array_equal(out["diffuse.B"], half)
    ranks = dofsim.render_ids(arrays["crypto00"], depth, lens, guide=guide)
    np.testing.assert_array_equal(out["crypto00.G"], ranks[..., 1])


def test_arrays_of_one_layer_are_channels(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    color = np.random.default_rng(4).random((*SIZE, 3), dtype=np.float32)
    depth = np.full(SIZE, 6.0, np.float32)
    np.savez("a.npz", color=color, depth=depth, uv=color[..., :2], aovs=np.ones((*SIZE, 5), np.float32))
    assert run(["render", "a.npz", "-o", "o.exr", *LENS_OPTIONS, "--channels", "*"]) == 0
    out = io.read_exr("o.exr")
    assert sorted(out) == sorted([*"RGBZ", "uv.U", "uv.V", *(f"aovs.{i}" for i in range(5))])
    expected = dofsim.render(color[..., 1], depth, dofsim.Lens(**LENS), guide=color, kinds="data")
    np.testing.assert_array_equal(out["uv.V"], expected)


def test_what_cannot_be_done_is_one_line(deep, capsys):
    render = ["render", "d.exr", "-o", "o.exr", *LENS_OPTIONS]
    line = fails(capsys, 2, *render, "--channels", "ZBack")
    assert "d.exr: no channel or layer is called 'ZBack'; channels: A, B, G, P.X" in line
    line = fails(capsys, 2, *render, "-q", "--kind", "crypto00.R=data")
    assert "ids are R G B A of layers" in line
    infinite = cells(SIZE, lambda y, x: samples_of(y, x) | {"glow.R": [np.inf, 1.0]})
    write_deep("i.exr", infinite)
    line = fails(capsys, 2, "render", "i.exr", "-o", "o.exr", *LENS_OPTIONS, "-q", "--channels", "*")
    assert "glow.R has inf at row 0, column 0 of layer 0; say what it is" in line
    write_deep("u.exr", cells(SIZE, samples_of), types={"P.X": np.uint32})
    line = fails(capsys, 2, "render", "u.exr", "-o", "o.exr", *LENS_OPTIONS, "--channels", "*")
    assert "P.X holds whole numbers, of which there is no mean" in line
    np.savez("n.npz", picture=np.ones((*SIZE, 3)), depth=np.ones(SIZE))
    line = fails(capsys, 2, "render", "n.npz", "-o", "o.exr", *LENS_OPTIONS, "--channels", "*")
    assert "n.npz: none of its arrays is called color or rgba or rgb; arrays: picture, depth" in line
    np.savez("c.npz", color=np.full((*SIZE, 3), 7, np.uint8), depth=np.ones(SIZE))
    line = fails(capsys, 2, "render", "c.npz", "-o", "o.exr", *LENS_OPTIONS, "--channels", "*")
    assert "c.npz: R holds whole numbers, of which there is no mean" in line
