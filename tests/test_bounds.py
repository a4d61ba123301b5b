"""A range in focus, and a bound on the blur's radius: laws of both, for every method and on both devices."""

import pickle

import dofsim
import numpy as np
import pytest
from both_devices import assert_agree, metric_scene
from dofsim import Lens
from dofsim._dofsim import methods_available

HEIGHT, WIDTH = 70, 110
LENS = Lens(aperture_radius=0.06, focus_distance=2.5, fov=40.0)
METHODS = methods_available()
# What blur is measured against depends on the bound.
MEASURES = ("poisson", "gaussian")


def scene(seed=1):
    """Give white noise at steps and on a slope from 1 m to infinity."""
    rng = np.random.default_rng(seed)
    depth = np.full((HEIGHT, WIDTH), 5.0, np.float32)
    depth[:12] = np.inf
    depth[40:, 60:] = 2.4
    depth[20:60, 10:50] = np.linspace(1.6, 2.8, 40, dtype=np.float32)
    depth[30:50, 70:80] = 1.0
    return rng.random((HEIGHT, WIDTH, 3), dtype=np.float32), depth


def render(lens=LENS, *, data=None, device="cpu", **options):
    color, depth = data or scene()
    return dofsim.render(color, depth, lens, device=device, **options)


# The range in focus.


@pytest.mark.parametrize("method", METHODS)
def test_a_range_of_one_plane_is_that_plane_to_the_bit(method):
    np.testing.assert_array_equal(
        render(in_focus=(2.5, 2.5), method=method), render(LENS.replace(focus_distance=2.5), method=method)
    )


@pytest.mark.parametrize("method", METHODS)
def test_a_range_that_shrinks_to_a_plane_tends_to_that_plane(method):
    plane = render(method=method)
    apart = [
        np.abs(render(in_focus=(2.5 - e, 2.5 + e), method=method) - plane).mean() for e in (1e-1, 1e-3, 1e-5)
    ]
    assert apart[0] > 1e-4
    assert apart[2] < 1e-2 * apart[0]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("device", ["cpu", "gpu"])
def test_all_that_is_in_the_range_comes_back_as_it_was(request, method, device):
    if device == "gpu":
        device = request.getfixturevalue("gpu")
    color, depth = scene()
    depth[:12] = 4.0
    out = render(data=(color, depth), in_focus=(1.0, 5.0), method=method, device=device)
    np.testing.assert_array_equal(out, color)


def test_what_is_in_the_range_is_sharp_beside_what_is_not():
    color, depth = scene()
    out = render(data=(color, depth), in_focus=(1.6, 2.8))
    inside = np.zeros(depth.shape, bool)
    # Away from its edges, and what is nearer than the range.
    inside[24:56, 14:46] = inside[55:, 85:] = True
    np.testing.assert_allclose(out[inside], color[inside], atol=1e-5)
    assert out[:8].std() < 0.5 * color[:8].std()


def test_the_radius_is_measured_from_the_nearer_end():
    z = np.array([[0.5, 1.0, 2.0, 2.3, 2.6, 4.0, np.inf]])
    radius = dofsim.coc(z, LENS, in_focus=(2.0, 2.6))
    k = 0.06 * 0.5 * z.size / np.tan(np.radians(20.0))
    expected = k * (np.clip(1 / z, 1 / 2.6, 1 / 2.0) - 1 / z)
    np.testing.assert_allclose(radius, expected, rtol=1e-6)
    assert (radius[0, 2:5] == 0.0).all()


@pytest.mark.parametrize("wider", [(1.9, 2.6), (2.0, 3.0), (0.5, np.inf)])
def test_a_wider_range_enlarges_no_radius(wider):
    z = 10.0 ** np.random.default_rng(2).uniform(-1, 2, (20, 30))
    narrow, wide = (np.abs(dofsim.coc(z, LENS, in_focus=ends)) for ends in ((2.0, 2.6), wider))
    assert (wide <= narrow * (1 + 1e-6)).all()
    assert (wide < narrow - 1e-3).any()


def test_the_ends_lean_with_the_surface_in_focus():
    depth = np.full((40, 60), 2.3)
    k = 0.03 * 30.0 / np.tan(np.radians(25.0))
    for flaw in ({"tilt": (20.0, -30.0)}, {"field_curvature": 0.3}):
        lens = Lens(aperture_radius=0.03, focus_distance=2.3, fov=50.0, **flaw)
        # A plane at the distance of the depth is sharp on the axis, so this is what the surface alone does.
        lean = dofsim.coc(depth, lens) / k
        if "tilt" in flaw:
            # The slope of a plane's disparity is in proportion to its disparity on the axis.
            lean *= 2.3 * 0.5 * (1 / 2.25 + 1 / 2.4)
        ranged = dofsim.coc(depth, lens, in_focus=(2.25, 2.4))
        d = 1.0 / 2.3 - lean
        np.testing.assert_allclose(ranged, k * (np.clip(d, 1 / 2.4, 1 / 2.25) - d), atol=1e-4)
        assert np.abs(ranged).max() > 0.01


def test_the_word_of_render_is_that_of_the_lens():
    ranged = LENS.replace(in_focus=(2.0, 2.6))
    once = render(ranged)
    np.testing.assert_array_equal(render(in_focus=(2.0, 2.6)), once)
    np.testing.assert_array_equal(render(Lens(aperture_radius=0.06, fov=40.0, in_focus=(2.0, 2.6))), once)
    kept = dofsim.Scene(*scene(), device="cpu")
    np.testing.assert_array_equal(kept.render(LENS, in_focus=(2.0, 2.6)), once)
    stack = kept.focal_stack(LENS, [2.5, (2.0, 2.6), 1.7])
    np.testing.assert_array_equal(stack[1], once)
    np.testing.assert_array_equal(stack[0], render())
    np.testing.assert_array_equal(stack[2], render(LENS.replace(focus_distance=1.7)))
    # What was kept of one range or of one plane is not taken for another's.
    np.testing.assert_array_equal(
        kept.render(ranged.replace(in_focus=(1.0, 5.0))), render(in_focus=(1.0, 5.0))
    )


def test_relative_disparity_has_ranges_too():
    color, depth = scene()
    disparity = 1.0 / depth
    lens = Lens.from_disparity(strength_px=9.0, in_focus=(0.6, 0.3))
    assert lens.focus == pytest.approx(0.45)
    radius = dofsim.coc(disparity, lens, depth_kind="disparity")
    np.testing.assert_allclose(radius, 9.0 * (np.clip(disparity, 0.3, 0.6) - disparity), atol=1e-5)
    out = dofsim.render(color, disparity, lens, depth_kind="disparity", device="cpu")
    np.testing.assert_allclose(out[65:, 90:], color[65:, 90:], atol=1e-5)


def test_layers_within_the_range_hide_each_other_as_before():
    rng = np.random.default_rng(3)
    layers = rng.random((3, 40, 50, 4), dtype=np.float32)
    layers[0, ..., 3] = rng.random((40, 50)) < 0.3
    layers[1, ..., 3] = rng.random((40, 50)) < 0.6
    layers[2, ..., 3] = 1.0
    layers[..., :3] *= layers[..., 3:]
    depths = np.stack([np.full((40, 50), z) for z in (2.0, 2.2, 2.4)])
    wide = LENS.replace(aperture_radius=0.6)
    out = dofsim.render(layers, depths, wide, in_focus=(1.9, 2.5), device="cpu")
    seen = layers[2]
    for layer in layers[1::-1]:
        seen = layer + (1 - layer[..., 3:]) * seen
    np.testing.assert_allclose(out, seen, atol=1e-6)


def test_a_lens_with_a_range_is_a_lens():
    ranged = LENS.replace(in_focus=(2.0, 6.0))
    assert repr(ranged) == "Lens(aperture_radius=0.06, in_focus=(2.0, 6.0), fov=40.0, fov_axis='x')"
    assert ranged.in_focus == (2.0, 6.0)
    # The plane that blurs both ends alike.
    assert ranged.focus_distance == 3.0
    for one in (
        ranged,
        LENS.replace(in_focus=[1.5, np.inf]),
        Lens.from_disparity(strength_px=2.0, in_focus=(2, 1)),
    ):
        assert eval(repr(one), {"Lens": Lens}) == pickle.loads(pickle.dumps(one)) == one
        assert hash(one) == hash(pickle.loads(pickle.dumps(one)))
        assert one != one.replace(in_focus=(9.0, 9.0))
        assert repr(one).replace("'", "&#x27;") in one._repr_html_()
    assert ranged.replace(focus_distance=4.0) == LENS.replace(focus_distance=4.0)
    assert ranged.replace(aperture_radius=0.1).in_focus == (2.0, 6.0)
    assert LENS.replace(in_focus=None) == LENS
    depth = np.full((4, 6), 2.0)
    assert ranged.focused_at(depth, 1, 1) == LENS.replace(focus_distance=2.0)
    camera = Lens.from_camera(focal_length_mm=50, f_number=2.0, focus_distance=3.0).replace(
        in_focus=(2.0, 6.0)
    )
    near, far = camera.depth_of_field(1e-9)
    assert (near, far) == pytest.approx((2.0, 6.0), rel=1e-4)
    assert camera.coc_diameter_mm(3.0) == 0.0 < camera.coc_diameter_mm(1.9)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        ((2.6, 2.0), ValueError, r"^in_focus must be two distances in metres, .*; got \(2.6, 2\)"),
        ((0.0, 2.0), ValueError, r"^in_focus must be two distances.*; got \(0, 2\)"),
        ((np.inf, np.inf), ValueError, r"^in_focus must be two distances.*; got \(inf, inf\)"),
        ((1.0, np.nan), ValueError, r"^in_focus must be two distances.*; got \(1, NaN\)"),
        (2.0, TypeError, r"^in_focus must be two numbers; got 2.0"),
        ((1, 2, 3), (TypeError, ValueError), r"^in_focus must be two numbers; got \(1, 2, 3\)"),
        ("ab", TypeError, r"^in_focus must be two numbers; got 'ab'"),
    ],
)
def test_ranges_that_are_none_are_named(value, error, text):
    for call in (
        lambda: render(in_focus=value),
        lambda: LENS.replace(in_focus=value),
        lambda: dofsim.coc(scene()[1], LENS, in_focus=value),
    ):
        with pytest.raises(error, match=text):
            call()


def test_a_plane_and_a_range_exclude_each_other():
    one_of = r"^Lens\(\) takes one of focus_distance and in_focus"
    with pytest.raises(TypeError, match=one_of):
        Lens(aperture_radius=0.1, focus_distance=1.0, fov=40.0, in_focus=(1.0, 2.0))
    with pytest.raises(TypeError, match=one_of):
        Lens(aperture_radius=0.1, fov=40.0)
    with pytest.raises(TypeError, match=one_of):
        LENS.replace(focus_distance=1.0, in_focus=(1.0, 2.0))
    with pytest.raises(TypeError, match=r"^from_disparity\(\) takes one of focus and in_focus"):
        Lens.from_disparity(strength_px=1.0)
    with pytest.raises(
        ValueError, match=r"^in_focus must be two finite disparities, .*larger.*; got \(1, 2\)"
    ):
        Lens.from_disparity(strength_px=1.0, in_focus=(1.0, 2.0))
    for method, option in (("gaussian", "focal_range"), ("taps", "hyperfocal_factor")):
        with pytest.raises(ValueError, match=f"^{option} is measured from a plane in focus"):
            render(in_focus=(2.0, 3.0), method=method, **{option: 1.0})


# The bound on the radius.


def absurd():
    """One pixel is so near that its circle of confusion is wider than any picture."""
    color, depth = scene()
    depth[33, 21] = 1e-4
    return color, depth


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("device", ["cpu", "gpu"])
def test_one_absurd_depth_refuses_no_frame(request, method, device):
    if device == "gpu":
        device = request.getfixturevalue("gpu")
    words = {"max_coc_px": 12.0, "method": method, "device": device}
    if method == "levels":
        # By default they depend on the largest radius.
        words["c0_px"] = 3.0
    out = render(data=absurd(), **words)
    assert np.isfinite(out).all()
    # What the pixel does to the picture ends where its disc ends, plus what a method spreads by itself.
    # Elsewhere the flagship has other lens points.
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    far = np.hypot(y - 33, x - 21) > 12.0 + 16.0
    apart = (out - render(**words))[far]
    assert np.sqrt(np.mean(apart**2)) < (0.04 if method == "lens" else 1e-6)


def test_the_error_without_it_says_how_many_where_and_what_helps():
    color, depth = absurd()
    depth[40, 3:5] = 1e-4
    text = (
        r"^depth has 3 of 7700 values that are too near for this lens: .* more than \d+ px; the first, "
        r"of \d+ px, is at row 33, column 21\. Pass max_coc_px to bound the radius"
    )
    with pytest.raises(ValueError, match=text):
        render(data=(color, depth))
    with pytest.raises(
        ValueError, match=r"^depth has .* values that are too far behind the focus for this lens"
    ):
        render(
            Lens(aperture_radius=1e3, focus_distance=1.0, fov=40.0), data=(color, np.full_like(depth, 5.0))
        )
    assert np.isfinite(render(data=(color, depth), max_coc_px=40.0)).all()


@pytest.mark.parametrize("method", METHODS)
def test_a_bound_that_nothing_reaches_changes_no_bit(method):
    largest = float(np.abs(dofsim.coc(scene()[1], LENS)).max())
    if method not in MEASURES:
        np.testing.assert_array_equal(
            render(method=method, max_coc_px=1.001 * largest), render(method=method)
        )
    assert (render(method=method, max_coc_px=0.2 * largest) != render(method=method)).any()


@pytest.mark.parametrize("method", METHODS)
def test_the_bound_is_that_of_the_depth_which_has_this_radius(method):
    color, depth = scene()
    bound = 3.0
    radius = dofsim.coc(depth, LENS)
    k = -dofsim.coc(np.full(depth.shape, 1.0), LENS)[0, 0] / (1.0 - 1.0 / 2.5)
    nearest, farthest = 1 / (1 / 2.5 + bound / k), 1 / (1 / 2.5 - bound / k)
    assert radius.min() < -bound < bound < radius.max()
    clipped = np.clip(depth, nearest, farthest)
    words = {"max_coc_px": bound} if method in MEASURES else {}
    expected = render(data=(color, clipped), method=method, **words)
    np.testing.assert_allclose(render(method=method, max_coc_px=bound), expected, atol=1e-4)


def test_coc_is_bounded_alike():
    _, depth = absurd()
    plain, bounded = dofsim.coc(depth, LENS), dofsim.coc(depth, LENS, max_coc_px=5.0)
    np.testing.assert_allclose(bounded, np.clip(plain, -5.0, 5.0), atol=1e-4)
    assert np.abs(bounded).max() <= 5.0
    both = dofsim.coc(depth, LENS, in_focus=(2.0, 3.0), max_coc_px=5.0)
    np.testing.assert_allclose(
        both, np.clip(dofsim.coc(depth, LENS, in_focus=(2.0, 3.0)), -5.0, 5.0), atol=1e-4
    )


@pytest.mark.parametrize("method", METHODS)
def test_a_slightly_larger_bound_changes_the_picture_slightly(method):
    at = [render(max_coc_px=1.2 + e, method=method) for e in (0.0, 1e-4, 0.5)]
    slight, large = (np.abs(picture - at[0]).mean() for picture in at[1:])
    assert slight < 0.02 * large


def test_a_stack_is_bounded_at_every_focus():
    kept = dofsim.Scene(*absurd(), device="cpu")
    stack = kept.focal_stack(LENS, [2.5, 1.2], max_coc_px=7.0)
    for picture, distance in zip(stack, [2.5, 1.2], strict=True):
        lens = LENS.replace(focus_distance=distance)
        np.testing.assert_array_equal(picture, render(lens, data=absurd(), max_coc_px=7.0))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_bounds_that_are_none_are_named(method, value):
    with pytest.raises(ValueError, match=r"^max_coc_px must be a radius in pixels, .*; got"):
        render(max_coc_px=value, method=method)
    with pytest.raises(TypeError, match=r"^max_coc_px must be a number; got 'wide'"):
        render(max_coc_px="wide", method=method)


# Both, on both devices.


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "words",
    [{"in_focus": (1.7, 3.5)}, {"max_coc_px": 5.0}, {"in_focus": (2.0, np.inf), "max_coc_px": 4.0}],
    ids=str,
)
@pytest.mark.parametrize("flaw", [{}, {"tilt": (10.0, -20.0), "axial_color": (0.03, 0.0, -0.02)}], ids=str)
def test_gpu_and_cpu_agree(gpu, method, words, flaw):
    lens = Lens(aperture_radius=0.08, focus_distance=3.0, fov=40.0, **flaw)
    on_gpu, on_cpu = (
        dofsim.render(*metric_scene(), lens, device=device, method=method, **words) for device in (gpu, "cpu")
    )
    assert_agree(on_gpu, on_cpu, method)


@pytest.mark.parametrize("threads", [1, 3])
def test_threads_change_no_bit(threads):
    words = {"in_focus": (1.7, 3.5), "max_coc_px": 5.0}
    np.testing.assert_array_equal(render(threads=threads, **words), render(**words))
