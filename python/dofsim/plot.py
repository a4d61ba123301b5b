"""Plots of lenses, openings and pictures, drawn with matplotlib (the extra ``plot``).

Every function returns a figure, which a notebook shows and ``figure.savefig("name.png")`` writes. The
figures are outside matplotlib's list of open ones: nothing has to be closed. Where there is an argument
``ax``, the plot goes there instead, into a figure of your own.

Pictures of floats are linear light, shown encoded as sRGB; pictures of integers are shown as they are.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _compare, _display, falsecolor, metrics
from ._blur import Blur, in_focus, metres
from ._dofsim import Aperture, Lens
from ._dofsim import coc as radius_of
from ._drawing import NEAR_COLOR, SHARP_RADIUS_PX, Curve
from ._extras import missing

try:
    from matplotlib.axes import Axes
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
except ImportError as error:
    raise ImportError(missing("plots need", "matplotlib", "plot")) from error

if TYPE_CHECKING:
    from matplotlib.image import AxesImage

    from ._dofsim import _DepthKind, _Invalid

__all__ = ["aperture", "coc", "compare", "depth_of_field", "focal_stack", "pictures"]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)


_FAR_COLOR = "#2f62a8"
_COC = ListedColormap(falsecolor.false_color(np.linspace(-1.0, 1.0, 256), 1.0) / 255.0)
_HEAT = ListedColormap(falsecolor.heat(np.linspace(0.0, 1.0, 256)) / 255.0)
# Regions beside each other: distinct without colour vision, after Okabe and Ito.
_REGIONS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")


class _Shown(Figure):
    """A figure that a notebook shows without pyplot."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def coc(
    depth: NDArray[np.floating[Any]],
    lens: Lens,
    *,
    limit_px: float | None = None,
    ax: Axes | None = None,
    depth_kind: _DepthKind = "z",
    near: float | None = None,
    far: float | None = None,
    invalid: _Invalid = "raise",
) -> Figure:
    """Return a figure of the circles of confusion of a picture: near red, far blue, in focus light.

    Parameters
    ----------
    depth : ndarray
        Shape (H, W), as for `dofsim.coc`.
    lens : Lens
        The lens.
    limit_px : float, optional
        The radius in pixels at which the colours end; by default the largest in the picture, rounded up.
    ax : matplotlib.axes.Axes, optional
        Where to draw.
    depth_kind, near, far, invalid : optional
        As for `dofsim.coc`.

    Returns
    -------
    matplotlib.figure.Figure
        The map with its scale: signed radius in pixels.

    Raises
    ------
    ValueError
        If the depth is not as `dofsim.coc` wants it, or the limit is not positive.

    Examples
    --------
    >>> import dofsim, dofsim.plot
    >>> import numpy as np
    >>> lens = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0)
    >>> depth = np.linspace(1.0, 9.0, 64 * 48).reshape(48, 64)
    >>> dofsim.plot.coc(depth, lens).axes[1].get_ylabel()
    'radius of the circle of confusion, px'
    """
    radius = radius_of(depth, lens, depth_kind=depth_kind, near=near, far=far, invalid=invalid)
    limit = falsecolor.round_limit(radius) if limit_px is None else limit_px
    if not limit > 0.0 or not math.isfinite(limit):
        raise ValueError(f"limit_px must be positive and finite; got {limit_px}")
    figure, ax = _axes(ax, _size_of(radius, width=6.0, beside=1.1))
    image = _show(ax, radius, cmap=_COC, vmin=-limit, vmax=limit)
    bar = figure.colorbar(image, ax=ax, ticks=np.linspace(-limit, limit, 5), fraction=0.05, pad=0.03)
    bar.set_label("radius of the circle of confusion, px")
    bar.ax.set_title("far", fontsize="small", color=_FAR_COLOR)
    bar.ax.set_xlabel("near", fontsize="small", color=NEAR_COLOR)
    ax.set_title(f"Focused at {in_focus(lens)}", loc="left", fontsize="medium")
    return figure


def depth_of_field(
    lens: Lens,
    *,
    size: tuple[int, int] = (1920, 1080),
    sharp_radius_px: float = SHARP_RADIUS_PX,
    ax: Axes | None = None,
) -> Figure:
    """Return a figure of the circle of confusion against distance, with what is sharp.

    Parameters
    ----------
    lens : Lens
        A metric lens.
    size : tuple of int, optional
        Width and height in pixels of the picture that the blur is counted in.
    sharp_radius_px : float, optional
        The largest radius of the circle of confusion in pixels that counts as sharp.
    ax : matplotlib.axes.Axes, optional
        Where to draw.

    Returns
    -------
    matplotlib.figure.Figure
        Radius against the logarithm of the distance on the optical axis; the near and the far limit, and the
        hyperfocal distance.

    Raises
    ------
    ValueError
        If the lens is one over relative disparity, or a number is not positive.

    Examples
    --------
    >>> import dofsim, dofsim.plot
    >>> lens = dofsim.Lens.from_camera(focal_length_mm=50, f_number=1.8, focus_distance=3.0)
    >>> dofsim.plot.depth_of_field(lens).axes[0].get_title(loc="left")
    'sharp 2.89 m to 3.12 m, hyperfocal 75.3 m'
    """
    if not sharp_radius_px > 0.0 or not math.isfinite(sharp_radius_px):
        raise ValueError(f"sharp_radius_px must be positive and finite; got {sharp_radius_px}")
    blur = Blur.of(lens, size)
    curve = Curve.of(blur, 512, sharp_radius_px)
    distance, radius, top = curve.distance, curve.radius, curve.top
    nearest, farthest = curve.sharp
    figure, ax = _axes(ax, (6.4, 3.6))
    ax.set_xscale("log")
    ax.set_xlim(distance[0], distance[-1])
    ax.set_ylim(0.0, top)

    ax.axvspan(max(nearest, distance[0]), min(farthest, distance[-1]), color="#e9e6df", zorder=0)
    ax.axhline(sharp_radius_px, color="0.55", linewidth=0.8, linestyle=":")
    for side, color, name in (
        (radius <= 0.0, NEAR_COLOR, "in front of"),
        (radius >= 0.0, _FAR_COLOR, "behind"),
    ):
        ax.plot(distance[side], np.abs(radius[side]), color=color, linewidth=2.2, label=f"{name} the focus")
    hyperfocal = blur.hyperfocal(sharp_radius_px)
    if distance[0] < hyperfocal < distance[-1]:
        ax.axvline(hyperfocal, color="0.35", linewidth=1.0, linestyle="--")
        away, right = 4, "left"
        if hyperfocal > 0.5 * distance[-1]:
            away, right = -4, "right"
        ax.annotate(
            "hyperfocal",
            (hyperfocal, 0.96 * top),
            xytext=(away, 0),
            textcoords="offset points",
            ha=right,
            va="top",
            fontsize="small",
            color="0.35",
        )
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_xlabel("distance, m")
    ax.set_ylabel(f"radius of the blur, px of {size[0]}")
    sharp = f"sharp {metres(nearest)} to {metres(farthest)}, hyperfocal {metres(hyperfocal)}"
    ax.set_title(sharp, loc="left", fontsize="medium", pad=22)
    ax.legend(loc="lower left", bbox_to_anchor=(-0.01, 0.99), ncols=2, frameon=False, fontsize="small")
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def aperture(aperture: Aperture, *, radius_px: float = 96.0) -> Figure:
    """Return a figure of what an aperture makes of a point of light behind the focus and in front of it.

    Parameters
    ----------
    aperture : Aperture
        The opening.
    radius_px : float, optional
        Radius of the circle of confusion in pixels.

    Returns
    -------
    matplotlib.figure.Figure
        Both pictures, each as bright as its brightest pixel allows.

    Raises
    ------
    ValueError
        If the radius is not between 2 and 512.

    Examples
    --------
    >>> import dofsim, dofsim.plot
    >>> figure = dofsim.plot.aperture(dofsim.Aperture(blades=6, rotation=15.0), radius_px=16)
    >>> [ax.get_title() for ax in figure.axes]
    ['behind the focus', 'in front of it']
    """
    points = _display.points_of_light(aperture, radius_px)
    figure = _figure((6.0, 3.5))
    for place, (title, point) in enumerate(zip(("behind the focus", "in front of it"), points, strict=True)):
        ax = figure.add_subplot(1, 2, place + 1)
        _show(ax, _codes(point))
        ax.set_title(title, fontsize="medium")
    figure.suptitle(repr(aperture), fontsize="small", family="monospace")
    return figure


def compare(
    result: NDArray[Any],
    reference: NDArray[Any],
    *,
    masks: Mapping[str, NDArray[np.bool_]] | None = None,
    border: int = 0,
    names: tuple[str, str] = ("dofsim", "reference"),
) -> Figure:
    """Return a figure of two pictures, where they differ, their regions and the numbers.

    Parameters
    ----------
    result, reference : ndarray
        Linear pictures of one shape, (H, W) or (H, W, 3).
    masks : mapping of str to ndarray of bool, optional
        Regions of shape (H, W) by name, as from `dofsim.metrics.regions`; by default only the whole picture.
    border : int, optional
        Pixels along each edge that no number counts.
    names : tuple of str, optional
        What the two pictures are called.

    Returns
    -------
    matplotlib.figure.Figure
        The two pictures; the error as heat and the regions as colours; PSNR, SSIM and FLIP of each region, by
        the conventions of `dofsim.metrics`.

    Raises
    ------
    ValueError
        If shapes differ, or there is nothing to compare.
    ImportError
        If the packages that measure are missing.

    Examples
    --------
    >>> import dofsim.plot
    >>> import numpy as np
    >>> grey = np.full((32, 48, 3), 0.2)
    >>> len(dofsim.plot.compare(grey, 1.1 * grey).axes)
    5
    """
    error = metrics.error_map(result, reference)
    regions = {"overall": np.ones(error.shape, bool)} if masks is None else dict(masks)
    numbers = _compare.measure_regions(result, reference, regions, border=border)

    width, height = _size_of(error, width=3.9)
    below = 0.5 + 0.26 * len(numbers)
    figure = _figure((2 * width + 1.0, 2 * (height + 0.4) + below))
    grid = figure.add_gridspec(3, 2, height_ratios=(height, height, below))
    for column, (name, picture) in enumerate(zip(names, (result, reference), strict=True)):
        ax = figure.add_subplot(grid[0, column])
        _show(ax, _codes(picture))
        ax.set_title(name, loc="left", fontsize="medium")
    ax = figure.add_subplot(grid[1, 0])
    image = _show(ax, error, cmap=_HEAT, vmin=0.0, vmax=max(float(error.max()), 1e-6))
    ax.set_title("difference of sRGB code values, of 1", loc="left", fontsize="medium")
    bar = ax.inset_axes((1.02, 0.0, 0.025, 1.0))
    figure.colorbar(image, cax=bar)
    ax = figure.add_subplot(grid[1, 1])
    _draw_regions(ax, regions, border)
    ax.set_title("regions", loc="left", fontsize="medium")
    _draw_numbers(figure.add_subplot(grid[2, :]), numbers, list(regions))
    return figure


def focal_stack(
    pictures: NDArray[Any] | Sequence[NDArray[Any]],
    distances: Sequence[float] | NDArray[np.floating[Any]],
    *,
    columns: int = 3,
) -> Figure:
    """Return a figure of the pictures of a focal stack beside each other.

    Parameters
    ----------
    pictures : ndarray or sequence of ndarray
        Shape (N, H, W, C) or (N, H, W), as `dofsim.Scene.focal_stack` returns them.
    distances : sequence of float
        What each is focused on, in metres.
    columns : int, optional
        How many there are in a row.

    Returns
    -------
    matplotlib.figure.Figure
        The pictures with their distances.

    Raises
    ------
    ValueError
        If there is not one distance to each picture, or no picture.

    Examples
    --------
    >>> import dofsim.plot
    >>> import numpy as np
    >>> figure = dofsim.plot.focal_stack(np.zeros((2, 24, 32, 3)), [1.0, 2.5])
    >>> figure.axes[1].get_title(loc="left")
    '2.5 m'
    """
    if len(pictures) != len(distances):
        raise ValueError(
            f"there must be as many distances as pictures; got {len(distances)}, {len(pictures)}"
        )
    return _draw_pictures(list(pictures), [metres(float(distance)) for distance in distances], columns)


def pictures(pictures: Mapping[str, NDArray[Any]], *, columns: int = 3) -> Figure:
    """Return a figure of pictures beside each other.

    Parameters
    ----------
    pictures : mapping of str to ndarray
        Pictures of one shape, (H, W) or (H, W, C), by what is written above them.
    columns : int, optional
        How many there are in a row.

    Returns
    -------
    matplotlib.figure.Figure
        The pictures with their titles.

    Raises
    ------
    ValueError
        If there is no picture.

    Examples
    --------
    >>> import dofsim.plot
    >>> import numpy as np
    >>> figure = dofsim.plot.pictures({"black": np.zeros((24, 32)), "white": np.ones((24, 32))})
    >>> figure.axes[1].get_title(loc="left")
    'white'
    """
    return _draw_pictures(list(pictures.values()), list(pictures), columns)


def _draw_pictures(pictures: Sequence[NDArray[Any]], titles: Sequence[str], columns: int) -> Figure:
    if not pictures:
        raise ValueError("pictures must be at least one")
    if columns < 1:
        raise ValueError(f"columns must be greater than 0; got {columns}")
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    width, height = _size_of(np.asarray(pictures[0]), width=min(8.4 / columns, 5.0))
    figure = _figure((columns * width, rows * (height + 0.3)))
    for place, (title, picture) in enumerate(zip(titles, pictures, strict=True)):
        ax = figure.add_subplot(rows, columns, place + 1)
        _show(ax, _codes(picture))
        ax.set_title(title, loc="left", fontsize="medium")
    return figure


def _figure(inches: tuple[float, float]) -> Figure:
    return _Shown(figsize=inches, dpi=130, layout="constrained", facecolor="white")


def _axes(ax: Axes | None, inches: tuple[float, float]) -> tuple[Figure, Axes]:
    """Give the axes to draw into with their figure, a new one unless the caller has some."""
    if ax is None:
        figure = _figure(inches)
        return figure, figure.add_subplot()
    figure = ax.figure if isinstance(ax.figure, Figure) else ax.figure.figure
    return figure, ax


def _size_of(picture: NDArray[Any], *, width: float, beside: float = 0.0) -> tuple[float, float]:
    """Give a size in inches with the sides of a picture, and room beside it."""
    rows, columns = picture.shape[:2]
    return width, (width - beside) * rows / columns + (0.5 if beside else 0.0)


def _codes(picture: NDArray[Any]) -> NDArray[np.uint8]:
    """Give what a screen shows of a picture: (H, W, 3) sRGB code values."""
    pixels = np.asarray(picture)
    if pixels.ndim == 3 and pixels.shape[-1] in (2, 4):
        pixels = pixels[..., :-1]
    if np.issubdtype(pixels.dtype, np.integer):
        pixels = (pixels / (np.iinfo(pixels.dtype).max / 255.0)).round().astype(np.uint8)
        pixels = pixels if pixels.ndim == 3 else pixels[..., np.newaxis]
        return pixels if pixels.shape[-1] == 3 else np.repeat(pixels, 3, axis=-1)
    pixels = pixels[..., 0] if pixels.ndim == 3 and pixels.shape[-1] == 1 else pixels
    return _compare.shown(pixels)


def _show(ax: Axes, pixels: NDArray[Any], **colors: Any) -> AxesImage:
    """Show pixels without a frame; drawn smaller, they are averaged."""
    ax.set_axis_off()
    return ax.imshow(pixels, interpolation="antialiased", **colors)


def _draw_regions(ax: Axes, regions: Mapping[str, NDArray[np.bool_]], border: int) -> None:
    """Colour what each pixel counts for; a later region lies over an earlier one."""
    shape = next(iter(regions.values())).shape
    colors = np.full((*shape, 3), 1.0)
    for index, mask in enumerate(regions.values()):
        code = _REGIONS[index % len(_REGIONS)].lstrip("#")
        colors[mask] = [int(code[i : i + 2], 16) / 255.0 for i in (0, 2, 4)]
    inside = np.zeros(shape, bool)
    inside[border : shape[0] - border, border : shape[1] - border] = True
    colors[~inside] = 0.85
    _show(ax, colors)


def _draw_numbers(ax: Axes, numbers: Mapping[str, _compare.Distance], order: Sequence[str]) -> None:
    """Write a row for each region, with its colour."""
    ax.set_axis_off()
    rows = [
        [name, f"{distance.psnr:.2f}", f"{distance.ssim:.4f}", f"{distance.flip:.4f}"]
        for name, distance in numbers.items()
    ]
    table = ax.table(
        rows,
        colLabels=["", "PSNR, dB", "SSIM", "FLIP"],
        colWidths=[0.2, 0.12, 0.12, 0.12],
        loc="center",
        edges="open",
        cellLoc="right",
    )
    table.auto_set_font_size(False)
    table.set_fontsize(10)
    table.scale(1.0, 1.35)
    for row, name in enumerate(numbers):
        table[row + 1, 0].get_text().set_color(_REGIONS[order.index(name) % len(_REGIONS)])
        table[row + 1, 0].get_text().set_fontweight("bold")
