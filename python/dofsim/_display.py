"""What a notebook shows of a lens and of an opening: HTML that needs no script and nothing from outside."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable
from html import escape
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ._blur import Blur, in_focus, metres
from ._dofsim import Aperture, Lens, encode_png, render
from ._drawing import NEAR_COLOR, SHARP_RADIUS_PX, Curve, codes

T = TypeVar("T")

# The picture that a lens is described for.
_SIZE = 1920, 1080
_CHART = 360, 110


def lens_html(lens: Lens) -> str:
    """Give the words of a lens as a table, and for a metric one its blur against distance."""
    return _or_words_alone(lens, _lens_html)


def aperture_html(aperture: Aperture) -> str:
    """Give the words of an opening, and what it makes of a point of light."""
    return _or_words_alone(aperture, _aperture_html)


def _or_words_alone(setting: T, html: Callable[[T], str]) -> str:
    """Show a setting; the words alone where its numbers are too extreme to draw.

    Notebooks ask for it unasked, so it is never an error.
    """
    try:
        with np.errstate(all="raise", under="ignore"):
            return html(setting)
    except (ValueError, ArithmeticError) as error:
        return f"<div><code>{escape(repr(setting))}</code><br>No picture of it: {escape(str(error))}</div>"


def _lens_html(lens: Lens) -> str:
    rows = "".join(
        f"<tr><th style='text-align:left;font-weight:600'>{escape(name)}</th>"
        f"<td style='text-align:left'>{escape(value)}</td></tr>"
        for name, value in _facts(lens)
    )
    chart = "" if not lens.aperture_radius else _chart(Blur.of(lens, _SIZE))
    return (
        f"<div><code>{escape(repr(lens))}</code>"
        f"<div style='display:flex;flex-wrap:wrap;gap:1.5em;align-items:center;margin-top:.5em'>"
        f"<table style='margin:0'>{rows}</table>{chart}</div></div>"
    )


def _aperture_html(aperture: Aperture) -> str:
    source = base64.b64encode(aperture_png(aperture)).decode()
    return (
        f"<div><code>{escape(repr(aperture))}</code><br>"
        f"<img alt='A point of light behind the focus, and one in front of it' style='margin-top:.5em' "
        f"src='data:image/png;base64,{source}'></div>"
    )


def aperture_png(aperture: Aperture) -> bytes:
    """Give a picture of a point of light behind the focus, and of one in front of it."""
    points = np.concatenate(points_of_light(aperture, 48.0), axis=1)
    return encode_png(codes(points))


def points_of_light(aperture: Aperture, radius_px: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Render a point behind the focus and one in front of it, the brightest pixel of each being 1."""
    if not 2.0 <= radius_px <= 512.0:
        raise ValueError(f"radius_px must be between 2 and 512; got {radius_px}")
    # Wide enough for the disc, and so that the picture's mirror image beyond its border stays outside.
    middle = math.ceil(1.2 * radius_px)
    side = 2 * middle + 1
    point = np.zeros((side, side), np.float32)
    point[middle, middle] = 1.0
    lens = Lens.from_disparity(strength_px=radius_px, focus=0.0)

    def seen(disparity: float) -> NDArray[np.float32]:
        depth = np.full(point.shape, disparity, np.float32)
        disc: NDArray[np.float32] = render(
            point, depth, lens, aperture=aperture, depth_kind="disparity", device="cpu"
        )
        disc /= disc.max()
        return disc

    return seen(-1.0), seen(1.0)


def _facts(lens: Lens) -> list[tuple[str, str]]:
    """Name what a photographer asks."""
    if lens.focus_distance is None:
        strength = (
            f"{lens.strength_px:g} px"
            if lens.strength_percent is None
            else f"{lens.strength_percent:g} % of the width"
        )
        return [("focus", in_focus(lens)), ("blur radius", f"{strength} per unit of disparity")]
    facts = [
        ("focus", in_focus(lens)),
        ("field of view", f"{lens.fov:.4g}\N{DEGREE SIGN} along {lens.fov_axis}"),
    ]
    if not lens.aperture_radius:
        return [*facts, ("opening", "a pinhole: all is sharp")]
    blur = Blur.of(lens, _SIZE)
    nearest, farthest = blur.limits(SHARP_RADIUS_PX)
    return [
        *facts,
        ("opening", f"{2e3 * lens.aperture_radius:.3g} mm wide"),
        ("sharp", f"{metres(nearest)} to {metres(farthest)}"),
        ("hyperfocal", metres(blur.hyperfocal(SHARP_RADIUS_PX))),
        ("blur radius at \N{INFINITY}", f"{float(blur.radius_px(np.inf)):.3g} px of {_SIZE[0]}"),
    ]


def _chart(blur: Blur) -> str:
    """Draw the radius of the blur against the logarithm of the distance, with what is sharp."""
    width, height = _CHART
    floor = height - 18
    curve = Curve.of(blur, 120, SHARP_RADIUS_PX)
    distance, radius, top = curve.distance, curve.radius, curve.top

    def across(at: float) -> float:
        part = math.log(at / distance[0]) / math.log(distance[-1] / distance[0])
        return width * min(max(part, 0.0), 1.0)

    def line(side: NDArray[np.bool_], color: str) -> str:
        side &= np.abs(radius) <= top
        points = " ".join(
            f"{across(float(z)):.1f},{floor * (1.0 - abs(float(r)) / top):.1f}"
            for z, r in zip(distance[side], radius[side], strict=True)
        )
        return f"<polyline points='{points}' fill='none' stroke='{color}' stroke-width='2'/>"

    def mark(z: float, anchor: str) -> str:
        return f"<text x='{across(z):.0f}' y='{height - 4}' text-anchor='{anchor}'>{metres(z)}</text>"

    nearest, farthest = (across(limit) for limit in curve.sharp)
    marks = [mark(float(distance[0]), "start"), mark(float(distance[-1]), "end")]
    if blur.focus_disparity > 0.0:
        marks.append(mark(1.0 / blur.focus_disparity, "middle"))
    return (
        f"<svg role='img' aria-label='Blur against distance' width='{width}' height='{height}' "
        f"viewBox='0 0 {width} {height}' font-size='11' fill='currentColor' style='max-width:100%'>"
        f"<rect x='{nearest:.1f}' width='{max(farthest - nearest, 1.0):.1f}' height='{floor}' opacity='.15'/>"
        f"<line x1='0' y1='{floor}' x2='{width}' y2='{floor}' stroke='currentColor' opacity='.5'/>"
        f"{line(radius <= 0.0, NEAR_COLOR)}{line(radius >= 0.0, '#4a7fc8')}{''.join(marks)}</svg>"
    )
