"""Cameras of other programs: what each says of the same two cameras."""

import json

import dofsim
import numpy as np
import pytest
from dofsim.cameras import Camera, read_cameras, write_cameras

WIDTH, HEIGHT, FOCAL = 640, 480, 500.0
INTRINSICS = np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1]])
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def turned(axis, degrees):
    axis = np.array(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def quaternion(axis, degrees):
    """Give w, x, y, z."""
    axis = np.array(axis, float) / np.linalg.norm(axis)
    half = np.radians(0.5 * degrees)
    return [np.cos(half), *(np.sin(half) * axis)]


AXIS, ANGLE, PLACE = (0.2, 1.0, -0.3), 25.0, (1.0, -2.0, 3.0)
POSE = np.eye(4)
POSE[:3, :3], POSE[:3, 3] = turned(AXIS, ANGLE), PLACE
CAMERAS = [
    Camera(POSE, INTRINSICS, (WIDTH, HEIGHT), "a.png"),
    Camera(np.eye(4), INTRINSICS, (WIDTH, HEIGHT), "b.png"),
]


def same(found, expected=CAMERAS):
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.pose, other.pose, atol=1e-6)
        np.testing.assert_allclose(one.intrinsics, other.intrinsics, rtol=1e-9)
        assert (one.size, one.name) == (other.size, other.name)


def test_our_own_file_there_and_back(tmp_path):
    write_cameras(tmp_path / "cameras.json", CAMERAS)
    same(read_cameras(tmp_path / "cameras.json"))
    # What is the same for all stands once, and other axes are said.
    words = {
        "axes": "opengl",
        "width": WIDTH,
        "height": HEIGHT,
        "intrinsics": INTRINSICS.tolist(),
        "cameras": [{"name": one.name, "pose": (one.pose @ OPENGL).tolist()} for one in CAMERAS],
    }
    (tmp_path / "other.json").write_text(json.dumps(words))
    same(read_cameras(tmp_path / "other.json"))


def test_colmap(tmp_path):
    (tmp_path / "cameras.txt").write_text(
        f"# comment\n1 SIMPLE_PINHOLE {WIDTH} {HEIGHT} {FOCAL} 320 240\n"
        f"2 PINHOLE {WIDTH} {HEIGHT} {FOCAL} {FOCAL} 320 240\n"
    )
    # COLMAP's poses are from world to camera.
    w, x, y, z = quaternion(AXIS, -ANGLE)
    shift = -turned(AXIS, ANGLE).T @ PLACE
    (tmp_path / "images.txt").write_text(
        "# comment\n1 1 0 0 0 0 0 0 2 b.png\n\n"
        f"7 {w} {x} {y} {z} {shift[0]} {shift[1]} {shift[2]} 1 a.png\n10 20 -1 30 40 5\n"
    )
    same(read_cameras(tmp_path))
    same(read_cameras(tmp_path / "images.txt"))


def test_nerfstudio(tmp_path):
    frames = [{"file_path": one.name, "transform_matrix": (one.pose @ OPENGL).tolist()} for one in CAMERAS]
    shared = {"w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL, "cx": 320, "cy": 240}
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({**shared, "frames": frames}))
    same(read_cameras(path))
    angle = 2.0 * np.arctan(0.5 * WIDTH / FOCAL)
    path.write_text(json.dumps({"w": WIDTH, "h": HEIGHT, "camera_angle_x": angle, "frames": frames}))
    same(read_cameras(path))
    path.write_text(json.dumps({**shared, "k1": 0.1, "frames": frames}))
    with pytest.raises(ValueError, match="is distorted"):
        read_cameras(path)


def test_hypersim(tmp_path):
    h5py = pytest.importorskip("h5py")
    folder = tmp_path / "_detail" / "cam_00"
    folder.mkdir(parents=True)
    (tmp_path / "_detail" / "metadata_scene.csv").write_text(
        "parameter_name,parameter_value\nmeters_per_asset_unit,0.5\n"
    )
    for name, values in {
        "positions": [np.multiply(PLACE, 2.0), [0, 0, 0]],
        "orientations": [(POSE @ OPENGL)[:3, :3], OPENGL[:3, :3]],
        "frame_indices": [0, 7],
    }.items():
        with h5py.File(folder / f"camera_keyframe_{name}.hdf5", "w") as file:
            file["dataset"] = np.array(values)
    found = read_cameras(folder)
    np.testing.assert_allclose(found[0].pose, POSE, atol=1e-9)
    np.testing.assert_allclose(found[1].pose, np.eye(4), atol=1e-9)
    assert [one.name for one in found] == ["frame.0000", "frame.0007"]
    # The data set's own focal length, for its pictures of 1024 x 768.
    assert found[0].intrinsics[0, 0] == pytest.approx(886.81, abs=0.01)


def test_tartanair(tmp_path):
    # A camera that looks north stands 1 m to the east, and then one that looks east.
    path = tmp_path / "pose_left.txt"
    w, x, y, z = quaternion((0, 0, 1), 90.0)
    path.write_text(f"0 1 0 0 0 0 1\n0 0 0 {x} {y} {z} {w}\n")
    north, east = read_cameras(path)
    assert north.size == (640, 480)
    assert north.intrinsics[0, 0] == pytest.approx(320.0)
    np.testing.assert_allclose(north.pose[:3, 3], [0, 1, 0])
    np.testing.assert_allclose(north.pose[:3, :3] @ [0, 0, 1], [1, 0, 0])
    np.testing.assert_allclose(north.pose[:3, :3] @ [1, 0, 0], [0, 1, 0])
    np.testing.assert_allclose(east.pose[:3, :3] @ [0, 0, 1], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(east.pose[:3, :3] @ [0, 1, 0], [0, 0, 1], atol=1e-12)


def test_blender():
    words = {"lens": 36.0 * FOCAL / WIDTH, "sensor_width": 36.0, "fstop": 2.0, "focus_distance": 3.0}
    scaled = POSE @ OPENGL @ np.diag([2.0, 2.0, 2.0, 1.0])
    camera = Camera.from_blender(scaled, words, WIDTH, HEIGHT)
    np.testing.assert_allclose(camera.pose, POSE, atol=1e-12)
    np.testing.assert_allclose(camera.intrinsics, INTRINSICS)
    # The lens has the same field of view.
    lens = dofsim.Lens.from_blender(words)
    assert camera.lens(aperture_radius=0.01, focus_distance=3.0).fov == pytest.approx(lens.fov)
    shifted = Camera.from_blender(scaled, {**words, "shift_x": 0.1, "shift_y": 0.1}, WIDTH, HEIGHT)
    np.testing.assert_allclose(shifted.intrinsics[:2, 2], [319.5 - 64.0, 239.5 + 64.0])


def test_mitsuba():
    mi = pytest.importorskip("mitsuba")
    from dofsim.mitsuba import set_variant

    set_variant("scalar_rgb")
    # Looks along +z; Mitsuba's pictures then run towards -x.
    film = {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT}
    to_world = mi.ScalarTransform4f().translate([1, 2, 3])
    camera = {
        "type": "perspective",
        "fov": 2 * np.degrees(np.arctan(0.5 * WIDTH / FOCAL)),
        "to_world": to_world,
        "film": film,
    }
    camera["principal_point_offset_x"] = 0.1
    found = Camera.from_mitsuba({"type": "scene", "camera": camera})
    np.testing.assert_allclose(found.pose, [[-1, 0, 0, 1], [0, -1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    np.testing.assert_allclose(found.intrinsics, INTRINSICS - [[0, 0, 64], [0, 0, 0], [0, 0, 0]], rtol=1e-6)


def test_a_camera_moves_along_its_own_axes():
    right = CAMERAS[0].moved(right=0.25)
    np.testing.assert_allclose(right.pose[:3, 3], np.array(PLACE) + 0.25 * POSE[:3, 0])
    np.testing.assert_array_equal(right.pose[:3, :3], POSE[:3, :3])


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", "{}", '"cameras", or "frames"'),
        ("a.json", "[", "not a JSON file"),
        ("a.json", '{"cameras": 3}', "'cameras' must be a list"),
        ("a.json", '{"cameras": [{}]}', "camera 0 needs 'pose'"),
        ("a.json", '{"axes": "blender", "cameras": [{}]}', '"axes" must be "opencv" or "opengl"'),
        ("a.json", '{"frames": [{"w": 3, "h": 2}]}', "frame 0 needs the number 'camera_angle_x'"),
        ("pose_left.txt", "0 0 0 0 0 0 1\n0 0 1", "line 2: 7 numbers are needed"),
        ("pose_left.txt", "0 0 0 0 0 0 0", "quaternion must not be 0"),
        ("cameras.txt", "1 OPENCV 4 4 1 1 1 1 0 0 0 0", "line 1: a camera must be without distortion"),
    ],
)
def test_one_clear_line_for_what_cannot_be_read(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_text(text)
    if name == "cameras.txt":
        (tmp_path / "images.txt").write_text("")
        path = tmp_path
    with pytest.raises(ValueError, match=message) as error:
        read_cameras(path)
    assert "\n" not in str(error.value)
