"""Lenses of cameras and of other programs, and what they are asked in millimetres."""

import json
import pickle
import time

import dofsim
import numpy as np
import pytest

THIN = {"aperture_radius": 0.05, "focus_distance": 3.0, "fov": 42.0}


def camera(**words):
    return dofsim.Lens.from_camera(**{"focal_length_mm": 50, "f_number": 8, "focus_distance": 5.0, **words})


# Limits of sharpness, with a circle of confusion of 0.03 mm


def test_the_hyperfocal_distance_of_the_usual_example():
    # The worked example of Wikipedia's article "Hyperfocal distance": 50 mm at f/8 is 10 467 mm.
    assert camera().hyperfocal_distance(0.03) == pytest.approx(10.467, abs=5e-4)
    focused = camera(focus_distance=camera().hyperfocal_distance(0.03))
    near, far = focused.depth_of_field(0.03)
    assert near == pytest.approx(0.5 * 10.467, abs=5e-4)
    assert far > 1e9


@pytest.mark.parametrize(
    ("f_mm", "n", "limit_mm", "metres"),
    [
        # Wikipedia, "Hyperfocal distance": 50 mm, f/8, 0.03 mm.
        (50.0, 8.0, 0.03, 10.467),
        # US Army correspondence course SS0507: 2 in, f/8, 0.002 in, 20.8 ft.
        (50.8, 8.0, 0.0508, 20.8 * 0.3048),
        # M. Sedlacek, "Setting Hyperfocal Distances": 50 mm, f/8, 0.033 mm.
        (50.0, 8.0, 0.033, 9.47),
    ],
)
def test_hyperfocal_distances_are_those_in_print(f_mm, n, limit_mm, metres):
    # Two of the three leave out the focal length that is to be added.
    lens = camera(focal_length_mm=f_mm, f_number=n)
    assert lens.hyperfocal_distance(limit_mm) == pytest.approx(metres, abs=0.065)


@pytest.mark.parametrize("f_mm", [24.0, 50.0, 135.0])
@pytest.mark.parametrize("n", [1.8, 8.0])
@pytest.mark.parametrize("u", [0.8, 5.0, 60.0])
def test_limits_are_the_closed_forms(f_mm, n, u):
    lens = camera(focal_length_mm=f_mm, f_number=n, focus_distance=u)
    f, c = f_mm * 1e-3, 0.03e-3
    near, far = lens.depth_of_field(0.03)
    assert near == pytest.approx(u * f**2 / (f**2 + n * c * (u - f)))
    rest = f**2 - n * c * (u - f)
    assert far == (pytest.approx(u * f**2 / rest) if rest > 0.0 else float("inf"))
    assert lens.hyperfocal_distance(0.03) == pytest.approx(f**2 / (n * c) + f)
    for z in (0.5, 3.0, 1000.0):
        assert lens.coc_diameter_mm(z) == pytest.approx(1e3 * (f / n) * f * abs(u - z) / (z * (u - f)))
    assert (lens.focal_length_mm, lens.f_number) == (pytest.approx(f_mm), pytest.approx(n))


def test_what_is_asked_in_millimetres_is_what_is_drawn():
    lens = camera(f_number=1.8, focus_distance=2.0, sensor="aps-c")
    width_mm, _ = dofsim.SENSORS["aps-c"]
    radius_px = float(dofsim.coc(np.full((200, 300), 3.0), lens)[0, 0])
    assert lens.coc_diameter_mm(3.0) == pytest.approx(2.0 * radius_px * width_mm / 300, rel=1e-6)


def test_sensors_go_by_name():
    assert dofsim.SENSORS["full frame"] == (36.0, 24.0)
    assert camera(sensor="full frame") == camera(sensor_width_mm=36.0) == camera()
    for name, (width, height) in dofsim.SENSORS.items():
        assert camera(sensor=name).sensor_mm == width > height
    with pytest.raises(ValueError, match=r"sensor must be one of .*full frame"):
        camera(sensor="half frame")
    with pytest.raises(TypeError, match="one of sensor_width_mm and sensor"):
        camera(sensor="aps-c", sensor_width_mm=20.0)


def test_lenses_without_a_sensor_say_what_they_lack():
    for lens in (dofsim.Lens(**THIN), dofsim.Lens.from_disparity(strength_px=1.0, focus=0.0)):
        assert lens.focal_length_mm is None
        with pytest.raises(ValueError, match="depth_of_field needs a lens whose sensor is known"):
            lens.depth_of_field(0.03)
    assert dofsim.Lens(**THIN, sensor_mm=36.0).depth_of_field(0.03)[0] < 3.0


# Other programs' cameras

XML = """<scene version="3.0.0">
    <default name="radius" value="0.04"/>
    <sensor type="thinlens">
        <float name="aperture_radius" value="$radius"/>
        <float name="focus_distance" value="2.5"/>
        <float name="fov" value="35"/>
        <string name="fov_axis" value="y"/>
        <transform name="to_world"><lookat origin="0,0,0" target="0,0,1" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="64"/></film>
    </sensor>
</scene>"""


def test_mitsubas_scene_files(tmp_path):
    path = tmp_path / "scene.xml"
    path.write_text(XML)
    expected = dofsim.Lens(aperture_radius=0.04, focus_distance=2.5, fov=35.0, fov_axis="y")
    assert dofsim.Lens.from_mitsuba(path) == expected
    assert dofsim.Lens.from_mitsuba(str(path)) == expected
    for text, match in [
        (XML.replace('<default name="radius" value="0.04"/>', ""), r"\$radius has no default"),
        ('<scene version="3.0.0"/>', "one sensor is needed; there are 0"),
        ("no XML", "no XML file"),
        (XML.replace("focus_distance", "distance"), 'the thinlens sensor has no "focus_distance"'),
        (XML.replace('value="0.04"', 'value="-1"'), "aperture_radius must be"),
    ]:
        path.write_text(text)
        with pytest.raises(ValueError, match=rf"scene\.xml: (the parameter )?{match}"):
            dofsim.Lens.from_mitsuba(path)
    with pytest.raises(FileNotFoundError):
        dofsim.Lens.from_mitsuba(tmp_path / "missing.xml")


def scene_file(path, radius, /, **defaults):
    """Write a scene file whose lens has this radius, and these parameters before it."""
    given = "".join(f'<default name="{name}" value="{value}"/>' for name, value in defaults.items())
    text = XML.replace('<default name="radius" value="0.04"/>', given)
    path.write_text(text.replace('value="$radius"', f'value="{radius}"'))
    return path


def test_mitsubas_parameters_are_filled_in_by_their_whole_names(tmp_path):
    path = scene_file(tmp_path / "scene.xml", "$a1", a="2", a1="0.08")
    assert dofsim.Lens.from_mitsuba(path).aperture_radius == 0.08
    path = scene_file(tmp_path / "scene.xml", "$radius", small="0.5", radius="$small")
    assert dofsim.Lens.from_mitsuba(path).aperture_radius == 0.5
    path = scene_file(tmp_path / "scene.xml", "$early$early", later="1")
    with pytest.raises(ValueError, match=r"the parameter \$early has no default"):
        dofsim.Lens.from_mitsuba(path)
    doubled = {f"a{i}": 2 * f"$a{i - 1}" for i in range(1, 41)}
    path = scene_file(tmp_path / "scene.xml", "$a40", a0="9", **doubled)
    with pytest.raises(ValueError, match="a value is longer than 4096 characters"):
        dofsim.Lens.from_mitsuba(path)


def test_a_scene_file_of_many_parameters_takes_time_by_its_length(tmp_path):
    # The last one is what the first one is.
    chain = {f"p{i}": f"$p{i - 1}" for i in range(1, 2000)}
    path = scene_file(tmp_path / "scene.xml", "$p1999", p0="0.08", **chain)
    start = time.process_time()
    assert dofsim.Lens.from_mitsuba(path).aperture_radius == 0.08
    # Some hundredths of a second; it was half a minute when all names were looked for in each value.
    assert time.process_time() - start < 5


@pytest.mark.parametrize(
    ("words", "error", "match"),
    [
        (
            {"type": "thinlens", "focus_distance": 1.0},
            ValueError,
            'the thinlens sensor has no "aperture_radius"',
        ),
        ({"type": "perspective"}, ValueError, 'the sensor has no "fov"'),
        (
            {"type": "irradiancemeter"},
            ValueError,
            'of type "thinlens" or "perspective"; got "irradiancemeter"',
        ),
        ({"type": "perspective", "fov": "40"}, TypeError, "fov must be a number; got '40'"),
        ({"type": "perspective", "focal_length": "5_0mm"}, ValueError, 'like "50mm"; got "5_0mm"'),
        (
            {"type": "perspective", "fov": 40, "fov_axis": 3},
            TypeError,
            "'int' object is not an instance of 'str'",
        ),
        (
            {"type": "perspective", "fov": 40, "fov_axis": "w"},
            ValueError,
            'fov_axis must be one of .*; got "w"',
        ),
    ],
)
def test_sensors_that_are_none_are_refused_by_name(words, error, match):
    with pytest.raises(error, match=match):
        dofsim.Lens.from_mitsuba(words)


def test_mitsubas_focal_lengths_are_those_of_film():
    lens = dofsim.Lens.from_mitsuba({"type": "perspective", "focal_length": "50mm"})
    assert (lens.fov_axis, lens.aperture_radius) == ("diagonal", 0.0)
    assert lens.fov == pytest.approx(np.degrees(2.0 * np.arctan(0.5 * np.hypot(36.0, 24.0) / 50.0)))


@pytest.mark.parametrize("offset", [(0.1, 0.0), (0.0, -0.15), (-0.05, 0.1)])
def test_mitsubas_principal_point_is_where_the_axis_meets_the_picture(offset):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    x, y = offset
    words = {
        "type": "perspective",
        "fov": 50.0,
        "principal_point_offset_x": x,
        "principal_point_offset_y": y,
    }
    film = {"type": "hdrfilm", "width": 100, "height": 80, "rfilter": {"type": "box"}}
    sensor = mi.load_dict({**words, "film": film})
    ball = {"type": "sphere", "center": [0, 0, 4], "radius": 0.1, "emitter": {"type": "area"}}
    scene = mi.load_dict({"type": "scene", "integrator": {"type": "path", "max_depth": 1}, "ball": ball})
    picture = np.array(mi.render(scene, sensor=sensor, spp=8))[..., 0]
    rows, columns = np.mgrid[:80, :100] + 0.5
    seen = np.array([(picture * columns).sum() / 100, (picture * rows).sum() / 80]) / picture.sum() - 0.5
    for lens in (dofsim.Lens.from_mitsuba(words), dofsim.Lens.from_mitsuba(sensor)):
        assert lens.principal_point == pytest.approx(seen, abs=2e-3)


def test_blenders_cameras(tmp_path):
    words = {
        "lens": 85.0,
        "aperture_fstop": 2.0,
        "focus_distance": 3.0,
        "sensor_width": 36.0,
        "aperture_blades": 5,
        "aperture_rotation": 0.2,
        "aperture_ratio": 0.5,
    }
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(words))
    lens, aperture = dofsim.Lens.from_blender(path), dofsim.Aperture.from_blender(path)
    assert (lens, aperture) == (dofsim.Lens.from_blender(words), dofsim.Aperture.from_blender(words))
    # Its width is the diameter over the ratio, and the longer half-axis is the radius.
    assert lens.aperture_radius == pytest.approx(85e-3 / (2 * 2.0) / 0.5)
    assert lens.sensor_mm == 36.0
    assert (aperture.blades, aperture.ratio) == (5, 0.5)
    assert aperture.rotation == pytest.approx(np.degrees(0.2) + 36.0)
    for text, match in [
        ("[1]", "camera must be a"),
        ("{}", "the camera has no"),
        ('{"lens": "x"}', "lens must"),
    ]:
        path.write_text(text)
        with pytest.raises(ValueError, match=rf"camera\.json: {match}"):
            dofsim.Lens.from_blender(path)
    path.write_text('{"aperture_blades": 1e9}')
    with pytest.raises(ValueError, match=r"camera\.json: blades must be"):
        dofsim.Aperture.from_blender(path)
    with pytest.raises(ValueError, match="shift_x must be 0"):
        dofsim.Lens.from_blender({**words, "shift_x": 0.1})
    with pytest.raises(TypeError, match="camera must be a dictionary or the path"):
        dofsim.Lens.from_blender(3)
    with pytest.raises(ValueError, match='the camera has no "lens"'):
        dofsim.Lens.from_blender({"fstop": 2.0, "focus_distance": 3.0})
    with pytest.raises(ValueError, match="lens and fstop must be greater than 0; got 85 and 0"):
        dofsim.Lens.from_blender({**words, "aperture_fstop": 0.0})
    with pytest.raises(ValueError, match=r'sensor_fit must be one of "AUTO", .*; got "WIDE"'):
        dofsim.Lens.from_blender({**words, "sensor_fit": "WIDE"})


def test_intrinsics_of_colmap():
    words = {"fx": 500.0, "width": 1000, "aperture_radius": 0.02, "focus_distance": 2.0}
    assert dofsim.Lens.from_colmap(**words).fov == pytest.approx(90.0)
    off = dofsim.Lens.from_colmap(**words, cx=480.0, cy=310.0, height=600)
    assert off.principal_point == pytest.approx((-0.02, 310 / 600 - 0.5))
    # The axis is where rays are as long as their depth.
    near = dofsim.Lens.from_colmap(**{**words, "focus_distance": 1.0}, cx=480.5, cy=310.5, height=600)
    depth = np.full((600, 1000), 1.5)
    radius = np.abs(dofsim.coc(depth, near, depth_kind="distance"))
    assert np.unravel_index(radius.argmax(), radius.shape) == (310, 480)
    with pytest.raises(ValueError, match="cy needs the height"):
        dofsim.Lens.from_colmap(**words, cy=310.0)
    with pytest.raises(ValueError, match="fx must be"):
        dofsim.Lens.from_colmap(**{**words, "fx": 0.0})


# Relative disparity


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (37.0, 500.0), (1e-4, -2.0)])
def test_relative_disparity_of_any_scale_gives_the_same_picture(scale, offset):
    rng = np.random.default_rng(15)
    color = rng.random((60, 80, 3), dtype=np.float32)
    disparity = np.kron(rng.random((6, 8)), np.ones((10, 10)))
    lens = dofsim.Lens.from_disparity(strength_px=10.0, focus=1.0)
    raw = (scale * disparity + offset).astype(np.float64)
    radius = dofsim.coc(raw, lens, depth_kind="relative")
    low, high = np.quantile(disparity, [0.01, 0.99], method="lower")
    np.testing.assert_allclose(radius, 10.0 * (1.0 - (disparity - low) / (high - low)), atol=0.01)
    out = dofsim.render(color, raw, lens, depth_kind="relative")
    same = dofsim.render(color, (disparity - low) / (high - low), lens, depth_kind="disparity")
    assert np.sqrt(np.mean((out - same) ** 2)) < 0.01


def test_strength_in_per_cent_is_of_the_width():
    disparity = np.zeros((30, 200))
    percent = dofsim.Lens.from_disparity(strength_percent=4.0, focus=1.0)
    assert percent.strength_percent == 4.0
    assert dofsim.coc(disparity, percent, depth_kind="disparity")[0, 0] == pytest.approx(8.0)
    with pytest.raises(TypeError, match="one of strength_px and strength_percent"):
        dofsim.Lens.from_disparity(strength_px=1.0, strength_percent=1.0, focus=0.0)
    with pytest.raises(ValueError, match="strength_percent"):
        dofsim.Lens.from_disparity(strength_percent=-1.0, focus=0.0)


def test_relative_disparity_is_of_one_picture_and_one_kind_of_lens():
    with pytest.raises(ValueError, match="is relative and needs a lens made by"):
        dofsim.coc(np.ones((4, 4)), dofsim.Lens(**THIN), depth_kind="relative")
    layers = np.ones((2, 8, 8, 4), np.float32), np.ones((2, 8, 8))
    with pytest.raises(ValueError, match="cannot be used with layers"):
        dofsim.render(*layers, dofsim.Lens.from_disparity(strength_px=1.0, focus=0.0), depth_kind="relative")


# Lenses are values

LENSES = [
    dofsim.Lens(**THIN, tilt=(10.0, -5.0), field_curvature=0.1, principal_point=(0.1, 0.0)),
    dofsim.Lens(**THIN, axial_color=(0.1, 0.0, -0.1), lateral_color=(0.001, 0.0, -0.001)),
    dofsim.Lens(**THIN, cat_eye=0.5, vignetting="full"),
    camera(breathing=True),
    dofsim.Lens(**THIN, coma=0.01, astigmatism=-0.02, barn_doors=(1.0, 0.5, 0.3)),
    dofsim.Lens.from_disparity(strength_percent=3.0, focus=0.2, cat_eye=0.3),
]


@pytest.mark.parametrize("lens", LENSES)
def test_lenses_can_be_kept_compared_and_read(lens):
    assert pickle.loads(pickle.dumps(lens)) == lens
    assert eval(repr(lens), {"Lens": dofsim.Lens}) == lens
    assert hash(lens.replace(cat_eye=lens.cat_eye)) == hash(lens)
    assert lens.replace(cat_eye=0.9) != lens


@pytest.mark.parametrize(
    ("words", "match"),
    [
        ({"tilt": (0.0, 95.0)}, "tilt"),
        ({"focus_distance": float("inf"), "tilt": (1.0, 0.0)}, "tilt"),
        ({"cat_eye": 2.0}, "cat_eye"),
        ({"vignetting": "optical"}, "vignetting"),
        ({"vignetting": "some"}, "vignetting"),
        ({"lateral_color": (0.0, 0.0, 0.5)}, "lateral_color"),
        ({"axial_color": (0.0, 0.0, float("nan"))}, "axial_color"),
        ({"field_curvature": float("inf")}, "field_curvature"),
        ({"sensor_mm": -1.0}, "sensor_mm"),
        ({"breathing_focal_length_mm": 50.0}, "sensor_mm"),
        ({"principal_point": (100.0, 0.0)}, "principal_point"),
    ],
)
def test_bad_lenses_are_refused_by_name(words, match):
    with pytest.raises(ValueError, match=match):
        dofsim.Lens(**{**THIN, **words})
