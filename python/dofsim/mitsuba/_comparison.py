"""dofsim beside Mitsuba's own thin lens."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import dofsim

from .. import _compare, metrics
from ._capture import Capture, rgbd, squared
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
    noise : Distance
        From one half of the reference's samples to all of them: what no method can measurably fall below.
    border : int
        Pixels along each edge that are not compared.
    seconds : dict of str to float
        What dofsim, the pinhole picture with its depth, and the thin lens took.
    """

    picture: NDArray[np.float32]
    reference: NDArray[np.float32]
    capture: Capture
    masks: Mapping[str, NDArray[np.bool_]]
    distances: Mapping[str, _compare.Distance]
    noise: _compare.Distance
    border: int
    seconds: Mapping[str, float]

    def __str__(self) -> str:
        """Return a table of the regions, and the times."""
        rows = {**self.distances, "reference's noise": self.noise}
        lines = [f"{'':18}{'PSNR, dB':>10}{'SSIM':>9}{'FLIP':>9}"]
        lines += [f"{name:18}{d.psnr:10.2f}{d.ssim:9.4f}{d.flip:9.4f}" for name, d in rows.items()]
        lines.append("; ".join(f"{name} {taken:.2f} s" for name, taken in self.seconds.items()))
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw both pictures, their difference, the regions and the numbers with `dofsim.plot.compare`.

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
    pinhole_spp: int = 64,
    border: int | None = None,
    sensor: int = 0,
    seed: int = 0,
    **options: Any,
) -> Comparison:
    """Render a scene through Mitsuba's thin lens and through dofsim's, and measure how far they are apart.

    Parameters
    ----------
    scene : mitsuba.Scene, dict or path
        The scene, with a ``thinlens`` sensor.
    spp : int, optional
        The thin lens's samples a pixel; half of them have other random numbers than the rest, which tells the
        reference's noise.
    layers, supersample, sensor, seed : int, optional
        As for `rgbd`.
    pinhole_spp : int, optional
        What `rgbd` calls `spp`.
    border : int, optional
        Pixels along each edge that are not compared, as the lens sees there what the picture does not hold.
        By default the largest radius of the blur, at most an eighth of the shorter side.
    **options
        As for `dofsim.render`: ``method``, ``device`` and so on.

    Returns
    -------
    Comparison
        Pictures, numbers and times.

    Raises
    ------
    TypeError, ValueError
        As `rgbd`; or if the sensor has no lens.
    ImportError
        If the packages that measure are missing (``pip install dofsim[metrics]``).

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

    start = time.perf_counter()
    capture = rgbd(loaded, spp=pinhole_spp, layers=layers, supersample=supersample, sensor=sensor, seed=seed)
    captured = time.perf_counter()
    picture = capture.render(**options)[..., :3]
    rendered = time.perf_counter()
    halves = [
        render(loaded, view, "thinlens", spp=squared(-(-spp // 2)), seed=seed + half) for half in (1, 2)
    ]
    traced = time.perf_counter()

    reference = 0.5 * (halves[0] + halves[1])
    first = capture.depth if layers == 1 else capture.depth[0]
    # The pixel of the output is seen at its middle, or next to it.
    coc = dofsim.coc(first[supersample // 2 :: supersample, supersample // 2 :: supersample], capture.lens)
    if border is None:
        border = min(ceil(float(np.abs(coc).max())), min(coc.shape) // 8)
    masks = metrics.regions(coc)
    return Comparison(
        picture=picture,
        reference=reference,
        capture=capture,
        masks=masks,
        distances=_compare.measure_regions(picture, reference, masks, border=border),
        noise=_compare.measure(halves[0], reference, border=border),
        border=border,
        seconds={
            "dofsim": rendered - captured,
            "pinhole and depth": captured - start,
            "thin lens": traced - rendered,
        },
    )
