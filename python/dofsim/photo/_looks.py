"""What is done to a photograph: its depth refined, a lens for it, blur, and grain."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

import dofsim
from dofsim._relative import range_of

from ._shot import Photo, codes_of, light_of, opaque

# Widths of a 35 mm frame in millimetres, and the focal length that is taken for one that nobody has said.
_FRAME_MM = 36.0
_USUAL_FOCAL_MM = 50.0


def refined(photo: Photo) -> NDArray[np.float32]:
    """Give a photograph's depth at its own size, with the edges that the picture has.

    Parameters
    ----------
    photo : Photo
        The photograph, with depth.

    Returns
    -------
    ndarray of float32
        Shape (H, W): relative disparity.

    Raises
    ------
    ValueError
        If there is no depth, or its shape is another.
    """
    if photo.depth is None:
        raise ValueError("the photograph has no depth; give a depth map beside it")
    color = opaque(photo.image)
    return dofsim.refine_depth(color, photo.depth, depth_kind="relative", invalid="far")


def lens_for(photo: Photo, *, f_number: float = 1.4, nearest_m: float = 1.0) -> dofsim.Lens:
    """Give the lens that blurs a photograph as one of this f-number on a full frame would have.

    Relative depth has no metres. What is nearest in the picture is taken to be `nearest_m` away, and what is
    farthest to be infinitely far.

    Parameters
    ----------
    photo : Photo
        The photograph; its view is that of its focal length, or of 50 mm if that is not known.
    f_number : float, optional
        Focal length over diameter of the opening.
    nearest_m : float, optional
        The distance of what is nearest, in metres.

    Returns
    -------
    Lens
        For ``depth_kind="relative"``, focused on what is nearest.

    Raises
    ------
    ValueError
        If a number is not positive and finite.

    Examples
    --------
    >>> import numpy as np
    >>> from dofsim import io, photo
    >>> shot = photo.Photo(io.Image(np.zeros((2, 2, 3), np.uint8), "srgb", "none"), focal_length_35mm=72.0)
    >>> photo.lens_for(shot, f_number=2.0)
    Lens.from_disparity(strength_percent=3.6, focus=1.0)
    """
    for name, value in (("f_number", f_number), ("nearest_m", nearest_m)):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive and finite; got {value}")
    focal_mm = photo.focal_length_35mm or _USUAL_FOCAL_MM
    # Radius of the opening in metres times focal length in widths of the picture, over the nearest distance.
    radius_m = 1e-3 * focal_mm / (2.0 * f_number)
    strength = 100.0 * radius_m * (focal_mm / _FRAME_MM) / nearest_m
    return dofsim.Lens.from_disparity(strength_percent=round(strength, 6), focus=1.0)


def render(
    photo: Photo,
    depth: NDArray[np.float32],
    lens: dofsim.Lens,
    *,
    matte: NDArray[Any] | None = None,
    restore_highlights: bool = False,
    keep_grain: bool = False,
    depth_range: tuple[float, float] | None = None,
    **options: Any,
) -> NDArray[np.float32]:
    """Render a photograph through a lens.

    Parameters
    ----------
    photo : Photo
        The photograph.
    depth : ndarray
        Relative disparity of its size, as of `refined`.
    lens : Lens
        The lens, as of `lens_for`.
    matte : ndarray, optional
        How much of each pixel the subject covers, shape (H, W), 0 to 1: for hair and soft edges, see
        `dofsim.layers_from_matte`.
    restore_highlights : bool, optional
        Whether clipped lamps get light back first: that of the photograph's gain map, or else what
        `dofsim.restore_highlights` guesses.
    keep_grain : bool, optional
        Whether blurred places get the photograph's grain back, see `with_grain`.
    depth_range : tuple of float, optional
        The disparities that are far and near, one pair for all pictures of a sequence; by default percentiles
        of this picture.
    **options
        As for `dofsim.render`.

    Returns
    -------
    ndarray of float32
        Shape (H, W) or (H, W, C): linear light of the photograph's own primaries.

    Raises
    ------
    ValueError, TypeError, DeviceError
        As `dofsim.render`.
    """
    color = opaque(photo.image)
    if restore_highlights:
        color = dofsim.restore_highlights(color, gains=photo.gains)
    if matte is None:
        result = dofsim.render(color, depth, lens, depth_kind="relative", depth_range=depth_range, **options)
    else:
        far, near = depth_range or range_of(depth) or (0.0, 1.0)
        # The far end keeps a little disparity, for it is taken in metres, which are finite.
        shares = np.maximum((depth - far) / (near - far), 1e-3).astype(np.float32)
        layers, metres = dofsim.layers_from_matte(color, matte, 1.0 / shares)
        result = dofsim.render(layers, 1.0 / metres, lens, depth_kind="disparity", **options)[..., :3]
        result = result[..., 0] if color.ndim == 2 else result
    if keep_grain:
        radius = dofsim.coc(depth, lens, depth_kind="relative", depth_range=depth_range)
        result = with_grain(result, photo, radius)
    return result


def with_grain(
    pixels: NDArray[np.float32], photo: Photo, radius_px: NDArray[np.float32], *, seed: int = 0
) -> NDArray[np.float32]:
    """Give a blurred photograph its grain back: what is blurred is too smooth beside what is sharp.

    A disc of n pixels averages the noise of n pixels. What that took of the photograph's own noise, whose
    strength is measured for dark and for bright places, is put back as new noise.

    Parameters
    ----------
    pixels : ndarray
        The blurred photograph, as of `render`.
    photo : Photo
        The photograph.
    radius_px : ndarray
        Shape (H, W): radius of the blur in pixels, of any sign.
    seed : int, optional
        Another one gives other noise.

    Returns
    -------
    ndarray of float32
        The shape of ``pixels``. What is in focus keeps its bits.

    Raises
    ------
    ValueError
        If the sizes differ.
    """
    if pixels.shape[:2] != radius_px.shape or pixels.shape[:2] != photo.image.pixels.shape[:2]:
        raise ValueError(
            f"pixels, photo and radius_px must be of one size; got {pixels.shape[:2]}, "
            f"{photo.image.pixels.shape[:2]} and {radius_px.shape}"
        )
    levels, strengths = _grain(photo.image.pixels, photo.image.alpha != "none")
    codes = codes_of(pixels, photo.image, sixteen=True).astype(np.float32) / np.float32(65535)
    brightness = codes if codes.ndim == 2 else codes.mean(-1)
    lost = np.sqrt(1.0 - 1.0 / (1.0 + math.pi * radius_px.astype(np.float32) ** 2))
    noise = np.random.default_rng(seed).standard_normal(radius_px.shape, dtype=np.float32)
    noise *= lost * np.interp(brightness, levels, strengths).astype(np.float32)
    noisy = codes + (noise if codes.ndim == 2 else noise[..., np.newaxis])
    light = light_of(np.rint(65535 * np.clip(noisy, 0.0, 1.0)).astype(np.uint16), photo.image)
    # Light beyond white has no code, and what is sharp has its grain.
    touched = (pixels <= 1.0) & ((noise != 0) if codes.ndim == 2 else (noise != 0)[..., np.newaxis])
    return np.where(touched, light, pixels)


def _grain(pixels: NDArray[Any], has_alpha: bool) -> tuple[list[float], list[float]]:
    """Measure noise in code values, 0 to 1, at several levels of brightness."""
    codes = pixels[..., :-1] if has_alpha else pixels
    grey = (codes if codes.ndim == 2 else codes.mean(-1)).astype(np.float32) / np.iinfo(pixels.dtype).max
    height, width = (side // 8 * 8 for side in grey.shape)
    if height < 16 or width < 16:
        return [0.0], [0.0]
    around = np.roll(grey, 1, 0) + np.roll(grey, -1, 0) + np.roll(grey, 1, 1) + np.roll(grey, -1, 1)
    residual = (grey - 0.25 * around)[:height, :width].reshape(height // 8, 8, width // 8, 8)
    blocks = grey[:height, :width].reshape(height // 8, 8, width // 8, 8).mean((1, 3)).ravel()
    # The variance of a pixel less the mean of four neighbours is 1.25 times its own.
    deviations = (residual.std((1, 3)) / math.sqrt(1.25)).ravel()
    levels, strengths = [], []
    edges = np.linspace(0.02, 0.98, 9)
    for low, high in pairwise(edges):
        inside = deviations[(blocks >= low) & (blocks < high)]
        if inside.size >= 8:
            # Blocks with the least structure are noise alone.
            levels.append(float(0.5 * (low + high)))
            strengths.append(float(np.quantile(inside, 0.2)))
    return (levels, strengths) if levels else ([0.0], [0.0])
