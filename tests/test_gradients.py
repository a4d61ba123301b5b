"""Gradients: adjoints of renders, and derivatives by depth and lens against differences of renders."""

import dofsim
import numpy as np
import pytest
from dofsim._dofsim import simd_available
from scipy import ndimage as ndi

LENS = dofsim.Lens(aperture_radius=0.05, focus_distance=2.0, fov=42.0)
SHAPE = (72, 130)


def textured(seed, shape=SHAPE):
    noise = np.random.default_rng(seed).random((*shape, 3))
    smooth = ndi.gaussian_filter(noise, (1.2, 1.2, 0.0))
    return ((smooth - smooth.min()) / np.ptp(smooth)).astype(np.float32)


def balls(shape=SHAPE):
    """Give two balls in front of a tilted wall; pixels of silhouettes mix both."""
    (height, width), (y, x) = shape, np.mgrid[: shape[0], : shape[1]].astype(float)
    color, depth = textured(1, shape).astype(float), 5.0 + 0.01 * x
    for seed, cx, cy, radius, near in ((2, 0.3, 0.4, 0.22, 1.4), (3, 0.65, 0.6, 0.28, 2.3)):
        from_middle = np.hypot(x - cx * width, y - cy * height)
        radius *= height
        coverage = np.clip(radius - from_middle + 0.5, 0.0, 1.0)[..., None]
        color = coverage * textured(seed, shape) * [1.0, 0.6, 0.4] + (1.0 - coverage) * color
        bulge = 0.2 * np.sqrt(np.maximum(0.0, 1.0 - (from_middle / radius) ** 2))
        depth = np.where(from_middle < radius, near - bulge, depth)
    return color.astype(np.float32), depth


def clutter():
    chosen = np.random.default_rng(4).choice([1.0, 1.5, 2.0, 4.0, np.inf], (SHAPE[0] // 8, SHAPE[1] // 8 + 1))
    return textured(5), chosen.repeat(8, 0).repeat(8, 1)[:, : SHAPE[1]]


def lamps():
    color, depth = 0.1 * textured(6), np.where(np.arange(SHAPE[1]) < 40, 1.2, 5.0) * np.ones(SHAPE)
    color[::17, ::13] = 30.0
    return color, depth


def wall(near, far):
    return textured(7), near + (far - near) * np.mgrid[: SHAPE[0], : SHAPE[1]][1] / SHAPE[1]


SCENES = {
    "balls": balls,
    "clutter": clutter,
    "lamps": lamps,
    "wall": lambda: wall(4.0, 4.0),
    "slope": lambda: wall(1.5, 4.5),
    "in focus": lambda: wall(2.0, 2.0),
}


def blurred(lens, depth, radius_px):
    largest = np.abs(dofsim.coc(depth, lens)).max()
    if largest < 1e-6:
        return lens
    return lens.replace(aperture_radius=lens.aperture_radius * radius_px / largest)


def assert_adjoint(color, depth, lens, **options):
    random = np.random.default_rng(8)
    along = random.standard_normal(color.shape).astype(np.float32)
    words = {"device": "cpu", "resolution": "full", **options}
    mapped = dofsim.render(along, depth, lens, guide=color, **words).astype(float)
    weights = random.standard_normal(mapped.shape).astype(np.float32)
    back = dofsim.vjp(color, depth, lens, weights, **options)["color"]
    assert back.shape == color.shape
    scale = np.linalg.norm(mapped) * np.linalg.norm(weights)
    assert np.vdot(mapped, weights) == pytest.approx(np.vdot(along, back.astype(float)), abs=1e-7 * scale)


# Lenses, apertures and frames, as changes of the lens and as options.
LENSES = [
    ({}, {"aperture": dofsim.Aperture(blades=6, rotation=10.0)}),
    ({}, {"aperture": dofsim.Aperture(obstruction=0.4, spherical=0.5)}),
    ({"cat_eye": 0.6}, {}),
    ({"tilt": (10.0, 5.0)}, {}),
    ({}, {"overscan": 6}),
    ({}, {"supersample": 2}),
    ({}, {"views": 100}),
]

# Colours


@pytest.mark.parametrize("radius_px", [0.4, 3.0, 12.0, 60.0])
@pytest.mark.parametrize("scene", SCENES)
def test_the_gradient_of_colours_is_the_adjoint_of_the_render(scene, radius_px):
    color, depth = SCENES[scene]()
    assert_adjoint(color, depth, blurred(LENS, depth, radius_px))


@pytest.mark.parametrize(
    ("changes", "options"),
    [
        *LENSES,
        ({"cat_eye": 0.6, "vignetting": "full"}, {}),
        ({"in_focus": (1.8, 2.4)}, {}),
        ({}, {"max_coc_px": 3.0}),
    ],
)
def test_lenses_apertures_and_frames_have_their_adjoint(changes, options):
    for scene in ("balls", "lamps"):
        color, depth = SCENES[scene]()
        assert_adjoint(color, depth, blurred(LENS, depth, 8.0).replace(**changes), **options)


@pytest.mark.parametrize("channels", [0, 1, 2, 4])
def test_pictures_of_any_number_of_channels(channels):
    color, depth = balls()
    color = np.concatenate([color, 0.5 + 0.5 * color[..., :1]], axis=2)
    color = color[..., 0] if channels == 0 else color[..., -channels:]
    assert_adjoint(np.ascontiguousarray(color), depth, blurred(LENS, depth, 6.0))


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_gradients_have_the_dtype_of_what_they_are_by(dtype):
    color, depth = balls()
    found = dofsim.vjp(
        color.astype(dtype), depth.astype(dtype), LENS, color, wrt=["color", "depth", "disparity"]
    )
    assert {value.dtype for value in found.values()} == {np.dtype(dtype)}


def test_the_number_of_threads_changes_no_bit():
    color, depth = clutter()
    wrt = ("color", "depth", "aperture_radius", "focus_distance")
    one, two = (dofsim.vjp(color, depth, LENS, color, wrt=wrt, threads=n) for n in (1, 2))
    assert all(np.array_equal(one[name], two[name]) for name in wrt)


@pytest.mark.parametrize("name", [name for name in simd_available() if name != "portable"])
@pytest.mark.parametrize("scene", [clutter, lamps])
def test_the_instruction_set_changes_no_bit(scene, name, monkeypatch):
    color, depth = scene()
    wrt = ("color", "disparity", "aperture_radius", "focus_distance")

    def found(name):
        monkeypatch.setenv("DOFSIM_SIMD", name)
        return dofsim.vjp(color, depth, LENS, color, wrt=wrt)

    portable, other = found("portable"), found(name)
    assert all(np.array_equal(portable[name], other[name]) for name in wrt)


def test_what_is_in_focus_gives_the_weights_back():
    color, depth = wall(2.0, 2.0)
    weights = np.random.default_rng(9).standard_normal(color.shape).astype(np.float32)
    np.testing.assert_array_equal(dofsim.vjp(color, depth, LENS, weights)["color"], weights)


# Layers


def rgba(color, alpha):
    alpha = np.broadcast_to(alpha, SHAPE)[..., None]
    return np.concatenate([alpha * color, alpha], axis=2).astype(np.float32)


def round_alpha(cx, cy, radius):
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.clip(radius - np.hypot(x - cx, y - cy) + 0.5, 0.0, 1.0)


def planes(*depths):
    return np.stack([np.full(SHAPE, depth) for depth in depths])


def whole_layers():
    """Give a disc before a wall in a first layer without gaps, and the wall behind the disc."""
    is_near = round_alpha(64, 36, 20) >= 0.5
    front = rgba(np.where(is_near[..., None], textured(1), textured(2)), 1.0)
    return np.stack([front, rgba(textured(2), 1.0 * is_near)]), np.stack(
        [np.where(is_near, 1.3, 5.0), np.full(SHAPE, 5.0)]
    )


def soft_layers():
    """Give two discs with soft edges, one before the other, and empty space around them."""
    layers = [rgba(textured(1), round_alpha(50, 30, 18)), rgba(textured(2), round_alpha(76, 40, 26))]
    return np.stack(layers), planes(1.3, 4.0)


def fog():
    """Give what light passes through, before a disc and a slope."""
    layers = [
        rgba(textured(1), 0.3 + 0.2 * (np.mgrid[: SHAPE[0], : SHAPE[1]][1] > 70)),
        rgba(textured(2), round_alpha(60, 36, 22)),
        rgba(textured(3), 1.0),
    ]
    depth = planes(1.2, 1.8, 5.0)
    depth[2] += np.linspace(0.0, 2.0, SHAPE[1])
    return np.stack(layers), depth


def random_layers():
    """Give blocks of any depth and coverage, in any order."""
    random = np.random.default_rng(11)

    def blocks(values):
        chosen = random.choice(values, (3, SHAPE[0] // 8, SHAPE[1] // 8 + 1))
        return chosen.repeat(8, 1).repeat(8, 2)[..., : SHAPE[1]]

    alpha, depth = blocks([0.0, 0.0, 0.4, 1.0, 1.0]), blocks([1.2, 1.6, 2.0, 3.0, 9.0])
    return np.stack([rgba(textured(20 + i), one) for i, one in enumerate(alpha)]), depth


LAYERS = {"whole": whole_layers, "soft": soft_layers, "fog": fog, "random": random_layers}


@pytest.mark.parametrize("radius_px", [0.4, 3.0, 12.0])
@pytest.mark.parametrize("scene", LAYERS)
def test_the_gradient_of_layers_is_the_adjoint_of_their_render(scene, radius_px):
    color, depth = LAYERS[scene]()
    assert_adjoint(color, depth, blurred(LENS, depth, radius_px))


@pytest.mark.parametrize(("changes", "options"), LENSES)
def test_layers_have_their_adjoint_through_lenses_and_apertures(changes, options):
    for scene in ("fog", "random"):
        color, depth = LAYERS[scene]()
        assert_adjoint(color, depth, blurred(LENS, depth, 8.0).replace(**changes), **options)


def test_a_layer_alone_is_a_picture():
    color, depth = wall(1.5, 4.5)
    lens = blurred(LENS, depth, 6.0)
    weights = np.random.default_rng(3).standard_normal((*SHAPE, 4)).astype(np.float32)
    layers = np.stack([rgba(color, 1.0), rgba(color, 0.0)])
    found = dofsim.vjp(layers, np.stack([depth, depth]), lens, weights)["color"]
    alone = dofsim.vjp(layers[0], depth, lens, weights)["color"]
    np.testing.assert_allclose(found[0], alone, atol=1e-5)
    assert not found[1].any()


# Depth and lens


class Loss:
    """The squared difference to the picture through another lens."""

    def __init__(self, color, depth, lens):
        self.color = color
        self.target = self.picture(
            depth, lens.replace(aperture_radius=1.2 * lens.aperture_radius, focus_distance=2.3)
        )

    def picture(self, depth, lens):
        # Of few lens points, a difference of two renders is mostly noise: a ray meets a rim or it does not.
        return dofsim.render(self.color, depth, lens, device="cpu", views=4096).astype(float)

    def __call__(self, depth, lens):
        return np.sum((self.picture(depth, lens) - self.target) ** 2)

    def weights(self, depth, lens):
        return 2.0 * (self.picture(depth, lens) - self.target)


def by_lens(loss, depth, lens, name, step=4e-3):
    value = getattr(lens, name)
    ends = [loss(depth, lens.replace(**{name: value * (1.0 + sign * step)})) for sign in (1, -1)]
    return (ends[0] - ends[1]) / (2.0 * step * value)


@pytest.mark.parametrize(("scene", "part"), [("balls", 0.1), ("wall", 0.03), ("slope", 0.05)])
@pytest.mark.parametrize("radius_px", [4.0, 10.0])
def test_the_gradient_of_the_lens_is_that_of_renders(scene, part, radius_px):
    color, depth = SCENES[scene]()
    lens = blurred(LENS, depth, radius_px)
    loss = Loss(color, depth, lens)
    names = ("aperture_radius", "focus_distance")
    found = dofsim.vjp(color, depth, lens, loss.weights(depth, lens), wrt=names, views=1024)
    relative = {name: found[name] * getattr(lens, name) for name in names}
    expected = {name: by_lens(loss, depth, lens, name) * getattr(lens, name) for name in names}
    # The terms of near and of far surfaces may cancel in one of them.
    scale = max(map(abs, expected.values()))
    for name in names:
        assert relative[name] == pytest.approx(expected[name], abs=part * scale)


@pytest.mark.parametrize("scene", ["wall", "slope"])
def test_the_gradient_of_depth_on_a_surface_is_that_of_renders(scene):
    color, depth = SCENES[scene]()
    lens = blurred(LENS, depth, 8.0)
    loss = Loss(color, depth, lens)
    found = dofsim.vjp(color, depth, lens, loss.weights(depth, lens), wrt="depth", views=1024)["depth"]
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    # Away from the focus, where the loss is no parabola.
    for cx, cy in ((45, 50), (65, 36), (95, 50)):
        bump = depth * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2.0 * 10.0**2))
        ends = [loss(depth + sign * 4e-3 * bump, lens) for sign in (1, -1)]
        assert np.vdot(found, bump) == pytest.approx((ends[0] - ends[1]) / 8e-3, rel=0.05)


# A wall and slopes gentle enough for exact discs, in focus and out of it, and one that is so in parts.
DISCS = {"wall": (4.0, 4.0), "slope": (3.2, 4.5), "near": (1.5, 1.52), "partly swept": (1.5, 1.8)}


@pytest.mark.parametrize("radius_px", [0.45, 2.0, 4.0, 10.0])
@pytest.mark.parametrize("scene", DISCS)
def test_gradients_of_exact_discs_are_differences_of_the_render_itself(scene, radius_px):
    color, depth = wall(*DISCS[scene])
    lens = blurred(LENS, depth, radius_px)
    # Nothing is noise here: the usual lens points, and the step in which a loss is differentiated.
    random = np.random.default_rng(3)
    weights = ndi.gaussian_filter(random.standard_normal(color.shape), (1.0, 1.0, 0.0)).astype(np.float32)
    names = ("aperture_radius", "focus_distance", "depth")
    found = dofsim.vjp(color, depth, lens, weights, wrt=names)

    def difference(change, step=1e-3):
        ends = [dofsim.render(color, *change(by), device="cpu").astype(float) for by in (step, -step)]
        along = (ends[0] - ends[1]) / (2.0 * step)
        return np.vdot(along, weights), np.linalg.norm(along) * np.linalg.norm(weights)

    for name in ("aperture_radius", "focus_distance"):
        value = getattr(lens, name)
        expected, scale = difference(
            lambda by, name=name, value=value: (depth, lens.replace(**{name: value * (1.0 + by)}))
        )
        assert found[name] * value == pytest.approx(expected, rel=0.01, abs=2e-3 * scale)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    for cx, cy in ((45, 50), (64, 32), (95, 20)):
        bump = depth * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2.0 * 10.0**2))
        expected, scale = difference(lambda by, bump=bump: (depth + by * bump, lens))
        assert np.vdot(found["depth"], bump) == pytest.approx(expected, rel=0.01, abs=2e-3 * scale)


@pytest.mark.parametrize("scene", SCENES)
def test_what_is_asked_for_together_is_what_is_asked_for_alone(scene):
    color, depth = SCENES[scene]()
    lens = blurred(LENS, depth, 8.0)
    wrt = ("color", "disparity", "aperture_radius", "focus_distance")
    together = dofsim.vjp(color, depth, lens, color, wrt=wrt)
    for name in wrt:
        np.testing.assert_array_equal(together[name], dofsim.vjp(color, depth, lens, color, wrt=name)[name])


def test_the_rim_of_what_is_near_moves_over_what_is_behind():
    # Of even colours, nothing else changes with depth.
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    from_middle = np.hypot(x - 64.5, y - 35.5)
    coverage = np.clip(25.5 - from_middle, 0.0, 1.0)[..., None]
    color = (0.2 + 0.6 * coverage * np.ones(3)).astype(np.float32)
    is_near = from_middle < 25.0
    depth = np.where(is_near, 1.2, 5.0)
    lens = blurred(LENS, depth, 6.0)
    loss = Loss(color, depth, lens)
    found = dofsim.vjp(color, depth, lens, loss.weights(depth, lens), wrt="depth", views=1024)["depth"]
    ends = [loss(depth * (1.0 + sign * 4e-3 * is_near), lens) for sign in (1, -1)]
    assert np.vdot(found, depth * is_near) == pytest.approx((ends[0] - ends[1]) / 8e-3, rel=0.04)
    assert np.abs(found[~is_near]).sum() < 1e-3 * np.abs(found).sum()


# How many pixels a dioptre shifts, and what is in focus.
K, FOCUS = 50.0, 0.5


def of_shifts(shift_px):
    """Give disparities of these shifts relative to the focus, and the lens that shifts by them."""
    lens = LENS.replace(focus_distance=1.0 / FOCUS)
    own = abs(float(dofsim.coc(np.ones(SHAPE), lens)[0, 0])) / (1.0 - FOCUS)
    return FOCUS + shift_px / K, lens.replace(aperture_radius=lens.aperture_radius * K / own)


def change_along(color, shift_px, bump_px, step=0.15):
    """Give how the render changes along a bump of shifts: the mean with two numbers of lens points."""

    def picture(by, views):
        disparity, lens = of_shifts(shift_px + by * bump_px)
        words = {"depth_kind": "inverse_z", "device": "cpu", "resolution": "full", "views": views}
        return dofsim.render(color, disparity, lens, **words).astype(float)

    ends = [picture(step, views) - picture(-step, views) for views in (3000, 4096)]
    return (ends[0] + ends[1]) / (4.0 * step)


def by_shift(color, shift_px, weights):
    disparity, lens = of_shifts(shift_px)
    words = {"wrt": "disparity", "depth_kind": "inverse_z", "views": 1024}
    return dofsim.vjp(color, disparity, lens, weights.astype(np.float32), **words)["disparity"] / K


# Columns of the last whole pixel of what is near: in a tile, and beside the border of two.
@pytest.mark.parametrize("last", [40, 62, 64])
@pytest.mark.parametrize("part", [0.0, 0.3, 0.7])
@pytest.mark.parametrize(("near", "far"), [(7.7, -5.7), (-2.2, -7.7)])
def test_a_rim_moves_with_the_pixels_whose_depth_it_has(last, part, near, far):
    # Of even colours. The pixel beside the last one is covered in part.
    x = np.mgrid[: SHAPE[0], : SHAPE[1]][1]
    coverage = np.clip(last + 1.0 + part - x, 0.0, 1.0)
    color = (0.2 + 0.6 * coverage[..., None] * np.ones(3)).astype(np.float32)
    is_near = coverage >= 0.5
    shift_px = np.where(is_near, near, far)
    weights = ndi.gaussian_filter(change_along(color, shift_px, 1.0 * is_near, 0.3), (1.0, 1.0, 0.0))
    found = by_shift(color, shift_px, weights).sum(axis=0)
    scale = np.vdot(weights, change_along(color, shift_px, 1.0 * is_near))
    # Along the side of a tile, an eighth of what lies across the pixels there is left out.
    part = 0.05 if last == 40 else 0.12
    assert found.sum() == pytest.approx(scale, rel=part)
    for column in range(last - 2, last + 3):
        expected = np.vdot(weights, change_along(color, shift_px, 1.0 * (x == column)))
        assert found[column] == pytest.approx(expected, abs=part * scale)


# Far, near, and where the surface passes through the focus.
@pytest.mark.parametrize("row", [24, 35, 48])
def test_the_gradient_on_a_steep_surface_is_where_differences_of_the_render_are(row):
    y = np.mgrid[: SHAPE[0], : SHAPE[1]][0]
    color, shift_px = textured(7), 0.39 * (y - 35.5)
    bump = np.exp(-((y - row) ** 2) / (2.0 * 2.0**2))
    weights = ndi.gaussian_filter(change_along(color, shift_px, bump, 0.3), (1.0, 1.0, 0.0))
    found = by_shift(color, shift_px, weights).sum(axis=1)
    rows = range(row - 4, row + 5)
    expected = [np.vdot(weights, change_along(color, shift_px, 1.0 * (y == one))) for one in rows]
    assert np.linalg.norm(found[rows[0] : rows[-1] + 1] - expected) < 0.07 * np.linalg.norm(expected)
    assert np.vdot(found, bump[:, 0]) == pytest.approx(
        np.vdot(weights, change_along(color, shift_px, bump)), rel=0.04
    )


def test_disparity_is_one_over_depth():
    color, depth = wall(1.5, 4.5)
    weights = np.random.default_rng(3).standard_normal(color.shape)
    found = dofsim.vjp(color, depth, LENS, weights, wrt=("depth", "disparity"))
    np.testing.assert_allclose(found["depth"], -found["disparity"] / depth**2, rtol=1e-5)
    direct = dofsim.vjp(color, 1.0 / depth, LENS, weights, wrt="depth", depth_kind="inverse_z")["depth"]
    np.testing.assert_allclose(direct, found["disparity"], rtol=1e-3, atol=1e-3 * np.abs(direct).max())


def test_relative_depth_and_its_lens():
    color, depth = wall(0.2, 0.9)
    lens = dofsim.Lens.from_disparity(strength_px=12.0, focus=0.6)
    weights = np.random.default_rng(3).standard_normal(color.shape)
    wrt = ("depth", "strength_px", "focus")
    found = dofsim.vjp(color, depth, lens, weights, wrt=wrt, depth_kind="disparity")
    words = {"depth_kind": "relative", "depth_range": (0.0, 100.0)}
    scaled = dofsim.vjp(color, 100.0 * depth, lens, weights, wrt=wrt, **words)
    np.testing.assert_allclose(100.0 * scaled["depth"], found["depth"], rtol=1e-3, atol=1e-3)
    # All disparities together do what the focus does.
    assert found["depth"].sum() == pytest.approx(-found["focus"], rel=1e-3)


def test_nothing_changes_with_infinite_depth():
    color, depth = balls()
    depth = np.where(depth > 4.0, np.inf, depth)
    found = dofsim.vjp(color, depth, LENS, color, wrt="depth")["depth"]
    assert np.isfinite(found).all()
    assert not found[np.isinf(depth)].any()
    assert found.any()


# Forward


def test_along_colours_the_derivative_is_the_render_of_them():
    color, depth = balls()
    along = np.random.default_rng(2).standard_normal(color.shape).astype(np.float32)
    found = dofsim.jvp(color, depth, LENS, {"color": along})
    np.testing.assert_array_equal(found, dofsim.render(along, depth, LENS, guide=color, device="cpu"))


def test_forward_and_backward_agree():
    color, depth = wall(1.5, 4.5)
    lens = blurred(LENS, depth, 6.0)
    weights = np.random.default_rng(3).standard_normal(color.shape)
    names = ("aperture_radius", "focus_distance")
    back = dofsim.vjp(color, depth, lens, weights, wrt=names)
    for name in names:
        along = dofsim.jvp(color, depth, lens, {name: 1.0})
        terms = np.abs(along * weights).sum()
        assert np.vdot(along, weights) == pytest.approx(back[name], abs=2e-3 * terms)


def test_tangents_add_up():
    color, depth = wall(1.5, 4.5)
    tangents = {"color": color, "depth": 0.1 * depth, "focus_distance": 0.3}
    all_together = dofsim.jvp(color, depth, LENS, tangents)
    each = sum(dofsim.jvp(color, depth, LENS, {name: along}) for name, along in tangents.items())
    assert np.abs(all_together - each).mean() < 0.02 * np.abs(each).mean()


# What is refused


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wrt": ()}, "wrt must name at least one of color, alpha, depth, disparity, aperture_radius"),
        ({"wrt": "fov"}, "wrt must be among color, .*; got 'fov'"),
        ({"wrt": "focus"}, "wrt must be among color, .*; got 'focus'"),
        ({"wrt": "alpha"}, "is the last of 4 channels"),
        ({"cotangent": np.ones((3, 4, 3))}, r"cotangent must have the shape \(72, 130, 3\)"),
        ({"cotangent": np.full((*SHAPE, 3), np.nan)}, "cotangent must be finite"),
        ({"color": np.ones((*SHAPE, 3), np.uint8)}, "color must have dtype float16, float32 or float64"),
        ({"depth_kind": "distance"}, "depth_kind must be z, inverse_z, disparity, relative for gradients"),
        ({"depth_kind": "relative"}, "depth_range must be given"),
        (
            {"lens": LENS.replace(axial_color=(0.01, 0.0, -0.01))},
            "are for a lens without axial_color",
        ),
        ({"lens": LENS.replace(cat_eye=0.5), "wrt": "depth"}, "for a lens without cat_eye"),
        ({"lens": LENS.replace(tilt=(5.0, 0.0)), "wrt": "depth"}, "for a lens without tilt"),
        ({"taps": 12}, "taps"),
    ],
)
def test_what_cannot_be_differentiated_is_named(changes, message):
    color, depth = wall(4.0, 4.0)
    words = {"color": color, "depth": depth, "lens": LENS, "cotangent": color, **changes}
    with pytest.raises((ValueError, TypeError), match=message):
        dofsim.vjp(**words)


def test_of_layers_only_colours_are_differentiated():
    color, depth = whole_layers()
    with pytest.raises(
        ValueError, match="wrt: gradients of depth and of the lens are for pictures of one layer"
    ):
        dofsim.vjp(color, depth, LENS, color[0], wrt="depth")
    with pytest.raises(ValueError, match=r"color must have shape \(H, W\), \(H, W, C\) or, in layers"):
        dofsim.vjp(color[None], depth, LENS, color[0])
    with pytest.raises(ValueError, match=r"cotangent must have the shape \(72, 130, 4\)"):
        dofsim.vjp(color, depth, LENS, color)
    with pytest.raises(ValueError, match="alpha is part of"):
        dofsim.jvp(color, depth, LENS, {"alpha": 1.0})


def test_lamps_at_the_edges_of_layers_are_refused():
    color, depth = whole_layers()
    color[0, 34:39, 42:47, :3] = 60.0
    with pytest.raises(ValueError, match="no lamp mixes with another surface at the edge of a first layer"):
        dofsim.vjp(color, depth, LENS, color[0])
