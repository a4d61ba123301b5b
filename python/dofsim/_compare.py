"""Two pictures and how far they are apart, as numbers and as a panel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import _panel, io, metrics


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


def measure(a: NDArray[np.float32], b: NDArray[np.float32], *, border: int = 0) -> Distance:
    """Measure the distance of two pictures of linear light, shape (H, W) or (H, W, 3)."""
    return Distance(
        metrics.psnr(a, b, border=border),
        metrics.ssim(a, b, border=border),
        metrics.flip(a, b, border=border),
    )


def opaque(image: io.Image) -> NDArray[np.float32]:
    """Give linear light, shape (H, W) or (H, W, 3); what is not covered is black."""
    values = image.to_linear()
    if image.alpha != "none":
        values = values[..., :-1]
    return values[..., 0] if values.ndim == 3 and values.shape[-1] == 1 else values


def shown(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Give the sRGB code values of linear light as (H, W, 3)."""
    codes = np.rint(metrics.srgb(linear) * 255).astype(np.uint8)
    return codes if codes.ndim == 3 else np.repeat(codes[..., np.newaxis], 3, axis=-1)


def difference_tile(a: NDArray[np.float32], b: NDArray[np.float32], title: str) -> _panel.Tile:
    """Show the difference of two pictures as heat, from black (equal) to light (the largest)."""
    error = metrics.error_map(a, b)
    top = max(float(error.max()), 1e-6)
    stops = np.array([[0, 0, 0], [90, 20, 110], [220, 70, 70], [254, 190, 110], [252, 253, 191]], float)
    places = np.linspace(0.0, 1.0, len(stops))

    def heat(values: NDArray[np.floating]) -> NDArray[np.uint8]:
        channels = [np.interp(values, places, stops[:, channel]) for channel in range(3)]
        colors: NDArray[np.uint8] = np.rint(np.stack(channels, axis=-1)).astype(np.uint8)
        return colors

    ticks = [(0.0, "0"), (0.5, f"{top / 2:.3g}"), (1.0, f"{top:.3g} of 1")]
    return _panel.Tile(title, heat(error / top), _panel.Scale(heat(np.linspace(0.0, 1.0, 256)), ticks))
