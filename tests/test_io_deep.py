"""Deep OpenEXR files: any number of samples a pixel, read as layers."""

import resource
import struct
import tracemalloc

import dofsim
import numpy as np
import OpenEXR
import pytest
from dofsim import io
from dofsim._deep import flatten

CHANNELS = ("A", "B", "G", "R", "Z")


def attribute(name, kind, data):
    return f"{name}\0{kind}\0".encode() + struct.pack("<i", len(data)) + data


def deep_scanlines(pixels, *, data_window=None, display_window=None):
    """Write a deep file by the format's description: one part, 32-bit floats, no compression."""
    height, width = pixels["Z"].shape
    data_window = data_window or (0, 0, width - 1, height - 1)
    channels = b"".join(name.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, 1, 1) for name in CHANNELS)
    header = b"".join(
        (
            attribute("channels", "chlist", channels + b"\0"),
            attribute("compression", "compression", b"\0"),
            attribute("dataWindow", "box2i", struct.pack("<4i", *data_window)),
            attribute("displayWindow", "box2i", struct.pack("<4i", *(display_window or data_window))),
            attribute("lineOrder", "lineOrder", b"\0"),
            attribute("pixelAspectRatio", "float", struct.pack("<f", 1)),
            attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
            attribute("screenWindowWidth", "float", struct.pack("<f", 1)),
            attribute("type", "string", b"deepscanline"),
            attribute("version", "int", struct.pack("<i", 1)),
            attribute("chunkCount", "int", struct.pack("<i", height)),
            attribute("maxSamplesPerPixel", "int", struct.pack("<i", max(map(len, pixels["Z"].ravel())))),
        )
    )
    start = struct.pack("<II", 20000630, 2 | 1 << 11) + header + b"\0"
    chunks = []
    for y in range(height):
        counts = struct.pack(f"<{width}i", *np.cumsum([len(samples) for samples in pixels["Z"][y]]))
        data = b"".join(pixels[name][y, x].astype("<f4").tobytes() for name in CHANNELS for x in range(width))
        sizes = struct.pack("<iQQQ", data_window[1] + y, len(counts), len(data), len(data))
        chunks.append(sizes + counts + data)
    offsets = np.cumsum([len(start) + 8 * height, *map(len, chunks)])[:-1]
    return start + struct.pack(f"<{height}Q", *offsets) + b"".join(chunks)


def cells(shape, samples):
    """Arrays of samples from a function of the pixel."""
    pixels = {}
    for place in np.ndindex(shape):
        for name, values in samples(*place).items():
            pixels.setdefault(name, np.empty(shape, object))[place] = np.asarray(values, np.float32)
    return pixels


@pytest.fixture
def noise():
    rng = np.random.default_rng(5)

    def samples(_y, _x):
        n = rng.integers(0, 9)
        alpha = rng.uniform(0.1, 1.0, n)
        color = {name: alpha * rng.uniform(0.0, 3.0, n) for name in "RGB"}
        return {**color, "A": alpha, "Z": rng.uniform(0.5, 9.0, n)}

    return cells((13, 17), samples)


def over(pixels):
    """All samples of each pixel over one another, in plain words."""
    out = np.zeros((*pixels["Z"].shape, 4))
    for place in np.ndindex(pixels["Z"].shape):
        left = 1.0
        for i in np.argsort(pixels["Z"][place]):
            out[place] += left * np.array([pixels[name][place][i] for name in "RGBA"], np.float64)
            left *= 1.0 - pixels["A"][place][i]
    return out


def flat(color):
    out, left = np.zeros(color.shape[1:]), np.ones((*color.shape[1:3], 1))
    for layer in color.astype(np.float64):
        out += left * layer
        left *= 1.0 - layer[..., 3:]
    return out


@pytest.mark.parametrize("max_layers", [1, 2, 3, 4, 20])
def test_layers_over_one_another_are_the_samples_over_one_another(tmp_path, noise, max_layers):
    (tmp_path / "deep.exr").write_bytes(deep_scanlines(noise))
    color, depth = io.read_rgbd(tmp_path / "deep.exr", max_layers=max_layers)
    assert len(color) == min(max_layers, 8)
    np.testing.assert_allclose(flat(color), over(noise), atol=2e-6)
    covered = color[..., 3] > 0
    assert np.all(np.isinf(depth) == ~covered)
    # What is covered comes first, the nearest before the others.
    assert np.all(covered[:-1] >= covered[1:])
    assert np.all(depth[:-1] <= depth[1:])


def test_few_samples_are_kept_as_they_are(tmp_path, noise):
    (tmp_path / "deep.exr").write_bytes(deep_scanlines(noise))
    color, depth = io.read_rgbd(tmp_path / "deep.exr", max_layers=8)
    for place in np.ndindex(noise["Z"].shape):
        order = np.argsort(noise["Z"][place])
        n = len(order)
        np.testing.assert_array_equal(depth[(slice(n), *place)], noise["Z"][place][order])
        for c, name in enumerate("RGBA"):
            np.testing.assert_array_equal(color[(slice(n), *place, c)], noise[name][place][order])


def test_neighbours_in_disparity_are_merged_first_at_their_mean():
    near, pair, far = 0.5, (0.2, 0.21), 0.0
    alpha = [0.5, 0.6, 1.0, 1.0]
    disparity = np.array([near, pair[1], pair[0], far])
    with np.errstate(divide="ignore"):
        one = {"A": alpha, "Z": 1 / disparity, "R": [0, 1, 2, 0], "G": [0] * 4, "B": [0] * 4}
    color, depth = flatten(cells((1, 1), lambda *_: one), 3)
    assert color[:, 0, 0, 0].tolist() == pytest.approx([0.0, 1 + 0.4 * 2, 0.0])
    assert color[:, 0, 0, 3].tolist() == pytest.approx([0.5, 1.0, 1.0])
    assert (1 / depth[:, 0, 0]).tolist() == pytest.approx([near, 0.6 * pair[1] + 0.4 * pair[0], far])


def volume(z, back, alpha, red):
    """Make one pixel of volumes."""
    values = {"A": alpha, "Z": z, "ZBack": back, "R": red, "G": np.zeros(len(z)), "B": np.zeros(len(z))}
    return cells((1, 1), lambda *_: values)


def test_a_volume_is_split_at_even_disparities_and_stops_as_much():
    color, depth = flatten(volume([1.0], [4.0], [0.9], [0.6]), 3)
    # Six pieces of a share of the way each, merged to three of two.
    disparity = np.linspace(1.0, 0.25, 7)
    share = np.diff(1 / disparity) / 3.0
    stopped = 1.0 - 0.1**share
    expected = 1.0 - (1.0 - stopped[0::2]) * (1.0 - stopped[1::2])
    np.testing.assert_allclose(color[:, 0, 0, 3], expected, rtol=1e-5)
    np.testing.assert_allclose(flat(color)[0, 0], [0.6, 0.0, 0.0, 0.9], rtol=1e-5)
    bounds = 1 / depth[:, 0, 0]
    assert np.all((bounds < disparity[0:6:2]) & (bounds > disparity[2::2]))


def test_two_halves_of_a_volume_are_the_volume():
    halves = 1.0 - np.sqrt(0.2)
    red = 0.5 * halves / 0.8
    whole = flatten(volume([1.0], [3.0], [0.8], [0.5]), 24)
    split = flatten(volume([1.0, 2.0], [2.0, 3.0], [halves] * 2, [red] * 2), 24)
    np.testing.assert_allclose(flat(split[0]), flat(whole[0]), rtol=1e-5)
    # The disparity at which half of the light has been stopped, or any other part of it.
    parts = np.linspace(0.1, 0.7, 7)
    seen = []
    for color, depth in (whole, split):
        stopped = 1.0 - np.cumprod(1.0 - color[:, 0, 0, 3].astype(float))
        seen.append(np.interp(parts, stopped, 1 / depth[:, 0, 0]))
    np.testing.assert_allclose(seen[1], seen[0], rtol=0.02)


def test_solid_and_thin_volumes():
    # What is opaque is seen at its front; what has no extent, or no end, stands where it begins.
    color, depth = flatten(volume([1.0, 5.0], [2.0, 6.0], [1.0, 1.0], [0.5, 0.7]), 4)
    assert (color[0, 0, 0, 0], color[0, 0, 0, 3]) == (0.5, 1.0)
    assert depth[0, 0, 0] < 1.2
    thin = {"A": [0.5, 0.25], "Z": [1.0, 2.0], "R": [0.1, 0.2], "G": [0, 0], "B": [0, 0]}
    for back in ([1.0, 2.0], [0.5, np.inf]):
        for found, expected in zip(
            flatten(volume(thin["Z"], back, thin["A"], thin["R"]), 4),
            flatten(cells((1, 1), lambda *_: thin), 4),
            strict=True,
        ):
            np.testing.assert_array_equal(found, expected)


def test_light_without_coverage_keeps_its_place_and_its_light():
    glow = {"A": [0.0, 1.0], "Z": [1.0, 2.0], "R": [5.0, 0.25], "G": [0, 0], "B": [0, 0]}
    color, depth = flatten(cells((1, 1), lambda *_: glow), 4)
    assert depth[:, 0, 0].tolist() == [1.0, 2.0]
    assert color[0, 0, 0].tolist() == pytest.approx([5.0, 0.0, 0.0, 1e-3])


def test_without_alpha_samples_are_opaque_and_grey_is_all_colours():
    color, depth = flatten(cells((1, 1), lambda *_: {"Z": [3.0], "Y": [0.5]}), 4)
    assert color.tolist() == [[[[0.5, 0.5, 0.5, 1.0]]]]
    assert depth.tolist() == [[[3.0]]]


def test_windows(tmp_path, noise):
    height, width = noise["Z"].shape
    stored = (2, -3, 2 + width - 1, -3 + height - 1)
    seen = (0, 0, width + 4, 5)
    path = tmp_path / "deep.exr"
    path.write_bytes(deep_scanlines(noise, data_window=stored, display_window=seen))
    all_color, all_depth = io.read_rgbd(path, window="data")
    color, depth = io.read_rgbd(path)
    assert color.shape[1:3] == (6, width + 5)
    np.testing.assert_array_equal(color[:, :, 2 : 2 + width], all_color[:, 3:9])
    np.testing.assert_array_equal(depth[:, :, 2 : 2 + width], all_depth[:, 3:9])
    assert not color[:, :, :2].any()
    assert np.isinf(depth[:, :, :2]).all()


def test_what_the_official_library_writes(tmp_path, noise):
    header = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.deepscanline}
    with OpenEXR.File(header, dict(noise)) as file:
        file.write(str(tmp_path / "official.exr"))
    (tmp_path / "own.exr").write_bytes(deep_scanlines(noise))
    for ours, theirs in zip(
        io.read_rgbd(tmp_path / "own.exr"), io.read_rgbd(tmp_path / "official.exr"), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)


def test_peeled_layers_come_back_as_they_were(tmp_path):
    rng = np.random.default_rng(6)
    there = np.arange(3)[:, None, None] < rng.integers(1, 4, (24, 32))
    depth = np.where(there, np.cumsum(rng.uniform(0.1, 2.0, there.shape), axis=0), np.inf).astype(np.float32)
    color = np.where(there[..., None], rng.random((*there.shape, 4)), 0.0).astype(np.float32)

    def samples(y, x):
        some = there[:, y, x]
        return {**{name: color[some, y, x, c] for c, name in enumerate("RGBA")}, "Z": depth[some, y, x]}

    (tmp_path / "deep.exr").write_bytes(deep_scanlines(cells((24, 32), samples)))
    rgbd = io.read_rgbd(tmp_path / "deep.exr")
    np.testing.assert_array_equal(rgbd.color, color)
    np.testing.assert_array_equal(rgbd.depth, depth)
    lens = dofsim.Lens(aperture_radius=0.1, focus_distance=2.0, fov=40.0)
    assert dofsim.render(*rgbd, lens, alpha=rgbd.alpha).shape == (24, 32, 4)


def test_memory_grows_with_the_samples_and_not_with_the_most_of_a_pixel(noise):
    shape = (300, 400)
    rng = np.random.default_rng(5)
    counts = np.ones(shape, int)
    counts[7, 9], counts[100:103] = 5000, 40
    channels = {name: np.empty(shape, object) for name in CHANNELS}
    for place in np.ndindex(shape):
        for name in CHANNELS:
            channels[name][place] = rng.random(counts[place], np.float32)
    tracemalloc.start()
    color, depth = flatten(channels, 4)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert color.shape == (4, *shape, 4)
    # Padded to 5000 samples a pixel it would be 12 GB.
    assert peak < 300 << 20
    for place in [(7, 9), (0, 0), (101, 50)]:
        alone, far = flatten(
            {name: channels[name][place[0] : place[0] + 1, place[1] : place[1] + 1] for name in CHANNELS}, 4
        )
        count = len(alone)
        np.testing.assert_array_equal(color[:count, place[0], place[1]], alone[:, 0, 0])
        np.testing.assert_array_equal(depth[:count, place[0], place[1]], far[:, 0, 0])


@pytest.mark.parametrize("keep", [3, 7, 200, 900])
def test_damaged_files_are_errors(tmp_path, noise, keep):
    (tmp_path / "deep.exr").write_bytes(deep_scanlines(noise)[:keep])
    with pytest.raises(ValueError, match=r"deep\.exr"):
        io.read_rgbd(tmp_path / "deep.exr")


@pytest.mark.parametrize("window", ["data_window", "display_window"])
@pytest.mark.parametrize("box", [(0, 0, 59999, 59999), (-(2**31), 0, 2**31 - 1, 0), (5, 5, 4, 4)])
def test_a_short_file_that_claims_a_huge_window_is_cheap(tmp_path, noise, window, box):
    (tmp_path / "deep.exr").write_bytes(deep_scanlines(noise, **{window: box}))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match=r"deep\.exr: damaged file: its header claims .* cannot hold"):
        io.read_rgbd(tmp_path / "deep.exr")
    # Kibibytes on Linux, and bytes elsewhere, where this is no test.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 64 * 1024


def test_words_that_deep_files_do_not_take(tmp_path, noise):
    (tmp_path / "deep.exr").write_bytes(deep_scanlines(noise))
    with pytest.raises(ValueError, match="layer and depth_channel"):
        io.read_rgbd(tmp_path / "deep.exr", layer="beauty")
    with pytest.raises(ValueError, match="max_layers must be positive; got 0"):
        io.read_rgbd(tmp_path / "deep.exr", max_layers=0)
