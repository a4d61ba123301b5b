"""A lens traced from its prescription."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dofsim._dofsim import Lens, LensMap

from ._extras import missing
from ._lens_map import lens_points

# Steps of Newton's method for the ray through a point of the stop. It takes slopes of rays that are so many
# radii of the pupil apart.
_AIMS = 6
_STEP = 1e-4
# The tangent of a field so near to the axis that rays there are paraxial.
_PARAXIAL = 1e-5
_MM = 1e-3


class Traced:
    """A lens with its stop and its entrance pupil, whose rays are told by the field and a point of the stop.

    Lengths are in millimetres. The optical axis is z; x is to the right as the camera looks, y down.
    """

    def __init__(self, optic: Any, focus_distance: float) -> None:
        try:
            from optiland.rays import RealRays
        except ModuleNotFoundError as error:
            raise ImportError(
                missing("lenses from prescriptions need", "optiland", "prescription")
            ) from error
        self._rays = RealRays
        self._surfaces = optic.surfaces
        self._wavelength = float(optic.primary_wavelength)
        paraxial = optic.paraxial
        self.pupil_radius = 0.5 * _number(paraxial.EPD())
        self.pupil_z = _number(paraxial.entrance_pupil_axial_position())
        self._stop = int(optic.surfaces.stop_index)
        heights, _ = paraxial.marginal_ray()
        self._stop_radius = abs(float(np.ravel(heights[self._stop])[0]))
        self.focus = focus_distance / _MM
        self.sensor_z = 0.0
        self.sensor_z = self._best_focus()
        middle = np.zeros((1, 2))
        chief = self.landings(np.array([_PARAXIAL]), self.aimed(np.array([_PARAXIAL]), middle), self.focus)[0]
        # The sensor's picture is upside down, so this is negative.
        self.image_distance = float(chief[0, 0]) / _PARAXIAL

    def _trace(self, tangent: NDArray[np.float64], pupil: NDArray[np.float64], distance: float) -> Any:
        """Trace rays from points at a distance, of these fields, through points of the pupil."""
        at = self.pupil_radius * pupil
        away = np.zeros_like(at)
        away[..., 0] = tangent
        # From the object, at `distance` in front of the pupil, to the point of the pupil, per millimetre.
        slope = at / distance - away if math.isfinite(distance) else -away
        start_z = _number(self._surfaces[1].geometry.cs.z) - 2.0 * self.pupil_radius
        start = at + slope * (start_z - self.pupil_z)
        norm = np.sqrt(1.0 + (slope**2).sum(-1))
        flat = [
            np.ravel(v) for v in (start[..., 0], start[..., 1], slope[..., 0] / norm, slope[..., 1] / norm)
        ]
        x, y, toward_x, toward_y = flat
        rays = self._rays(
            x,
            y,
            np.full_like(x, start_z),
            toward_x,
            toward_y,
            np.ravel(1.0 / norm),
            np.ones_like(x),
            np.full_like(x, self._wavelength),
        )
        with np.errstate(all="ignore"):
            self._surfaces.trace(rays, skip=1)
        return rays

    def aimed(
        self, tangent: NDArray[np.float64], points: NDArray[np.float64], distance: float | None = None
    ) -> NDArray[np.float64]:
        """Give the points of the pupil whose rays pass these points of the stop; in focus by default."""
        distance = self.focus if distance is None else distance
        tangent = np.broadcast_to(tangent, points.shape[:-1])
        pupil = points.copy()

        def off(pupil: NDArray[np.float64]) -> NDArray[np.float64]:
            self._trace(tangent, pupil, distance)
            stop = self._surfaces[self._stop]
            passed = [np.asarray(v).reshape(pupil.shape[:-1]) for v in (stop.x, stop.y)]
            return np.stack(passed, axis=-1) / self._stop_radius - points

        for _ in range(_AIMS):
            here = off(pupil)
            columns = [(off(pupil + _STEP * axis) - here) / _STEP for axis in np.eye(2)]
            (a, c), (b, d) = (np.moveaxis(column, -1, 0) for column in columns)
            determinant = a * d - b * c
            with np.errstate(all="ignore"):
                move = np.stack(
                    [d * here[..., 0] - b * here[..., 1], a * here[..., 1] - c * here[..., 0]], axis=-1
                )
                move /= determinant[..., None]
            # A ray that has missed a surface stays: it does not arrive.
            pupil = pupil - np.where(np.abs(move) < 1.0, move, np.nan)
        return pupil

    def landings(
        self, tangent: NDArray[np.float64], pupil: NDArray[np.float64], distance: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Give where rays meet the sensor, and their slopes there; NaN for those that do not arrive."""
        tangent = np.broadcast_to(tangent, pupil.shape[:-1])
        rays = self._trace(tangent, pupil, distance)
        x, y, z, to_x, to_y, to_z, light = (
            np.asarray(v).reshape(pupil.shape[:-1])
            for v in (rays.x, rays.y, rays.z, rays.L, rays.M, rays.N, rays.i)
        )
        slope = np.stack([to_x / to_z, to_y / to_z], axis=-1)
        landing = np.stack([x, y], axis=-1) + slope * (self.sensor_z - z)[..., None]
        landing[~(light > 0)] = np.nan
        return landing, slope

    def _best_focus(self) -> float:
        """Give the place of the sensor where the spot of a point in focus on the axis is smallest."""
        at = np.arange(1, 17) / 16
        # Rings of the aperture have areas as their radii.
        points = np.stack([at, np.zeros_like(at)], axis=-1)
        landing, slope = self.landings(np.zeros(1), self.aimed(np.zeros(1), points), self.focus)
        x, u = landing[:, 0], slope[:, 0]
        return self.sensor_z - float(np.nansum(at * x * u) / np.nansum(at * u * u))


def _number(value: Any) -> float:
    return float(np.ravel(value)[0])


def from_optiland(
    optic: Any,
    focus_distance: float,
    half_diagonal_mm: float,
    field: ArrayLike | None,
    points: int,
) -> Lens:
    """Make `Lens.from_optiland`."""
    if not focus_distance > 0:
        raise ValueError(f"focus_distance must be a distance in metres above 0; got {focus_distance}")
    if not (math.isfinite(half_diagonal_mm) and half_diagonal_mm > 0):
        raise ValueError(f"half_diagonal_mm must be a length in millimetres above 0; got {half_diagonal_mm}")
    if points < 3:
        raise ValueError(f"points must be at least 3; got {points}")
    heights = np.linspace(0.0, 1.0, 9) if field is None else np.atleast_1d(np.asarray(field, np.float64))
    traced = Traced(optic, focus_distance)
    grid = lens_points(points)
    inside = np.hypot(grid[..., 0], grid[..., 1]) <= 1 + 1e-9
    half_tangent = half_diagonal_mm / abs(traced.image_distance)
    pupils, focused = [], []
    for height in heights:
        tangent = np.full(1, height * half_tangent)
        pupil = np.full(grid.shape, np.nan)
        offset = np.full(grid.shape, np.nan)
        pupil[inside] = traced.aimed(tangent, grid[inside])
        offset[inside] = traced.landings(tangent, pupil[inside], traced.focus)[0]
        chief = traced.landings(tangent, traced.aimed(tangent, np.zeros((1, 2))), traced.focus)[0]
        # Upright, as the picture is.
        offset = (offset - chief) * math.copysign(1.0, traced.image_distance) / half_diagonal_mm
        pupil[np.isnan(offset).any(-1)] = np.nan
        pupils.append(pupil)
        focused.append(offset)
    lens_map = LensMap(heights, np.stack(pupils), focused=np.stack(focused))
    return Lens(
        aperture_radius=traced.pupil_radius * _MM,
        focus_distance=focus_distance,
        fov=2 * math.degrees(math.atan(half_tangent)),
        fov_axis="diagonal",
        psf=lens_map,
    )
