"""Motion vectors: what moves between pictures is found where it is when the reference is taken."""

import dofsim
import numpy as np
import pytest
from dofsim import metrics
from oracle.cards import Card, Cards, pose

LENS = dofsim.Lens(
    aperture_radius=0.05, focus_distance=2.0, fov=float(np.degrees(2.0 * np.arctan(0.5 * 96 / 100.0)))
)


def flat(*color):
    return lambda x, y, towards: np.broadcast_to(np.array(color, float), (*x.shape, 3))


def checks(x, y, towards):
    return np.where((np.sin(30 * x) * np.sin(30 * y) > 0)[..., None], [0.9, 0.2, 0.1], [0.7, 0.6, 0.1])


WALL = Card((0.0, 0.0, 4.0), (9.0, 9.0))
FENCE = [Card((x, 0.0, 0.8), (0.03, 0.6), flat(0.1, 0.2, 0.3)) for x in (-0.25, -0.08, 0.09, 0.26)]
WALKER = Card((-0.05, 0.05, 1.6), (0.22, 0.3), checks)
# Where the walker was when the views were taken, beside where it is for the reference.
STEPS = [(0.0, 0.0, 0.0), (-0.13, 0.01, 0.0), (0.12, -0.01, 0.0)]
POSES = np.stack([pose(), pose(-0.03), pose(0.03)])


def moved(card, step):
    return Card(
        tuple(a + b for a, b in zip(card.centre, step, strict=True)), card.half, card.color, card.slope
    )


def taken(still, mover, steps=STEPS, poses=POSES):
    """Give colours and depths of the views, and the motion from each to the reference."""
    colors, depths, flow = [], [], []
    for step, camera in zip(steps, poses, strict=True):
        there = moved(mover, step)
        scene = Cards([*still, there])
        color, depth = scene.pinhole(camera)
        turn, origin = camera[:3, :3], camera[:3, 3]
        towards = scene.rays() @ turn.T
        is_mover = np.isclose(there.hit(origin, towards)[0], depth)
        world = origin + depth[..., None] * towards - np.where(is_mover[..., None], step, 0.0)
        back = world @ poses[0][:3, :3] - poses[0][:3, 3] @ poses[0][:3, :3]
        at = (back / back[..., 2:]) @ scene.intrinsics.T
        y, x = np.mgrid[: scene.height, : scene.width]
        colors.append(color)
        depths.append(depth)
        flow.append(at[..., :2] - np.stack([x, y], axis=-1))
    return np.stack(colors), np.stack(depths), np.stack(flow)


COLORS, DEPTHS, FLOW = taken([WALL, *FENCE], WALKER)


def layered(colors=COLORS, depths=DEPTHS, flow=None, poses=POSES, **options):
    return dofsim.layers_from_views(colors, depths, poses, Cards([]).intrinsics, flow=flow, **options)


def is_at(depths, z):
    """Where one of the hidden layers is at a distance."""
    return np.isclose(depths[1:], z, rtol=1e-4).any(axis=0)


def test_what_moves_is_found_where_it_is():
    layers, depths = layered(flow=FLOW)
    color, z = Cards([WALL, WALKER]).pinhole(pose())
    hidden = (DEPTHS[0] < 1.0) & (z == 1.6)
    found = is_at(depths, 1.6)
    # All but what mixes two colours; beside it, nothing.
    assert found[hidden].mean() > 0.7
    assert (z[found] == 1.6).mean() > 0.97
    layer = np.argmax(np.isclose(depths[1:], 1.6, rtol=1e-4), axis=0) + 1
    there = np.take_along_axis(layers, layer[None, ..., None], axis=0)[0]
    assert np.abs(there[..., :3] - color)[found & (z == 1.6)].mean() < 0.03
    # Without it, it is contradicted.
    assert is_at(layered()[1], 1.6)[hidden].mean() < 0.15


def test_it_makes_better_pictures():
    truth = Cards([WALL, *FENCE, WALKER]).thin_lens(0.05, 2.0)
    single = metrics.psnr(dofsim.render(COLORS[0], DEPTHS[0], LENS), truth, border=8)
    without, with_flow = (
        metrics.psnr(dofsim.render(*layered(flow=flow, lens=LENS), LENS)[..., :3], truth, border=8)
        for flow in (None, FLOW)
    )
    assert with_flow > max(single, without) + 1.0, (single, without, with_flow)


@pytest.mark.parametrize(
    "nothing",
    [
        np.zeros_like(FLOW),
        np.full_like(FLOW, np.nan),
        np.zeros(FLOW.shape, np.float16),
        [None, np.zeros(FLOW.shape[1:]), None],
        [None, None, None],
    ],
)
def test_no_motion_changes_no_bit(nothing):
    for a, b in zip(layered(flow=nothing), layered(), strict=True):
        np.testing.assert_array_equal(a, b)


def test_motion_of_the_camera_alone_changes_nothing():
    colors, depths, flow = taken([WALL, *FENCE], WALKER, [(0.0, 0.0, 0.0)] * 3)
    assert np.abs(flow[1]).max() > 3.0
    layers, z = layered(colors, depths, flow)
    expected, metres = layered(colors, depths)
    differ = (layers[..., 3] != expected[..., 3]) | ~np.isclose(z, metres, rtol=1e-4)
    assert differ.mean() < 0.002
    assert np.abs(layers - expected)[~differ].max() < 0.01


def test_what_does_not_know_its_motion_stands_still():
    """Only what moves has vectors, as some renderers write them."""
    sparse = np.where(np.isclose(DEPTHS, 1.6)[..., None], FLOW, np.nan)
    _, depths = layered(flow=sparse)
    _, expected = layered(flow=FLOW)
    assert (is_at(depths, 1.6) == is_at(expected, 1.6)).mean() > 0.998
    assert (is_at(depths, 4.0) == is_at(expected, 4.0)).mean() > 0.998


def test_a_camera_that_stands_still_sees_what_others_hid_before():
    poses = np.stack([pose()] * 3)
    steps = [(0.0, 0.0, 0.0), (-0.3, 0.0, 0.0), (0.3, 0.0, 0.0)]
    colors, depths, flow = taken([WALL], WALKER, steps, poses)
    layers, z = layered(colors, depths, flow, poses, lens=LENS)
    wall, _ = Cards([WALL]).pinhole(pose())
    found = is_at(z, 4.0)
    assert (DEPTHS[0][found] < 4.0).all()
    assert found.sum() > 300
    assert np.abs(layers[1][found][:, :3] - wall[found]).max() < 0.01
    assert len(layered(colors, depths, None, poses, lens=LENS)[0]) == 1


def test_things_that_touch_and_move_apart_are_not_one_surface():
    """A card slides along the edge of another one, in its plane. No colour between both is theirs."""
    fixed = Card((0.25, 0.05, 1.6), (0.1, 0.3), flat(0.1, 0.8, 0.2))
    slider = Card((-0.07, 0.05, 1.6), (0.22, 0.3), flat(0.9, 0.1, 0.1))
    steps = [(0.0, 0.0, 0.0), (0.0, 0.14, 0.0), (0.0, -0.14, 0.0)]
    poses = np.stack([pose(), pose(-0.1), pose(0.1)])
    colors, depths, flow = taken([WALL, *FENCE, fixed], slider, steps, poses)
    layers, z = layered(colors, depths, flow, poses)
    at = np.isclose(z[1:], 1.6, rtol=1e-4)
    pure = [
        np.abs(layers[1:][at][:, :3] - one).max(axis=-1) < 0.02 for one in ((0.1, 0.8, 0.2), (0.9, 0.1, 0.1))
    ]
    assert all(one.sum() > 30 for one in pure), [one.sum() for one in pure]
    assert (pure[0] | pure[1]).mean() > 0.99


def test_order_and_threads_do_not_matter():
    expected = layered(flow=FLOW)
    order = [0, 2, 1]
    other = layered(COLORS[order], DEPTHS[order], FLOW[order], POSES[order])
    turned = [2, 1, 0]
    last = layered(COLORS[turned], DEPTHS[turned], FLOW[turned], POSES[turned], reference=2)
    for a, b, c, d in zip(expected, other, last, layered(flow=FLOW, threads=1), strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)
        np.testing.assert_array_equal(a, d)


@pytest.mark.parametrize("kind", ["a wrong way", "another thing's", "comes nearer"])
def test_motion_that_does_not_fit_is_never_worse_than_one_layer(kind):
    colors, depths, flow = COLORS, DEPTHS, FLOW
    if kind == "a wrong way":
        flow = np.where(np.isclose(DEPTHS, 1.6)[..., None], FLOW + 6.0, FLOW)
    elif kind == "another thing's":
        flow = np.roll(FLOW, 9, axis=2)
    else:
        nearer = [(x, y, z) for (x, y, _), z in zip(STEPS, (0.0, 0.3, -0.3), strict=True)]
        colors, depths, flow = taken([WALL, *FENCE], WALKER, nearer)
    truth = Cards([WALL, *FENCE, WALKER]).thin_lens(0.05, 2.0)
    single = metrics.psnr(dofsim.render(COLORS[0], DEPTHS[0], LENS), truth, border=8)
    found = metrics.psnr(
        dofsim.render(*layered(colors, depths, flow, lens=LENS), LENS)[..., :3], truth, border=8
    )
    assert found > single - 0.2, (kind, single, found)


ENDLESS = FLOW.copy()
ENDLESS[1, 3, 5, 0] = np.inf


@pytest.mark.parametrize(
    ("flow", "error", "message"),
    [
        (FLOW[:2], ValueError, r"^flow must be as many as colors, 3; got 2$"),
        (
            FLOW[..., :1],
            ValueError,
            r"^flow\[0\] must have two values for each pixel of colors, .* got \[72, 96, 1\]$",
        ),
        (
            [None, FLOW[1, 1:], None],
            ValueError,
            r"^flow\[1\] must have two values .* shape \(72, 96, 2\); got \[71, 96, 2\]$",
        ),
        (
            ENDLESS,
            ValueError,
            r"^flow\[1\] must be finite, or NaN where no motion is known; got inf at pixel \(5, 3\)$",
        ),
        (FLOW.astype(int), TypeError, r"^flow\[0\] must have dtype float16, float32 or float64; got int64$"),
        ([None, "here", None], TypeError, r"^flow\[1\] must be a NumPy array"),
        (3, TypeError, r"^flow must be an array or a sequence of arrays; got"),
    ],
)
def test_one_clear_line_for_what_cannot_be_used(flow, error, message):
    with pytest.raises(error, match=message):
        layered(flow=flow)
