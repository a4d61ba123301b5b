"""Cameras of Mitsuba, Blender, COLMAP, nerfstudio, Hypersim, TartanAir and JSON: where they stand.

`dofsim.layers_from_views` takes their poses and intrinsics.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from csv import DictReader
from dataclasses import dataclass, replace
from math import pi, radians, tan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _cameras, _dofsim
from ._datasets import read_hdf5
from ._dofsim import Lens
from ._files import StrPath, read_text
from ._names import shortened

__all__ = ["Camera", "read_cameras", "write_cameras"]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)


# From the axes of OpenGL and Blender (x right, y up, z backward) to those of OpenCV.
_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
# From those of an aircraft (x forward, y right, z down).
_FROM_AIRCRAFT = np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera: where it stands, and what it sees.

    Attributes
    ----------
    pose : ndarray of float64
        From camera to world, shape (4, 4), with OpenCV's axes: x to the right, y down, z forward.
    intrinsics : ndarray of float64
        ``[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]`` in pixels, for pixel centres at whole numbers.
    size : tuple of int
        Width and height of the picture in pixels.
    name : str
        Of the picture, if the file says it.

    Examples
    --------
    >>> import numpy as np
    >>> from dofsim import Camera
    >>> camera = Camera(np.eye(4), [[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], (640, 480))
    >>> camera.moved(right=0.1).pose[:3, 3]
    array([0.1, 0. , 0. ])
    >>> round(camera.lens(aperture_radius=0.02, focus_distance=3.0).fov, 2)
    65.24
    """

    pose: NDArray[np.float64]
    intrinsics: NDArray[np.float64]
    size: tuple[int, int]
    name: str = ""

    def __post_init__(self) -> None:
        """Check shapes."""
        for name, shape in (("pose", (4, 4)), ("intrinsics", (3, 3))):
            value = np.array(getattr(self, name), np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise ValueError(
                    f"{name} must be finite, of shape {shape}; got {shortened(repr(value.tolist()))}"
                )
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        if len(self.size) != 2 or min(self.size) < 1:
            raise ValueError(f"size must be a width and a height in pixels; got {self.size}")

    def moved(self, *, right: float = 0.0, down: float = 0.0, forward: float = 0.0) -> Camera:
        """Return the same camera so many metres away: the other one of a stereo pair, a point of the lens."""
        pose = self.pose.copy()
        pose[:3, 3] += pose[:3, :3] @ [right, down, forward]
        return replace(self, pose=pose)

    def lens(self, *, aperture_radius: float, focus_distance: float) -> Lens:
        """Return a lens with this camera's field of view.

        Raises
        ------
        ValueError
            If its pixels are not square.
        """
        (fx, skew, cx), (_, fy, cy), _ = self.intrinsics.tolist()
        if abs(fx - fy) > 1e-3 * fx or abs(skew) > 1e-3 * fx:
            raise ValueError(f"a lens needs square pixels; fx is {fx}, fy {fy} and skew {skew}")
        width, height = self.size
        return Lens.from_colmap(
            fx=fx,
            width=width,
            height=height,
            cx=cx + 0.5,
            cy=cy + 0.5,
            aperture_radius=aperture_radius,
            focus_distance=focus_distance,
        )

    @classmethod
    def from_mitsuba(cls, scene: Any, sensor: int = 0) -> Camera:
        """Return the camera of a sensor of a Mitsuba scene.

        Parameters
        ----------
        scene : mitsuba.Scene, dict or path
            The scene.
        sensor : int, optional
            Which of its sensors: a ``thinlens`` or a ``perspective`` one.

        Raises
        ------
        ValueError
            If there is no such sensor, or it has no field of view.
        """
        from .mitsuba._variant import check_variant
        from .mitsuba._view import View, load_scene

        check_variant()
        view = View.of(load_scene(scene), sensor)
        return cls(view.pose(), view.intrinsics(), view.size)

    @classmethod
    def from_blender(
        cls, matrix_world: ArrayLike, camera: dict[str, Any] | StrPath, width: int, height: int
    ) -> Camera:
        """Return the camera of a Blender object.

        Parameters
        ----------
        matrix_world : array_like
            The object's own, shape (4, 4).
        camera : dict or path
            ``lens`` (mm), and optionally ``sensor_width``, ``sensor_height``, ``sensor_fit``, ``shift_x`` and
            ``shift_y``, as `Lens.from_blender` has them.
        width, height : int
            Size of the picture, of square pixels.

        Raises
        ------
        ValueError
            If an entry is missing.
        """
        words = _cameras.blender_view(camera)
        fit = words["sensor_fit"]
        side = {"HORIZONTAL": width, "VERTICAL": height}.get(fit, max(width, height))
        focal_px = side * words["lens_mm"] / words["sensor_mm"]
        cx = 0.5 * (width - 1) - side * words["shift_x"]
        cy = 0.5 * (height - 1) + side * words["shift_y"]
        pose = np.array(matrix_world, np.float64) @ _FROM_OPENGL
        # An object may be scaled, which a camera does not see.
        pose[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
        return cls(pose, _matrix(focal_px, focal_px, cx, cy), (width, height))


def read_cameras(path: StrPath, *, size: tuple[int, int] | None = None) -> list[Camera]:
    """Return the cameras that a file or a folder describes.

    Parameters
    ----------
    path : path
        What it is, its name says:

        - a folder of COLMAP, with ``images.txt`` and ``cameras.txt``, or ``images.txt``;
        - ``transforms.json`` of nerfstudio and instant-ngp, or another JSON file with ``frames``;
        - a folder of Hypersim, ``_detail/cam_00``, with ``camera_keyframe_positions.hdf5``;
        - a file of TartanAir, ``pose_left.txt``: seven numbers a line;
        - JSON as `write_cameras` writes it, for USD, Alembic and everything else.
    size : tuple of int, optional
        Width and height of the pictures, where the file does not say them: Hypersim's are 1024 x 768 and
        TartanAir's 640 x 480 unless it is given.

    Returns
    -------
    list of Camera
        In the order of the file; of COLMAP in that of the names.

    Raises
    ------
    ValueError
        If the file is none of these, or something is missing from it; the text says what.
    ImportError
        If Hypersim's files cannot be read, the extra ``hdf5``.
    """
    where = Path(path)
    if where.is_dir():
        if (where / "images.txt").exists():
            return _colmap(where)
        if (where / "camera_keyframe_positions.hdf5").exists():
            return _hypersim(where, size or (1024, 768))
        raise ValueError(
            f"{path}: a folder of cameras has images.txt (COLMAP) or "
            "camera_keyframe_positions.hdf5 (Hypersim)"
        )
    if where.name == "images.txt":
        return _colmap(where.parent)
    if where.suffix.lower() == ".json":
        words = _cameras.json_file(where)
        if not isinstance(words, dict) or not ("frames" in words or "cameras" in words):
            raise ValueError(f'{path}: JSON of cameras has "cameras", or "frames" as nerfstudio')
        return _transforms(where, words) if "frames" in words else _own(where, words)
    return _tartanair(where, size or (640, 480))


def write_cameras(path: StrPath, cameras: Sequence[Camera]) -> None:
    """Write cameras as JSON.

    The file holds ``{"axes": "opencv", "cameras": [...]}``. Each camera has ``"name"``, ``"pose"`` (four rows
    of four: from camera to world, in metres), ``"intrinsics"`` (three rows of three, pixel centres at whole
    numbers), ``"width"`` and ``"height"``. What is the same for all may stand beside ``"cameras"``. Files
    that others write may have ``"axes": "opengl"``: x right, y up, z backward, as in USD, Alembic and
    Blender.

    Parameters
    ----------
    path : path
        The file.
    cameras : sequence of Camera
        What is written.
    """
    words = [
        {
            "name": camera.name,
            "pose": camera.pose.tolist(),
            "intrinsics": camera.intrinsics.tolist(),
            "width": camera.size[0],
            "height": camera.size[1],
        }
        for camera in cameras
    ]
    text = json.dumps({"axes": "opencv", "cameras": words}, indent=1)
    _dofsim.write_bytes(Path(path), text.encode())


def _matrix(fx: float, fy: float, cx: float, cy: float) -> NDArray[np.float64]:
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _rotation(w: float, x: float, y: float, z: float) -> NDArray[np.float64]:
    """Give the rotation of a quaternion of any length."""
    n = w * w + x * x + y * y + z * z
    if not n > 0.0:
        raise ValueError(f"a quaternion must not be 0; got {[w, x, y, z]}")
    s = 2.0 / n
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    )


def _placed(rotation: NDArray[np.float64], position: ArrayLike) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def _lines(path: Path) -> Iterable[tuple[int, list[str]]]:
    """Yield the number and the words of each line, without comments."""
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if not line.startswith("#"):
            yield number, line.split()


def _numbers(path: Path, number: int, words: Sequence[str], least: int) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) < least:
        raise ValueError(
            f"{path}, line {number}: {least} numbers are needed; got {shortened(' '.join(words))!r}"
        )
    return values


# The models of COLMAP without distortion: which parameters are fx, fy, cx, cy.
_COLMAP_MODELS = {"SIMPLE_PINHOLE": (0, 0, 1, 2), "PINHOLE": (0, 1, 2, 3)}


def _colmap(folder: Path) -> list[Camera]:
    """Read COLMAP's text files. Poses are from world to camera, and pixel centres at halves."""
    path = folder / "cameras.txt"
    models = {}
    for number, words in _lines(path):
        if not words:
            continue
        if len(words) < 5 or words[1] not in _COLMAP_MODELS:
            raise ValueError(
                f"{path}, line {number}: a camera must be without distortion, SIMPLE_PINHOLE or PINHOLE "
                f"(COLMAP's image_undistorter makes such); got {shortened(' '.join(words[1:2]))!r}"
            )
        order = _COLMAP_MODELS[words[1]]
        values = _numbers(path, number, words[2:], 2 + max(order) + 1)
        fx, fy, cx, cy = (values[2 + i] for i in order)
        models[words[0]] = _matrix(fx, fy, cx - 0.5, cy - 0.5), (int(values[0]), int(values[1]))
    path = folder / "images.txt"
    cameras = []
    # Every second line lists points, and may be empty.
    for number, words in list(_lines(path))[::2]:
        if not words:
            continue
        w, x, y, z, *shift = _numbers(path, number, words[1:8], 7)
        if len(words) < 10 or words[8] not in models:
            raise ValueError(f"{path}, line {number}: a camera of cameras.txt and a name are needed")
        turn = _rotation(w, x, y, z).T
        intrinsics, size = models[words[8]]
        cameras.append(Camera(_placed(turn, -turn @ shift), intrinsics, size, " ".join(words[9:])))
    return sorted(cameras, key=lambda camera: camera.name)


def _transforms(path: Path, words: dict[str, Any]) -> list[Camera]:
    """Read nerfstudio's and instant-ngp's frames: OpenGL's axes, pixel centres at halves."""
    cameras = []
    for i, frame in enumerate(_list(path, words, "frames")):
        own = {**words, **frame}
        if any(own.get(name) for name in ("k1", "k2", "k3", "k4", "p1", "p2")):
            raise ValueError(f"{path}: frame {i} is distorted (k1, k2, p1, p2); undistort the pictures first")
        width, height = (_number(path, i, own, name) for name in "wh")
        if own.get("fl_x") is None:
            own["fl_x"] = 0.5 * width / tan(0.5 * _number(path, i, own, "camera_angle_x"))
        fx = _number(path, i, own, "fl_x")
        own = {"fl_y": fx, "cx": 0.5 * width, "cy": 0.5 * height} | own
        fy, cx, cy = (_number(path, i, own, name) for name in ("fl_y", "cx", "cy"))
        pose = _pose(path, i, frame.get("transform_matrix"), "transform_matrix") @ _FROM_OPENGL
        intrinsics, size = _matrix(fx, fy, cx - 0.5, cy - 0.5), (int(width), int(height))
        cameras.append(Camera(pose, intrinsics, size, str(frame.get("file_path", ""))))
    return cameras


def _number(path: Path, i: int, words: dict[str, Any], name: str) -> float:
    value = words.get(name)
    if isinstance(value, (int, float)):
        return float(value)
    raise ValueError(f"{path}: frame {i} needs the number {name!r}; got {shortened(repr(value))}")


def _list(path: Path, words: dict[str, Any], name: str) -> list[dict[str, Any]]:
    found = words[name]
    if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
        raise ValueError(f"{path}: {name!r} must be a list of cameras")
    return found


def _pose(path: Path, i: int, rows: Any, name: str) -> NDArray[np.float64]:
    try:
        pose = np.array(rows, np.float64)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape == (3, 4):
        pose = np.vstack([pose, [0.0, 0.0, 0.0, 1.0]])
    if pose.shape != (4, 4):
        raise ValueError(f"{path}: camera {i} needs {name!r}, four rows of four numbers")
    return pose


def _own(path: Path, words: dict[str, Any]) -> list[Camera]:
    cameras = []
    for i, camera in enumerate(_list(path, words, "cameras")):
        own = {**words, **camera}
        axes = own.get("axes", "opencv")
        if axes not in ("opencv", "opengl"):
            raise ValueError(f'{path}: "axes" must be "opencv" or "opengl"; got {shortened(repr(axes))}')
        pose = _pose(path, i, own.get("pose"), "pose")
        width, height = own.get("width"), own.get("height")
        if not (isinstance(width, int) and isinstance(height, int)):
            raise ValueError(
                f'{path}: camera {i} needs "width" and "height" in pixels; got {width} and {height}'
            )
        try:
            intrinsics = np.array(own.get("intrinsics"), np.float64)
            cameras.append(
                Camera(
                    pose if axes == "opencv" else pose @ _FROM_OPENGL,
                    intrinsics,
                    (width, height),
                    str(own.get("name", "")),
                )
            )
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}: camera {i}: {error}") from None
    return cameras


def _hypersim(folder: Path, size: tuple[int, int]) -> list[Camera]:
    """Read a trajectory of Hypersim: OpenGL's axes, in units of the scene, 60 degrees wide."""

    def read(name: str) -> NDArray[Any]:
        return read_hdf5(folder / f"camera_keyframe_{name}.hdf5", "dataset")

    positions, turns = read("positions"), read("orientations")
    frames = read("frame_indices") if (folder / "camera_keyframe_frame_indices.hdf5").exists() else None
    scene = folder.parent / "metadata_scene.csv"
    with scene.open(newline="", encoding="utf-8") as file:
        units = {row["parameter_name"]: row["parameter_value"] for row in DictReader(file)}
    if "meters_per_asset_unit" not in units:
        raise ValueError(f"{scene}: there is no meters_per_asset_unit")
    metres = float(units["meters_per_asset_unit"])
    width, height = size
    focal_px = 0.5 * width / tan(pi / 6.0)
    intrinsics = _matrix(focal_px, focal_px, 0.5 * (width - 1), 0.5 * (height - 1))
    numbers = range(len(positions)) if frames is None else frames.tolist()
    return [
        Camera(_placed(turn, metres * at) @ _FROM_OPENGL, intrinsics, size, f"frame.{number:04d}")
        for number, turn, at in zip(numbers, turns, positions, strict=True)
    ]


def _tartanair(path: Path, size: tuple[int, int]) -> list[Camera]:
    """Read a trajectory of TartanAir: position and quaternion x, y, z, w, in an aircraft's axes.

    The pictures are 90 degrees wide.
    """
    width, height = size
    focal_px = 0.5 * width / tan(radians(45.0))
    intrinsics = _matrix(focal_px, focal_px, 0.5 * (width - 1), 0.5 * (height - 1))
    cameras: list[Camera] = []
    for number, words in _lines(path):
        if not words:
            continue
        values = _numbers(path, number, words, 7)
        if len(values) != 7:
            raise ValueError(
                f"{path}, line {number}: a pose has 7 numbers, as TartanAir's; got {len(values)}"
            )
        x, y, z, w = values[3:]
        # The world's axes are the aircraft's, too, which are right-handed.
        pose = _placed(_rotation(w, x, y, z), values[:3]) @ _FROM_AIRCRAFT
        cameras.append(Camera(pose, intrinsics, size, f"{len(cameras):06d}"))
    return cameras
