"""Writing pictures and depth maps."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays, _dofsim
from ._alpha import premultiply, unpremultiply
from ._exr import Compression
from ._files import StrPath
from ._profile import ColorProfile

Alpha = Literal["none", "straight", "premultiplied"]
SampleType = Literal["half", "float", "uint8", "uint16"]
Transfer = Literal["linear", "srgb"]

ALPHAS: tuple[Alpha, ...] = get_args(Alpha)
SAMPLE_TYPES: tuple[SampleType, ...] = get_args(SampleType)
TRANSFERS: tuple[Transfer, ...] = get_args(Transfer)

_KINDS = {
    ".exr": "exr",
    ".png": "png",
    ".tif": "tiff",
    ".tiff": "tiff",
    ".pfm": "pfm",
    ".npy": "npy",
    ".npz": "npz",
}
SUFFIXES = tuple(_KINDS)
_SAMPLE_TYPES: dict[str, dict[SampleType, type[np.generic]]] = {
    "exr": {"half": np.float16, "float": np.float32},
    "png": {"uint8": np.uint8, "uint16": np.uint16},
    "tiff": {"float": np.float32, "uint8": np.uint8, "uint16": np.uint16},
    "pfm": {"float": np.float32},
}


def write_image(
    path: StrPath,
    pixels: ArrayLike,
    *,
    transfer: Transfer | None = None,
    alpha: Alpha | None = None,
    depth: ArrayLike | None = None,
    dtype: SampleType | None = None,
    compression: Compression | None = None,
    attributes_of: StrPath | None = None,
    corner: tuple[int, int] | None = None,
    profile: ColorProfile | None = None,
) -> None:
    """Write a picture in the format that the suffix names.

    Integer files (PNG, TIFF of integers) are written as sRGB with straight alpha, float files (OpenEXR, PFM,
    TIFF of floats) as linear light with premultiplied alpha; pixels given otherwise are converted. NPY and
    NPZ hold the array as it is.

    Parameters
    ----------
    path : str or path-like
        The file: ``.exr``, ``.png``, ``.tif``, ``.tiff``, ``.pfm``, ``.npy`` or ``.npz``. What was there is
        replaced.
    pixels : array_like
        Shape (H, W) or (H, W, C), C from 1 to 4: uint8, uint16 or floats. Integer formats clip at 0 and 1,
        and NaN becomes 0 there.
    transfer : {"linear", "srgb"}, optional
        How ``pixels`` stand for light. The default is ``"srgb"`` for integers; floats are linear.
    alpha : {"none", "straight", "premultiplied"}, optional
        What the last of two or four channels is. The default is ``"straight"`` for integers and
        ``"premultiplied"`` for floats.
    depth : array_like, optional
        Shape (H, W): written beside the picture, as channel ``Z`` of OpenEXR or array ``depth`` of NPZ.
    dtype : {"half", "float", "uint8", "uint16"}, optional
        The type of the samples in the file. The default is that of ``pixels`` where the format has it, else
        ``"float"`` or ``"uint8"``.
    compression : {"none", "rle", "zips", "zip", "piz"}, optional
        Of OpenEXR files. All are lossless. The default is ``"zip"`` for half floats, which it halves, and
        ``"none"`` for floats, which it shrinks by a twentieth in longer than it takes to render them.
    attributes_of : str or path-like, optional
        Another OpenEXR file, for those that are written: its attributes are kept, such as chromaticities,
        pixel aspect ratio, time code, comments and those that programs added of their own.
    corner : tuple of int, optional
        Column and row of the display window of ``attributes_of`` where the picture begins: ``(0, 0)`` and its
        size for the whole of it. Without it the picture has a display window of its own.
    profile : ColorProfile, optional
        The colour profile that ``pixels`` are of: floats are linear light of its primaries, and integers are
        its codes. PNG and TIFF of integers are written with it. What is written as floats is linear light of
        Rec. 709's primaries, as these formats have it without further words.

    Raises
    ------
    ValueError
        If the format cannot hold what is given.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from dofsim.io import list_channels, write_image
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "rgbz.exr")
    ...     write_image(path, np.ones((4, 6, 3)), depth=np.full((4, 6), 2.0), dtype="half")
    ...     list_channels(path)
    ['B', 'G', 'R', 'Z']
    """
    kind = _kind(path)
    array = _picture(pixels)
    if alpha is None:
        has_alpha = array.ndim == 3 and array.shape[2] in (2, 4)
        integer = np.issubdtype(array.dtype, np.integer)
        alpha = ("straight" if integer else "premultiplied") if has_alpha else "none"
    transfer = _transfer_of(array, transfer)
    icc = None
    if profile is not None and kind not in ("npy", "npz"):
        if kind in ("png", "tiff") and issubclass(_target(kind, array, dtype), np.integer):
            array, icc = _in_profile(array, _target(kind, array, dtype), alpha, profile), profile.icc
            transfer, alpha, dtype = "srgb", "none" if alpha == "none" else "straight", None
        else:
            array, transfer = _in_rec709(array, alpha, profile), "linear"
            alpha = "none" if alpha == "none" else "premultiplied"
    plane = None if depth is None else _depth_plane(depth, array.shape[:2])
    if plane is not None and kind not in ("exr", "npz"):
        raise ValueError(f"{path}: only OpenEXR and NPZ hold depth beside the picture; use write_depth")

    if kind == "npy":
        _arrays.write_npy(path, array)
    elif kind == "npz":
        _arrays.write_npz(path, {"color": array} | ({} if plane is None else {"depth": plane}))
    else:
        target = _target(kind, array, dtype)
        if kind == "pfm" and alpha != "none":
            raise ValueError(f"{path}: PFM holds no alpha")
        values = _converted(array, target, transfer, alpha)
        if kind == "exr":
            channels = _exr_channels(values) + ([] if plane is None else [("Z", plane)])
            usual: Compression = "zip" if target is np.float16 else "none"
            _dofsim.write_exr(
                path,
                [(None, channels)],
                compression=compression or usual,
                attributes_of=attributes_of,
                corner=corner,
            )
        elif kind == "png":
            _dofsim.write_png(path, values, icc)
        elif kind == "tiff":
            _dofsim.write_tiff(path, values, target is np.float32, icc)
        else:
            _dofsim.write_pfm(path, values)


def write_depth(
    path: StrPath, depth: ArrayLike, *, scale: float = 1.0, compression: Compression = "zip"
) -> None:
    """Write a depth map in the format that the suffix names.

    Parameters
    ----------
    path : str or path-like
        The file: OpenEXR (channel ``Z``), TIFF, PFM, NPY and NPZ hold floats, PNG holds 16-bit integers.
    depth : array_like
        Shape (H, W).
    scale : float, optional
        What one unit in the file stands for: ``depth / scale`` is written, and `dofsim.io.read_depth` with
        the same scale gives ``depth`` back. 0.001 makes a 16-bit PNG of metres hold millimetres.
    compression : {"none", "rle", "zips", "zip", "piz"}, optional
        Of OpenEXR files. All are lossless.

    Raises
    ------
    ValueError
        If the format cannot hold the values: PNG holds 0 to 65535, and nothing infinite.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from dofsim.io import read_depth, write_depth
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "depth.png")
    ...     write_depth(path, np.array([[1.25, 2.5]]), scale=0.001)
    ...     read_depth(path, scale=0.001)
    array([[1.25, 2.5 ]], dtype=float32)
    """
    kind = _kind(path)
    if not math.isfinite(scale) or scale <= 0:
        raise ValueError(f"scale must be positive and finite, not {scale}")
    plane = _depth_plane(np.asarray(depth) / scale, None)
    if kind == "png":
        codes = np.rint(plane)
        if not ((codes >= 0) & (codes <= 65535)).all():
            raise ValueError(f"{path}: PNG holds depth / scale from 0 to 65535, these are not all there")
        _dofsim.write_png(path, codes.astype(np.uint16))
    elif kind == "exr":
        _dofsim.write_exr(path, [(None, [("Z", plane)])], compression=compression)
    elif kind == "tiff":
        _dofsim.write_tiff(path, plane, False)
    elif kind == "pfm":
        _dofsim.write_pfm(path, plane)
    elif kind == "npy":
        _arrays.write_npy(path, plane)
    else:
        _arrays.write_npz(path, {"depth": plane})


def holds(path: StrPath, dtype: SampleType) -> bool:
    """Return whether the format that the suffix names can hold samples of a type."""
    return dtype in _SAMPLE_TYPES.get(_kind(path), {})


def _kind(path: StrPath) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in _KINDS:
        raise ValueError(f"{path}: the suffix {suffix!r} is not one of {', '.join(_KINDS)}")
    return _KINDS[suffix]


def _picture(pixels: ArrayLike) -> NDArray[Any]:
    array = np.asarray(pixels)
    if array.dtype not in (np.uint8, np.uint16) and array.dtype.kind != "f":
        raise ValueError(f"pixels must be uint8, uint16 or floats, not {array.dtype}")
    if array.ndim not in (2, 3) or (array.ndim == 3 and not 1 <= array.shape[2] <= 4):
        raise ValueError(f"pixels must have shape (H, W) or (H, W, 1 to 4), not {array.shape}")
    return array[..., 0] if array.ndim == 3 and array.shape[2] == 1 else array


def _transfer_of(array: NDArray[Any], transfer: Transfer | None) -> Transfer:
    if transfer not in (None, "linear", "srgb"):
        raise ValueError(f"transfer must be 'linear' or 'srgb', not {transfer!r}")
    if array.dtype.kind != "f":
        return transfer or "srgb"
    if transfer == "srgb":
        raise ValueError("floats are linear light; transfer='srgb' is for integers")
    return "linear"


def _depth_plane(depth: ArrayLike, size: tuple[int, ...] | None) -> NDArray[np.float32]:
    plane = np.ascontiguousarray(depth, np.float32)
    if plane.ndim != 2 or (size is not None and plane.shape != size):
        raise ValueError(f"depth must have shape {size or '(H, W)'}, not {plane.shape}")
    return plane


def _target(kind: str, array: NDArray[Any], dtype: SampleType | None) -> type[np.generic]:
    """Choose the type of the samples in the file."""
    offered = _SAMPLE_TYPES[kind]
    if dtype is not None:
        if dtype not in offered:
            raise ValueError(f"{kind} holds {' or '.join(offered)}, not {dtype!r}")
        return offered[dtype]
    same = [one for one in offered.values() if array.dtype == one]
    return same[0] if same else offered.get("float", np.uint8)


def _converted(
    array: NDArray[Any], target: type[np.generic], transfer: Transfer, alpha: Alpha
) -> NDArray[Any]:
    """Bring pixels into the light, the alpha and the type that files of this type hold."""
    to_integer = issubclass(target, np.integer)
    file_transfer = "srgb" if to_integer else "linear"
    file_alpha = "none" if alpha == "none" else ("straight" if to_integer else "premultiplied")
    if array.dtype == target and transfer == file_transfer and alpha == file_alpha:
        return np.ascontiguousarray(array, target)

    has_alpha = alpha != "none"
    if array.dtype.kind == "u":
        codes = np.ascontiguousarray(array)
        values = _dofsim.decode_codes(codes, srgb=transfer == "srgb", alpha=has_alpha)
    else:
        values = np.ascontiguousarray(array, np.float32)
    if alpha == "straight" and file_alpha == "premultiplied":
        values = premultiply(values)
    elif alpha == "premultiplied" and file_alpha == "straight":
        values = unpremultiply(values)
    if to_integer:
        return _dofsim.encode_codes(values, sixteen=target is np.uint16, alpha=has_alpha)
    if target is np.float16 and np.abs(values, where=np.isfinite(values), out=np.zeros_like(values)).max() > (
        np.finfo(np.float16).max
    ):
        raise ValueError("half floats end at 65504, and there are larger values; use dtype='float'")
    return np.ascontiguousarray(values, target)


def _linear_of_profile(array: NDArray[Any], profile: ColorProfile) -> NDArray[np.float32]:
    lights = (1 if array.ndim == 2 else array.shape[2]) - (array.ndim == 3 and array.shape[2] in (2, 4))
    if lights != len(profile.curves):
        raise ValueError(
            f"profile {profile.name!r} is of {len(profile.curves)} channels, and pixels have {lights}"
        )
    return profile.decode(array) if array.dtype.kind == "u" else np.asarray(array, np.float32)


def _in_profile(
    array: NDArray[Any], target: type[np.generic], alpha: Alpha, profile: ColorProfile
) -> NDArray[Any]:
    """Give codes of a profile with straight alpha."""
    if array.dtype == target and alpha != "premultiplied":
        return array
    values = _linear_of_profile(array, profile)
    values = unpremultiply(values) if alpha == "premultiplied" else values
    return profile.encode(values, sixteen=target is np.uint16)


def _in_rec709(array: NDArray[Any], alpha: Alpha, profile: ColorProfile) -> NDArray[np.float32]:
    """Give linear light of Rec. 709's primaries, premultiplied."""
    values = _linear_of_profile(array, profile)
    values = premultiply(values) if alpha == "straight" else values
    if len(profile.curves) == 1:
        return values
    light = values[..., :3] @ profile.to_rec709.T.astype(np.float32)
    return np.concatenate([light, values[..., 3:]], axis=-1)


def _exr_channels(values: NDArray[Any]) -> list[tuple[str, NDArray[Any]]]:
    planes = values[..., np.newaxis] if values.ndim == 2 else values
    names = {1: "Y", 2: "YA", 3: "RGB", 4: "RGBA"}[planes.shape[2]]
    return [(name, np.ascontiguousarray(planes[..., index])) for index, name in enumerate(names)]
