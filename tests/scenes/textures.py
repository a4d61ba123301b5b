"""Textures made with NumPy: periodic, rich in detail, and limited in bandwidth so that they do not alias."""

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float32]


def noise(height: int, width: int, seed: int, cycles: tuple[float, float] = (2.0, 128.0)) -> Picture:
    """Make noise in [0, 1] with a 1/f spectrum between two frequencies, in cycles across the picture."""
    spectrum = np.fft.rfft2(np.random.default_rng(seed).standard_normal((height, width)))
    frequency = np.hypot(np.fft.fftfreq(height, 1 / height)[:, None], np.fft.rfftfreq(width, 1 / width))
    inside = (frequency >= cycles[0]) & (frequency <= cycles[1])
    filtered = np.fft.irfft2(np.where(inside, spectrum / np.maximum(frequency, 1.0), 0.0), s=(height, width))
    return np.clip(0.5 + filtered / (5.0 * filtered.std()), 0.0, 1.0).astype(np.float32)


def wave(height: int, width: int, across: int, down: int, hardness: float = 3.0) -> Picture:
    """Make stripes with whole numbers of periods across and down (so that tiles join) and softened steps."""
    y, x = np.mgrid[0:height, 0:width]
    phase = 2.0 * np.pi * (across * (x + 0.5) / width + down * (y + 0.5) / height)
    return (0.5 + 0.5 * np.tanh(hardness * np.sin(phase))).astype(np.float32)


def checks(height: int, width: int, across: int, down: int, hardness: float = 4.0) -> Picture:
    """Make a checkerboard with softened steps."""
    signed_x = 2.0 * wave(height, width, across, 0, hardness) - 1.0
    signed_y = 2.0 * wave(height, width, 0, down, hardness) - 1.0
    return 0.5 + 0.5 * signed_x * signed_y


def blend(weight: Picture, low: object, high: object) -> Picture:
    """Mix two colours, or two (H, W, 3) pictures, by a weight in [0, 1]."""
    w = weight[..., None]
    return ((1.0 - w) * np.asarray(low, np.float32) + w * np.asarray(high, np.float32)).astype(np.float32)


def weathered(picture: Picture, seed: int, contrast: float = 0.8) -> Picture:
    """Multiply noise of many sizes into a picture."""
    height, width = picture.shape[:2]
    coarse = noise(height, width, seed, (1.0, height / 24.0))
    fine = noise(height, width, seed + 1, (height / 24.0, height / 5.0))
    factor = 1.0 + contrast * (0.6 * coarse + 0.4 * fine - 0.5) * 2.0
    return (picture * np.maximum(factor, 0.02)[..., None]).astype(np.float32)


def scattered(size: int, seed: int) -> Picture:
    """Make blobs of many hues: a noise shared by the channels, mixed with one of each channel's own."""
    shared = noise(size, size, seed, (2.0, size / 8.0))
    channels = [0.4 * shared + 0.6 * noise(size, size, seed + i, (2.0, size / 14.0)) for i in (1, 2, 3)]
    return np.stack([np.clip(2.0 * c - 0.5, 0.02, 1.0) for c in channels], axis=-1).astype(np.float32)
