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
    """Return a photograph's depth at its own size, with the edges of the picture.

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
    return refined_with_coverage(photo)[0]


def refined_with_coverage(photo: Photo) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the refined depth, and how much of each pixel the nearer of two surfaces covers.

    Parameters
    ----------
    photo : Photo
        The photograph, with depth.

    Returns
    -------
    tuple of ndarray of float32
        Relative disparity and coverage, each of shape (H, W).

    Raises
    ------
    ValueError
        As `refined`.
    """
    if photo.depth is None:
        raise ValueError("the photograph has no depth; give a depth map beside it")
    color = opaque(photo.image)
    return dofsim.refine_depth(color, photo.depth, depth_kind="relative", invalid="far", return_coverage=True)


def subject(
    depth: NDArray[np.float32],
    lens: dofsim.Lens,
    *,
    coverage: NDArray[np.float32] | None = None,
    depth_range: tuple[float, float] | None = None,
) -> NDArray[np.float32]:
    """Return a matte of what is in focus or nearer.

    Its edges are those of the depth; single hairs, which no depth map has, can be painted into it.

    Parameters
    ----------
    depth : ndarray
        Relative disparity of the photograph's size, as of `refined`.
    lens : Lens
        The lens, as of `lens_for`.
    coverage : ndarray, optional
        Of edges, as of `refined_with_coverage`: soft edges instead of steps.
    depth_range : tuple of float, optional
        As of `render`.

    Returns
    -------
    ndarray of float32
        Shape (H, W), 0 to 1, as `render` takes it.

    Examples
    --------
    >>> import dofsim
    >>> import numpy as np
    >>> from dofsim import photo
    >>> depth = np.repeat(np.array([0.2, 0.9], np.float32), 4)[np.newaxis].repeat(3, 0)
    >>> photo.subject(depth, dofsim.Lens.from_disparity(strength_percent=3.0, focus=1.0))[0, 2:6]
    array([0., 0., 1., 1.], dtype=float32)
    """
    radius = dofsim.coc(depth, lens, depth_kind="relative", depth_range=depth_range)
    # From a quarter of the largest blur behind the focus on, the background begins; from half on, all is.
    share = np.clip(radius / max(float(radius.max()), 1e-30), 0.0, 1.0)
    fade = np.clip((share - 0.25) / 0.25, 0.0, 1.0)
    matte: NDArray[np.float32] = (1.0 - fade * fade * (3.0 - 2.0 * fade)).astype(np.float32)
    if coverage is None:
        return matte
    near, far = matte, matte
    for axis in (0, 1):
        near, far = _extremes(near, axis, np.maximum), _extremes(far, axis, np.minimum)
    return np.where(coverage < 1.0, far + coverage * (near - far), matte)


def _extremes(plane: NDArray[np.float32], axis: int, of: Any) -> NDArray[np.float32]:
    """Give the extreme of each pixel and its two neighbours along an axis."""
    lines = np.moveaxis(plane, axis, 0)
    padded = np.concatenate([lines[:1], lines, lines[-1:]])
    found: NDArray[np.float32] = np.moveaxis(of(of(padded[:-2], padded[2:]), lines), 0, axis)
    return found


def lens_for(photo: Photo, *, f_number: float = 1.4, nearest_m: float = 1.0) -> dofsim.Lens:
    """Return the lens that blurs a photograph as one of this f-number on a full-frame camera would.

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
    """Return a photograph seen through a lens, in linear light.

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
    """Return a blurred photograph with new grain where the blur took the old.

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
