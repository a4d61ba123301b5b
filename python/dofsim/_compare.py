"""Two pictures and how far they are apart, as numbers and as a panel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _drawing, _panel, falsecolor, io, metrics


@dataclass(frozen=True)
class Distance:
    """How far one picture is from another.

    Attributes
    ----------
    psnr : float
        Peak signal-to-noise ratio in decibels; higher is closer.
    ssim : float
        Structural similarity; 1 is equal.
    flip : float
        Mean of FLIP; 0 is equal.
    """

    psnr: float
    ssim: float
    flip: float

    def __str__(self) -> str:
        """Return the three on one line."""
        return f"PSNR {self.psnr:.2f} dB, SSIM {self.ssim:.4f}, FLIP {self.flip:.4f}"


def measure(
    a: NDArray[Any], b: NDArray[Any], *, border: int = 0, mask: NDArray[np.bool_] | None = None
) -> Distance:
    """Measure the distance of two pictures of linear light, shape (H, W) or (H, W, 3)."""
    return Distance(
        metrics.psnr(a, b, border=border, mask=mask),
        metrics.ssim(a, b, border=border, mask=mask),
        metrics.flip(a, b, border=border, mask=mask),
    )


def measure_regions(
    a: NDArray[Any], b: NDArray[Any], regions: Mapping[str, NDArray[np.bool_]], *, border: int = 0
) -> dict[str, Distance]:
    """Measure the distance in each region that has a pixel inside the border."""
    inside = np.s_[border : a.shape[0] - border, border : a.shape[1] - border]
    return {
        name: measure(a, b, border=border, mask=mask) for name, mask in regions.items() if mask[inside].any()
    }


def opaque(image: io.Image) -> NDArray[np.float32]:
    """Give linear light, shape (H, W) or (H, W, 3); what is not covered is black."""
    values = image.to_linear()
    if image.alpha != "none":
        values = values[..., :-1]
    return values[..., 0] if values.ndim == 3 and values.shape[-1] == 1 else values


def shown(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Give the sRGB code values of linear light as (H, W, 3)."""
    codes = _drawing.codes(linear)
    return codes if codes.ndim == 3 else np.repeat(codes[..., np.newaxis], 3, axis=-1)


def difference_tile(a: NDArray[np.float32], b: NDArray[np.float32], title: str) -> _panel.Tile:
    """Show the difference of two pictures as heat, from black (equal) to light (the largest)."""
    error = metrics.error_map(a, b)
    top = max(float(error.max()), 1e-6)
    ticks = [(0.0, "0"), (0.5, f"{top / 2:.3g}"), (1.0, f"{top:.3g} of 1")]
    scale = _panel.Scale(falsecolor.heat(np.linspace(0.0, 1.0, 256)), ticks)
    return _panel.Tile(title, falsecolor.heat(error / top), scale)
