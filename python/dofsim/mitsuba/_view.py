"""What a scene's sensor sees, as numbers; and sensors made from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import atan, cos, degrees, pi, radians, sin, tan
from os import PathLike, fspath
from typing import Any, Literal

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

__all__ = ["View", "load_scene", "render"]

# Samples of all pixels together in one launch; bounds the memory that the vectorised variants take.
_SAMPLES_PER_LAUNCH = 16_000_000


def load_scene(scene: Any) -> Any:
    """Load a scene from a dictionary or a file; a loaded one is what it is."""
    if isinstance(scene, dict):
        return mi.load_dict(scene)
    if isinstance(scene, str | PathLike):
        return mi.load_file(fspath(scene))
    if isinstance(scene, mi.Scene):
        return scene
    raise TypeError(
        f"scene must be a mitsuba.Scene, a dictionary or the path of an XML file; got {type(scene)}"
    )


@dataclass(frozen=True)
class View:
    """Where a camera stands, what it sees, and on how many pixels.

    Attributes
    ----------
    to_world : ndarray
        The 4 x 4 matrix of the camera's frame, which looks along +z.
    x_fov : float
        Field of view in degrees along the width.
    clip : tuple of float
        Distances of the near and the far clip plane.
    offset : tuple of float
        Mitsuba's offsets of the principal point: how far the picture moves to the left and up, of its size.
    size : tuple of int
        Width and height in pixels.
    aperture_radius, focus_distance : float
        The thin lens; a radius of 0 is a pinhole.
    """

    to_world: NDArray[np.float64]
    x_fov: float
    clip: tuple[float, float]
    offset: tuple[float, float]
    size: tuple[int, int]
    aperture_radius: float
    focus_distance: float

    @classmethod
    def of(cls, scene: Any, index: int) -> View:
        """Read a sensor of a scene.

        Raises
        ------
        ValueError
            If there is no such sensor, it has no field of view, or its film is cropped.
        """
        sensors = scene.sensors()
        if not sensors:
            raise ValueError("the scene has no sensor; add a thinlens, or a perspective one for a pinhole")
        if not 0 <= index < len(sensors):
            raise ValueError(f"sensor must be one of the scene's {len(sensors)}; got {index}")
        sensor = sensors[index]
        parameters = mi.traverse(sensor)
        if "x_fov" not in parameters:
            raise ValueError(
                f"sensor {index} must be a thinlens or a perspective one; it is {sensor.class_name()}"
            )

        def number(name: str, default: float) -> float:
            return float(np.ravel(parameters[name])[0]) if name in parameters else default

        film = sensor.film()
        width, height = (int(side) for side in film.size())
        if [int(side) for side in film.crop_size()] != [width, height]:
            raise ValueError(f"sensor {index} must not crop its film, whose lens is about the whole of it")
        to_world = np.array(sensor.world_transform().matrix, dtype=np.float64).reshape(4, 4, -1)[..., 0]
        return cls(
            to_world=to_world,
            x_fov=number("x_fov", 0.0),
            clip=(number("near_clip", 1e-2), number("far_clip", 1e4)),
            offset=(number("principal_point_offset_x", 0.0), number("principal_point_offset_y", 0.0)),
            size=(width, height),
            aperture_radius=number("aperture_radius", 0.0),
            focus_distance=number("focus_distance", 1.0),
        )

    def widened(self, margin: int) -> View:
        """See so many more pixels on every side."""
        width, height = self.size
        wide, high = width + 2 * margin, height + 2 * margin
        return replace(
            self,
            x_fov=degrees(2.0 * atan(tan(radians(0.5 * self.x_fov)) * wide / width)),
            offset=(self.offset[0] * width / wide, self.offset[1] * height / high),
            size=(wide, high),
        )

    def finer(self, factor: int) -> View:
        """See the same on so many times the pixels along each axis."""
        return replace(self, size=(factor * self.size[0], factor * self.size[1]))

    def on_rim(self, number: int, count: int) -> View:
        """See the same from one of several points of the lens's rim, evenly spread."""
        turn = 2.0 * pi * (number + 0.5) / count
        to_world = self.to_world.copy()
        axes = to_world[:3, :2] / np.linalg.norm(to_world[:3, :2], axis=0)
        to_world[:3, 3] += self.aperture_radius * (axes @ [cos(turn), sin(turn)])
        return replace(self, to_world=to_world)

    def pose(self) -> NDArray[np.float64]:
        """Give the camera-to-world pose in OpenCV's axes; Mitsuba's x runs to the left, and its y up."""
        pose = self.to_world.copy()
        pose[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
        pose[:3, :2] *= -1.0
        return pose

    def intrinsics(self) -> NDArray[np.float64]:
        """Give the camera's matrix in pixels, for pixel centres at whole numbers."""
        focal_px = 0.5 * self.size[0] / tan(radians(0.5 * self.x_fov))
        cx, cy = (n * (0.5 - offset) - 0.5 for n, offset in zip(self.size, self.offset, strict=True))
        return np.array([[focal_px, 0.0, cx], [0.0, focal_px, cy], [0.0, 0.0, 1.0]])

    def sensor(
        self,
        kind: Literal["perspective", "thinlens"],
        *,
        rows: tuple[int, int] | None = None,
        sampler: str = "multijitter",
    ) -> Any:
        """Make a sensor whose film keeps each pixel's own samples; of some rows only (first, number)."""
        words: dict[str, Any] = {
            "type": kind,
            "fov": self.x_fov,
            "fov_axis": "x",
            "near_clip": self.clip[0],
            "far_clip": self.clip[1],
            "to_world": mi.ScalarTransform4f(self.to_world.tolist()),
            "film": {
                "type": "hdrfilm",
                "width": self.size[0],
                "height": self.size[1],
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": sampler},
        }
        if rows is not None:
            words["film"] |= {"crop_offset_y": rows[0], "crop_height": rows[1], "crop_width": self.size[0]}
        if kind == "thinlens":
            words |= {"aperture_radius": self.aperture_radius, "focus_distance": self.focus_distance}
        if self.offset != (0.0, 0.0):
            words |= {"principal_point_offset_x": self.offset[0], "principal_point_offset_y": self.offset[1]}
        return mi.load_dict(words)


def render(
    scene: Any,
    view: View,
    kind: Literal["perspective", "thinlens"],
    *,
    spp: int,
    seed: int,
    advance: Callable[[int], object] = lambda samples: None,
) -> NDArray[np.float32]:
    """Render (height, width, 3) linear colours, averaged over each pixel's square.

    After each launch, ``advance`` is told its number of samples.
    """
    # All of a pixel's samples go into one launch, whose multi-jittered set covers pixel and lens evenly; it
    # is the rows that are split up.
    width, height = view.size
    step = max(1, min(height, _SAMPLES_PER_LAUNCH // (spp * width)))
    bands = []
    for top in range(0, height, step):
        sensor = view.sensor(kind, rows=(top, min(step, height - top)))
        picture = np.array(mi.render(scene, sensor=sensor, spp=spp, seed=seed * 100_003 + top))
        # Integrators that give more put the colours first.
        bands.append(picture[..., :3].astype(np.float32))
        advance(spp * width * len(picture))
    return np.concatenate(bands)
