"""Deep OpenEXR files: any number of samples a pixel, read as layers."""

import resource
import struct
import tracemalloc
import zlib

import dofsim
import numpy as np
import OpenEXR
import pytest
from dofsim import io
from dofsim._deep import flatten

CHANNELS = ("A", "B", "G", "R", "Z")


def attribute(name, kind, data):
    return f"{name}\0{kind}\0".encode() + struct.pack("<i", len(data)) + data


def packed(data):
    """Compress as ZIP does: even bytes before odd ones, each as the difference from the one before."""
    split = np.frombuffer(data[0::2] + data[1::2], np.uint8)
    differences = np.diff(split, prepend=split[:1]) + np.uint8(128)
    differences[:1] = split[:1]
    short = zlib.compress(differences.tobytes())
    return short if len(short) < len(data) else data


def header_of(pixels, compression, kind, count, data_window, display_window, *more):
    """Write the header of a file of one part of 32-bit floats."""
    channels = b"".join(name.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, 1, 1) for name in CHANNELS)
    header = b"".join(
        (
            attribute("channels", "chlist", channels + b"\0"),
            attribute("compression", "compression", bytes([compression])),
            attribute("dataWindow", "box2i", struct.pack("<4i", *data_window)),
            attribute("displayWindow", "box2i", struct.pack("<4i", *(display_window or data_window))),
            attribute("lineOrder", "lineOrder", b"\0"),
            attribute("pixelAspectRatio", "float", struct.pack("<f", 1)),
            attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
            attribute("screenWindowWidth", "float", struct.pack("<f", 1)),
            attribute("type", "string", kind),
            attribute("version", "int", struct.pack("<i", 1)),
            attribute("chunkCount", "int", struct.pack("<i", count)),
            attribute("maxSamplesPerPixel", "int", struct.pack("<i", max(map(len, pixels["Z"].ravel())))),
            *more,
        )
    )
    return struct.pack("<II", 20000630, 2 | 1 << 11) + header + b"\0"


def block(place, pixels, rows, columns, pack):
    """Write a block of these rows and columns, which begins with its place."""
    area = [[(y, x) for x in columns] for y in rows]
    counts = b"".join(
        np.cumsum([len(pixels["Z"][at]) for at in line]).astype("<i4").tobytes() for line in area
    )
    samples = (pixels[name][at].astype("<f4").tobytes() for line in area for name in CHANNELS for at in line)
    data = b"".join(samples)
    short, stored = pack(counts), pack(data)
    return place + struct.pack("<QQQ", len(short), len(stored), len(data)) + short + stored


def with_offsets(start, blocks):
    offsets = np.cumsum([len(start) + 8 * len(blocks), *map(len, blocks)])[:-1]
    return start + struct.pack(f"<{len(blocks)}Q", *offsets) + b"".join(blocks)


def deep_scanlines(pixels, *, data_window=None, display_window=None, lines=None):
    """Write a deep file by the format's description, without compression or with ZIP of so many lines."""
    height, width = pixels["Z"].shape
    data_window = data_window or (0, 0, width - 1, height - 1)
    compression, pack = {None: (0, bytes), 1: (2, packed), 16: (3, packed)}[lines]
    first = range(0, height, lines or 1)
    start = header_of(pixels, compression, b"deepscanline", len(first), data_window, display_window)
    blocks = [
        block(
            struct.pack("<i", data_window[1] + y),
            pixels,
            range(y, min(y + (lines or 1), height)),
            range(width),
            pack,
        )
        for y in first
    ]
    return with_offsets(start, blocks)


def deep_tiles(pixels, tile):
    """Write the same as tiles, compressed by ZIPS."""
    height, width = pixels["Z"].shape
    places = [(y, x) for y in range(0, height, tile[1]) for x in range(0, width, tile[0])]
    box = (0, 0, width - 1, height - 1)
    tiles = attribute("tiles", "tiledesc", struct.pack("<IIB", *tile, 0))
    start = header_of(pixels, 2, b"deeptile", len(places), box, None, tiles)
    blocks = [
        block(
            struct.pack("<4i", x // tile[0], y // tile[1], 0, 0),
            pixels,
            range(y, min(y + tile[1], height)),
            range(x, min(x + tile[0], width)),
            packed,
        )
        for y, x in places
    ]
    return with_offsets(start, blocks)


def cells(shape, samples):
    """Arrays of samples from a function of the pixel."""
    pixels = {}
    for place in np.ndindex(shape):
        for name, values in samples(*place).items():
            pixels.setdefault(name, np.empty(shape, object))[place] = np.asarray(values, np.float32)
    return pixels


def joined(pixels):
    """Give the counts of arrays of samples, and the samples of each channel one after another."""
    counts = np.array([[len(samples) for samples in row] for row in pixels["Z"]], np.uint32)
    return counts, {name: np.concatenate(list(samples.ravel())) for name, samples in pixels.items()}


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
    color, depth = flatten(*joined(cells((1, 1), lambda *_: one)), 3)
    assert color[:, 0, 0, 0].tolist() == pytest.approx([0.0, 1 + 0.4 * 2, 0.0])
    assert color[:, 0, 0, 3].tolist() == pytest.approx([0.5, 1.0, 1.0])
    # What is opaque stays where it is.
    assert (1 / depth[:, 0, 0]).tolist() == pytest.approx([near, pair[0], far])
    one["A"] = [0.5, 0.6, 0.2, 1.0]
    color, depth = flatten(*joined(cells((1, 1), lambda *_: one)), 3)
    first, second = -np.log([0.4, 0.8])
    mean = (first * pair[1] + second * pair[0]) / (first + second)
    assert (1 / depth[:, 0, 0]).tolist() == pytest.approx([near, mean, far])


def volume(z, back, alpha, red):
    """Make the samples of one pixel of volumes."""
    values = {"A": alpha, "Z": z, "ZBack": back, "R": red, "G": np.zeros(len(z)), "B": np.zeros(len(z))}
    return joined(cells((1, 1), lambda *_: values))


def test_a_volume_is_split_at_even_disparities_and_stops_as_much():
    color, depth = flatten(*volume([1.0], [4.0], [0.9], [0.6]), 3)
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
    whole = flatten(*volume([1.0], [3.0], [0.8], [0.5]), 24)
    split = flatten(*volume([1.0, 2.0], [2.0, 3.0], [halves] * 2, [red] * 2), 24)
    np.testing.assert_allclose(flat(split[0]), flat(whole[0]), rtol=1e-5)
    # The disparity at which half of the light has been stopped, or any other part of it.
    parts = np.linspace(0.1, 0.7, 7)
    seen = []
    for color, depth in (whole, split):
        stopped = 1.0 - np.cumprod(1.0 - color[:, 0, 0, 3].astype(float))
        seen.append(np.interp(parts, stopped, 1 / depth[:, 0, 0]))
    np.testing.assert_allclose(seen[1], seen[0], rtol=0.02)


@pytest.mark.parametrize("alpha", [0.05, 0.3, 0.7])
@pytest.mark.parametrize("max_layers", [2, 3, 4])
def test_a_wall_in_focus_stays_sharp_behind_fog(max_layers, alpha):
    """Fog that reaches the wall is merged with it, and does not move it."""
    shape = (48, 64)
    wall = np.random.default_rng(0).random((*shape, 3), np.float32)
    counts = np.full(shape, 2, np.uint32)

    def both(fog, behind):
        values = np.empty((*shape, 2), np.float32)
        values[..., 0], values[..., 1] = fog, behind
        return values.ravel()

    channels = {"Z": both(1.0, 5.0), "ZBack": both(5.0, 5.0), "A": both(alpha, 1.0)}
    channels |= {name: both(0.5 * alpha, wall[..., c]) for c, name in enumerate("RGB")}
    lens = dofsim.Lens.from_disparity(strength_px=10, focus=0.2)
    pictures = []
    for most in (24, max_layers):
        color, depth = flatten(counts, channels, most)
        np.testing.assert_allclose(depth[-1], 5.0)
        assert len(depth) == most
        picture = dofsim.render(color, 1 / depth, lens, depth_kind="disparity", device="cpu")
        pictures.append(picture[..., :3])
    # What is moved is fog alone, which has no pattern.
    assert np.abs(pictures[1] - pictures[0]).max() < 1e-3


def test_solid_and_thin_volumes():
    # What is opaque is seen at its front; what has no extent, or no end, stands where it begins.
    color, depth = flatten(*volume([1.0, 5.0], [2.0, 6.0], [1.0, 1.0], [0.5, 0.7]), 4)
    assert (color[0, 0, 0, 0], color[0, 0, 0, 3]) == (0.5, 1.0)
    assert depth[0, 0, 0] < 1.2
    thin = {"A": [0.5, 0.25], "Z": [1.0, 2.0], "R": [0.1, 0.2], "G": [0, 0], "B": [0, 0]}
    for back in ([1.0, 2.0], [0.5, np.inf]):
        for found, expected in zip(
            flatten(*volume(thin["Z"], back, thin["A"], thin["R"]), 4),
            flatten(*joined(cells((1, 1), lambda *_: thin)), 4),
            strict=True,
        ):
            np.testing.assert_array_equal(found, expected)


def test_light_without_coverage_keeps_its_place_and_its_light():
    glow = {"A": [0.0, 1.0], "Z": [1.0, 2.0], "R": [5.0, 0.25], "G": [0, 0], "B": [0, 0]}
    color, depth = flatten(*joined(cells((1, 1), lambda *_: glow)), 4)
    assert depth[:, 0, 0].tolist() == [1.0, 2.0]
    assert color[0, 0, 0].tolist() == pytest.approx([5.0, 0.0, 0.0, 1e-3])


def test_without_alpha_samples_are_opaque_and_grey_is_all_colours():
    color, depth = flatten(*joined(cells((1, 1), lambda *_: {"Z": [3.0], "Y": [0.5]})), 4)
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


def assert_is_noise(path, noise, stored=np.float32):
    """Assert that a file holds these samples, to the bit; their alpha alone may be of another type."""
    pixels = {**noise, "A": cells(noise["Z"].shape, lambda *at: {"A": noise["A"][at].astype(stored)})["A"]}
    for ours, theirs in zip(io.read_rgbd(path, max_layers=5), flatten(*joined(pixels), 5), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("compression", ["NO", "RLE", "ZIPS"])
@pytest.mark.parametrize("stored", [np.float32, np.float16])
def test_what_the_official_library_writes(tmp_path, noise, compression, stored):
    path = tmp_path / "official.exr"
    alpha = np.empty(noise["A"].shape, object)
    for place in np.ndindex(alpha.shape):
        alpha[place] = noise["A"][place].astype(stored)
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.deepscanline}
    with OpenEXR.File(header, {**noise, "A": alpha, "id": noise["Z"]}) as file:
        file.write(str(path))
    assert_is_noise(path, noise, stored)


def test_the_first_deep_part_with_depth_of_several_parts(tmp_path, noise):
    path = tmp_path / "parts.exr"
    deep = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.deepscanline}
    flat = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = [
        OpenEXR.Part(flat, {"Z": np.ones(noise["Z"].shape, np.float32)}, "flat"),
        OpenEXR.Part(dict(deep), {"A": noise["A"]}, "without depth"),
        OpenEXR.Part(dict(deep), dict(noise), "deep"),
        OpenEXR.Part(dict(deep), {"Z": noise["A"]}, "another"),
    ]
    with OpenEXR.File(parts) as file:
        file.write(str(path))
    assert_is_noise(path, noise)


@pytest.mark.parametrize("lines", [1, 16])
def test_zip_of_one_line_and_of_sixteen(tmp_path, noise, lines):
    (tmp_path / "deep.exr").write_bytes(deep_scanlines(noise, lines=lines))
    assert_is_noise(tmp_path / "deep.exr", noise)


@pytest.mark.parametrize("tile", [(4, 4), (5, 3), (64, 64)])
def test_tiles(tmp_path, noise, tile):
    (tmp_path / "deep.exr").write_bytes(deep_tiles(noise, tile))
    assert_is_noise(tmp_path / "deep.exr", noise)


def test_compression_that_deep_pixels_may_not_have_is_named(tmp_path, noise):
    data = deep_scanlines(noise).replace(
        attribute("compression", "compression", b"\0"), attribute("compression", "compression", b"\4")
    )
    (tmp_path / "deep.exr").write_bytes(data)
    with pytest.raises(
        ValueError, match=r"deep\.exr: found deep pixels of compression \[4\]; accepted: .*ZIPS"
    ):
        io.read_rgbd(tmp_path / "deep.exr")


def test_every_file_that_ends_too_early_is_an_error(tmp_path, noise):
    path = tmp_path / "deep.exr"
    for whole in (deep_scanlines(noise, lines=16), deep_tiles(noise, (5, 3)), deep_scanlines(noise)):
        for end in range(8, len(whole), 37):
            path.write_bytes(whole[:end])
            with pytest.raises(ValueError, match=r"deep\.exr: damaged file: "):
                io.read_rgbd(path)


def damaged(noise, at, value, kind="<Q"):
    """Put a number into the first block of a file, at these bytes from its beginning."""
    data = bytearray(deep_scanlines(noise))
    height = noise["Z"].shape[0]
    table = len(data) - sum(28 + 4 * len(row) + 20 * sum(map(len, row)) for row in noise["Z"]) - 8 * height
    (first,) = struct.unpack_from("<Q", data, table)
    struct.pack_into(kind, data, first + at, value)
    return data, table


@pytest.mark.parametrize(
    ("at", "value", "kind", "text"),
    [
        (0, 1, "<i", "blocks of pixels are missing|contradict one another"),
        (0, -7, "<i", "not where the file says"),
        (4, 2**40, "<Q", "its blocks are longer than the file"),
        (12, 2**63, "<Q", "its blocks are longer than the file"),
        (20, 2**63, "<Q", "which a file of .* cannot hold"),
        (20, 4, "<Q", "another number of samples than it says"),
        (28, -1, "<i", "the numbers of samples contradict one another"),
        (28 + 4 * 16, 2**31 - 1, "<i", "another number of samples than it says"),
    ],
)
def test_blocks_that_contradict_themselves_are_errors(tmp_path, noise, at, value, kind, text):
    data, _ = damaged(noise, at, value, kind)
    (tmp_path / "deep.exr").write_bytes(data)
    with pytest.raises(ValueError, match=rf"deep\.exr: damaged file: .*({text})"):
        io.read_rgbd(tmp_path / "deep.exr")


def test_a_block_that_is_named_twice_is_an_error(tmp_path, noise):
    data, table = damaged(noise, 0, 0, "<i")
    data[table : table + 8] = data[table + 8 : table + 16]
    (tmp_path / "deep.exr").write_bytes(data)
    with pytest.raises(ValueError, match=r"deep\.exr: damaged file: "):
        io.read_rgbd(tmp_path / "deep.exr")


def test_a_short_file_that_claims_many_samples_is_cheap(tmp_path):
    """Deflate makes a thousand bytes of one, and not more."""
    counts = np.zeros((1, 4096), object)
    for x in range(4096):
        counts[0, x] = np.zeros(300, np.float32)
    pixels = dict.fromkeys(CHANNELS, counts)
    whole = deep_scanlines(pixels, lines=1)
    assert len(whole) < 60_000
    (tmp_path / "deep.exr").write_bytes(whole)
    (tmp_path / "cut.exr").write_bytes(whole[:-1])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match="ends after the file"):
        io.read_rgbd(tmp_path / "cut.exr")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 8 * 1024
    color, depth = io.read_rgbd(tmp_path / "deep.exr")
    assert not color.any()
    assert np.isinf(depth).all()


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
    samples = joined(channels)
    tracemalloc.start()
    color, depth = flatten(*samples, 4)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert color.shape == (4, *shape, 4)
    # Padded to 5000 samples a pixel it would be 12 GB.
    assert peak < 300 << 20
    for place in [(7, 9), (0, 0), (101, 50)]:
        own = {name: channels[name][place[0] : place[0] + 1, place[1] : place[1] + 1] for name in CHANNELS}
        alone, far = flatten(*joined(own), 4)
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


def test_empty_surroundings_take_no_more_memory_than_what_is_returned(tmp_path, noise):
    # The tallest window that any file may have.
    (tmp_path / "deep.exr").write_bytes(deep_scanlines(noise, display_window=(0, 0, 0, 2**24 - 1)))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    color, depth = io.read_rgbd(tmp_path / "deep.exr")
    assert color.shape[1:3] == (2**24, 1)
    assert np.isinf(depth[:, noise["Z"].shape[0] :]).all()
    taken = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    assert taken < color.nbytes + depth.nbytes + depth.size + (64 << 20)


def test_words_that_deep_files_do_not_take(tmp_path, noise):
    (tmp_path / "deep.exr").write_bytes(deep_scanlines(noise))
    with pytest.raises(ValueError, match="layer and depth_channel"):
        io.read_rgbd(tmp_path / "deep.exr", layer="beauty")
    with pytest.raises(ValueError, match="max_layers must be positive; got 0"):
        io.read_rgbd(tmp_path / "deep.exr", max_layers=0)
