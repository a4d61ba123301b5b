"""What `render`, `Scene`, `Lens` and `Aperture` take, and what they say when they cannot."""

import copy
import inspect
import math
import pickle
import subprocess
import sys

import dofsim
import numpy as np
import pytest
from dofsim import Aperture, Lens

LENS = Lens(aperture_radius=0.05, focus_distance=2.0, fov=40.0)
RELATIVE = Lens.from_disparity(strength_px=5.0, focus=0.2)


def scene(height=24, width=32, channels=3, dtype=np.float32):
    rng = np.random.default_rng(7)
    shape = (height, width) if channels is None else (height, width, channels)
    if np.issubdtype(dtype, np.integer):
        color = rng.integers(0, np.iinfo(dtype).max, shape, dtype=dtype)
    else:
        color = rng.random(shape).astype(dtype)
    depth = np.full((height, width), 4.0, np.float32)
    depth[height // 2 :, width // 3 :] = 1.5
    return color, depth


@pytest.mark.parametrize("channels", [None, 1, 2, 3, 4])
@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (2, 2), (33, 65)])
def test_every_shape_is_rendered(size, channels):
    color, depth = scene(*size, channels)
    out = dofsim.render(color, depth, LENS)
    assert out.shape == color.shape
    assert out.dtype == np.float32
    assert np.isfinite(out).all()
    # A mean over a lens lies between the least and the greatest value; residuals of edges may pass it.
    assert out.min() > color.min() - 0.2
    assert out.max() < color.max() + 0.2


@pytest.mark.parametrize("color_dtype", [np.float16, np.float32, np.float64, np.uint8, np.uint16])
@pytest.mark.parametrize("depth_dtype", [np.float16, np.float32, np.float64])
def test_output_has_the_dtype_of_color(color_dtype, depth_dtype):
    color, depth = scene(dtype=color_dtype)
    out = dofsim.render(color, depth.astype(depth_dtype), LENS, transfer="linear")
    assert out.dtype == color_dtype
    scale = np.iinfo(color_dtype).max if np.issubdtype(color_dtype, np.integer) else 1.0
    expected = dofsim.render((color / scale).astype(np.float32), depth, LENS)
    # One step of the coarsest of the types: 8 bits, or the 11 of a half.
    np.testing.assert_allclose(out / scale, expected, atol=1 / 255)


def test_memory_layout_does_not_matter():
    color, depth = scene()
    expected = dofsim.render(color, depth, LENS)
    wide = np.zeros((48, 96, 3), np.float32)
    wide[::2, ::3] = color
    for c, d in [
        (np.asfortranarray(color), np.asfortranarray(depth)),
        (wide[::2, ::3], depth),
        (color[::-1, ::-1].copy()[::-1, ::-1], depth[::-1].copy()[::-1]),
        (np.ascontiguousarray(color.transpose(2, 1, 0)).transpose(2, 1, 0), depth),
    ]:
        np.testing.assert_array_equal(dofsim.render(c, d, LENS), expected)


@pytest.mark.parametrize("dtype", [np.uint16, np.float16, np.float32, np.float64])
def test_fields_of_packed_records_are_read_in_order(dtype):
    color, depth = scene(dtype=dtype)
    depth = depth + np.linspace(0, 1, depth.size, dtype=np.float32).reshape(depth.shape)
    fields = [("label", "u1"), ("color", dtype, 3), ("z", "f4")]
    records = np.zeros(depth.shape, fields)
    records["color"], records["z"] = color, depth
    options = {"transfer": "linear", "device": "cpu"}
    expected = dofsim.render(color, depth, LENS, **options)
    for turned in (slice(None), slice(None, None, -1)):
        c, z = records["color"][turned], records["z"][turned]
        np.testing.assert_array_equal(dofsim.render(c[turned], z[turned], LENS, **options), expected)
        np.testing.assert_array_equal(dofsim.coc(z[turned], LENS), dofsim.coc(depth, LENS))
    for y, x in ((0, 0), (11, 20), (23, 31)):
        assert LENS.focused_at(records["z"], x, y) == LENS.focused_at(depth, x, y)
    planes = np.zeros(depth.shape, [("label", "u1"), ("t", "f8")])
    planes["t"] = depth
    assert Aperture(image=planes["t"]) == Aperture(image=depth.astype(np.float64))
    words = {"method": "sprites", **options}
    np.testing.assert_array_equal(
        dofsim.render(color, depth, LENS, sprite=planes["t"], **words),
        dofsim.render(color, depth, LENS, sprite=planes["t"].copy(), **words),
    )


def test_the_other_byte_order_and_any_address_are_read():
    color, depth = scene()
    expected = dofsim.render(color, depth, LENS)
    np.testing.assert_array_equal(dofsim.render(color.astype(">f4"), depth.astype(">f4"), LENS), expected)
    buffer = np.zeros(color.nbytes + 3, np.uint8)[3:]
    unaligned = buffer.view(np.float32).reshape(color.shape)
    unaligned[...] = color
    np.testing.assert_array_equal(dofsim.render(unaligned, depth, LENS), expected)
    with pytest.raises(ValueError, match="out must be C-contiguous and aligned"):
        dofsim.render(color, depth, LENS, out=unaligned)
    with pytest.raises(TypeError, match="out must have the dtype of color, float32; got >f4"):
        dofsim.render(color, depth, LENS, out=color.astype(">f4"))


def test_inputs_are_only_read():
    color, depth = scene()
    before = color.copy(), depth.copy()
    color.flags.writeable = depth.flags.writeable = False
    out = dofsim.render(color, depth, LENS)
    np.testing.assert_array_equal(color, before[0])
    np.testing.assert_array_equal(depth, before[1])
    assert out.flags.writeable
    assert not np.shares_memory(out, color)


@pytest.mark.parametrize("side", [4096])
def test_big_picture(side):
    color = np.random.default_rng(8).random((side, side, 3), dtype=np.float32)
    depth = np.full((side, side), 4.0, np.float32)
    depth[side // 3 : side // 2, side // 3 : side // 2] = 1.5
    out = dofsim.render(color, depth, Lens(aperture_radius=0.01, focus_distance=2.0, fov=40.0))
    assert out.shape == color.shape
    assert out.mean(dtype=np.float64) == pytest.approx(color.mean(dtype=np.float64), rel=0.01)


def test_layers_come_out_as_one_picture():
    color, depth = scene(channels=4)
    color[..., :3] *= color[..., 3:]
    out = dofsim.render(np.stack([color, color]), np.stack([depth, depth + 1.0]), LENS)
    assert out.shape == color.shape


GOOD_COLOR, GOOD_DEPTH = scene()


def bad_depth(value):
    depth = GOOD_DEPTH.copy()
    depth[3, 5] = depth[7, 2] = depth[20, 30] = value
    return depth


def nan_color():
    color = GOOD_COLOR.copy()
    color[4, 6, 1] = np.nan
    return color


WRONG = {
    "no rows": ({"color": np.zeros((0, 5, 3), np.float32)}, "color must not be empty.*0, 5, 3"),
    "no pixels of depth": ({"depth": np.zeros((0, 5), np.float32)}, "depth must not be empty"),
    "shapes differ": ({"depth": np.ones((24, 31))}, r"same layers, rows and columns as color.*32.*31"),
    "five channels": ({"color": np.zeros((24, 32, 5), np.float32)}, "1 to 4 channels"),
    "one axis": ({"color": np.zeros(24, np.float32)}, r"shape \(H, W\), \(H, W, C\)"),
    "depth of four axes": ({"depth": np.ones((1, 1, 24, 32))}, r"depth must have shape \(H, W\)"),
    "NaN in color": ({"color": nan_color()}, "color has 1 pixel that is not finite.*row 4, column 6.*fill"),
    "NaN depth": ({"depth": bad_depth(np.nan)}, "depth has 3 of 768.*first is NaN at row 3, column 5.*far"),
    "negative depth": ({"depth": bad_depth(-1.0)}, "depth has 3 of 768.*first is -1 at row 3, column 5"),
    "zero depth": ({"depth": bad_depth(0.0)}, "depth has 3 of 768.*first is 0 at row 3, column 5"),
    "absurd lens": ({"lens": LENS.replace(aperture_radius=1e5)}, "768 of 768.*16384 px.*max_coc_px"),
    "method": ({"method": "magic"}, 'method must be one of "lens", .*"taps".*"magic"'),
    "device": ({"device": "tpu"}, 'device must be "auto", "cpu", "gpu" or an adapter; got "tpu"'),
    "depth kind": ({"depth_kind": "metres"}, 'depth_kind must be one of "z", "distance".*"metres"'),
    "alpha": ({"alpha": "yes"}, 'alpha must be one of "premultiplied", "straight", "none"; got "yes"'),
    "alpha of three": ({"alpha": "straight"}, 'alpha must be "none" for color of 3 channels'),
    "transfer": ({"transfer": "gamma"}, 'transfer must be one of "linear", "srgb"; got "gamma"'),
    "invalid": ({"invalid": "skip"}, 'invalid must be one of "raise", "far"; got "skip"'),
    "integers": ({"color": np.zeros((24, 32, 3), np.uint8)}, "transfer must be given for integer color"),
    "relative lens": ({"lens": RELATIVE}, 'depth_kind="z" is metric.*from_disparity'),
    "metric lens": ({"depth_kind": "disparity"}, "needs a lens made by Lens.from_disparity"),
    "no near": ({"depth_kind": "zbuffer", "far": 9.0}, "near must be given"),
    "no far": ({"depth_kind": "zbuffer", "near": 1.0}, "far must be given"),
    "one plane": ({"depth_kind": "zbuffer", "near": 2.0, "far": 2.0}, "far must differ from near"),
    "all negative": ({"depth": -np.ones((24, 32), np.float32)}, "all 768 values are negative.*negate them"),
    "negative but the sky": (
        {"depth": np.where(np.arange(768).reshape(24, 32) < 40, np.inf, -2.0)},
        "all 768 values but 40 that are 0, infinite or NaN are negative.*negate them",
    ),
    "all behind": (
        {"depth": -np.ones((24, 32), np.float32), "invalid": "far"},
        "all 768 values are negative.*negate them",
    ),
    "no near plane": ({"depth_kind": "distance_from_near"}, "near must be given"),
    "near for z": ({"near": 1.0}, "near and far are for"),
    "supersample": ({"supersample": 5}, "supersample=5 must divide"),
    "supersample of zero": ({"supersample": 0}, "supersample must be from 1 to 16; got 0"),
    "overscan": ({"overscan": 12}, "overscan must leave a picture"),
    "threads": ({"threads": 0}, "threads must be from 1 to 1024; got 0"),
    "views": ({"views": 8}, "views must be from 16 to 16384; got 8"),
}


def call(**changes):
    return dofsim.render(**{"color": GOOD_COLOR, "depth": GOOD_DEPTH, "lens": LENS, **changes})


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_used_is_named(case):
    changes, text = WRONG[case]
    with pytest.raises(ValueError, match=text):
        call(**changes)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"color": GOOD_COLOR.tolist()}, "color must be a NumPy array"),
        ({"color": GOOD_COLOR.astype(np.complex64)}, "color must have dtype"),
        ({"depth": GOOD_DEPTH.astype(np.int32)}, "depth must have dtype"),
        ({"lens": 3.0}, "lens"),
    ],
)
def test_what_is_of_the_wrong_type_is_named(changes, text):
    with pytest.raises(TypeError, match=text):
        call(**changes)


HUGE = [-1, 2**63, -(2**63) - 1, 10**400]


@pytest.mark.parametrize("value", HUGE)
@pytest.mark.parametrize("name", ["threads", "overscan", "supersample", "views", "taps"])
def test_whole_numbers_of_any_size_are_named(name, value):
    words = {"method": "poisson"} if name == "taps" else {}
    with pytest.raises(ValueError, match=rf"^{name} must be a whole number.*; got {str(value)[:60]}"):
        call(**{name: value}, **words)
    with pytest.raises(TypeError, match=f"^{name} must be a whole number"):
        call(**{name: "many"}, **words)


@pytest.mark.parametrize("value", [10**400, -(10**400)])
@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda v: LENS.replace(aperture_radius=v), "aperture_radius"),
        (lambda v: LENS.replace(focus_distance=v), "focus_distance"),
        (lambda v: LENS.replace(fov=v), "fov"),
        (lambda v: LENS.replace(tilt=(v, 0.0)), "tilt"),
        (lambda v: LENS.replace(cat_eye=v), "cat_eye"),
        (lambda v: LENS.replace(coma=v), "coma"),
        (lambda v: LENS.replace(barn_doors=(1.0, 1.0, v)), "barn_doors"),
        (lambda v: LENS.replace(lateral_color=(0.0, 0.0, v)), "lateral_color"),
        (lambda v: RELATIVE.replace(focus=v), "focus"),
        (lambda v: Aperture(rotation=v), "rotation"),
        (lambda v: Aperture(ratio=v), "ratio"),
        (lambda v: Lens.from_camera(focal_length_mm=v, f_number=2, focus_distance=3), "focal_length_mm"),
        (lambda v: Lens.from_colmap(fx=v, width=9, aperture_radius=0.1, focus_distance=1), "fx"),
        (lambda v: call(depth_kind="zbuffer", near=v, far=9.0), "near"),
        (lambda v: call(method="hexagonal", max_coc_px=v), "max_coc_px"),
        (lambda v: LENS.replace(in_focus=(v, v)), "in_focus"),
        (lambda v: LENS.coc_diameter_mm(v), "z"),
    ],
)
def test_numbers_that_are_no_double_are_named(make, name, value):
    with pytest.raises(ValueError, match=f"^{name} must"):
        make(value)


@pytest.mark.parametrize("value", [[1, 2], (1, 2, 3), 7, "ab", (1, "b")])
def test_pairs_are_named(value):
    with pytest.raises((TypeError, ValueError), match=r"^tilt must be a tuple of two numbers; got"):
        LENS.replace(tilt=value)
    with pytest.raises((TypeError, ValueError), match=r"^axial_color must be a tuple of three numbers; got"):
        LENS.replace(axial_color=[0, 0, 0])


@pytest.mark.parametrize("value", [2**63, 10**400, 2**62, -(2**70)])
def test_pixels_of_any_size_are_named(value):
    _, depth = scene()
    with pytest.raises((ValueError, IndexError), match=r"^x must"):
        LENS.focused_at(depth, value, 0)
    if value != 2**62:
        with pytest.raises(ValueError, match=r"^radius_px must be a whole number from 0"):
            LENS.focused_at(depth, 3, 3, radius_px=value)
    assert LENS.focused_at(depth, 3, 3, radius_px=2**63 - 1) == LENS.focused_at(depth, 3, 3, radius_px=99)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda v: LENS.replace(tilt=(v, 0.1)), "tilt"),
        (lambda v: LENS.replace(field_curvature=v), "field_curvature"),
        (lambda v: LENS.replace(principal_point=(v, v)), "principal_point"),
        (lambda v: RELATIVE.replace(focus=v), "focus"),
        (lambda v: Aperture(rotation=v, blades=5), "rotation"),
        (lambda v: Aperture(image=np.array([[1.0, v]])), "image"),
    ],
)
def test_a_negative_zero_is_a_zero(make, name):
    assert make(0.0) == make(-0.0)
    assert hash(make(0.0)) == hash(make(-0.0))


@pytest.mark.parametrize("radius", [0.0, 1e-300, 0.05, 1e300])
@pytest.mark.parametrize("distance", [1e-300, 1e-3, 2.0, 1e300, math.inf])
@pytest.mark.parametrize("fov", [1e-300, 40.0, 179.9999999999])
def test_a_notebook_can_show_every_lens(radius, distance, fov):
    lens = Lens(aperture_radius=radius, focus_distance=distance, fov=fov)
    assert repr(lens).replace("'", "&#x27;") in lens._repr_html_()


@pytest.mark.parametrize("values", [[[1e-300]], [[1e300, 1e-300]], [[0.0, 1e-30]]])
def test_a_notebook_can_show_every_opening(values):
    aperture = Aperture(image=np.array(values))
    assert aperture._repr_html_().startswith("<div><code>Aperture(")


def test_a_device_that_is_not_there_is_its_own_error():
    with pytest.raises(dofsim.DeviceError, match="gpu:99"):
        call(device="gpu:99")
    assert issubclass(dofsim.DeviceError, RuntimeError)


@pytest.mark.parametrize("value", [np.nan, -1.0, 0.0])
def test_invalid_far_is_infinity(value):
    np.testing.assert_array_equal(call(depth=bad_depth(value), invalid="far"), call(depth=bad_depth(np.inf)))


def test_every_kind_of_depth_gives_the_same_picture():
    z = GOOD_DEPTH.astype(np.float64)
    height, width = z.shape
    focal_px = 0.5 * width / math.tan(math.radians(LENS.fov / 2))
    x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    ray = np.sqrt(1.0 + (x / focal_px) ** 2 + (y / focal_px) ** 2)
    near, far = 0.5, 100.0
    expected = call()
    t = (1.0 / near - 1.0 / z) / (1.0 / near - 1.0 / far)
    kinds = [
        ("distance", z * ray, {}),
        ("inverse_z", 1.0 / z, {}),
        ("zbuffer", t, {"near": near, "far": far}),
        ("zbuffer", 1.0 - near / z, {"near": near, "far": math.inf}),
        ("zbuffer", 1.0 - t, {"near": far, "far": near}),
        ("zbuffer", near / z, {"near": math.inf, "far": near}),
        ("opengl_ndc", 2.0 * t - 1.0, {"near": near, "far": far}),
        ("distance_from_near", (z - near) * ray, {"near": near}),
    ]
    for kind, depth, planes in kinds:
        # Depth is rounded to float32 in another form: 1e-7 of a disparity, times a blur of a few pixels.
        out = call(depth=depth, depth_kind=kind, **planes)
        np.testing.assert_allclose(out, expected, atol=1e-4, err_msg=kind)
    k = LENS.aperture_radius * focal_px
    relative = Lens.from_disparity(strength_px=k, focus=1.0 / LENS.focus_distance)
    np.testing.assert_allclose(
        call(depth=1.0 / z, depth_kind="disparity", lens=relative), expected, atol=1e-4
    )


@pytest.mark.parametrize(
    "value",
    [
        LENS,
        LENS.replace(focus_distance=math.inf, fov_axis="diagonal"),
        RELATIVE,
        Aperture(),
        Aperture(blades=6, rotation=15.0),
        Aperture(blades=5, apodization=0.3),
    ],
)
def test_settings_are_values(value):
    for same in (eval(repr(value)), pickle.loads(pickle.dumps(value)), copy.deepcopy(value)):
        assert same == value
        assert hash(same) == hash(value)
    with pytest.raises(AttributeError):
        value.fov = value.blades = 1


def test_settings_that_differ_are_unequal():
    assert LENS.replace(fov=41.0) != LENS
    assert LENS != RELATIVE
    assert Aperture(blades=6) != Aperture(blades=6, rotation=1.0)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Lens(aperture_radius=-1.0, focus_distance=1.0, fov=40.0), "aperture_radius"),
        (lambda: Lens(aperture_radius=0.1, focus_distance=0.0, fov=40.0), "focus_distance"),
        (lambda: Lens(aperture_radius=0.1, focus_distance=1.0, fov=180.0), "fov"),
        (lambda: Lens(aperture_radius=0.1, focus_distance=1.0, fov=40.0, fov_axis="z"), 'fov_axis must.*"x"'),
        (lambda: Lens.from_camera(focal_length_mm=50, f_number=0, focus_distance=1), "f_number"),
        (lambda: Lens.from_disparity(strength_px=-1.0, focus=0.0), "strength_px"),
        (lambda: Lens.from_mitsuba({"type": "orthographic"}), "thinlens"),
        (lambda: Lens.from_mitsuba({"type": "thinlens", "fov": 40.0}), "aperture_radius"),
        (lambda: Lens.from_blender({"lens": 50.0, "fstop": 2.0}), "focus_distance"),
        (lambda: Aperture(blades=2), "blades must be 0 .*3 to 64; got 2"),
        (lambda: Aperture(rotation=math.nan), "rotation"),
        (lambda: Aperture(apodization=0.01), "apodization"),
    ],
)
def test_settings_out_of_range_are_named(make, text):
    with pytest.raises(ValueError, match=text):
        make()


def test_replace_changes_only_what_it_names():
    changed = LENS.replace(focus_distance=5.0)
    assert (changed.aperture_radius, changed.focus_distance, changed.fov) == (0.05, 5.0, 40.0)
    assert RELATIVE.replace(focus=0.5) == Lens.from_disparity(strength_px=5.0, focus=0.5)
    with pytest.raises(TypeError, match=r"strength_px.*aperture_radius"):
        LENS.replace(strength_px=1.0)


def test_focused_at_takes_the_depth_of_the_pixel():
    assert LENS.focused_at(GOOD_DEPTH, 31, 23).focus_distance == pytest.approx(1.5)
    assert LENS.focused_at(GOOD_DEPTH, 31, 0).focus_distance == pytest.approx(4.0)
    assert LENS.focused_at(GOOD_DEPTH, -1, -1) == LENS.focused_at(GOOD_DEPTH, 31, 23)
    with pytest.raises(IndexError, match="x must lie within 32"):
        LENS.focused_at(GOOD_DEPTH, 32, 0)
    with pytest.raises(ValueError, match="depth"):
        LENS.focused_at(bad_depth(np.nan), 5, 3)


def test_camera_has_the_textbook_circle_of_confusion():
    f, n, u, sensor, width = 0.05, 1.8, 3.0, 0.036, 1920
    lens = Lens.from_camera(focal_length_mm=50, f_number=n, focus_distance=u, sensor_width_mm=36)
    z = np.broadcast_to([[0.7], [2.9], [3.0], [10.0]], (4, width)).astype(np.float64)
    diameter = (f / n) * f * (z - u) / (z * (u - f))
    np.testing.assert_allclose(dofsim.coc(z, lens), 0.5 * diameter / sensor * width, atol=1e-4)


def test_mitsuba_sensor():
    words = {"type": "thinlens", "aperture_radius": 0.08, "focus_distance": 4.0, "fov": 42.0, "fov_axis": "y"}
    expected = Lens(aperture_radius=0.08, focus_distance=4.0, fov=42.0, fov_axis="y")
    assert Lens.from_mitsuba(words) == expected
    assert Lens.from_mitsuba({"type": "perspective", "fov": 42.0}).aperture_radius == 0.0
    # Full frame: 2 atan(43.27 mm / 2 / 50 mm).
    film = Lens.from_mitsuba({**words, "focal_length": "50mm"})
    assert (film.fov_axis, film.fov) == ("diagonal", pytest.approx(46.793, abs=1e-3))


def test_loaded_mitsuba_sensor():
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    sensor = mi.load_dict({"type": "thinlens", "aperture_radius": 0.08, "focus_distance": 4.0, "fov": 42.0})
    lens = Lens.from_mitsuba(sensor)
    assert (lens.aperture_radius, lens.focus_distance, lens.fov) == pytest.approx((0.08, 4.0, 42.0))


def test_blender_camera():
    words = {"lens": 50.0, "fstop": 2.5, "focus_distance": 4.0}
    lens = Lens.from_blender(words)
    assert (lens.aperture_radius, lens.focus_distance, lens.fov_axis) == (0.01, 4.0, "larger")
    assert lens.fov == pytest.approx(math.degrees(2 * math.atan(18 / 50)))
    upright = Lens.from_blender({**words, "sensor_fit": "VERTICAL", "sensor_height": 20.0})
    assert (upright.fov_axis, upright.fov) == ("y", pytest.approx(math.degrees(2 * math.atan(10 / 50))))


def test_what_completion_shows_is_public_and_can_be_used():
    names = dir(dofsim)
    assert "FocusPicker" in names
    assert [name for name in names if name.startswith("_") and name != "__version__"] == []
    modules = {"batch", "cameras", "io", "metrics", "photo", "presets"}
    assert set(names) == {*dofsim.__all__, "FocusPicker", *modules}


def test_modules_need_no_import_of_their_own():
    modules = ["batch", "cameras", "io", "metrics", "photo", "plot", "presets"]
    code = f"import dofsim; print([getattr(dofsim, name).__name__ for name in {modules}])"
    found = subprocess.check_output([sys.executable, "-c", code], text=True)
    assert found.strip() == str([f"dofsim.{name}" for name in modules])


def test_sizes_are_told_as_they_were_given():
    color, depth = np.ones((24, 32, 3), np.float32), np.ones((24, 31), np.float32)
    with pytest.raises(ValueError, match=r"shape is \(24, 32, 3\); got shape \(24, 31\)"):
        dofsim.render(color, depth, Lens(aperture_radius=0.1, focus_distance=1.0, fov=40.0))
    assert (
        repr(dofsim.Scene(color, depth[:, :1] * np.ones(32)))
        == "<dofsim.Scene of 32 x 24 pixels, 3 channels>"
    )


@pytest.mark.parametrize("function", [Lens, Lens.from_disparity, Lens.from_camera, Aperture, dofsim.render])
def test_signatures_show_their_defaults(function):
    parameters = inspect.signature(function).parameters.values()
    assert [one.name for one in parameters if one.default is Ellipsis] == []


def test_the_defaults_of_a_lens_are_those_it_has():
    lens = Lens(aperture_radius=0.1, focus_distance=1.0, fov=40.0)
    for name, parameter in inspect.signature(Lens).parameters.items():
        if parameter.default not in (inspect.Parameter.empty, None):
            assert getattr(lens, name) == parameter.default
