"""Laws that every picture through a lens obeys, whatever the scene."""

import os

import dofsim
import numpy as np
import pytest
from dofsim._dofsim import simd_available
from oracle import lens as oracle

HEIGHT, WIDTH = 112, 144


def lens(strength_px=8.0, focus=0.0):
    return dofsim.Lens.from_disparity(strength_px=strength_px, focus=focus)


def render(color, depth, strength_px=8.0, focus=0.0, **options):
    return dofsim.render(color, depth, lens(strength_px, focus), depth_kind="disparity", **options)


@pytest.fixture(scope="module")
def depth():
    """Surfaces behind, in and in front of the focus, with edges between them."""
    d = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    d[60:, 90:] = 0.0
    d[30:80, 40:85] = 1.0
    return d


@pytest.fixture(scope="module")
def color():
    return np.random.default_rng(1).random((HEIGHT, WIDTH, 3), dtype=np.float32)


def samples(dtype, shape):
    rng = np.random.default_rng(2)
    if np.issubdtype(dtype, np.integer):
        return rng.integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
    # Values that float32 holds, for the computation is in float32.
    return rng.random(shape, dtype=np.float32).astype(dtype)


DTYPES = [np.float16, np.float32, np.float64, np.uint8, np.uint16]


# The transfer of integers is undone bit for bit; that of floats is not.
TRANSFERS = [(dtype, "linear") for dtype in DTYPES] + [(np.uint8, "srgb"), (np.uint16, "srgb")]


@pytest.mark.parametrize(("dtype", "transfer"), TRANSFERS)
def test_closed_aperture_changes_no_bit(dtype, transfer, depth):
    picture = samples(dtype, (*depth.shape, 3))
    np.testing.assert_array_equal(render(picture, depth, 0.0, transfer=transfer), picture)


@pytest.mark.parametrize("dtype", DTYPES)
def test_plane_in_focus_changes_no_bit(dtype):
    picture = samples(dtype, (50, 70, 3))
    pinhole = dofsim.Lens(aperture_radius=0.1, focus_distance=4.0, fov=40.0)
    out = dofsim.render(picture, np.full((50, 70), 4.0), pinhole, transfer="linear")
    np.testing.assert_array_equal(out, picture)


@pytest.mark.parametrize("slope", [0.0, 0.02])
def test_channels_are_independent_on_one_surface(color, slope):
    d = (1.0 + slope * np.arange(WIDTH, dtype=np.float32)) * np.ones((HEIGHT, 1), np.float32)
    together = render(color, d)
    for c in range(3):
        np.testing.assert_array_equal(together[..., c], render(color[..., c], d))


@pytest.mark.parametrize("axis", [0, 1])
def test_mirrored_input_gives_mirrored_output(depth, axis):
    # Smooth colour with full contrast at the edges; white noise would only measure the sampling.
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    c = (0.5 + 0.1 * np.sin(x / 9.0) + 0.1 * np.sin(y / 7.0) + 0.25 * depth).astype(np.float32)
    there = render(c, depth, views=512)
    back = np.flip(render(np.flip(c, axis), np.flip(depth, axis), views=512), axis)
    # 512 lens points are no mirror image of themselves: an edge moves coverage by a few of them.
    assert np.abs(there - back).max() < 0.02
    assert np.sqrt(np.mean((there - back) ** 2)) < 0.002


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_number_of_threads_changes_no_bit(color, depth, threads):
    np.testing.assert_array_equal(render(color, depth, threads=threads), render(color, depth))


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("name", simd_available())
def test_instruction_set_changes_no_bit(monkeypatch, depth, name, channels):
    c = np.random.default_rng(3).random((HEIGHT, WIDTH, channels), dtype=np.float32)
    monkeypatch.setenv("DOFSIM_SIMD", "portable")
    plain = render(c, depth)
    monkeypatch.setenv("DOFSIM_SIMD", name)
    np.testing.assert_array_equal(render(c, depth), plain)


def test_unknown_instruction_set_is_refused(monkeypatch, color, depth):
    monkeypatch.setenv("DOFSIM_SIMD", "abacus")
    with pytest.raises(ValueError, match=r"DOFSIM_SIMD must be one of .*portable.*abacus"):
        render(color, depth)
    assert os.environ["DOFSIM_SIMD"] == "abacus"


@pytest.mark.parametrize("value", [0.7, 300.0])
def test_constant_picture_stays_constant(depth, value):
    noisy = np.random.default_rng(4).uniform(-1.0, 1.0, depth.shape).astype(np.float32)
    for d in (depth, noisy):
        out = render(np.full((*d.shape, 3), value, np.float32), d)
        np.testing.assert_allclose(out, value, rtol=1e-5)


@pytest.mark.parametrize("surface", ["behind", "in front"])
def test_lamp_is_drawn_as_an_even_disc(surface):
    radius_px, dark, lamp = 20.0, 0.01, 10_000.0
    sign = -1.0 if surface == "behind" else 1.0
    d = np.full((160, 200), sign, np.float32)
    # An edge in the same tiles, whose own blur of 8 px just stays clear of the lamp's disc.
    d[:, 95:] = 0.0 if surface == "in front" else 0.4
    c = np.full(d.shape, dark, np.float32)
    c[60, 60] = lamp
    out = render(c, d, radius_px)
    y, x = np.mgrid[:160, :200]
    # Two pixels of the rim are left out, for they are covered in part.
    inside = out[np.hypot(x - 60, y - 60) < radius_px - 2.0]
    assert inside.std() < 0.02 * inside.mean()
    assert (out - dark).sum(dtype=np.float64) == pytest.approx(lamp, rel=0.01)


@pytest.mark.parametrize("side", [3, 4, 5, 7, 8, 11])
@pytest.mark.parametrize("background", [0.0, 0.01, 0.3])
def test_lamp_inside_a_small_object_keeps_its_energy(side, background):
    # Out of focus before a background in focus. The object is so small that most of it, or all, is edge.
    picture = np.full((HEIGHT, WIDTH), background, np.float32)
    picture[50, 60] = 1e4
    depth = np.zeros((HEIGHT, WIDTH), np.float32)
    first = slice(50 - side // 2, 50 - side // 2 + side), slice(60 - side // 2, 60 - side // 2 + side)
    depth[first] = 1.0
    out = render(picture, depth, strength_px=20.0)
    assert (out.astype(np.float64) - background).sum() / 1e4 == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("slope", [0.0, 0.39, 1.0])
def test_sharp_silhouette_is_smooth_before_the_disc_of_a_lamp(slope):
    fine = 8
    y, x = (np.mgrid[: HEIGHT * fine, : WIDTH * fine] + 0.5) / fine
    inside = x + slope * (y - 56.0) < 70.3
    coverage = inside.reshape(HEIGHT, fine, WIDTH, fine).mean((1, 3)).astype(np.float32)
    behind = np.full((HEIGHT, WIDTH), 0.02, np.float32)
    behind[55:57, 76:78] = 100.0
    depth = np.where(coverage > 0.5, 0.0, -1.0).astype(np.float32)
    out = render(coverage * 0.05 + (1.0 - coverage) * behind, depth, strength_px=20.0)
    disc = render(behind, np.full_like(depth, -1.0), strength_px=20.0)
    expected = coverage * 0.05 + (1.0 - coverage) * disc
    edge = (coverage > 0.0) & (coverage < 1.0) & (disc > 0.1)
    assert edge.sum() > 20
    np.testing.assert_allclose(out[edge], expected[edge], atol=0.01 * disc.max())


@pytest.mark.parametrize("axis", [0, 1])
def test_steep_plane_stays_closed(axis):
    # The circle of confusion grows by 2 px a pixel: neighbours drift apart by up to that much.
    strength_px = 40.0
    c = np.zeros((128, 128, 3), np.float32)
    whole = np.full_like(c, [1.0, 0.0, 0.0])
    steep = np.broadcast_to(2.0 * (np.arange(128, dtype=np.float32) - 64) / strength_px, (128, 128))
    steep = np.ascontiguousarray(steep if axis == 1 else steep.T)
    # The plane fills the frame: any crack would show the blue of the layer behind it.
    back = np.zeros((128, 128, 4), np.float32)
    back[..., 2:] = 1.0
    front = np.concatenate([whole, np.ones((128, 128, 1), np.float32)], axis=-1)
    out = render(np.stack([front, back]), np.stack([steep, np.full_like(steep, -4.0)]), strength_px)
    np.testing.assert_allclose(out[16:-16, 16:-16, 2], 0.0, atol=1e-5)


def test_overscan_is_a_crop(color, depth):
    margin = 20
    # The opening of a relative lens does not depend on the frame, so that both see the same.
    whole = render(color, depth)
    out = render(color, depth, overscan=margin)
    np.testing.assert_array_equal(out, whole[margin:-margin, margin:-margin])


def test_overscan_keeps_the_field_of_view_of_the_output(color):
    metric = dofsim.Lens(aperture_radius=0.2, focus_distance=2.0, fov=40.0)
    out = dofsim.render(color, np.full(color.shape[:2], 4.0), metric, overscan=16)
    inner = dofsim.render(color[16:-16, 16:-16], np.full(out.shape[:2], 4.0), metric)
    # Away from the border, where one sees its margin and the other a mirror image.
    np.testing.assert_allclose(out[24:-24, 24:-24], inner[24:-24, 24:-24], atol=1e-5)


def test_supersampling_is_close_to_averaging_first(color):
    fine = np.kron(color[:64, :80], np.ones((2, 2, 1), np.float32))
    d = np.full((64, 80), 1.0, np.float32)
    out = dofsim.render(
        fine, np.kron(d, np.ones((2, 2), np.float32)), lens(), depth_kind="disparity", supersample=2
    )
    # The finer disc is the coarse one but for how its rim is shared among pixels: 1/(pi 8) of the noise.
    np.testing.assert_allclose(out, render(color[:64, :80], d), atol=0.01)


@pytest.fixture(scope="module")
def bars():
    """Make a striped bar before a striped wall: its two whole layers, and the bar's coverage."""
    x, y = np.meshgrid(np.arange(96), np.arange(80))
    wall = np.stack(
        [0.5 + 0.4 * np.sin(x / 5.0), 0.5 + 0.4 * np.sin(y / 4.0), 0.3 + 0.0 * x, 1.0 + 0.0 * x], -1
    )
    covered = ((x >= 44) & (x < 52)).astype(float)
    bar = np.stack([0.9 + 0.0 * x, 0.4 + 0.3 * np.sin(y / 6.0), 0.1 + 0.0 * x, 1.0 + 0.0 * x], -1)
    return wall, bar * covered[..., None], covered


def layered(color, depth):
    """Put a wall behind a picture, and give both as layers."""
    layers = np.ones((2, HEIGHT, WIDTH, 4), np.float32)
    layers[0, ..., :3], layers[1, ..., :3] = color, color[::-1]
    return layers, np.stack([depth, np.full_like(depth, -1.5)])


@pytest.mark.parametrize("options", [{}, {"cat_eye": 0.5}], ids=str)
def test_layers_without_a_gap_cover_every_pixel_and_a_gap_far_away_changes_nothing(color, depth, options):
    through = lens().replace(**options)
    layers, depths = layered(color, depth)
    whole = dofsim.render(layers, depths, through, depth_kind="disparity")
    assert (whole[..., 3] == 1.0).all()
    layers[:, -3:, -3:] = 0.0
    gap = dofsim.render(layers, depths, through, depth_kind="disparity")
    assert (gap[-3:, -3:, 3] < 1.0).all()
    np.testing.assert_allclose(gap[:-64, :-64], whole[:-64, :-64], atol=1e-6)


@pytest.mark.parametrize("focus", ["wall", "bar", "between"])
def test_layers_show_what_the_bar_hides(bars, focus):
    wall, bar, covered = bars
    near, far = {"wall": (10.0, 0.0), "bar": (0.0, -10.0), "between": (5.0, -6.0)}[focus]
    truth = oracle.render([(bar, near), (wall, far)])[..., :3]

    depths = np.stack([np.full(covered.shape, near), np.full(covered.shape, far)]).astype(np.float32)
    two = render(np.stack([bar, wall]).astype(np.float32), depths, 1.0, views=1024)[..., :3]
    seen = bar[..., :3] + wall[..., :3] * (1.0 - covered[..., None])
    one = render(seen.astype(np.float32), np.where(covered > 0, *depths), 1.0, views=1024)

    def error(out):
        return np.sqrt(np.mean((out - truth)[12:-12, 12:-12] ** 2))

    # Seen: 0.0007, 0.0002, 0.005 with both layers and 0.012, 0.005, 0.008 with one. What is left between the
    # two is the bar's edge, which the oracle interpolates over a pixel and dofsim keeps sharp.
    assert error(two) < 0.007
    assert error(one) < 0.016
    assert error(two) < error(one)


def test_two_layers_are_no_worse_than_one_where_the_second_hides_as_much():
    x = np.arange(144)
    bars = np.repeat(((x % 24) < 8)[None], 64, 0)
    rng = np.random.default_rng(6)
    wall = np.ones((*bars.shape, 4))
    wall[..., :3] = np.kron(rng.uniform(0.2, 0.8, (16, 36, 3)), np.ones((4, 4, 1)))
    bar = np.array([0.05, 0.05, 0.05, 1.0])
    front, back = np.where(bars[..., None], bar, wall), bars[..., None] * bar
    depths = np.stack([np.where(bars, 1.0, 0.0), np.where(bars, 0.98, -9.0), np.zeros(bars.shape)])
    colors = np.stack([front, back, wall])

    def picture(*layers):
        layers = list(layers)
        color, depth = colors[layers].astype(np.float32), depths[layers].astype(np.float32)
        return render(color, depth, 10.0)[:, 12:-12]

    def psnr(a, b):
        return -10 * np.log10(np.mean((a - b) ** 2))

    one, two, truth = picture(0), picture(0, 1), picture(0, 1, 2)
    assert (two[..., 3] == 1.0).all()
    assert psnr(two, truth) > psnr(one, truth) - 0.1
    # What differs is behind the border of the bars, which is taken apart in a picture of one layer only.
    inner = ((x % 24 != 0) & (x % 24 != 7))[12:-12]
    assert psnr(two[:, inner], one[:, inner]) > 40.0


@pytest.mark.parametrize("alpha", ["straight", "premultiplied"])
def test_coverage_of_a_grey_picture_is_no_light_either(alpha):
    rng = np.random.default_rng(3)
    grey, coverage = rng.random((2, 30, 40, 1), dtype=np.float32)
    depth = np.full((30, 40), 1.0, np.float32)
    words = {"transfer": "srgb", "alpha": alpha}
    two = render(np.concatenate([grey, coverage], axis=-1), depth, **words)
    four = render(np.concatenate([grey, grey, grey, coverage], axis=-1), depth, **words)
    np.testing.assert_array_equal(two[..., 1], four[..., 3])
    np.testing.assert_array_equal(two[..., 0], four[..., 0])


THROUGH = [{}, {"cat_eye": 0.5}, {"axial_color": (0.02, 0.0, -0.02)}]


@pytest.mark.parametrize("options", THROUGH, ids=str)
def test_whole_coverage_changes_no_bit(depth, options):
    rng = np.random.default_rng(4)
    # Lamps and noise: what edge pixels and hidden surfaces are made of is decided by colour.
    plain = rng.random((HEIGHT, WIDTH, 3), dtype=np.float32) ** 8
    plain[rng.random((HEIGHT, WIDTH)) < 0.01] *= 50.0
    whole = np.concatenate([plain, np.ones_like(plain[..., :1])], axis=-1)
    through = lens(8.0, 0.5).replace(**options)
    with_coverage = dofsim.render(whole, depth, through, depth_kind="disparity")
    np.testing.assert_array_equal(
        with_coverage[..., :3], dofsim.render(plain, depth, through, depth_kind="disparity")
    )
    # But for the rounding of running sums.
    np.testing.assert_allclose(with_coverage[..., 3], 1.0, rtol=0, atol=2e-6)


@pytest.mark.parametrize("layers", [1, 2])
@pytest.mark.parametrize("options", [*({"lens": o} for o in THROUGH), {"supersample": 2}], ids=str)
def test_coverage_stays_coverage(layers, options):
    options = dict(options)
    rng = np.random.default_rng(5)
    shape = (layers, 48, 64)
    alpha = rng.choice([0.0, 0.5, 1.0, 1.0], (*shape, 1)) * rng.choice([0.8, 1.0], (*shape, 1))
    color = np.concatenate([alpha * rng.random((*shape, 3)), alpha], axis=-1).astype(np.float32)
    depth = np.sort(rng.choice([-1.0, 0.0, 0.1, 1.0], shape), axis=0)[::-1].astype(np.float32)
    if layers == 1:
        color, depth = color[0], depth[0]
    through = lens(3.0, 0.1).replace(**options.pop("lens", {}))
    out = dofsim.render(color, depth, through, depth_kind="disparity", **options)
    assert out[..., 3].min() >= 0.0
    assert out[..., 3].max() <= 1.0
    flat = np.zeros(out.shape[:2], np.float32)
    again = dofsim.render(out, flat, lens(3.0, 0.1), depth_kind="disparity")
    assert again[..., 3].min() >= 0.0
    assert again[..., 3].max() <= 1.0
