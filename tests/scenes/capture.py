"""What a scene looks like: through a pinhole, through the lens, as depth, and peeled into layers."""

from collections.abc import Sequence
from typing import Any

import mitsuba as mi
import numpy as np
from dofsim.mitsuba._coverage import covered
from dofsim.mitsuba._peel import peel
from dofsim.mitsuba._view import View, render
from numpy.typing import NDArray

from .camera import Camera
from .shapes import X_RIGHT

Array = NDArray[np.float32]

# Samples of all pixels together in one launch that traces light from the lamps.
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

    def _view(self, width: int, height: int, at: Sequence[float] = (0.0, 0.0, 0.0)) -> View:
        to_world = np.eye(4)
        to_world[:3, 3] = at * np.array([X_RIGHT, -1.0, 1.0])
        return View(
            to_world=to_world,
            x_fov=self.camera.fov,
            clip=(0.01, 1e4),
            offset=(0.0, 0.0),
            size=(width, height),
            aperture_radius=self.camera.aperture_radius,
            focus_distance=self.camera.focus_distance,
        )

    def _render_lamps(self, kind: str, view: View, spp: int, seed: int) -> Array:
        sensor = view.sensor(kind, sampler="independent")
        width, height = view.size
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

    def _take(self, kind: str, view: View, spp: int, lamp_spp: int, seed: int) -> Array:
        picture = render(self.without_lamps, view, kind, spp=spp, seed=seed)
        if self.only_lamps is None:
            return picture
        return picture + self._render_lamps(kind, view, lamp_spp, seed)

    def pinhole(self, width: int, height: int, spp: int, lamp_spp: int = 256, seed: int = 0) -> Array:
        """Render (height, width, 3) linear colours through a pinhole, averaged over each pixel's square."""
        return self._take("perspective", self._view(width, height), spp, lamp_spp, seed)

    def thin_lens(self, width: int, height: int, spp: int, lamp_spp: int = 256, seed: int = 1) -> Array:
        """Render (height, width, 3) linear colours through the lens, averaged over each pixel's square."""
        return self._take("thinlens", self._view(width, height), spp, lamp_spp, seed)

    def lens_from(
        self, at: Sequence[float], width: int, height: int, spp: int, lamp_spp: int = 256, seed: int = 1
    ) -> Array:
        """Render colours through a lens so many metres to the right, down and forward."""
        return self._take("thinlens", self._view(width, height, at), spp, lamp_spp, seed)

    def seen_from(
        self, at: Sequence[float], width: int, height: int, spp: int, lamp_spp: int = 256, seed: int = 0
    ) -> tuple[Array, Array]:
        """Render colours and depth through a pinhole so many metres to the right, down and forward."""
        view = self._view(width, height, at)
        _, depth = peel(self.scene, view, 1, spp=0, seed=seed)
        return self._take("perspective", view, spp, lamp_spp, seed), depth[0]

    def peel(self, width: int, height: int, layers: int, spp: int = 1, seed: int = 2) -> tuple[Array, Array]:
        """Sample the surfaces one behind another along the ray through each pixel's centre."""
        return peel(self.scene, self._view(width, height), layers, spp=spp, seed=seed)

    def covered(
        self, width: int, height: int, layers: int, spp: int, means: Array, seed: int = 2
    ) -> tuple[Array, Array]:
        """Sample them along so many rays of each pixel, with what each covers; `means` is what is seen."""
        return covered(self.scene, self._view(width, height), layers, spp=spp, seed=seed, means=means)


def with_means(first: Array, means: Array) -> Array:
    """Give a first layer without gaps, (H, W, 4), the colours that a pinhole sees, averaged over pixels."""
    assert np.all(first[..., 3] == 1.0)
    return np.concatenate([means, first[..., 3:]], axis=-1)


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
