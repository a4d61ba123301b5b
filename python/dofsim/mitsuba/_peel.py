"""Surfaces one behind another along the ray through each pixel's centre."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from ._view import View

__all__ = ["peel", "peel_rays"]

# The share of light that passes through a surface unbent, from which on it is not there.
_PASSING = 0.5

Layers = tuple[NDArray[np.float32], NDArray[np.float32]]


def peel(scene: Any, view: View, layers: int, *, spp: int, seed: int) -> Layers:
    """Sample colour and depth of the surfaces behind each pixel's centre, nearest first.

    Behind the first one, surfaces seen from behind are passed through: they are the insides of solids, which
    no lens can see. Cards with a ``mask`` are no solids, and count from both sides. Where more than half of
    the light passes through a surface unbent, as through the transparent part of a mask, it is not there: the
    outline of a filtered mask is where its opacity is one half. The environment is a last surface at
    infinity.

    Parameters
    ----------
    scene : mitsuba.Scene
        The scene.
    view : View
        The pinhole.
    layers : int
        How many surfaces.
    spp : int
        Light paths that each colour is averaged over; 0 for depth alone.
    seed : int
        Of their random numbers.

    Returns
    -------
    color : (layers, height, width, 4) array
        Premultiplied linear colour; alpha 0 where there is no such surface.
    depth : (layers, height, width) array
        Planar depth in metres, infinite where there is no surface.
    """
    color, depth = peel_rays(
        scene, view, layers, spp=spp, seed=seed, rows=range(view.size[1]), points=[(0.5, 0.5)]
    )
    return color[0], depth[0]


def peel_rays(
    scene: Any,
    view: View,
    layers: int,
    *,
    spp: int,
    seed: int,
    rows: range,
    points: Sequence[tuple[float, float]],
) -> Layers:
    """Sample colour and depth of the surfaces along several rays through each pixel of some rows.

    Parameters
    ----------
    scene, view, layers, spp, seed
        As for `peel`.
    rows : range
        Rows of pixels, one after another.
    points : sequence of tuple of float
        Where in a pixel each ray is, from its upper left corner.

    Returns
    -------
    color : (rays, layers, rows, width, 4) array
        As of `peel`.
    depth : (rays, layers, rows, width) array
        As of `peel`.
    """
    if mi.variant().startswith("scalar"):
        return _peel_scalar(scene, view, layers, spp, seed, rows, points)
    return _peel_wavefront(scene, view, layers, spp, seed, rows, points)


def _peel_scalar(
    scene: Any,
    view: View,
    layers: int,
    spp: int,
    seed: int,
    rows: range,
    points: Sequence[tuple[float, float]],
) -> Layers:
    width, height = view.size
    color = np.zeros((len(points), layers, len(rows), width, 4), np.float32)
    depth = np.full((len(points), layers, len(rows), width), np.inf, np.float32)
    sensor, sampler = view.sensor("perspective"), mi.load_dict({"type": "independent"})
    axis, origin = view.to_world[:3, 2], view.to_world[:3, 3]
    for number, (row, y), x in product(range(len(points)), enumerate(rows), range(width)):
        at = mi.Point2f((x + points[number][0]) / width, (y + points[number][1]) / height)
        ray, _ = sensor.sample_ray(0.0, 0.5, at, mi.Point2f(0.5))
        sampler.seed(seed * 1_000_003 + (number * height + y) * width + x)
        for layer, (rgb, place) in enumerate(_along_ray(scene, ray, sampler, layers, spp)):
            color[number, layer, row, x] = [*rgb, 1.0]
            if place is not None:
                depth[number, layer, row, x] = axis @ (np.array(place) - origin)
    return color, depth


def _along_ray(scene: Any, ray: Any, sampler: Any, layers: int, spp: int) -> Iterator[tuple[Any, Any]]:
    """Yield the colour and the place of each surface that a ray meets; the environment has none."""
    found = 0
    while found < layers:
        hit = scene.ray_intersect(ray)
        is_surface = hit.is_valid()
        if not is_surface and scene.environment() is None:
            return
        is_mask = is_surface and mi.has_flag(hit.bsdf(ray).flags(), mi.BSDFFlags.Null)
        if is_mask and sum(hit.bsdf(ray).eval_null_transmission(hit)) > _PASSING * 3.0:
            ray = hit.spawn_ray(ray.d)
            continue
        if not is_surface or hit.wi.z > 0.0 or is_mask or found == 0:
            rgb = mi.Color3f(0.0)
            for _ in range(spp):
                rgb += scene.integrator().sample(scene, sampler, ray)[0] / spp
            yield rgb, hit.p if is_surface else None
            found += 1
        if not is_surface:
            return
        ray = hit.spawn_ray(ray.d)


def _peel_wavefront(
    scene: Any,
    view: View,
    layers: int,
    spp: int,
    seed: int,
    rows: range,
    points: Sequence[tuple[float, float]],
) -> Layers:
    import drjit as dr

    width, height = view.size
    shape = (layers, len(points), len(rows), width)
    count = len(points) * len(rows) * width
    index = dr.arange(mi.UInt32, count)
    # Arrays, not numbers, which would be written into kernels that then serve one band of rows.
    x, y = (mi.Float([point[axis] for point in points]) for axis in range(2))
    number, row = index // (len(rows) * width), index // width % len(rows) + dr.opaque(mi.UInt32, rows.start)
    at = mi.Point2f(
        (index % width + dr.gather(mi.Float, x, number)) / width,
        (row + dr.gather(mi.Float, y, number)) / height,
    )
    ray, _ = view.sensor("perspective").sample_ray(0.0, 0.5, at, mi.Point2f(0.5))
    ray = mi.Ray3f(ray)
    axis, origin = view.to_world[:3, 2], view.to_world[:3, 3]
    has_environment = scene.environment() is not None

    color = np.zeros((layers, count, 4), np.float32)
    depth = np.full((layers, count), np.inf, np.float32)
    found = np.zeros(count, np.int64)
    alive = mi.Bool(True)
    while True:
        hit = scene.ray_intersect(ray, alive)
        surface = alive & hit.is_valid()
        bsdf = hit.bsdf(ray)
        mask = surface & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null)
        passing = mask & (dr.mean(bsdf.eval_null_transmission(hit, mask)) > _PASSING)
        outside = surface & ~passing & ((hit.wi.z > 0.0) | mask | mi.Bool(found == 0))
        counts = outside | (alive & ~surface) if has_environment else outside
        rgb = _radiance(scene, ray, counts, count, spp, seed)
        now, solid = np.array(counts), np.array(outside)
        color[found[now], now, :3] = rgb[now]
        color[found[now], now, 3] = 1.0
        depth[found[solid], solid] = (np.array(hit.p).T[solid] - origin) @ axis
        found += now
        alive = surface & mi.Bool(found < layers)
        ray = hit.spawn_ray(ray.d)
        dr.eval(ray, alive)
        if not dr.any(alive):
            return color.reshape(*shape, 4).swapaxes(0, 1), depth.reshape(shape).swapaxes(0, 1)


def _radiance(scene: Any, ray: Any, active: Any, count: int, spp: int, seed: int) -> NDArray[np.float32]:
    import drjit as dr

    if spp == 0:
        return np.zeros((count, 3), np.float32)
    sampler = mi.load_dict({"type": "independent"})
    total = mi.Color3f(0.0)
    for pass_index in range(spp):
        sampler.seed(seed * 100_003 + pass_index, count)
        total += scene.integrator().sample(scene, sampler, ray, active=active)[0]
        dr.eval(total)
    return np.array(total / spp).T
