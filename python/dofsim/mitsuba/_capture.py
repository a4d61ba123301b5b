"""What `dofsim.render` wants of a Mitsuba scene."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import isqrt
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

import dofsim
from dofsim import _shown
from dofsim._names import listed

from ._coverage import covered
from ._peel import peel
from ._variant import check_variant
from ._view import View, load_scene, render

__all__ = ["Capture", "rgbd"]


@dataclass(frozen=True, eq=False)
class Capture:
    """A pinhole picture of a scene with its depth, and the lens to see it through.

    Unpacks into what `dofsim.render` takes first: ``dofsim.render(*capture)``, if it was taken without
    `supersample` and `overscan`, or else ``capture.render()``.

    Attributes
    ----------
    color : ndarray of float32
        Linear light: shape (H, W, 3), or (L, H, W, 4) of layers, premultiplied.
    depth : ndarray of float32
        Planar depth in metres, shape (H, W), at pixel centres, or (L, H, W); infinite for the background.
    lens : Lens
        That of the scene's sensor.
    supersample, overscan : int
        As for `dofsim.render`.
    """

    color: NDArray[np.float32]
    depth: NDArray[np.float32]
    lens: dofsim.Lens
    supersample: int = 1
    overscan: int = 0

    def __repr__(self) -> str:
        """Return sizes and the lens."""
        color, finer = _shown.described(self.color), self.supersample
        return f"<Capture of {color}, supersample={finer}, overscan={self.overscan}, {self.lens!r}>"

    def _repr_png_(self) -> bytes:
        """Return the pinhole picture, and its depth as grey."""
        return _shown.png([self.color, _shown.grey(self.depth)])

    def __iter__(self) -> Iterator[Any]:
        """Yield the colour, the depth and the lens."""
        return iter((self.color, self.depth, self.lens))

    def render(self, lens: dofsim.Lens | None = None, **options: Any) -> NDArray[np.float32]:
        """Return the scene seen through its lens, or through another one.

        Parameters
        ----------
        lens : Lens, optional
            Another lens; its field of view has to be that of the sensor.
        **options
            As for `dofsim.render`: ``method``, ``device``, ``aperture`` and so on.

        Returns
        -------
        ndarray of float32
            Shape (H, W, 3); of layers (H, W, 4), premultiplied.
        """
        picture: NDArray[np.float32] = dofsim.render(
            self.color,
            self.depth,
            lens or self.lens,
            supersample=self.supersample,
            overscan=self.overscan,
            **options,
        )
        return picture


def rgbd(
    scene: Any,
    *,
    spp: int = 64,
    layers: int = 1,
    supersample: int = 1,
    overscan: int = 0,
    views: int = 0,
    sensor: int = 0,
    seed: int = 0,
) -> Capture:
    """Return what `dofsim.render` takes of a scene: pinhole colour, depth at pixel centres, and the lens.

    Parameters
    ----------
    scene : mitsuba.Scene, dict or path
        The scene; its integrator renders the colours.
    spp : int, optional
        Samples a pixel, rounded up to a square; of layers, rays a pixel, too.
    layers : int, optional
        How many surfaces one behind another are sampled along each pixel's rays. Colours of layers are
        averaged over the pixel, and alpha is the part of it that a surface covers. With an `spp` of 1 there
        is one ray, through the pixel's centre, and alpha is 0 or 1. Behind the first surface, those seen from
        behind, the insides of solids, are left out.
    supersample : int, optional
        Pixels to one of the output, along each axis; `spp` counts for each of them.
    overscan : int, optional
        Pixels of the output added on every side, for what a lens sees from beyond the border.
    views : int, optional
        How many further pinholes on the rim of the lens are rendered, each as the first one. What they see
        behind its surfaces comes as further layers, see `dofsim.layers_from_views`. 4 to 8 see nearly all
        that the lens does, at the cost of as many pinhole renders.
    sensor : int, optional
        Which of the scene's sensors: a ``thinlens``, or a ``perspective`` one, whose lens is a pinhole.
    seed : int, optional
        Of the random numbers.

    Returns
    -------
    Capture
        Colour, depth and lens; unpacks into the three.

    Raises
    ------
    TypeError
        If it is given something else than a scene.
    ValueError
        If the scene has no sensor, or the sensor has no field of view or crops its film, if a number is out
        of range, if `views` is asked of a pinhole or beside `layers`, or if Mitsuba's variant is not an RGB
        one.

    Warns
    -----
    UserWarning
        If the scene has glass or mirrors, whose surfaces are taken for what they show.

    Examples
    --------
    >>> import dofsim
    >>> from dofsim.mitsuba import rgbd
    >>> film = {"type": "hdrfilm", "width": 24, "height": 16}
    >>> camera = {"type": "thinlens", "fov": 40, "aperture_radius": 0.1, "focus_distance": 3, "film": film}
    >>> ball = {"type": "sphere", "center": [0, 0, 4], "emitter": {"type": "area", "radiance": 1.0}}
    >>> scene = {"type": "scene", "integrator": {"type": "path"}, "camera": camera, "ball": ball}
    >>> color, depth, lens = rgbd(scene, spp=4)
    >>> color.shape, round(float(depth.min()), 1), lens.focus_distance
    ((16, 24, 3), 3.0, 3.0)
    """
    for name, value, least in (
        ("spp", spp, 1),
        ("layers", layers, 1),
        ("supersample", supersample, 1),
        ("overscan", overscan, 0),
        ("views", views, 0),
        ("seed", seed, 0),
    ):
        if value < least:
            raise ValueError(f"{name} must be at least {least}; got {value}")
    check_variant()
    loaded = load_scene(scene)
    seen = View.of(loaded, sensor)
    check_views(views, layers, seen, sensor)
    warn_of_specular_shapes(loaded)
    return capture_of(
        loaded,
        seen,
        sensor,
        spp=spp,
        layers=layers,
        supersample=supersample,
        overscan=overscan,
        views=views,
        seed=seed,
    )


def check_views(views: int, layers: int, seen: View, sensor: int) -> None:
    """Refuse views that a capture cannot have."""
    if views < 0:
        raise ValueError(f"views must be at least 0; got {views}")
    if views and layers > 1:
        raise ValueError(f"views and layers exclude each other; got {views} views and {layers} layers")
    if views and seen.aperture_radius == 0.0:
        raise ValueError(f"views are points of a lens, and sensor {sensor} is a pinhole; got {views}")


def capture_of(
    scene: Any,
    seen: View,
    sensor: int,
    *,
    spp: int,
    layers: int,
    supersample: int,
    overscan: int = 0,
    views: int = 0,
    seed: int,
    advance: Callable[[int], object] = lambda samples: None,
) -> Capture:
    """Take the picture of a loaded scene; ``advance`` is told how many samples were rendered."""
    lens = dofsim.Lens.from_mitsuba(scene.sensors()[sensor])
    view = seen.widened(overscan).finer(supersample)
    if layers == 1:
        _, depth = peel(scene, view, 1, spp=0, seed=seed)
        color = render(scene, view, "perspective", spp=squared(spp), seed=seed, advance=advance)
        if not views:
            return Capture(color, depth[0], lens, supersample, overscan)
        colors, depths, seen_from = [color], [depth[0]], [view]
        for number in range(views):
            seen_from.append(view.on_rim(number, views))
            # Other random numbers: noise is not seen twice.
            another = seed + 1 + number
            _, beside = peel(scene, seen_from[-1], 1, spp=0, seed=another)
            depths.append(beside[0])
            colors.append(
                render(scene, seen_from[-1], "perspective", spp=squared(spp), seed=another, advance=advance)
            )
        color, depth = dofsim.layers_from_views(
            colors,
            depths,
            np.stack([one.pose() for one in seen_from]),
            view.intrinsics(),
            lens=lens,
            overscan=overscan,
            supersample=supersample,
        )
        return Capture(color, depth, lens, supersample, overscan)
    if spp == 1:
        color, depth = peel(scene, view, layers, spp=1, seed=seed)
    else:
        spp = squared(spp)
        means = render(scene, view, "perspective", spp=spp, seed=seed, advance=advance)
        color, depth = covered(scene, view, layers, spp=spp, seed=seed, means=means)
    return Capture(color, depth, lens, supersample, overscan)


def specular_shapes(scene: Any) -> list[str]:
    """Name the shapes of a scene that show something else than themselves: glass and mirrors."""
    seen_in = (mi.BSDFFlags.DeltaReflection, mi.BSDFFlags.DeltaTransmission, mi.BSDFFlags.GlossyTransmission)
    own = (mi.BSDFFlags.DiffuseReflection, mi.BSDFFlags.DiffuseTransmission)
    found = []
    for shape in scene.shapes():
        if (bsdf := shape.bsdf()) is None:
            continue
        flags = bsdf.flags()
        if any(mi.has_flag(flags, one) for one in seen_in) and not any(
            mi.has_flag(flags, one) for one in own
        ):
            found.append(f"{shape.id()} ({bsdf.class_name()})")
    return sorted(found)


def warn_of_specular_shapes(scene: Any) -> None:
    """Warn the caller's caller of glass and mirrors, if a scene has any."""
    if found := specular_shapes(scene):
        warnings.warn(
            f"the scene has glass or mirrors, {listed(found)}: what they show is blurred as if it were at "
            "their surfaces",
            stacklevel=3,
        )


def squared(spp: int) -> int:
    """Round up to the square of a whole number, which multi-jittered sampling wants."""
    side = isqrt(spp - 1) + 1
    return side * side
