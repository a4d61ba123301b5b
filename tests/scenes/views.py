"""References for lenses that Mitsuba does not have: many pinhole views from points of the lens, added up.

A pinhole at a point of the lens whose film lies parallel to the plane in focus sees that plane undistorted,
only moved and scaled; a principal point and a field of view take both back, so that what is in focus falls on
the same pixels in all views and their mean is the picture through the lens. The film of a tilted focus plane
leans with it; the mean is then looked up once for each pixel of the upright picture.
"""

from math import atan, degrees, radians, tan

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from .camera import Camera
from .shapes import X_RIGHT

Vector = NDArray[np.float64]

# Places along each side of a pixel at which a leaning film is looked up.
LOOKS = 3


class Film:
    """A film parallel to the focus plane, large enough for all that the upright picture shows.

    Vectors have the components right, up and forward; the lens is at the origin.
    """

    def __init__(self, camera: Camera, tilt: tuple[float, float], width: int, height: int) -> None:
        self.focal_px = 0.5 * width / tan(radians(0.5 * camera.fov))
        self.size = width, height
        top_away, right_away = (tan(radians(angle)) for angle in tilt)
        self.slope = np.array([right_away, top_away])
        self.focus = np.array([0.0, 0.0, camera.focus_distance])
        normal = np.array([-right_away, -top_away, 1.0])
        self.normal = normal / np.linalg.norm(normal)
        up = np.array([0.0, 1.0, 0.0])
        up -= (up @ self.normal) * self.normal
        self.up = up / np.linalg.norm(up)
        self.right = np.cross(self.up, self.normal)
        self.leans = tilt != (0.0, 0.0)

        if not self.leans:
            self.scale, self.shape = self.focal_px / camera.focus_distance, (height, width)
            self.first = np.array([-0.5 * width, -0.5 * height]) / self.scale
            return
        # Two pixels of the film to one of the picture where the plane is nearest, as it is at some corner.
        edges = [self.on_plane(x, y) for x in (-0.5, width - 0.5) for y in (-0.5, height - 0.5)]
        self.scale = 2.0 * self.focal_px / min(corner[2] for corner in edges)
        flat = np.array([self.flat(corner) for corner in edges])
        margin = 8.0 / self.scale
        self.first = flat.min(axis=0) - margin
        columns, rows = np.ceil((flat.max(axis=0) + margin - self.first) * self.scale).astype(int)
        self.shape = int(rows), int(columns)

    def on_plane(self, x: NDArray, y: NDArray) -> Vector:
        """Find what pixel (x, y) of the upright picture sees of the focus plane."""
        width, height = self.size
        right = (np.asarray(x) - 0.5 * (width - 1)) / self.focal_px
        up = -(np.asarray(y) - 0.5 * (height - 1)) / self.focal_px
        z = self.focus[2] / (1.0 - self.slope[0] * right - self.slope[1] * up)
        return np.stack([right * z, up * z, z], axis=-1)

    def flat(self, point: Vector) -> Vector:
        """Give the place of a point of the focus plane within it, to the right and down, in metres."""
        return np.stack([(point - self.focus) @ self.right, -(point - self.focus) @ self.up], axis=-1)

    def view(self, scene, lens_point: Vector, spp: int, seed: int) -> NDArray[np.float32]:
        """Render the film from one point of the lens."""
        rows, columns = self.shape
        away = self.normal @ (self.focus - lens_point)
        # The focus plane's place `first` is to be the film's corner.
        corner = self.flat(lens_point)
        centre = (corner - self.first) * self.scale
        world = [X_RIGHT, 1.0, 1.0]
        sensor = mi.load_dict(
            {
                "type": "perspective",
                "fov": degrees(2.0 * atan(0.5 * columns / (self.scale * away))),
                "fov_axis": "x",
                "near_clip": 0.01,
                # Mitsuba's offsets say how far the picture moves to the left and up.
                "principal_point_offset_x": float(0.5 - centre[0] / columns),
                "principal_point_offset_y": float(0.5 - centre[1] / rows),
                "to_world": mi.ScalarTransform4f().look_at(
                    list(lens_point * world),
                    list((lens_point + self.normal) * world),
                    list(self.up * world),
                ),
                "film": {
                    "type": "hdrfilm",
                    "width": columns,
                    "height": rows,
                    "pixel_format": "rgb",
                    "component_format": "float32",
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "multijitter"},
            }
        )
        return np.array(mi.render(scene, sensor=sensor, spp=spp, seed=seed))

    def upright(self, film: NDArray[np.floating]) -> NDArray[np.float64]:
        """Look the upright picture up in the film."""
        if not self.leans:
            return film
        width, height = self.size
        total = np.zeros((height, width, 3))
        for k in range(LOOKS * LOOKS):
            offset = np.array([k % LOOKS, k // LOOKS]) / LOOKS - 0.5 + 0.5 / LOOKS
            x, y = np.meshgrid(np.arange(width) + offset[0], np.arange(height) + offset[1])
            at = (self.flat(self.on_plane(x, y)) - self.first) * self.scale - 0.5
            for c in range(3):
                total[..., c] += map_coordinates(film[..., c], [at[..., 1], at[..., 0]], order=1)
        return total / LOOKS**2


def add_up(
    scene,
    camera: Camera,
    lens_points: Vector,
    width: int,
    height: int,
    tilt: tuple[float, float] = (0.0, 0.0),
    spp: int = 4,
) -> NDArray[np.float32]:
    """Render (height, width, 3) linear colours through a lens.

    Parameters
    ----------
    scene : mitsuba.Scene
        What there is to see.
    camera : Camera
        The lens; `fov` is along x.
    lens_points : (N, 2) array
        Points of the opening in units of its radius, to the right and down.
    width, height : int
        Size of the picture.
    tilt : tuple of float
        Angles in degrees by which the top of the focus plane leans away, and its right side.
    spp : int
        Samples a pixel of the film and view.
    """
    film = Film(camera, tilt, width, height)
    total = np.zeros((*film.shape, 3))
    for seed, (right, down) in enumerate(lens_points):
        at = camera.aperture_radius * np.array([right, -down, 0.0])
        total += film.view(scene, at, spp, seed)
    return film.upright(total / len(lens_points)).astype(np.float32)
