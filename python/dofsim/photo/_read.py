"""Files of photographs and of depth maps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dofsim import _datasets, _dofsim, io
from dofsim._files import StrPath, open_regular
from dofsim._save import Alpha

from . import _gain_map
from ._exif import ORIENTATION, with_exif
from ._jpeg_parts import Jpeg
from ._maps import decoded, disparity, heif_disparity, one_channel, reversed_map, upright, upright_map
from ._packages import load_heif, load_pillow
from ._shot import Photo

# What decoders of others raise where a file is damaged.
_DAMAGE = (OSError, ValueError, RuntimeError, EOFError, SyntaxError)
# Brands of the container that HEIC and AVIF share.
_HEIF_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"}
_AVIF_BRANDS = {b"avif", b"avis"}
# The most pixels to a byte of a file: a plain picture of HEIC takes a hundredth of a bit a pixel.
_PIXELS_A_BYTE = 1000
_LEAST_BOUND = 1 << 26
# What `dofsim.render` is for: light or arrays, not photographs.
_RENDERS = ("exr", "npy", "npz")


def read(path: StrPath, depth: StrPath | None = None, *, depth_far_is_white: bool = False) -> Photo:
    """Return a photograph, upright, with its depth.

    Parameters
    ----------
    path : str or path-like
        HEIC or AVIF with its depth image, JPEG with Google's GDepth or Dynamic Depth, or any picture that
        `dofsim.io.read_color` reads.
    depth : str or path-like, optional
        The file of the depth map, as of `read_depth`; it goes before the depth in the photograph. A map of
        the shape that the photograph has before it is turned is turned with it.
    depth_far_is_white : bool, optional
        Whether larger values of that file are farther.

    Returns
    -------
    Photo
        The photograph.

    Raises
    ------
    ValueError
        If a file is damaged, of another kind, or has a colour profile that is not understood.
    ImportError
        If the file needs a package that is not installed.
    OSError
        If a file cannot be opened or read.

    Examples
    --------
    >>> import numpy as np
    >>> from dofsim import photo
    >>> from dofsim.io import write_image
    >>> write_image("photo.png", np.full((24, 32, 3), 90, np.uint8))
    >>> photo.read("photo.png").image.pixels.shape
    (24, 32, 3)
    """
    found, orientation = _readers(path)(path)
    if depth is not None:
        plane = read_depth(depth, far_is_white=depth_far_is_white)
        found = replace(found, depth=upright_map(plane, found.image.pixels.shape, orientation))
    return found


def read_depth(path: StrPath, *, far_is_white: bool = False) -> NDArray[np.float32]:
    """Return a depth map of any kind as relative disparity.

    Parameters
    ----------
    path : str or path-like
        A grey picture, or one of equal channels; or any file of depth of `dofsim.io.read_depth`.
    far_is_white : bool, optional
        Whether larger values are farther.

    Returns
    -------
    ndarray of float32
        Shape (h, w); larger is nearer.

    Raises
    ------
    ValueError
        If the file is damaged, or coloured by a colour map; the error names the map where it is known.
    OSError
        If it cannot be opened or read.
    """
    if (reader := _readers(path)) is not _read_raster:
        codes = reader(path)[0].image.pixels
    elif _datasets.file_kind(path) in ("exr", "npy", "npz", "hdf5", "dpt"):
        # Of no particular scale, so that integers are taken as they are.
        codes = io.read_depth(path, scale=1.0)
    else:
        codes, alpha, _ = _dofsim.read_raster(path)
        codes = codes[..., :-1] if alpha != "none" else codes
    plane = one_channel(path, codes).astype(np.float32)
    if np.isfinite(plane).sum() == 0:
        raise ValueError(f"{path}: no value of the depth map is finite")
    return reversed_map(plane) if far_is_white else plane


def read_matte(path: StrPath) -> NDArray[np.float32]:
    """Return the matte in a grey picture that is white where the subject is.

    Parameters
    ----------
    path : str or path-like
        A grey picture of integers, or one of equal channels.

    Returns
    -------
    ndarray of float32
        Shape (H, W), 0 to 1.

    Raises
    ------
    ValueError
        If the file is damaged or coloured, or has no integers.
    OSError
        If it cannot be opened or read.
    """
    codes, alpha, _ = _dofsim.read_raster(path)
    plane = one_channel(path, codes[..., :-1] if alpha != "none" else codes)
    if plane.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{path}: found {plane.dtype}; a matte has integers")
    return plane.astype(np.float32) / np.float32(np.iinfo(plane.dtype).max)


def _readers(path: StrPath) -> Callable[[StrPath], tuple[Photo, int]]:
    """Choose what reads a file, by its first bytes."""
    with open_regular(path) as file:
        start = file.read(12)
    brand = start[8:12] if start[4:8] == b"ftyp" else b""
    return _read_avif if brand in _AVIF_BRANDS else _read_heif if brand in _HEIF_BRANDS else _read_raster


def _read_raster(path: StrPath) -> tuple[Photo, int]:
    if (kind := _datasets.file_kind(path)) in _RENDERS:
        raise ValueError(f"{path}: a file of kind {kind} is no photograph; dofsim.render takes its pixels")
    pixels, alpha, beside = _dofsim.read_raster(path, turned=True)
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{path}: found {pixels.dtype} of shape {pixels.shape}; a photograph has integers")
    pixels = upright(pixels, beside.orientation)
    image = _image(path, pixels, alpha, beside.profile)
    depth, gains = None, None
    if _dofsim.file_kind(path) == "jpeg":
        jpeg = Jpeg.read(path)
        if (part := jpeg.depth()) is not None:
            depth = upright(disparity(path, part), beside.orientation)
        gains = _gain_map.of_jpeg(jpeg, beside.exif, decoded)
        gains = None if gains is None else upright(gains, beside.orientation)
    return with_exif(Photo(image, depth, gains), beside.exif), beside.orientation


def _read_avif(path: StrPath) -> tuple[Photo, int]:
    pillow = load_pillow()
    try:
        with pillow.open(path, formats=["AVIF"]) as file:
            _check_claim(file.size, Path(path).stat().st_size)
            icc, exif = file.info.get("icc_profile"), file.info.get("exif")
            orientation = int(file.getexif().get(ORIENTATION, 1))
            has_alpha = file.mode in ("RGBA", "LA")
            pixels = np.array(file)
    except _DAMAGE as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise ValueError(f"{path}: damaged file: {error}") from error
    alpha: Alpha = "straight" if has_alpha else "none"
    pixels = upright(pixels, orientation)
    image = _image(path, pixels, alpha, icc)
    return with_exif(Photo(image), exif), orientation


def _read_heif(path: StrPath) -> tuple[Photo, int]:
    heif = load_heif()
    length = Path(path).stat().st_size
    try:
        container = heif.open_heif(path, convert_hdr_to_8bit=False, bgr_mode=False)
        if len(container) == 0:
            raise ValueError("there is no picture in it")
        _check_claim(container.size, length)
        pixels = np.array(container)
        depths = container.info.get("depth_images") or []
        depth = heif_disparity(path, depths[0]) if depths else None
        gains = _gain_map.of_heif(path, container, container.info.get("exif"))
    except _DAMAGE as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise ValueError(f"{path}: damaged file: {error}") from error
    has_alpha = container.mode in ("RGBA", "RGBA;16", "LA", "LA;16")
    icc = container.info.get("icc_profile")
    alpha: Alpha = "straight" if has_alpha else "none"
    image = _image(path, pixels, alpha, icc)
    # The decoder has turned the picture, whatever Exif says besides.
    return with_exif(Photo(image, depth, gains), container.info.get("exif")), 1


def _image(path: StrPath, pixels: NDArray[Any], alpha: Alpha, icc: bytes | None) -> io.Image:
    if not icc:
        return io.Image(pixels, "srgb", alpha)
    try:
        return io.image_of_profile(path, pixels, alpha, icc)
    except ValueError as error:
        raise ValueError(f"{error}; save the photograph as sRGB, Display P3 or Adobe RGB") from error


def _check_claim(size: tuple[int, int], length: int) -> None:
    """Refuse a size that the header claims and the file cannot hold; nothing has been decoded yet."""
    if size[0] * size[1] > max(_LEAST_BOUND, _PIXELS_A_BYTE * length):
        raise ValueError(f"it claims {size[0]} x {size[1]} pixels, more than {length} bytes hold")
