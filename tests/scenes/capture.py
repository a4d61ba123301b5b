"""What a scene looks like: through a pinhole, through the lens, as depth, and peeled into layers."""

from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from .camera import Camera

Array = NDArray[np.float32]

# Samples of all pixels together in one launch; bounds the memory that the vectorised variants take.
SAMPLES_PER_LAUNCH = 16_000_000


class Capture:
    """One scene, loaded once, and the pictures of it.

    Parameters
    ----------
    shapes : dict
        The scene's objects as Mitsuba dictionaries.
    camera : Camera
        The lens; the pinhole has the same place and field of view.
    max_depth : int
        Path length of Mitsuba's path tracer; 1 shows nothing but what shines by itself.
    lamps : dict, optional
        Further objects, tiny and bright. A path from the camera seldom meets one, so what they send straight
        into the lens is traced from them to it, and they light nothing else.
    """

    def __init__(
        self,
        shapes: dict[str, Any],
        camera: Camera,
        max_depth: int = 1,
        lamps: dict[str, Any] | None = None,
    ) -> None:
        self.camera = camera
        self.shaded = max_depth > 1
        self.scene = self._load({**shapes, **(lamps or {})}, max_depth)
        self.without_lamps = self.scene
        self.only_lamps = None
        if lamps:
            self.without_lamps = self._load({**shapes, **_dark(lamps)}, max_depth)
            self.only_lamps = self._load({**_dark(shapes), **lamps}, max_depth)

    def _load(self, shapes: dict[str, Any], max_depth: int):
        return mi.load_dict(
            {"type": "scene", "integrator": {"type": "path", "max_depth": max_depth}, **shapes}
        )

    def _sensor(
        self, kind: str, width: int, height: int, film: dict[str, int] | None = None, sampler="multijitter"
    ):
        lens = (
            {"aperture_radius": self.camera.aperture_radius, "focus_distance": self.camera.focus_distance}
            if kind == "thinlens"
            else {}
        )
        return mi.load_dict(
            {
                "type": kind,
                "fov": self.camera.fov,
                "fov_axis": self.camera.fov_axis,
                "near_clip": 0.01,
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 0], [0, 0, 1], [0, 1, 0]),
                "film": {
                    "type": "hdrfilm",
                    "width": width,
                    "height": height,
                    "pixel_format": "rgb",
                    "component_format": "float32",
                    "rfilter": {"type": "box"},
                    **(film or {}),
                },
                "sampler": {"type": sampler},
                **lens,
            }
        )

    def _render(self, kind: str, width: int, height: int, spp: int, seed: int) -> Array:
        # All of a pixel's samples go into one launch, whose multi-jittered set covers pixel and lens evenly;
        # it is the rows that are split up.
        rows = max(1, min(height, SAMPLES_PER_LAUNCH // (spp * width)))
        bands = []
        for top in range(0, height, rows):
            band = {"crop_offset_y": top, "crop_height": min(rows, height - top), "crop_width": width}
            sensor = self._sensor(kind, width, height, film=band)
            bands.append(
                np.array(mi.render(self.without_lamps, sensor=sensor, spp=spp, seed=seed * 100_003 + top))
            )
        return np.concatenate(bands).astype(np.float32)

    def _render_lamps(self, kind: str, width: int, height: int, spp: int, seed: int) -> Array:
        sensor = self._sensor(kind, width, height, sampler="independent")
        tracer = mi.load_dict({"type": "ptracer", "max_depth": 1})
        launches = -(-spp * width * height // SAMPLES_PER_LAUNCH)
        total = np.zeros((height, width, 3))
        for launch in range(launches):
            launch_seed = seed * 100_003 + launch
            total += np.array(
                mi.render(
                    self.only_lamps,
                    sensor=sensor,
                    integrator=tracer,
                    spp=-(-spp // launches),
                    seed=launch_seed,
                )
            )
        return (total / launches).astype(np.float32)

    def _take(self, kind: str, width: int, height: int, spp: int, lamp_spp: int, seed: int) -> Array:
        picture = self._render(kind, width, height, spp, seed)
        if self.only_lamps is None:
            return picture
        return picture + self._render_lamps(kind, width, height, lamp_spp, seed)

    def pinhole(self, width: int, height: int, spp: int, lamp_spp: int = 256, seed: int = 0) -> Array:
        """Render (height, width, 3) linear colours through a pinhole, averaged over each pixel's square."""
        return self._take("perspective", width, height, spp, lamp_spp, seed)

    def thin_lens(self, width: int, height: int, spp: int, lamp_spp: int = 256, seed: int = 1) -> Array:
        """Render (height, width, 3) linear colours through the lens, averaged over each pixel's square."""
        return self._take("thinlens", width, height, spp, lamp_spp, seed)

    def peel(self, width: int, height: int, layers: int, spp: int = 1, seed: int = 2) -> tuple[Array, Array]:
        """Sample the surfaces one behind another along the ray through each pixel's centre.

        Surfaces seen from behind are passed through: all of the scenes' solids are closed, so no lens can
        see an inside. Shaded surfaces are averaged over `spp` paths.

        Returns
        -------
        color : (layers, height, width, 4) array
            Premultiplied linear colour, nearest first; alpha 0 where there is no such surface.
        depth : (layers, height, width) array
            Planar depth in metres, infinite where alpha is 0.
        """
        sensor = self._sensor("perspective", width, height)
        if mi.variant().startswith("scalar"):
            color = np.zeros((layers, height, width, 4), np.float32)
            depth = np.full((layers, height, width), np.inf, np.float32)
            for y in range(height):
                for x in range(width):
                    at = mi.Point2f((x + 0.5) / width, (y + 0.5) / height)
                    for layer, (rgb, z) in enumerate(self._peel_ray(sensor, at, layers, spp, seed)):
                        color[layer, y, x] = [*rgb, 1.0]
                        depth[layer, y, x] = z
            return color, depth
        return self._peel_wavefront(sensor, width, height, layers, spp, seed)

    def _peel_ray(self, sensor, at, layers: int, spp: int, seed: int):
        ray, _ = sensor.sample_ray(0.0, 0.5, at, mi.Point2f(0.5))
        sampler = sensor.sampler()
        if self.shaded:
            sampler.seed(seed + hash((at.x, at.y)) % 2**31)
        surfaces = []
        while len(surfaces) < layers:
            hit = self.scene.ray_intersect(ray)
            if not hit.is_valid():
                break
            if hit.wi.z > 0.0:
                rgb = mi.Color3f(0.0)
                for _ in range(spp):
                    rgb += self.scene.integrator().sample(self.scene, sampler, ray)[0] / spp
                surfaces.append((rgb, hit.p.z))
            ray = hit.spawn_ray(ray.d)
        return surfaces

    def _peel_wavefront(self, sensor, width: int, height: int, layers: int, spp: int, seed: int):
        import drjit as dr

        index = dr.arange(mi.UInt32, width * height)
        at = mi.Point2f((index % width + 0.5) / width, (index // width + 0.5) / height)
        ray, _ = sensor.sample_ray(0.0, 0.5, at, mi.Point2f(0.5))
        ray = mi.Ray3f(ray)
        color = np.zeros((layers, height * width, 4), np.float32)
        depth = np.full((layers, height * width), np.inf, np.float32)
        found = np.zeros(height * width, np.int64)
        alive = mi.Bool(True)
        while True:
            hit = self.scene.ray_intersect(ray, alive)
            alive = alive & hit.is_valid()
            facing = alive & (hit.wi.z > 0.0)
            rgb = self._radiance(ray, facing, width * height, spp, seed)
            now = np.array(facing)
            color[found[now], now, :3] = rgb[now]
            color[found[now], now, 3] = 1.0
            depth[found[now], now] = np.array(hit.p.z)[now]
            found += now
            alive = alive & mi.Bool(found < layers)
            ray = hit.spawn_ray(ray.d)
            dr.eval(ray, alive)
            if not dr.any(alive):
                return color.reshape(layers, height, width, 4), depth.reshape(layers, height, width)

    def _radiance(self, ray, active, count: int, spp: int, seed: int) -> Array:
        import drjit as dr

        sampler = mi.load_dict({"type": "independent"})
        total = mi.Color3f(0.0)
        for pass_index in range(spp):
            sampler.seed(seed * 100_003 + pass_index, count)
            total += self.scene.integrator().sample(self.scene, sampler, ray, active=active)[0]
            dr.eval(total)
        return np.array(total / spp).T


def _dark(shapes: dict[str, Any]) -> dict[str, Any]:
    """Give the shapes without their light; what is light only, as a sky, is left out."""
    geometry = {
        name: shape
        for name, shape in shapes.items()
        if not isinstance(shape, dict) or shape["type"] != "envmap"
    }
    return {
        name: {key: value for key, value in shape.items() if key != "emitter"}
        if isinstance(shape, dict)
        else shape
        for name, shape in geometry.items()
    }
