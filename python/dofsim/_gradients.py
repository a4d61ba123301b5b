"""Gradients: how a number made of the rendered picture changes with what the picture is rendered from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _dofsim
from ._dofsim import Aperture, Lens, Scene

# Parameters of the two kinds of lenses, by which the strength of the blur and the focus are set.
_STRENGTHS = ("aperture_radius", "strength_px", "strength_percent")
_FOCUSES = ("focus_distance", "focus")
_ARRAYS = ("color", "alpha", "depth", "disparity")
# Kinds of depth of which the derivative of disparity is known from the depth alone.
_KINDS = ("z", "inverse_z", "disparity", "relative")
# The relative step of central differences: the render is in float32, and its second derivative of order one.
_STEP = 1e-3


def vjp(
    color: ArrayLike,
    depth: ArrayLike,
    lens: Lens,
    cotangent: ArrayLike,
    *,
    wrt: str | Sequence[str] = ("color",),
    aperture: Aperture | None = None,
    depth_kind: str = "z",
    depth_range: tuple[float, float] | None = None,
    overscan: int = 0,
    supersample: int = 1,
    max_coc_px: float | None = None,
    threads: int | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Return how a weighted sum of the rendered picture changes with the picture, its depth and the lens.

    The sum is that of the picture by `render` with ``method="lens"``, on the CPU. If the weights are the
    gradient of a loss by the picture, what is returned is its gradient by each argument.

    Parameters
    ----------
    color : ndarray
        The pinhole picture, shape (H, W) or (H, W, C) with 1 to 4 channels, or layers, shape (L, H, W, 4), by
        which alone the sum is then differentiated: floats, linear light, premultiplied if the last of 4
        channels is coverage.
    depth : ndarray
        What each pixel sees, shape (H, W), or (L, H, W) of layers.
    lens : Lens
        The lens, without `axial_color`, `lateral_color`, `breathing_focal_length_mm`, `coma`, `astigmatism`,
        `barn_doors` and `psf`.
    cotangent : ndarray
        The weights: an array of the shape of the rendered picture.
    wrt : str or sequence of str, optional
        What the sum is differentiated by: ``"color"``; ``"alpha"``, the last of 4 channels; ``"depth"``;
        ``"disparity"``, which is 1 over the depth in metres or as it is given; ``"aperture_radius"`` and
        ``"focus_distance"`` in metres; of a lens made by `Lens.from_disparity` ``"strength_px"`` or
        ``"strength_percent"``, and ``"focus"``.
    aperture, overscan, supersample, max_coc_px, threads, **options
        As in `render`.
    depth_kind : {"z", "inverse_z", "disparity", "relative"}, optional
        As in `render`; ``"relative"`` with `depth_range`.
    depth_range : tuple of float, optional
        As in `render`.

    Returns
    -------
    dict of str to ndarray or float
        The derivative by each name in `wrt`: an array of the argument's shape and dtype, or a number. No bit
        depends on the number of threads.

    Raises
    ------
    ValueError, TypeError
        If an argument cannot be used.

    Notes
    -----
    For colours this is the exact adjoint of what `render` does with ``guide=color``: what the colours decide
    themselves, such as how mixed pixels are taken apart, is not differentiated.

    Depth and lens move what each lens point sees: along a surface, and at silhouettes the rim of the nearer
    surface over what is behind it. Exact discs grow. Which pixels are an edge, and what hides a highlight,
    stays.

    Examples
    --------
    >>> import dofsim
    >>> import numpy as np
    >>> color = np.random.default_rng(0).random((48, 64, 3), dtype=np.float32)
    >>> depth = np.full((48, 64), 4.0)
    >>> lens = dofsim.Lens(aperture_radius=0.1, focus_distance=2.0, fov=42.0)
    >>> picture = dofsim.render(color, depth, lens)
    >>> gradient = dofsim.vjp(color, depth, lens, 2 * picture, wrt=("color", "aperture_radius"))
    >>> gradient["color"].shape
    (48, 64, 3)
    >>> bool(gradient["aperture_radius"] < 0)
    True
    """
    names = _names("wrt", [wrt] if isinstance(wrt, str) else wrt, lens)
    color, depth = _picture(color), np.asarray(depth)
    scene = _scene(color, depth, depth_kind, depth_range, overscan, supersample)
    words = {"aperture": aperture, "max_coc_px": max_coc_px, "threads": threads, **options}
    weights = _weights(cotangent, color, overscan, supersample)
    gradients = _dofsim._Gradients(scene, lens, weights, **words)
    found: dict[str, Any] = {}
    by_color, by_depth = gradients.find(
        not {"color", "alpha"}.isdisjoint(names), not set(names) <= {"color", "alpha"}
    )
    if by_color is not None:
        by_color = by_color.reshape(color.shape).astype(color.dtype, copy=False)
        found["color"] = by_color
        if "alpha" in names:
            if color.ndim < 3 or color.shape[-1] != 4:
                raise ValueError(f'wrt: "alpha" is the last of 4 channels of color; got shape {color.shape}')
            found["alpha"] = by_color[..., 3]
    if by_depth is not None:
        by_disparity, by_log_strength, by_focus = by_depth
        settings = _settings(lens)
        for name in names:
            if name in _STRENGTHS:
                found[name] = by_log_strength / settings[name]
            elif name == "focus_distance":
                found[name] = -by_focus / settings[name] ** 2
            elif name == "focus":
                found[name] = by_focus
        if "disparity" in names:
            found["disparity"] = by_disparity.astype(_dtype(depth), copy=False)
        if "depth" in names:
            by_z = _by_depth(by_disparity, depth, depth_kind, depth_range)
            # Never the array of the disparities, which may be asked for as well.
            found["depth"] = by_z.astype(_dtype(depth), copy=by_z is by_disparity)
    return {name: found[name] for name in names}


def jvp(
    color: ArrayLike,
    depth: ArrayLike,
    lens: Lens,
    tangents: Mapping[str, Any],
    *,
    depth_kind: str = "z",
    **options: Any,
) -> NDArray[Any]:
    """Return how the rendered picture changes along tangents of the picture, its depth and the lens.

    The picture is that of `render` with ``method="lens"``, on the CPU.

    Parameters
    ----------
    color, depth, lens
        As in `vjp`.
    tangents : dict of str to ndarray or float
        The direction: arrays for ``"color"`` and ``"depth"``, numbers for parameters of the lens, by the
        names of `vjp`.
    depth_kind, **options
        As in `render`.

    Returns
    -------
    ndarray
        The derivative, of the shape of the rendered picture, in float64.

    Raises
    ------
    ValueError, TypeError
        If an argument cannot be used.

    Notes
    -----
    Along colours it is exact. Along depth and the lens it is the central difference of two renders, whose
    parameters differ from the given ones by a thousandth at most.

    Examples
    --------
    >>> import dofsim
    >>> import numpy as np
    >>> color = np.random.default_rng(0).random((48, 64, 3), dtype=np.float32)
    >>> depth = np.full((48, 64), 4.0)
    >>> lens = dofsim.Lens(aperture_radius=0.1, focus_distance=2.0, fov=42.0)
    >>> dofsim.jvp(color, depth, lens, {"focus_distance": 1.0}).shape
    (48, 64, 3)
    """
    names = _names("tangents", tangents, lens)
    if unusable := [name for name in names if name in ("alpha", "disparity")]:
        raise ValueError(f'tangents: {unusable[0]} is part of "color" or "depth"; give that one')
    color, depth = _picture(color), np.asarray(depth)
    words = {"depth_kind": depth_kind, "device": "cpu", "resolution": "full", **options}
    change: Any = 0.0
    if "color" in names:
        along = _floats("tangents: color", tangents["color"])
        if along.shape != color.shape:
            raise ValueError(f"tangents: color must have the shape {color.shape} of color; got {along.shape}")
        change = _dofsim.render(along, depth, lens, guide=color, **words).astype(np.float64)
    moved = [name for name in names if name != "color"]
    if moved:
        step = _step(depth, lens, {name: tangents[name] for name in moved})

        def at(sign: float) -> NDArray[np.float64]:
            changes = {name: sign * step * np.asarray(tangents[name], np.float64) for name in moved}
            shifted = depth + changes.pop("depth", 0.0)
            settings = _settings(lens)
            moved_lens: dict[str, Any] = {name: settings[name] + float(by) for name, by in changes.items()}
            other = lens.replace(**moved_lens)
            return _dofsim.render(color, shifted, other, **words).astype(np.float64)

        change = change + (at(1.0) - at(-1.0)) / (2.0 * step)
    return np.asarray(change)


def _step(depth: NDArray[Any], lens: Lens, tangents: Mapping[str, Any]) -> float:
    """Give the part of some tangents that changes each parameter by a thousandth at most."""
    settings = _settings(lens)
    largest = 0.0
    for name, tangent in tangents.items():
        if name == "depth":
            finite = np.isfinite(depth)
            change = float(np.max(np.abs(np.asarray(tangent)[finite] / depth[finite]), initial=0.0))
        else:
            change = abs(float(tangent) / (settings[name] or 1.0))
        largest = max(largest, change)
    return _STEP / largest if largest > 0.0 else _STEP


def _names(argument: str, given: Sequence[str] | Mapping[str, Any], lens: Lens) -> list[str]:
    """Check what is to be differentiated by."""
    accepted = [*_ARRAYS, *_settings(lens)]
    names = list(given)
    for name in names:
        if name not in accepted:
            raise ValueError(f"{argument} must be among {', '.join(accepted)}; got {name!r}")
    if not names:
        raise ValueError(f"{argument} must name at least one of {', '.join(accepted)}")
    return names


def _settings(lens: Lens) -> dict[str, float]:
    """Give the numbers of a lens that can be differentiated by."""
    found = {name: getattr(lens, name) for name in (*_STRENGTHS, *_FOCUSES)}
    return {name: value for name, value in found.items() if value is not None}


def _floats(name: str, given: ArrayLike) -> NDArray[Any]:
    array = np.asarray(given)
    if array.dtype.kind != "f":
        raise TypeError(f"{name} must have dtype float16, float32 or float64; got {array.dtype}")
    return array


def _picture(color: ArrayLike) -> NDArray[Any]:
    """Check a picture."""
    array = _floats("color", color)
    if array.ndim not in (2, 3, 4):
        raise ValueError(
            f"color must have shape (H, W), (H, W, C) or, in layers, (L, H, W, 4); got {array.shape}"
        )
    return array


def _dtype(array: NDArray[Any]) -> np.dtype[Any]:
    return array.dtype if array.dtype.kind == "f" else np.dtype(np.float64)


def _scene(
    color: NDArray[Any],
    depth: NDArray[Any],
    depth_kind: Any,
    depth_range: tuple[float, float] | None,
    overscan: int,
    supersample: int,
) -> Scene:
    if depth_kind not in _KINDS:
        raise ValueError(f"depth_kind must be {', '.join(_KINDS)} for gradients; got {depth_kind!r}")
    if depth_kind == "relative" and depth_range is None:
        raise ValueError(
            'depth_range must be given with depth_kind="relative": percentiles of a picture have no gradient'
        )
    return Scene(
        color,
        depth,
        device="cpu",
        depth_kind=depth_kind,
        depth_range=depth_range,
        overscan=overscan,
        supersample=supersample,
    )


def _weights(given: ArrayLike, color: NDArray[Any], overscan: int, supersample: int) -> NDArray[np.float32]:
    """Check a cotangent, and give it the margin of the picture."""
    cotangent = _floats("cotangent", given)
    # One layer, of which a picture of several has the shape.
    of_layer = color.shape[1:] if color.ndim == 4 else color.shape
    rows, columns = (side // supersample for side in of_layer[:2])
    channels = of_layer[2] if len(of_layer) == 3 else 1
    shape = (rows - 2 * overscan, columns - 2 * overscan, *of_layer[2:])
    if cotangent.shape != shape:
        raise ValueError(
            f"cotangent must have the shape {shape} of the rendered picture; got {cotangent.shape}"
        )
    if not np.isfinite(cotangent).all():
        raise ValueError("cotangent must be finite")
    weights = np.zeros((rows, columns, channels), np.float32)
    inside = slice(overscan, rows - overscan), slice(overscan, columns - overscan)
    weights[inside] = cotangent.reshape(*shape[:2], channels)
    return weights


def _by_depth(
    by_disparity: NDArray[np.float32],
    depth: NDArray[Any],
    depth_kind: str,
    depth_range: tuple[float, float] | None,
) -> NDArray[Any]:
    """Give the derivative by depth as it was given."""
    if depth_kind == "z":
        # One over z^2, in place: a picture's worth of doubles is as large as the picture.
        by_depth: NDArray[np.float64] = np.square(depth, dtype=np.float64)
        np.divide(np.negative(by_disparity), by_depth, out=by_depth)
        # Nothing changes with the depth of what is infinitely far away.
        by_depth[~np.isfinite(depth)] = 0.0
        return by_depth
    if depth_kind == "relative":
        assert depth_range is not None
        far, near = depth_range
        return by_disparity / (near - far)
    return by_disparity
