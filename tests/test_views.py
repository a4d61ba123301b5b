"""Layers of what other views saw: laws, damage, and arguments."""

import dofsim
import numpy as np
import pytest
from dofsim import metrics
from oracle.cards import Card, Cards, pose, rim, stripes

RADIUS, FOCUS, WIDTH, FOCAL_PX = 0.05, 1.0, 96, 100.0
LENS = dofsim.Lens(
    aperture_radius=RADIUS,
    focus_distance=FOCUS,
    fov=float(np.degrees(2.0 * np.arctan(0.5 * WIDTH / FOCAL_PX))),
)


def flat(*color):
    return lambda x, y, towards: np.broadcast_to(np.array(color, float), (*x.shape, 3))


def mirrored(x, y, towards):
    """Show what a bent mirror does, which depends on where it is seen from."""
    return stripes(8.0 * x + 20.0 * towards[..., 0], 8.0 * y + 20.0 * towards[..., 1], towards)


WALL = Card((0.0, 0.0, 4.0), (9.0, 9.0))
NEAR = Card((-0.1, 0.02, 0.5), (0.08, 0.1), flat(0.8, 0.3, 0.2))
MIDDLE = Card((0.15, 0.0, 1.0), (0.15, 0.2), stripes, slope=0.3)
SCENE = Cards([WALL, NEAR, MIDDLE])
TRUTH = SCENE.thin_lens(RADIUS, FOCUS)
AROUND = np.concatenate([pose()[None], rim(8, RADIUS)])


def seen(scene, poses=AROUND):
    views = [scene.pinhole(one) for one in poses]
    return np.stack([color for color, _ in views]), np.stack([depth for _, depth in views])


COLORS, DEPTHS = seen(SCENE)


def layered(colors=COLORS, depths=DEPTHS, poses=AROUND, **options):
    return dofsim.layers_from_views(colors, depths, poses, SCENE.intrinsics, **options)


def error_db(picture, truth=TRUTH):
    return metrics.psnr(picture[..., :3], truth, border=8)


def test_what_others_saw_is_what_is_there():
    layers, depths = layered(lens=LENS)
    np.testing.assert_array_equal(layers[0, ..., :3], COLORS[0].astype(np.float32))
    np.testing.assert_array_equal(depths[0], DEPTHS[0].astype(np.float32))
    wall, _ = Cards([WALL]).pinhole(pose())
    behind, z = layers[1], depths[1]
    there = behind[..., 3] > 0.0
    assert there.sum() > 300
    assert set(np.unique(behind[..., 3])) == {0.0, 1.0}
    np.testing.assert_allclose(z[there], 4.0, rtol=1e-5)
    np.testing.assert_allclose(behind[there][:, :3], wall[there], atol=0.02)
    assert np.isinf(z[~there]).all()


def test_it_is_worth_many_decibels():
    single = error_db(dofsim.render(COLORS[0], DEPTHS[0], LENS))
    eight = error_db(dofsim.render(*layered(lens=LENS), LENS))
    two = error_db(dofsim.render(*layered(COLORS[[0, 4, 8]], DEPTHS[[0, 4, 8]], AROUND[[0, 4, 8]]), LENS))
    assert eight > single + 3.0, (single, two, eight)
    assert two > single + 1.0, (single, two, eight)


def test_identical_views_change_nothing():
    color, depth = COLORS[:1].astype(np.float32), DEPTHS[:1]
    for options in ({}, {"lens": LENS}):
        layers, depths = layered(
            color.repeat(3, 0), depth.repeat(3, 0), np.tile(np.eye(4), (3, 1, 1)), **options
        )
        assert len(layers) == 1
        picture = dofsim.render(layers, depths, LENS)[..., :3]
        np.testing.assert_array_equal(picture, dofsim.render(color[0], depth[0], LENS))


@pytest.mark.parametrize("wall", [WALL, Card((0.0, 0.0, 3.0), (9.0, 9.0), stripes, slope=0.8)])
def test_one_plane_hides_nothing(wall):
    poses = np.stack([pose(), pose(0.3), pose(0.1, 0.2, 0.3, turn=5.0), pose(-0.2, turn=-8.0)])
    assert len(layered(*seen(Cards([wall]), poses), poses)[0]) == 1


def test_the_order_of_the_others_does_not_matter():
    expected = layered()
    for seed in range(3):
        order = np.concatenate([[0], 1 + np.random.default_rng(seed).permutation(8)])
        for a, b in zip(layered(COLORS[order], DEPTHS[order], AROUND[order]), expected, strict=True):
            np.testing.assert_array_equal(a, b)
    turned = [*range(1, 9), 0]
    for a, b in zip(
        layered(COLORS[turned], DEPTHS[turned], AROUND[turned], reference=8), expected, strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_the_number_of_threads_does_not_matter():
    for a, b in zip(layered(threads=1), layered(threads=5), strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_world_may_stand_anywhere():
    placed = pose(3.0, -2.0, 7.0, turn=33.0)
    layers, depths = layered(poses=placed @ AROUND)
    expected, z = layered()
    there = (layers[1, ..., 3] > 0) & (expected[1, ..., 3] > 0)
    assert (layers[1, ..., 3] != expected[1, ..., 3]).mean() < 0.002
    np.testing.assert_allclose(layers[1][there], expected[1][there], atol=1e-3)
    np.testing.assert_allclose(depths[1][there], z[1][there], rtol=1e-4)


def test_views_may_be_turned_and_moved_forward():
    poses = np.stack([pose(), pose(0.06, 0.0, 0.05, turn=4.0), pose(-0.06, 0.01, -0.05, turn=-3.0)])
    layers, depths = layered(*seen(SCENE, poses), poses)
    wall, _ = Cards([WALL]).pinhole(pose())
    there = layers[1, ..., 3] > 0.0
    assert there.sum() > 150
    np.testing.assert_allclose(depths[1][there], 4.0, rtol=1e-4)
    np.testing.assert_allclose(layers[1][there][:, :3], wall[there], atol=0.03)


def test_several_surfaces_lie_one_behind_another():
    scene = Cards(
        [WALL, Card((0.0, 0.0, 2.0), (0.24, 0.5), flat(0.2, 0.7, 0.3)), Card((0.0, 0.0, 1.0), (0.1, 0.3))]
    )
    poses = np.stack([pose(right) for right in (0.0, -0.12, -0.3, 0.12, 0.3)])
    layers, depths = layered(*seen(scene, poses), poses, layers=3)
    both = (layers[1, ..., 3] > 0) & (layers[2, ..., 3] > 0)
    assert both.sum() > 50
    np.testing.assert_allclose(depths[1][both], 2.0, rtol=1e-4)
    np.testing.assert_allclose(depths[2][both], 4.0, rtol=1e-4)
    assert len(layered(*seen(scene, poses), poses, layers=2)[0]) == 2


LAMP_Z, LAMP_COLOR = 1.5, np.array([40.0, 30.0, 20.0])
FARTHER = np.concatenate([pose()[None], rim(8, 0.2)])


def with_lamp(side_px, beside_px=0.0, color=LAMP_COLOR):
    """Put a square lamp of so many pixels behind the near card, so far beside the centre of a pixel."""
    x, y = ((at + beside_px - centre) * LAMP_Z / FOCAL_PX for at, centre in ((38.0, 47.5), (39.0, 35.5)))
    half = 0.5 * side_px * LAMP_Z / FOCAL_PX
    return Cards([WALL, NEAR, Card((x, y, LAMP_Z), (half, half), flat(*color))])


def lamp_in(layers, depths):
    """Give light and coverage of the cells of a lamp, each as a picture."""
    there = np.abs(depths[1:] / LAMP_Z - 1.0) < 0.1
    found = np.where(there[..., None], layers[1:], 0.0).sum(axis=0)
    return found[..., :3], found[..., 3]


@pytest.mark.parametrize("beside_px", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("side_px", [1.25, 2.0, 3.5, 7.0])
def test_a_lamp_arrives_with_the_light_that_it_has(side_px, beside_px):
    """Small ones consist of pixels of edges alone; large ones have no second rim."""
    layers, depths = layered(*seen(with_lamp(side_px, beside_px), FARTHER), FARTHER)
    light, coverage = lamp_in(layers, depths)
    np.testing.assert_allclose(light.sum(axis=(0, 1)), side_px**2 * LAMP_COLOR, rtol=0.05)
    assert (light <= 1.01 * LAMP_COLOR).all()
    assert coverage.max() <= 1.0
    y, x = np.mgrid[:72, :96]
    centre = [(light[..., 0] * at).sum() / light[..., 0].sum() for at in (x, y)]
    np.testing.assert_allclose(centre, [38.0 + beside_px, 39.0 + beside_px], atol=0.15)
    # One pixel of the view and one of the reference: no light is farther away.
    far = np.maximum(np.abs(x - 38.0 - beside_px), np.abs(y - 39.0 - beside_px)) > 0.5 * side_px + 1.5
    assert light[far].sum() < 1e-3 * light.sum()


def test_a_hidden_lamp_is_worth_many_decibels():
    scene = with_lamp(2.0)
    colors, depths = seen(scene)
    truth = scene.thin_lens(RADIUS, FOCUS)
    single = error_db(dofsim.render(colors[0], depths[0], LENS), truth)
    eight = error_db(dofsim.render(*layered(colors, depths, lens=LENS), LENS), truth)
    assert eight > single + 3.0, (single, eight)


def test_the_order_of_those_who_see_a_lamp_does_not_matter():
    colors, depths = seen(with_lamp(2.0, 0.3), FARTHER)
    expected = layered(colors, depths, FARTHER)
    order = np.concatenate([[0], 1 + np.random.default_rng(3).permutation(8)])
    for a, b in zip(layered(colors[order], depths[order], FARTHER[order]), expected, strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_outshines_others_a_little_becomes_a_lamp_little_by_little():
    """Up to five times a usual pixel, a small thing is left out; from twice that on it is whole."""
    dark, depths = seen(with_lamp(2.0, 0.3, np.zeros(3)), FARTHER)
    lit, _ = seen(with_lamp(2.0, 0.3, np.ones(3)), FARTHER)
    usual = np.median(np.linalg.norm(dark[0], axis=-1))

    def light(times):
        color = times * usual / 3**0.5
        found = layered(dark + color * (lit - dark), depths, FARTHER)
        return lamp_in(*found)[0].sum() / (3 * color)

    found = [light(times) for times in np.arange(4.0, 14.0, 0.25)]
    assert found[0] == 0.0
    assert found[-1] > 3.5
    assert np.abs(np.diff(found)).max() < 0.1 * max(found)


def test_what_the_lens_cannot_see_is_left_out():
    poses = np.stack([pose(), pose(0.4), pose(-0.4)])
    colors, depths = seen(SCENE, poses)
    everything, _ = layered(colors, depths, poses)
    seen_by_lens, _ = layered(colors, depths, poses, lens=LENS.replace(aperture_radius=0.01))
    assert 0 < (seen_by_lens[1:, ..., 3] > 0).sum() < 0.5 * (everything[1:, ..., 3] > 0).sum()


def damaged(kind, scene=SCENE):
    """Give views of a scene that is not the reference's, or that lie."""
    poses = AROUND.copy()
    colors, depths = seen(scene)
    if kind == "moved":
        x, y, z = NEAR.centre
        moved = Card((x + 0.03, y, 1.1 * z), NEAR.half, NEAR.color)
        moved = Cards([moved if card is NEAR else card for card in scene.cards])
        colors[1:], depths[1:] = seen(moved, AROUND[1:])
    elif kind == "pose":
        for i in range(1, len(poses)):
            turn = 2.0 * np.pi * i / 8
            poses[i] = poses[i] @ pose(turn=0.5 * np.cos(turn))
            poses[i, :3, :3] = poses[i, :3, :3] @ _about_x(0.5 * np.sin(turn))
    elif kind == "one pose":
        poses[1] = poses[1] @ pose(turn=0.5)
    else:
        depths[1:] *= float(kind)
    return colors, depths, poses


def _about_x(degrees):
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])


@pytest.fixture(scope="module", params=["cards", "lamp"])
def scene_and_truth(request):
    if request.param == "cards":
        return SCENE, TRUTH
    scene = Cards([*SCENE.cards, with_lamp(2.0).cards[-1]])
    return scene, scene.thin_lens(RADIUS, FOCUS)


@pytest.mark.parametrize("kind", ["moved", "pose", "one pose", "1.02", "1.5", "0.7"])
def test_what_does_not_fit_is_never_worse_than_one_layer(kind, scene_and_truth):
    scene, truth = scene_and_truth
    colors, depths, poses = damaged(kind, scene)
    single = error_db(dofsim.render(colors[0], depths[0], LENS), truth)
    found = error_db(dofsim.render(*layered(colors, depths, poses, lens=LENS), LENS), truth)
    assert found > single - 0.2, (kind, single, found)


def test_colours_tell_a_wrong_pose_where_silhouettes_do_not():
    """A rail across the picture, whose edges are where they were when a camera is turned along it."""
    scene = Cards([WALL, Card((0.0, 0.0, 1.0), (9.0, 0.1), flat(0.2, 0.3, 0.4))])
    poses = np.stack([pose(), pose(0.0, -0.05), pose(0.0, 0.05)])
    colors, depths = seen(scene, poses)
    layers, _ = layered(colors, depths, poses)
    assert (layers[1, ..., 3] > 0.0).sum() > 300
    # Two degrees are 3.5 pixels.
    turned = np.stack([poses[0], *(one @ pose(turn=2.0) for one in poses[1:])])
    assert len(layered(colors, depths, turned)[0]) == 1


def test_a_mirror_is_never_worse_than_one_layer():
    scene = Cards([WALL, NEAR, Card(MIDDLE.centre, MIDDLE.half, mirrored, MIDDLE.slope)])
    colors, depths = seen(scene)
    truth = scene.thin_lens(RADIUS, FOCUS)
    single = error_db(dofsim.render(colors[0], depths[0], LENS), truth)
    found = error_db(dofsim.render(*layered(colors, depths, lens=LENS), LENS), truth)
    assert found > single - 0.2, (single, found)


def test_one_view_that_lies_is_outvoted():
    colors = COLORS.copy()
    colors[3] = 1.0 - colors[3]
    honest, _ = layered()
    layers, _ = layered(colors)
    there = (layers[1, ..., 3] > 0) & (honest[1, ..., 3] > 0)
    apart = np.abs(layers[1] - honest[1])[there].max(axis=-1)
    # Where it is the only one, it cannot be told.
    assert np.quantile(apart, 0.6) < 0.05, np.quantile(apart, [0.25, 0.5, 0.6, 0.75])


def test_a_stereo_pair_with_disparity_in_pixels():
    baseline = 0.06
    poses = np.stack([pose(), pose(baseline)])
    colors, depths = seen(SCENE, poses)
    disparity_px = baseline * FOCAL_PX / depths
    layers, z = layered(colors, disparity_px / (baseline * FOCAL_PX), poses, depth_kind="inverse_z")
    expected, metres = layered(colors, depths, poses)
    np.testing.assert_allclose(layers, expected, atol=1e-4)
    np.testing.assert_allclose(z[0], metres[0], rtol=1e-6)


@pytest.mark.parametrize("kind", ["distance", "zbuffer"])
def test_depth_of_any_metric_kind(kind):
    near, far = 0.1, 50.0
    length = np.linalg.norm(SCENE.rays(), axis=-1)
    given, options = {
        "distance": (DEPTHS * length, {}),
        "zbuffer": (far / (far - near) * (1.0 - near / DEPTHS), {"near": near, "far": far}),
    }[kind]
    layers, z = layered(depths=given, depth_kind=kind, **options)
    expected, metres = layered()
    assert (layers[1, ..., 3] != expected[1, ..., 3]).mean() < 0.002
    np.testing.assert_allclose(z[0], metres[0], rtol=1e-4)


def test_pictures_of_other_kinds():
    grey, _ = layered(COLORS[..., 0])
    one_channel, _ = layered(COLORS[..., :1])
    np.testing.assert_array_equal(grey, one_channel)
    np.testing.assert_array_equal(grey[0, ..., 0], grey[0, ..., 2])
    rgba = np.concatenate([COLORS, np.ones_like(COLORS[..., :1])], axis=-1)
    colors, _ = layered()
    np.testing.assert_allclose(layered(rgba)[0], colors, atol=1e-6)
    codes = np.round(255 * COLORS).astype(np.uint8)
    as_list, _ = layered(list(codes), list(DEPTHS), transfer="srgb")
    np.testing.assert_array_equal(as_list, layered(codes, transfer="srgb")[0])


OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])
SCALED = np.diag([2.0, 2.0, 2.0, 1.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"poses": AROUND @ OPENGL},
            r"^poses\[1\] is in the axes of OpenGL or Blender .* numpy.diag\(\[1, -1, -1, 1\]\)",
        ),
        ({"poses": AROUND @ MIRROR}, r"^poses\[0\] must be a rotation and a position; it mirrors"),
        ({"poses": AROUND @ SCALED}, r"^poses\[0\] must be rigid, .* off by 3"),
        (
            {"poses": AROUND[:4]},
            r"^poses must have shape \(9, 4, 4\), one for each of colors; got \[4, 4, 4\]",
        ),
        ({"poses": AROUND.swapaxes(1, 2)}, r"^poses\[1\] must have the last row \[0, 0, 0, 1\]"),
        (
            {"poses": np.where(AROUND == 1.0, np.nan, AROUND)},
            r"^poses must be finite; poses\[0\] has NaN in row 0, column 0",
        ),
        ({"intrinsics": np.eye(4)}, r"^intrinsics must have shape \(3, 3\) or \(9, 3, 3\), .* got \[4, 4\]"),
        ({"intrinsics": SCENE.intrinsics.T}, r"^intrinsics .* must be \[\[fx, skew, cx\]"),
        (
            {"colors": COLORS[:, :, :-2]},
            r"^depths must have the size of colors, 72 x 94; depths\[0\] has 72 x 96",
        ),
        (
            {"colors": [*COLORS[:8], COLORS[8][2:]]},
            r"^colors must all have the size of the first one, 72 x 96 x 3; colors\[8\] has 70 x 96 x 3",
        ),
        ({"colors": COLORS[:8]}, r"^depths must be as many as colors, 8; got 9"),
        ({"colors": COLORS[0]}, r"^depths must be as many as colors, 72"),
        ({"colors": np.round(COLORS).astype(np.uint8)}, r"^colors\[0\]: transfer must be given"),
        (
            {"colors": np.where(COLORS > 0.75, np.nan, COLORS)},
            r"^colors\[0\] has \d+ pixels that are not finite",
        ),
        ({"depths": -DEPTHS}, r"^depths\[0\]: depth: all 6912 values are negative"),
        ({"reference": 9}, r"^reference must be from 0 to 8, one of 9 pictures; got 9"),
        ({"layers": 1}, r"^layers must be from 2 to 16; got 1"),
        ({"depth_kind": "relative"}, r"^depth_kind must be metric"),
        ({"lens": dofsim.Lens.from_disparity(strength_px=5, focus=0.5)}, r"^lens must be metric"),
    ],
)
def test_one_clear_line_for_what_cannot_be_used(change, message):
    given = {"colors": COLORS, "depths": DEPTHS, "poses": AROUND, "intrinsics": SCENE.intrinsics} | change
    positional = [given.pop(name) for name in ("colors", "depths", "poses", "intrinsics")]
    with pytest.raises(ValueError, match=message) as error:
        dofsim.layers_from_views(*positional, **given)
    assert "\n" not in str(error.value)


def test_types_are_named():
    with pytest.raises(TypeError, match=r"^colors must be an array or a sequence of arrays"):
        dofsim.layers_from_views(3, DEPTHS, AROUND, SCENE.intrinsics)
    with pytest.raises(TypeError, match=r"^poses must be numbers"):
        dofsim.layers_from_views(COLORS, DEPTHS, "here", SCENE.intrinsics)


def test_a_wrong_pose_is_not_taken_for_other_axes():
    for kind in ("pose", "one pose", "moved"):
        layered(*damaged(kind))
