"""How far one picture is from another: PSNR, SSIM and FLIP, with one convention for all three.

Pictures are floats in linear light. They are compared as they would be seen: as sRGB code values, clipped
to [0, 1]. Clipping keeps a highlight of any radiance from outweighing the rest of the picture; encoding
weighs dark and light errors roughly as the eye does.

`psnr` needs NumPy alone. `ssim` needs scikit-image and `flip` NVIDIA's ``flip-evaluator``; both come with
the extra ``metrics`` and are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._extras import missing

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["error_map", "flip", "psnr", "regions", "srgb", "ssim"]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)


def srgb(linear: ArrayLike) -> NDArray[np.float64]:
    """Return linear light as sRGB code values, clipped to [0, 1].

    Parameters
    ----------
    linear : array_like
        Linear values of any shape; 1 is display white. Values outside [0, 1] are clipped.

    Returns
    -------
    ndarray of float64
        Code values in [0, 1], in the input's shape.

    Raises
    ------
    ValueError
        If a value is NaN.

    References
    ----------
    IEC 61966-2-1:1999.

    Examples
    --------
    >>> from dofsim.metrics import srgb
    >>> srgb([0.0, 0.18, 1.0, 7.0]).round(3).tolist()
    [0.0, 0.461, 1.0, 1.0]
    """
    values = np.asarray(linear, dtype=np.float64)
    if np.isnan(values).any():
        raise ValueError(f"{np.count_nonzero(np.isnan(values))} values of the picture are NaN")
    clipped = np.clip(values, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1.0 / 2.4) - 0.055)


def psnr(a: ArrayLike, b: ArrayLike, *, border: int = 0, mask: ArrayLike | None = None) -> float:
    """Return the peak signal-to-noise ratio of two pictures, in decibels.

    Parameters
    ----------
    a, b : array_like, shape (H, W) or (H, W, C)
        Linear pictures of the same shape.
    border : int, optional
        Pixels left out along each edge.
    mask : array_like of bool, shape (H, W), optional
        The pixels to compare; all by default.

    Returns
    -------
    float
        ``-10 log10(mean squared difference of sRGB code values)``: higher is closer, infinite where equal.

    Raises
    ------
    ValueError
        If the shapes differ, a value is NaN, or no pixel is left to compare.
    TypeError
        If the mask is not boolean.

    Examples
    --------
    >>> import numpy as np
    >>> from dofsim.metrics import psnr
    >>> black = np.zeros((4, 6, 3))
    >>> psnr(black, black)
    inf
    >>> round(psnr(black, black + 1.0), 6)
    0.0
    """
    code_a, code_b, keep = _compared(a, b, border, mask)
    mean_square = float(np.mean((code_a - code_b)[keep] ** 2))
    return float("inf") if mean_square == 0.0 else float(-10.0 * np.log10(mean_square))


def ssim(a: ArrayLike, b: ArrayLike, *, border: int = 0, mask: ArrayLike | None = None) -> float:
    """Return the structural similarity of two pictures.

    Wang et al.'s settings: a Gaussian window with a standard deviation of 1.5 pixels, population covariances,
    a data range of 1; channels are averaged. The windows see the whole picture; `border` and `mask` choose
    which of the local values are averaged.

    Parameters
    ----------
    a, b : array_like, shape (H, W) or (H, W, C)
        Linear pictures of the same shape, at least 11 pixels wide and high.
    border : int, optional
        Pixels left out along each edge.
    mask : array_like of bool, shape (H, W), optional
        The pixels to compare; all by default.

    Returns
    -------
    float
        At most 1, which means equal.

    Raises
    ------
    ValueError
        If the shapes differ, a value is NaN, the picture is too small, or no pixel is left to compare.
    TypeError
        If the mask is not boolean.
    ImportError
        If scikit-image is missing.

    References
    ----------
    Z. Wang, A. C. Bovik, H. R. Sheikh, E. P. Simoncelli, "Image quality assessment: from error visibility to
    structural similarity", IEEE Transactions on Image Processing 13 (4), 2004.

    Examples
    --------
    >>> import numpy as np
    >>> from dofsim.metrics import ssim
    >>> ramp = np.linspace(0.0, 1.0, 32 * 32).reshape(32, 32)
    >>> round(ssim(ramp, ramp), 6)
    1.0
    """
    code_a, code_b, keep = _compared(a, b, border, mask)
    try:
        from skimage.metrics import structural_similarity
    except ImportError as error:
        raise ImportError(missing("SSIM needs", "scikit-image", "metrics")) from error
    local: NDArray[np.float64] = structural_similarity(  # type: ignore[no-untyped-call, unused-ignore]
        code_a,
        code_b,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        channel_axis=-1,
        full=True,
    )[1]
    return float(np.mean(local[keep]))


def flip(a: ArrayLike, b: ArrayLike, *, border: int = 0, mask: ArrayLike | None = None) -> float:
    """Return the mean of NVIDIA's FLIP, the difference that a person sees when flipping between two pictures.

    The low dynamic range version, at the evaluator's own viewing distance (67 pixels a degree). The whole
    pictures are filtered; `border` and `mask` choose which of the local values are averaged.

    Parameters
    ----------
    a, b : array_like, shape (H, W), (H, W, 1) or (H, W, 3)
        Linear pictures of the same shape; FLIP is symmetric in them. One channel is taken for grey.
    border : int, optional
        Pixels left out along each edge.
    mask : array_like of bool, shape (H, W), optional
        The pixels to compare; all by default.

    Returns
    -------
    float
        Between 0 (equal) and 1.

    Raises
    ------
    ValueError
        If the shapes differ, there are not 1 or 3 channels, a value is NaN, or no pixel is left to compare.
    TypeError
        If the mask is not boolean.
    ImportError
        If ``flip-evaluator`` is missing.

    References
    ----------
    P. Andersson, J. Nilsson, T. Akenine-Möller, M. Oskarsson, K. Åström, M. D. Fairchild, "FLIP: A Difference
    Evaluator for Alternating Images", Proceedings of the ACM on Computer Graphics and Interactive Techniques
    3 (2), 2020.

    Examples
    --------
    >>> import numpy as np
    >>> from dofsim.metrics import flip
    >>> grey = np.full((32, 32, 3), 0.5)
    >>> flip(grey, grey)
    0.0
    """
    code_a, code_b, keep = _compared(a, b, border, mask)
    return float(np.mean(_flip_per_pixel(code_a, code_b)[keep]))


def error_map(
    a: ArrayLike, b: ArrayLike, *, metric: Literal["difference", "flip"] = "difference"
) -> NDArray[np.float32]:
    """Return where two pictures differ, pixel by pixel.

    Parameters
    ----------
    a, b : array_like, shape (H, W) or (H, W, C)
        Linear pictures of the same shape.
    metric : {"difference", "flip"}, optional
        The absolute difference of sRGB code values, averaged over channels, or FLIP.

    Returns
    -------
    ndarray of float32, shape (H, W)
        Error of each pixel, in [0, 1].

    Raises
    ------
    ValueError
        If the shapes differ, a value is NaN, or `metric` is neither of the two.
    ImportError
        If FLIP is asked for and ``flip-evaluator`` is missing.

    Examples
    --------
    >>> import numpy as np
    >>> from dofsim.metrics import error_map
    >>> error_map(np.zeros((2, 2, 3)), np.ones((2, 2, 3))).tolist()
    [[1.0, 1.0], [1.0, 1.0]]
    """
    methods: dict[str, Callable[[Any, Any], NDArray[np.floating[Any]]]] = {
        "difference": lambda code_a, code_b: np.mean(np.abs(code_a - code_b), axis=-1),
        "flip": _flip_per_pixel,
    }
    if metric not in methods:
        raise ValueError(f"metric must be 'difference' or 'flip', not {metric!r}")
    code_a, code_b, _ = _compared(a, b, 0, None)
    return methods[metric](code_a, code_b).astype(np.float32)


def regions(coc_px: ArrayLike) -> dict[str, NDArray[np.bool_]]:
    """Return the regions of a picture that are measured apart, by the blur of what the pinhole sees.

    Parameters
    ----------
    coc_px : array_like, shape (H, W)
        Signed radius of the circle of confusion in pixels, as from `dofsim.coc`.

    Returns
    -------
    dict of str to ndarray of bool
        ``"overall"``; ``"in focus"`` (radius up to 1 px), ``"behind"`` and ``"in front"``; ``"near edges"``:
        the pixels no farther from a depth edge than the larger blur of its two sides. A depth edge lies
        between neighbours whose radii differ by more than a pixel.

    Raises
    ------
    ValueError
        If the array is not two-dimensional.
    ImportError
        If SciPy is missing.

    Examples
    --------
    >>> from dofsim.metrics import regions
    >>> {name: int(mask.sum()) for name, mask in regions([[0.0, 0.0, 0.0, 0.0, 2.0, 2.0]]).items()}
    {'overall': 6, 'in focus': 4, 'behind': 2, 'in front': 0, 'near edges': 5}
    """
    radius = np.asarray(coc_px, dtype=np.float64)
    if radius.ndim != 2:
        raise ValueError(f"coc_px has the shape (H, W), not {radius.shape}")
    return {
        "overall": np.ones(radius.shape, bool),
        "in focus": np.abs(radius) <= 1.0,
        "behind": radius > 1.0,
        "in front": radius < -1.0,
        "near edges": _near_depth_edge(radius),
    }


def _near_depth_edge(radius: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Find the pixels that the blur of a depth edge reaches."""
    try:
        from scipy.ndimage import distance_transform_edt
    except ImportError as error:
        raise ImportError(missing("regions need", "SciPy", "metrics")) from error
    # The larger blur of the two sides, at the pixels of either side of an edge; 0 elsewhere.
    edge = np.zeros(radius.shape)
    for axis in (0, 1):
        first, second = np.moveaxis(radius, axis, 0)[:-1], np.moveaxis(radius, axis, 0)[1:]
        reach = np.where(np.abs(first - second) > 1.0, np.maximum(np.abs(first), np.abs(second)), 0.0)
        along = np.moveaxis(edge, axis, 0)
        along[:-1] = np.maximum(along[:-1], reach)
        along[1:] = np.maximum(along[1:], reach)
    near = np.zeros(radius.shape, dtype=np.bool_)
    for pixels in range(1, int(np.ceil(edge.max())) + 1):
        near |= distance_transform_edt(edge <= pixels - 1) <= pixels
    return near


def _compared(
    a: ArrayLike, b: ArrayLike, border: int, mask: ArrayLike | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Check the arguments of all metrics; give (H, W, C) code values and the (H, W) pixels to compare."""
    first, second = np.asarray(a), np.asarray(b)
    if first.shape != second.shape:
        raise ValueError(f"the pictures have different shapes: {first.shape} and {second.shape}")
    if first.ndim not in (2, 3):
        raise ValueError(f"a picture has the shape (H, W) or (H, W, C), not {first.shape}")
    height, width = first.shape[:2]
    if border < 0:
        raise ValueError(f"border must not be negative, not {border}")
    keep = np.zeros((height, width), dtype=np.bool_)
    keep[border : max(height - border, border), border : max(width - border, border)] = True
    if mask is not None:
        chosen = np.asarray(mask)
        if chosen.dtype != np.bool_:
            raise TypeError(f"mask must be boolean, not {chosen.dtype}")
        if chosen.shape != keep.shape:
            raise ValueError(f"mask has the shape {chosen.shape}, the pictures {keep.shape}")
        keep &= chosen
    if not keep.any():
        raise ValueError("no pixel is left to compare")
    code_a, code_b = srgb(first), srgb(second)
    if first.ndim == 2:
        code_a, code_b = code_a[..., np.newaxis], code_b[..., np.newaxis]
    return code_a, code_b, keep


def _flip_per_pixel(code_a: NDArray[np.float64], code_b: NDArray[np.float64]) -> NDArray[np.float32]:
    """FLIP's (H, W) error map of two (H, W, C) pictures of sRGB code values."""
    if code_a.shape[-1] not in (1, 3):
        raise ValueError(f"FLIP compares pictures of 1 or 3 channels, not {code_a.shape[-1]}")
    try:
        import flip_evaluator  # type: ignore[import-untyped, unused-ignore]
    except ImportError as error:
        raise ImportError(missing("FLIP needs", "flip-evaluator", "metrics")) from error
    rgb_shape = (*code_a.shape[:2], 3)
    local: NDArray[np.float32] = flip_evaluator.evaluate(
        np.ascontiguousarray(np.broadcast_to(code_a, rgb_shape), dtype=np.float32),
        np.ascontiguousarray(np.broadcast_to(code_b, rgb_shape), dtype=np.float32),
        "LDR",
        applyMagma=False,
        computeMeanError=False,
    )[0]
    return local.reshape(code_a.shape[:2])
