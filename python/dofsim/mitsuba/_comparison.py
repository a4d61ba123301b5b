"""dofsim beside Mitsuba's own thin lens."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from html import escape
from math import ceil
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

import dofsim

from .. import _compare, _shown, io, metrics
from .._files import StrPath
from .._progress import bar
from ._capture import Capture, capture_of, check_views, squared, warn_of_specular_shapes
from ._variant import check_variant
from ._view import View, load_scene, render

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Comparison", "compare"]


@dataclass(frozen=True, eq=False)
class Comparison:
    """dofsim's picture of a scene, Mitsuba's, and how far they are apart; ``print`` it, or `plot` it.

    Attributes
    ----------
    picture, reference : ndarray of float32
        dofsim's and Mitsuba's, (H, W, 3), linear light.
    capture : Capture
        What dofsim was given.
    masks : dict of str to ndarray of bool
        The regions that are measured apart, see `dofsim.metrics.regions`.
    distances : dict of str to Distance
        PSNR, SSIM and FLIP of each region.
    one_layer : Distance, optional
        That of the whole picture without what the further views saw, if there are some.
    noise : Distance, optional
        From one half of the reference's samples to all of them: what no method can measurably fall below.
        None for a reference that was given.
    pinhole_noise : Distance
        The same of the pinhole picture that dofsim was given. Blur averages it out, and what is in focus
        keeps it.
    border : int
        Pixels along each edge that are not compared.
    seconds : dict of str to float
        What dofsim, the pinhole picture with its depth and with all further views, and the thin lens took.
    """

    picture: NDArray[np.float32]
    reference: NDArray[np.float32]
    capture: Capture
    masks: Mapping[str, NDArray[np.bool_]]
    distances: Mapping[str, _compare.Distance]
    noise: _compare.Distance | None
    pinhole_noise: _compare.Distance
    border: int
    seconds: Mapping[str, float]
    one_layer: _compare.Distance | None = None

    def __str__(self) -> str:
        """Return a table of the regions, and the times."""
        rows = {**self.distances, "pinhole's noise": self.pinhole_noise}
        if self.one_layer is not None:
            rows["overall, one layer"] = self.one_layer
        if self.noise is not None:
            rows["reference's noise"] = self.noise
        lines = [f"{'':18}{'PSNR, dB':>10}{'SSIM':>9}{'FLIP':>9}"]
        lines += [f"{name:18}{d.psnr:10.2f}{d.ssim:9.4f}{d.flip:9.4f}" for name, d in rows.items()]
        lines.append("; ".join(f"{name} {taken:.2f} s" for name, taken in self.seconds.items()))
        return "\n".join(lines)

    def __repr__(self) -> str:
        """Return the distance of the whole picture."""
        height, width = self.picture.shape[:2]
        return f"<Comparison of {width} x {height} pixels: {self.distances['overall']}>"

    def _repr_html_(self) -> str:
        """Return both pictures, their difference and the table."""
        difference = _shown.grey(-metrics.error_map(self.picture, self.reference))
        return f"{_shown.html([self.picture, self.reference, difference])}<pre>{escape(str(self))}</pre>"

    def plot(self) -> Figure:
        """Return a figure of both pictures, their difference, the regions and the numbers.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.
        """
        from .. import plot

        names = ("dofsim", "Mitsuba's thinlens")
        return plot.compare(self.picture, self.reference, masks=self.masks, border=self.border, names=names)


def compare(
    scene: Any,
    spp: int = 256,
    *,
    layers: int = 1,
    supersample: int = 1,
    views: int = 0,
    pinhole_spp: int = 64,
    border: int | None = None,
    sensor: int = 0,
    seed: int = 0,
    reference: ArrayLike | StrPath | None = None,
    progress: bool | None = None,
    **options: Any,
) -> Comparison:
    """Return a scene through Mitsuba's thin lens and through dofsim's, and how far they are apart.

    Parameters
    ----------
    scene : mitsuba.Scene, dict or path
        The scene, with a ``thinlens`` sensor.
    spp : int, optional
        The thin lens's samples a pixel; half of them have other random numbers than the rest, which tells the
        reference's noise.
    layers, supersample, views, sensor, seed : int, optional
        As for `rgbd`. With `views`, the picture without them is measured, too.
    pinhole_spp : int, optional
        What `rgbd` calls `spp`.
    border : int, optional
        Pixels along each edge that are not compared, as the lens sees there what the picture does not hold.
        By default the largest radius of the blur, at most an eighth of the shorter side.
    reference : array_like or path, optional
        A picture through the thin lens that has been rendered already, in place of rendering one: linear
        light, shape (H, W, 3), or a file of it. `spp` then does not matter.
    progress : bool, optional
        Whether a bar shows how far Mitsuba is. By default in terminals and notebooks.
    **options
        As for `dofsim.render`: ``method``, ``device`` and so on.

    Returns
    -------
    Comparison
        Pictures, numbers and times.

    Raises
    ------
    TypeError, ValueError
        As `rgbd`; or if the sensor has no lens, or the reference has another size.
    ImportError
        If the packages that measure are missing, the extra ``metrics``.

    Examples
    --------
    >>> from dofsim.mitsuba import compare
    >>> film = {"type": "hdrfilm", "width": 48, "height": 32}
    >>> camera = {"type": "thinlens", "fov": 40, "aperture_radius": 0.1, "focus_distance": 3, "film": film}
    >>> ball = {"type": "sphere", "center": [0, 0, 4], "emitter": {"type": "area", "radiance": 1.0}}
    >>> scene = {"type": "scene", "integrator": {"type": "path"}, "camera": camera, "ball": ball}
    >>> comparison = compare(scene, spp=32, pinhole_spp=16)
    >>> comparison.distances["overall"].psnr > 25
    True
    """
    if spp < 2:
        raise ValueError(f"spp must be at least 2; got {spp}")
    check_variant()
    loaded = load_scene(scene)
    view = View.of(loaded, sensor)
    if view.aperture_radius == 0.0:
        raise ValueError(f"sensor {sensor} must be a thinlens to be compared with")

    check_views(views, layers, view, sensor)
    warn_of_specular_shapes(loaded)
    given = None if reference is None else _read_reference(reference, view.size)
    finer = view.finer(supersample)
    samples = {
        "pinhole": (1 + views) * squared(pinhole_spp) * (pinhole_spp > 1 or layers == 1),
        "pinhole's halves": 2 * squared(-(-pinhole_spp // 2)),
    }
    total = sum(samples.values()) * finer.size[0] * finer.size[1]
    if given is None:
        total += 2 * squared(-(-spp // 2)) * view.size[0] * view.size[1]
    with bar(total, "Mitsuba", shown=progress) as advance:
        start = time.perf_counter()
        capture = capture_of(
            loaded,
            view,
            sensor,
            spp=pinhole_spp,
            layers=layers,
            supersample=supersample,
            views=views,
            seed=seed,
            advance=advance,
        )
        captured = time.perf_counter()
        picture = capture.render(**options)[..., :3]
        rendered = time.perf_counter()
        halves = [] if given is not None else _halves(loaded, view, "thinlens", spp, seed, advance)
        traced = time.perf_counter()
        pinholes = _halves(loaded, finer, "perspective", pinhole_spp, seed, advance)

    pinholes = [_averaged(one, supersample) for one in pinholes]
    truth = given if given is not None else 0.5 * (halves[0] + halves[1])
    first = capture.depth if capture.depth.ndim == 2 else capture.depth[0]
    # The pixel of the output is seen at its middle, or next to it.
    coc = dofsim.coc(first[supersample // 2 :: supersample, supersample // 2 :: supersample], capture.lens)
    if border is None:
        border = min(ceil(float(np.abs(coc).max())), min(coc.shape) // 8)
    masks = metrics.regions(coc)
    taken = f"pinhole, {views} views and depths" if views else "pinhole and depth"
    single = None
    if views:
        alone = replace(capture, color=capture.color[0, ..., :3], depth=first)
        single = _compare.measure(alone.render(**options), truth, border=border)
    return Comparison(
        picture=picture,
        reference=truth,
        capture=capture,
        masks=masks,
        distances=_compare.measure_regions(picture, truth, masks, border=border),
        noise=_compare.measure(halves[0], truth, border=border) if halves else None,
        pinhole_noise=_compare.measure(pinholes[0], 0.5 * (pinholes[0] + pinholes[1]), border=border),
        border=border,
        seconds={
            "dofsim": rendered - captured,
            taken: captured - start,
            **({"thin lens": traced - rendered} if halves else {}),
        },
        one_layer=single,
    )


def _halves(
    scene: Any,
    view: View,
    kind: Literal["perspective", "thinlens"],
    spp: int,
    seed: int,
    advance: Callable[[int], object],
) -> list[NDArray[np.float32]]:
    """Render a picture twice, each with half of the samples and other random numbers."""
    each = squared(-(-spp // 2))
    return [render(scene, view, kind, spp=each, seed=seed + half, advance=advance) for half in (1, 2)]


def _averaged(picture: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Average squares of pixels."""
    height, width, channels = picture.shape
    blocks = picture.reshape(height // factor, factor, width // factor, factor, channels)
    means: NDArray[np.float32] = blocks.mean(axis=(1, 3), dtype=np.float32)
    return means


def _read_reference(reference: ArrayLike | StrPath, size: tuple[int, int]) -> NDArray[np.float32]:
    """Read a picture of linear light of this width and height."""
    if isinstance(reference, str | os.PathLike):
        pixels = _compare.opaque(io.read_color(reference))
    else:
        pixels = np.asarray(reference, np.float32)
    if pixels.shape not in ((*size[::-1], 3), (*size[::-1], 4)):
        raise ValueError(
            f"reference must have the scene's size, {(*size[::-1], 3)}; got shape {pixels.shape}"
        )
    return np.ascontiguousarray(pixels[..., :3])
