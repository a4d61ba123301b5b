"""Depth maps: from the values of a file to relative disparity, upright."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dofsim import _dofsim
from dofsim._files import StrPath

from ._jpeg_parts import DepthPart

# Codes by which the channels of a grey map may differ; JPEG rounds each by itself.
_EQUAL = 6
# Representations of depth in HEIF that are even in depth, where larger is farther.
_UNIFORM_Z = 2


def decoded(data: bytes) -> NDArray[Any]:
    """Give the pixels of a picture file in memory."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "part")
        file.write_bytes(data)
        try:
            codes, _, _ = _dofsim.read_raster(file, turned=True)
        except ValueError as error:
            raise ValueError(str(error).partition(": ")[2]) from error
    return codes


def disparity(path: StrPath, part: DepthPart) -> NDArray[np.float32]:
    """Give the depth map of a phone as disparity."""
    try:
        codes = decoded(part.data)
    except ValueError as error:
        raise ValueError(f"{path}: its depth map: {error}") from error
    plane = one_channel(path, codes)
    share = plane.astype(np.float32) / np.float32(np.iinfo(plane.dtype).max)
    near, far = part.near, part.far
    if not (math.isfinite(near) and math.isfinite(far) and 0 < near < far):
        # Without a range in metres there is still an order: the first code is the nearest.
        return (1.0 - share).astype(np.float32)
    if part.inverse:
        return ((1.0 - share) / near + share / far).astype(np.float32)
    return (1.0 / (near + share * (far - near))).astype(np.float32)


def heif_disparity(path: StrPath, depth: Any) -> NDArray[np.float32]:
    plane = one_channel(path, np.asarray(depth.to_pillow())).astype(np.float32)
    metadata = (getattr(depth, "info", None) or {}).get("metadata") or {}
    if metadata.get("representation_type") != _UNIFORM_Z:
        return plane
    near, far = metadata.get("z_near") or 0.0, metadata.get("z_far") or 0.0
    if not (math.isfinite(near) and math.isfinite(far) and 0 < near < far):
        return reversed_map(plane)
    return (1.0 / (near + plane / max(float(plane.max()), 1.0) * (far - near))).astype(np.float32)


def reversed_map(plane: NDArray[np.float32]) -> NDArray[np.float32]:
    finite = plane[np.isfinite(plane)]
    turned: NDArray[np.float32] = (finite.max() - plane + finite.min()).astype(np.float32)
    return turned


def upright(array: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Turn and mirror rows and columns as one of Exif's eight orientations asks for."""
    if orientation in (5, 6, 7, 8):
        array = array.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        array = array[::-1]
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    return np.ascontiguousarray(array)


def upright_map(plane: NDArray[np.float32], shape: tuple[int, ...], orientation: int) -> NDArray[np.float32]:
    """Turn a map with its photograph, unless it is upright already."""

    def fits(height: int, width: int) -> bool:
        return abs(width * shape[0] - height * shape[1]) <= max(*shape[:2], height, width)

    height, width = plane.shape
    if orientation > 1 and not fits(height, width) and fits(width, height):
        return upright(plane, orientation)
    return plane


def one_channel(path: StrPath, codes: NDArray[Any]) -> NDArray[Any]:
    """Give the one channel of a grey map; refuse one that a colour map has coloured."""
    if codes.ndim == 2:
        return codes
    if codes.ndim == 3 and codes.shape[-1] in (2, 4):
        codes = codes[..., :-1]
    if codes.ndim != 3:
        raise ValueError(f"{path}: found {codes.dtype} of shape {codes.shape}; a depth map has one channel")
    spread = codes.max(-1).astype(np.int64) - codes.min(-1)
    if np.percentile(spread, 99) <= _EQUAL * (257 if codes.dtype == np.uint16 else 1):
        return codes[..., codes.shape[-1] // 2]
    name = _colormap(codes)
    colored = f"is coloured by the colour map {name!r}" if name else "is coloured"
    raise ValueError(f"{path}: the depth map {colored}; save it as grey, where larger is nearer")


def _colormap(codes: NDArray[Any]) -> str | None:
    """Name the colour map that all colours of a picture are near, if Matplotlib is there to ask."""
    try:
        from matplotlib import colormaps
    except ImportError:
        return None
    sample = codes.reshape(-1, 3)[:: max(1, codes.shape[0] * codes.shape[1] // 2000)].astype(np.float64)
    sample /= np.iinfo(codes.dtype).max
    best, name = math.inf, None
    for candidate in ("turbo", "jet", "viridis", "plasma", "inferno", "magma", "cividis", "Spectral", "hot"):
        colors = np.asarray(colormaps[candidate](np.linspace(0.0, 1.0, 256)))[:, :3]
        distance = np.linalg.norm(sample[:, None] - colors, axis=-1).min(1).mean()
        if distance < best:
            best, name = float(distance), candidate
    return name if best < 0.03 else None
