"""`dofsim.refine_depth`: edges that were softened come back, and what is sharp stays."""

import dofsim
import numpy as np
import pytest
from scipy import ndimage as ndi

HEIGHT, WIDTH = 160, 208
Y, X = np.mgrid[0:HEIGHT, 0:WIDTH]
LENS = dofsim.Lens.from_disparity(strength_px=12.0, focus=0.9)


def subject():
    """Draw a lobed disc before a sloping ground, which no edge is parallel to."""
    angle = np.arctan2(Y - 80, X - 104)
    return np.hypot(X - 104, 0.9 * (Y - 80)) + 4 * np.sin(5 * angle) < 46


def exact():
    return np.where(subject(), 0.9, 0.15 + 0.2 * Y / HEIGHT).astype(np.float32)


def picture():
    ground = 0.15 + 0.7 * ((X // 6 + Y // 6) % 2)[..., None] * np.array([0.3, 0.6, 0.9])
    return np.where(subject()[..., None], np.array([0.75, 0.45, 0.35]), ground).astype(np.float32)


def quarter(depth):
    return depth.reshape(HEIGHT // 4, 4, WIDTH // 4, 4).mean((1, 3))


def enlarged(small):
    """Interpolate between pixels' centres."""
    y, x = (np.arange(n) / 4 + 0.5 / 4 - 0.5 for n in (HEIGHT, WIDTH))
    return ndi.map_coordinates(small, np.meshgrid(y, x, indexing="ij"), order=1, mode="nearest")


SOFTENED = {
    "blurred by 2 px": lambda depth: ndi.gaussian_filter(depth, 2.0),
    "averaged 3 x 3": lambda depth: ndi.uniform_filter(depth, 3),
    "enlarged from a quarter": lambda depth: enlarged(quarter(depth)),
    "a quarter of the size": quarter,
    "blurred by 6 px": lambda depth: ndi.gaussian_filter(depth, 6.0),
}


def refined(depth, **options):
    return dofsim.refine_depth(picture(), depth.astype(np.float32), depth_kind="disparity", **options)


def rms_codes(depth):
    """Tell how far the picture is from that of exact depth, in codes, within 10 px of the silhouette."""
    band = ndi.binary_dilation(subject(), iterations=10) & ~ndi.binary_erosion(subject(), iterations=10)
    render = lambda depth: dofsim.render(picture(), depth, LENS, depth_kind="disparity", device="cpu")  # noqa: E731
    difference = (render(depth) - render(exact()))[band]
    return 255 * float(np.sqrt((difference**2).mean()))


@pytest.mark.parametrize("name", SOFTENED)
def test_soft_edges_are_steps_again(name):
    soft = SOFTENED[name](exact())
    sharp = refined(soft)
    assert sharp.shape == (HEIGHT, WIDTH)
    wrong = np.abs(sharp - exact()) > 0.1
    # Pixels through whose middle the edge passes may go to either side.
    assert wrong.mean() < (0.012 if "6 px" in name else 0.004)
    if soft.shape == sharp.shape:
        assert wrong.mean() < 0.15 * (np.abs(soft - exact()) > 0.1).mean()
        # Of corners that are narrower than the blur there is nothing left.
        share = 0.75 if "6 px" in name else 0.5
        assert rms_codes(sharp) < share * rms_codes(soft.astype(np.float32))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("kind", ["z", "distance", "inverse_z", "disparity", "relative"])
def test_sharp_depth_comes_back_to_the_bit(kind, dtype):
    depth = exact() if kind in ("inverse_z", "disparity", "relative") else 1.0 / exact()
    depth = depth.astype(dtype)
    np.testing.assert_array_equal(
        dofsim.refine_depth(picture(), depth, depth_kind=kind), depth.astype(np.float32)
    )


def test_eight_bits_are_sharp_enough():
    codes = np.rint(255 * exact()).astype(np.float32)
    assert np.abs(refined(codes) - codes).max() <= 1.0


def test_noise_goes_and_edges_stay():
    noisy = exact() + 0.008 * np.random.default_rng(1).standard_normal(exact().shape)
    clean = refined(noisy)
    assert np.std(clean - exact()) < 0.35 * np.std(noisy - exact())
    assert (np.abs(clean - exact()) > 0.1).mean() == 0.0


def test_lamps_that_the_map_has_nearly_lost_come_back():
    """Lamps of 2 to 4 px on a dark ground; a blur of 2 px leaves a fifth of their contrast."""
    depth = np.full((HEIGHT, WIDTH), 0.1, np.float32)
    color = np.full((HEIGHT, WIDTH, 3), 0.02, np.float32)
    depth[:, : WIDTH // 3] = 0.95
    lamps = [(40, 120, 1.0, 0.5), (40, 160, 1.6, 0.3), (90, 120, 2.2, 0.7), (120, 170, 1.6, 0.9)]
    for y, x, radius, disparity in lamps:
        disc = np.hypot(Y - y, X - x) <= radius
        depth[disc], color[disc] = disparity, 30.0
    soft = ndi.gaussian_filter(depth, 2.0)
    sharp = dofsim.refine_depth(color, soft, depth_kind="disparity")
    for y, x, _, disparity in lamps:
        assert abs(soft[y, x] - disparity) > 0.3 * (disparity - 0.1)
        assert sharp[y, x] == pytest.approx(disparity, abs=0.15 * (disparity - 0.1))


def test_metres_of_soft_depth_are_those_of_its_surfaces():
    metres = ndi.gaussian_filter(1.0 / exact(), 2.0)
    sharp = dofsim.refine_depth(picture(), metres, depth_kind="z")
    inside, outside = (
        ndi.binary_erosion(subject(), iterations=4),
        ~ndi.binary_dilation(subject(), iterations=4),
    )
    np.testing.assert_allclose(sharp[inside], 1 / 0.9, rtol=0.03)
    np.testing.assert_allclose(sharp[outside], 1 / exact()[outside], rtol=0.09)


def test_the_background_stays_infinitely_far():
    depth = np.where(subject(), 2.0, np.inf)
    np.testing.assert_array_equal(dofsim.refine_depth(picture(), depth), depth.astype(np.float32))


def test_a_scale_of_relative_depth_changes_nothing_but_the_scale():
    soft = ndi.gaussian_filter(exact(), 2.0)
    once = dofsim.refine_depth(picture(), soft, depth_kind="relative")
    twice = dofsim.refine_depth(picture(), 4 * soft, depth_kind="relative")
    np.testing.assert_array_equal(4 * once, twice)


def test_coverage_is_that_of_the_edge():
    """A straight edge through a pixel at 0.3 of its width: a blur leaves the place where it is."""
    edge = 100.3
    share = np.clip(edge + 0.5 - np.arange(WIDTH), 0.0, 1.0) * np.ones((HEIGHT, 1))
    soft = ndi.gaussian_filter(0.2 + 0.6 * share, 2.0)
    depth, coverage = dofsim.refine_depth(
        np.repeat(share[..., None], 3, -1), soft, depth_kind="disparity", return_coverage=True
    )
    row = coverage[HEIGHT // 2]
    assert row[100] == pytest.approx(0.8, abs=0.1)
    assert (row[:99] > 0.95).all()
    assert set(np.unique((depth > 0.5)[:, :100])) == {True}


@pytest.mark.parametrize("threads", [1, 3])
def test_threads_change_no_bit(threads):
    soft = ndi.gaussian_filter(exact(), 2.0) + 0.002 * np.random.default_rng(0).standard_normal(exact().shape)
    np.testing.assert_array_equal(refined(soft), refined(soft, threads=threads))


def test_a_small_change_of_depth_is_a_small_change():
    """A ramp that passes the middle of a pixel may flip it; nothing else does."""
    soft = ndi.gaussian_filter(exact(), 2.0)
    change = np.abs(refined(soft) - refined(soft * np.float32(1 + 1e-6)))
    assert (change > 1e-4).mean() < 1e-3


def test_what_was_sharpened_is_sharp():
    once = refined(ndi.gaussian_filter(exact(), 2.0))
    assert (np.abs(refined(once) - once) > 0.02).mean() < 2e-3


def test_render_and_scene_refine_alike():
    soft = quarter(exact())
    words = {"depth_kind": "disparity", "device": "cpu"}
    whole = dofsim.render(picture(), soft, LENS, refine=True, **words)
    scene = dofsim.Scene(picture(), soft, refine=True, **words)
    np.testing.assert_array_equal(scene.render(LENS), whole)
    np.testing.assert_array_equal(scene.depth, refined(soft))
    # What was found of the edges is used beside the depth, so that a little is better.
    apart = dofsim.render(picture(), scene.depth, LENS, **words)
    assert 0.0 < np.abs(whole - apart).mean() < 2e-3


def test_sharp_depth_is_rendered_as_without_refining():
    words = {"depth_kind": "disparity", "device": "cpu"}
    plain = dofsim.render(picture(), exact(), LENS, **words)
    np.testing.assert_array_equal(dofsim.render(picture(), exact(), LENS, refine=True, **words), plain)


def test_a_scene_has_its_depth():
    z = np.stack([np.full((8, 8), 1.0), np.full((8, 8), 2.0)])
    np.testing.assert_array_equal(dofsim.Scene(np.ones((2, 8, 8, 4), np.float32), z).depth, z)


def test_coverage_is_that_of_an_edge_within_a_pixel():
    """An edge a third into a pixel, of which the picture shows nothing."""
    edge = 103.5 + 1 / 3
    soft = np.interp(X, [edge - 3.0, edge + 3.0], [1.0, 0.25]).astype(np.float32)
    even = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    _, coverage = dofsim.refine_depth(even, soft, depth_kind="disparity", return_coverage=True)
    np.testing.assert_allclose(coverage[40:-40, 103:106].mean(0), [1.0, 1 / 3, 0.0], atol=0.02)
    assert (coverage[:, :95] == 1.0).all()
    assert (coverage[:, 115:] == 1.0).all()


def test_colours_that_are_none_can_be_filled():
    color, soft = picture(), quarter(exact())
    color[40, 50] = np.nan
    words = {"depth_kind": "disparity"}
    with pytest.raises(ValueError, match="invalid_color"):
        dofsim.refine_depth(color, soft, **words)
    words |= {"invalid_color": "fill"}
    sharp = dofsim.refine_depth(color, soft, **words)
    assert np.isfinite(sharp).all()
    with pytest.warns(UserWarning, match="color has 1 pixel"):
        scene = dofsim.Scene(color, soft, refine=True, device="cpu", **words)
    np.testing.assert_array_equal(scene.depth, sharp)
    assert np.isfinite(scene.render(LENS)).all()


@pytest.mark.parametrize(
    ("color", "depth", "options", "text"),
    [
        (picture(), np.ones((40, 40)), {}, "depth must have the shape of color, 208 x 160 pixels.*40 x 40"),
        (picture(), np.full((160, 208), np.nan), {}, "values that are not valid"),
        (np.ones((2, 8, 8, 4), np.float32), np.ones((8, 8)), {}, "one layer"),
        (picture(), np.ones((2, 160, 208)), {}, "one layer"),
        (np.zeros((160, 208, 3), np.uint8), exact(), {}, "transfer must be given"),
        (picture(), exact(), {"depth_kind": "depth"}, "depth_kind"),
    ],
)
def test_what_it_refuses(color, depth, options, text):
    with pytest.raises((ValueError, TypeError), match=text):
        dofsim.refine_depth(color, depth, **options)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 5)])
def test_tiny_pictures(shape):
    depth = np.linspace(1.0, 2.0, shape[0] * shape[1]).reshape(shape)
    assert np.isfinite(dofsim.refine_depth(np.ones((*shape, 3), np.float32), depth)).all()


@pytest.mark.parametrize("name", ["shifted", "grown"])
def test_depth_beside_the_picture_is_put_in_place(name):
    """Where the ground is even, colours tell an edge from everything else."""
    color = np.where(subject()[..., None], np.array([0.75, 0.45, 0.35]), np.array([0.1, 0.2, 0.3]))
    depth = exact()
    misplaced = np.roll(depth, 2, 1) if name == "shifted" else ndi.maximum_filter(depth, 5)
    found = dofsim.refine_depth(color.astype(np.float32), misplaced, depth_kind="disparity")
    before, after = (np.abs(one - depth) > 0.1 for one in (misplaced, found))
    assert after[8:-8, 8:-8].mean() < 0.25 * before[8:-8, 8:-8].mean()


def test_lamps_of_a_coarse_map_come_back():
    """A lamp's depth is in a map of a quarter of the size, spread over the squares that it touches."""
    depth = np.full((HEIGHT, WIDTH), 0.1, np.float32)
    color = np.full((HEIGHT, WIDTH, 3), 0.02, np.float32)
    depth[:, : WIDTH // 3] = 0.6
    disc = np.hypot(Y - 80, X - 140) <= 2.0
    depth[disc], color[disc] = 0.7, 30.0
    for small in (quarter(depth), enlarged(quarter(depth)).astype(np.float32)):
        sharp = dofsim.refine_depth(color, small, depth_kind="disparity")
        assert sharp[80, 140] == pytest.approx(0.7, abs=0.1)


def rails(half_px):
    """Draw rails before a wall, and a map of a quarter of the size."""
    rail = np.abs((X - 0.1 * Y) % 40 - 13) < half_px
    color = np.where(rail[..., None], np.array([0.8, 0.5, 0.2]), 0.3 * np.ones(3)).astype(np.float32)
    return rail, color, quarter(np.where(rail, 0.9, 0.2))


def test_rails_as_thin_as_pixels_of_a_coarse_map_are_about_as_near_as_they_are():
    """No pixel of the map has the depth of a rail of 5 px: each is a mean over 4, and enlarging mixes two."""
    rail, color, coarse = rails(2.5)
    given = np.median(enlarged(coarse)[rail])
    sharp = dofsim.refine_depth(color, coarse.astype(np.float32), depth_kind="disparity")
    assert given < 0.67
    assert np.median(sharp[rail]) > 0.74
    assert np.median(sharp[~rail]) == pytest.approx(0.2, abs=0.01)


def test_what_is_too_thin_to_be_shrunk_does_not_vanish():
    """A soft map makes a rail of 2 px wider than the picture shows it, and of it nothing would be left."""
    rail, color, coarse = rails(1.0)
    sharp = dofsim.refine_depth(color, coarse.astype(np.float32), depth_kind="disparity")
    assert np.median(sharp[rail]) > 0.4


def test_one_range_for_a_sequence_keeps_what_has_not_moved():
    depth = exact()
    near = depth.copy()
    near[-20:, :40] = 5.0
    words = {"depth_kind": "relative", "depth_range": (0.1, 1.0)}
    radius = dofsim.coc(depth, LENS, **words)
    np.testing.assert_array_equal(dofsim.coc(near, LENS, **words)[:-20], radius[:-20])
    # Without it every picture has its own scale, and the same pixels another blur.
    alone = dofsim.coc(near, LENS, depth_kind="relative") - dofsim.coc(depth, LENS, depth_kind="relative")
    assert np.abs(alone[:-20]).max() > 1.0
    # Where larger is farther, the first of the range is the larger.
    turned = dofsim.coc(1.1 - depth, LENS, depth_kind="relative", depth_range=(1.0, 0.1))
    np.testing.assert_allclose(turned, radius, atol=1e-4)
    with pytest.raises(ValueError, match="depth_range is for"):
        dofsim.coc(depth, LENS, depth_kind="disparity", depth_range=(0.0, 1.0))
    with pytest.raises(ValueError, match="two different disparities"):
        dofsim.coc(depth, LENS, depth_kind="relative", depth_range=(1.0, 1.0))
