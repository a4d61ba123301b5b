"""Photographs with depth: from phones, and with a depth map from a network.

`read` gives the picture upright, with its colour profile, its Exif and its depth; `render` blurs it, and
`write` writes it in the same colours. Reading HEIC and AVIF, and writing JPEG and HEIC, takes
the extra ``photo``.
"""

from __future__ import annotations

import io as bytes_io
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import dofsim

from . import _datasets, _dofsim, io
from ._extras import missing
from ._files import StrPath, open_regular
from ._jpeg_parts import DepthPart, read_depth_part
from ._save import Alpha

__all__ = [
    "SUFFIXES",
    "Photo",
    "lens_for",
    "read",
    "read_depth",
    "read_matte",
    "refined",
    "render",
    "with_grain",
    "write",
]

SUFFIXES = (".jpg", ".jpeg", ".png", ".heic", ".tif", ".tiff")
"""Suffixes of the files that `write` writes."""

# Widths of a 35 mm frame in millimetres, and the focal length that is taken for one that nobody has said.
_FRAME_MM = 36.0
_USUAL_FOCAL_MM = 50.0
# Tags of Exif.
_ORIENTATION, _EXIF_IFD, _F_NUMBER, _FOCAL_LENGTH, _FOCAL_LENGTH_35 = 0x0112, 0x8769, 0x829D, 0x920A, 0xA405
# Brands of the container that HEIC and AVIF share.
_HEIF_BRANDS = {b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"}
_AVIF_BRANDS = {b"avif", b"avis"}
# The most pixels to a byte of a file: a plain picture of HEIC takes a hundredth of a bit a pixel.
_PIXELS_A_BYTE = 1000
_LEAST_BOUND = 1 << 26
# Codes by which the channels of a grey map may differ; JPEG rounds each by itself.
_EQUAL = 6
# Representations of depth in HEIF that are even in depth, where larger is farther.
_UNIFORM_Z = 2


@dataclass(frozen=True, eq=False)
class Photo:
    """A photograph, upright.

    Attributes
    ----------
    image : dofsim.io.Image
        The pixels, uint8 or uint16, and what they mean.
    depth : ndarray of float32, optional
        Shape (h, w), of any size: relative disparity, larger is nearer. None if the file has no depth.
    exif : bytes, optional
        Exif without its orientation.
    focal_length_35mm : float, optional
        The focal length in millimetres of the same view on a frame of 36 x 24 mm.
    f_number : float, optional
        The f-number that the photograph was taken with.
    """

    image: io.Image
    depth: NDArray[np.float32] | None = None
    exif: bytes | None = None
    focal_length_35mm: float | None = None
    f_number: float | None = None


def read(path: StrPath, depth: StrPath | None = None, *, depth_far_is_white: bool = False) -> Photo:
    """Read a photograph, upright, and its depth.

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
        found = replace(found, depth=_upright_map(plane, found.image.pixels.shape, orientation))
    return found


def read_depth(path: StrPath, *, far_is_white: bool = False) -> NDArray[np.float32]:
    """Read a depth map of any kind as relative disparity.

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
    plane = _one_channel(path, codes).astype(np.float32)
    if np.isfinite(plane).sum() == 0:
        raise ValueError(f"{path}: no value of the depth map is finite")
    return _reversed(plane) if far_is_white else plane


def read_matte(path: StrPath) -> NDArray[np.float32]:
    """Read a matte: a grey picture, white where the subject is.

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
    plane = _one_channel(path, codes[..., :-1] if alpha != "none" else codes)
    if plane.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{path}: found {plane.dtype}; a matte has integers")
    return plane.astype(np.float32) / np.float32(np.iinfo(plane.dtype).max)


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
    color = _opaque(photo.image)
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
        Whether clipped lamps get light back first, see `dofsim.restore_highlights`.
    keep_grain : bool, optional
        Whether blurred places get the photograph's grain back, see `with_grain`.
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
    color = _opaque(photo.image)
    if restore_highlights:
        color = dofsim.restore_highlights(color)
    if matte is None:
        result = dofsim.render(color, depth, lens, depth_kind="relative", **options)
    else:
        # The far end keeps a little disparity, for it is taken in metres, which are finite.
        shares = np.maximum(_shares(depth), np.float32(1e-3))
        layers, metres = dofsim.layers_from_matte(color, matte, 1.0 / shares)
        result = dofsim.render(layers, 1.0 / metres, lens, depth_kind="disparity", **options)[..., :3]
        result = result[..., 0] if color.ndim == 2 else result
    if keep_grain:
        result = with_grain(result, photo, dofsim.coc(depth, lens, depth_kind="relative"))
    return result


def _shares(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Bring relative disparity to 0 to 1 as ``depth_kind="relative"`` does."""
    far, near = np.quantile(depth, [0.01, 0.99], method="lower")
    shares: NDArray[np.float32] = ((depth - far) / max(float(near - far), 1e-30)).astype(np.float32)
    return shares


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
    codes = _codes(pixels, photo.image, sixteen=True).astype(np.float32) / np.float32(65535)
    brightness = codes if codes.ndim == 2 else codes.mean(-1)
    lost = np.sqrt(1.0 - 1.0 / (1.0 + math.pi * radius_px.astype(np.float32) ** 2))
    noise = np.random.default_rng(seed).standard_normal(radius_px.shape, dtype=np.float32)
    noise *= lost * np.interp(brightness, levels, strengths).astype(np.float32)
    noisy = codes + (noise if codes.ndim == 2 else noise[..., np.newaxis])
    light = _light(np.rint(65535 * np.clip(noisy, 0.0, 1.0)).astype(np.uint16), photo.image)
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


def write(path: StrPath, pixels: NDArray[Any], photo: Photo, *, quality: int = 95) -> None:
    """Write pixels as the photograph has them: with its profile, its Exif and, where there is room, its bits.

    Parameters
    ----------
    path : str or path-like
        The file: ``.jpg``, ``.jpeg``, ``.png``, ``.heic``, ``.tif`` or ``.tiff``. What was there is replaced.
    pixels : ndarray
        Shape (H, W) or (H, W, C): linear light of the photograph's primaries, as of `render`.
    photo : Photo
        The photograph.
    quality : int, optional
        Of JPEG and HEIC, 1 to 100.

    Raises
    ------
    ValueError
        If the suffix or the quality is another.
    ImportError
        If the format needs a package that is not installed.
    OSError
        If the file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"{path}: the suffix {suffix!r} is not one of {', '.join(SUFFIXES)}")
    if not 1 <= quality <= 100:
        raise ValueError(f"quality must be from 1 to 100; got {quality}")
    sixteen = photo.image.pixels.dtype == np.uint16 and suffix in (".png", ".tif", ".tiff")
    if sixteen:
        # Pillow has no colour of 16 bits; nor has what writes it here a place for Exif.
        io.write_image(path, pixels, profile=photo.image.profile, dtype="uint16")
        return
    pillow = _pillow()
    words: dict[str, Any] = {"icc_profile": photo.image.profile.icc if photo.image.profile else None}
    if photo.exif:
        words["exif"] = photo.exif
    kinds = {".jpg": "JPEG", ".jpeg": "JPEG", ".png": "PNG", ".heic": "HEIF", ".tif": "TIFF", ".tiff": "TIFF"}
    if kinds[suffix] in ("JPEG", "HEIF"):
        words["quality"] = quality
    if kinds[suffix] == "JPEG":
        # Colour at half the size would soften the edges that depth of field leaves sharp.
        words["subsampling"] = 0
    if kinds[suffix] == "HEIF":
        _heif().register_heif_opener()
    buffer = bytes_io.BytesIO()
    pillow.fromarray(_codes(pixels, photo.image, sixteen=False)).save(buffer, format=kinds[suffix], **words)
    _dofsim.write_bytes(Path(path), buffer.getvalue())


def _codes(linear: NDArray[Any], image: io.Image, *, sixteen: bool) -> NDArray[Any]:
    values = np.ascontiguousarray(linear, np.float32)
    if image.transfer == "profile" and image.profile is not None:
        return image.profile.encode(values, sixteen=sixteen)
    return _dofsim.encode_codes(values, sixteen=sixteen, alpha=False)


def _light(codes: NDArray[Any], image: io.Image) -> NDArray[np.float32]:
    return io.Image(codes, image.transfer, "none", profile=image.profile).to_linear()


def _opaque(image: io.Image) -> NDArray[np.float32]:
    """Give linear light over black."""
    linear = image.to_linear()
    return linear if image.alpha == "none" else np.ascontiguousarray(linear[..., :-1])


def _read_raster(path: StrPath) -> tuple[Photo, int]:
    pixels, alpha, beside = _dofsim.read_raster(path, turned=True)
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{path}: found {pixels.dtype} of shape {pixels.shape}; a photograph has integers")
    pixels = _upright(pixels, beside.orientation)
    if beside.profile is None:
        image = io.Image(pixels, "srgb", alpha)
    else:
        image = io.image_of_profile(path, pixels, alpha, beside.profile)
    part = read_depth_part(path) if _dofsim.file_kind(path) == "jpeg" else None
    depth = None if part is None else _upright(_disparity(path, part), beside.orientation)
    return _with_exif(Photo(image, depth), beside.exif), beside.orientation


def _disparity(path: StrPath, part: DepthPart) -> NDArray[np.float32]:
    """Give the depth map of a phone as disparity."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "depth")
        file.write_bytes(part.data)
        try:
            codes, _, _ = _dofsim.read_raster(file, turned=True)
        except ValueError as error:
            raise ValueError(f"{path}: its depth map: {str(error).partition(': ')[2]}") from error
    plane = _one_channel(path, codes)
    share = plane.astype(np.float32) / np.float32(np.iinfo(plane.dtype).max)
    near, far = part.near, part.far
    if not (math.isfinite(near) and math.isfinite(far) and 0 < near < far):
        # Without a range in metres there is still an order: the first code is the nearest.
        return (1.0 - share).astype(np.float32)
    if part.inverse:
        return ((1.0 - share) / near + share / far).astype(np.float32)
    return (1.0 / (near + share * (far - near))).astype(np.float32)


def _readers(path: StrPath) -> Callable[[StrPath], tuple[Photo, int]]:
    """Choose what reads a file, by its first bytes."""
    with open_regular(path) as file:
        start = file.read(12)
    brand = start[8:12] if start[4:8] == b"ftyp" else b""
    return _read_avif if brand in _AVIF_BRANDS else _read_heif if brand in _HEIF_BRANDS else _read_raster


def _read_avif(path: StrPath) -> tuple[Photo, int]:
    pillow = _pillow()
    try:
        with pillow.open(path, formats=["AVIF"]) as file:
            _check_claim(file.size, Path(path).stat().st_size)
            icc, exif = file.info.get("icc_profile"), file.info.get("exif")
            orientation = int(file.getexif().get(_ORIENTATION, 1))
            has_alpha = file.mode in ("RGBA", "LA")
            pixels = np.array(file)
    except (OSError, ValueError, RuntimeError, EOFError, SyntaxError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise ValueError(f"{path}: damaged file: {error}") from error
    alpha: Alpha = "straight" if has_alpha else "none"
    pixels = _upright(pixels, orientation)
    image = io.image_of_profile(path, pixels, alpha, icc) if icc else io.Image(pixels, "srgb", alpha)
    return _with_exif(Photo(image), exif), orientation


def _check_claim(size: tuple[int, int], length: int) -> None:
    """Refuse a size that the header claims and the file cannot hold; nothing has been decoded yet."""
    if size[0] * size[1] > max(_LEAST_BOUND, _PIXELS_A_BYTE * length):
        raise ValueError(f"it claims {size[0]} x {size[1]} pixels, more than {length} bytes hold")


def _read_heif(path: StrPath) -> tuple[Photo, int]:
    heif = _heif()
    length = Path(path).stat().st_size
    try:
        container = heif.open_heif(path, convert_hdr_to_8bit=False, bgr_mode=False)
        _check_claim(container.size, length)
        pixels = np.array(container)
        depths = container.info.get("depth_images") or []
        depth = _heif_disparity(path, depths[0]) if depths else None
    except (OSError, ValueError, RuntimeError, EOFError, SyntaxError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise ValueError(f"{path}: damaged file: {error}") from error
    has_alpha = container.mode in ("RGBA", "RGBA;16", "LA", "LA;16")
    icc = container.info.get("icc_profile")
    alpha: Alpha = "straight" if has_alpha else "none"
    image = io.image_of_profile(path, pixels, alpha, icc) if icc else io.Image(pixels, "srgb", alpha)
    # The decoder has turned the picture, whatever Exif says besides.
    return _with_exif(Photo(image, depth), container.info.get("exif")), 1


def _heif_disparity(path: StrPath, depth: Any) -> NDArray[np.float32]:
    plane = _one_channel(path, np.asarray(depth.to_pillow())).astype(np.float32)
    metadata = (getattr(depth, "info", None) or {}).get("metadata") or {}
    if metadata.get("representation_type") != _UNIFORM_Z:
        return plane
    near, far = metadata.get("z_near") or 0.0, metadata.get("z_far") or 0.0
    if not (math.isfinite(near) and math.isfinite(far) and 0 < near < far):
        return _reversed(plane)
    return (1.0 / (near + plane / max(float(plane.max()), 1.0) * (far - near))).astype(np.float32)


def _reversed(plane: NDArray[np.float32]) -> NDArray[np.float32]:
    finite = plane[np.isfinite(plane)]
    turned: NDArray[np.float32] = (finite.max() - plane + finite.min()).astype(np.float32)
    return turned


def _upright(array: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Turn and mirror rows and columns as one of Exif's eight orientations asks for."""
    if orientation in (5, 6, 7, 8):
        array = array.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        array = array[::-1]
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    return np.ascontiguousarray(array)


def _upright_map(plane: NDArray[np.float32], shape: tuple[int, ...], orientation: int) -> NDArray[np.float32]:
    """Turn a map with its photograph, unless it is upright already."""

    def fits(height: int, width: int) -> bool:
        return abs(width * shape[0] - height * shape[1]) <= max(*shape[:2], height, width)

    height, width = plane.shape
    if orientation > 1 and not fits(height, width) and fits(width, height):
        return _upright(plane, orientation)
    return plane


def _one_channel(path: StrPath, codes: NDArray[Any]) -> NDArray[Any]:
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


def _with_exif(photo: Photo, exif: bytes | None) -> Photo:
    """Read the lens from Exif, and keep the rest without orientation. Damaged Exif is left out."""
    if not exif:
        return photo
    try:
        pillow = _pillow()
    except ImportError:
        return photo
    try:
        tags = pillow.Exif()
        tags.load(exif)
        inner = tags.get_ifd(_EXIF_IFD)
        tags.pop(_ORIENTATION, None)
        focal, f_number = _number(inner.get(_FOCAL_LENGTH_35)), _number(inner.get(_F_NUMBER))
        kept = tags.tobytes()
    except (
        SyntaxError,
        ValueError,
        TypeError,
        KeyError,
        OverflowError,
        OSError,
        EOFError,
        AttributeError,
        IndexError,
    ):
        return photo
    except Exception as error:
        # What Pillow meets in damaged Exif is of many kinds, such as struct.error and ZeroDivisionError.
        if type(error).__module__ in ("struct", "builtins"):
            return photo
        raise
    return replace(photo, exif=kept, focal_length_35mm=focal, f_number=f_number)


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and 0 < number < 1e5 else None


def _pillow() -> Any:
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError(missing("writing photographs needs", "Pillow", "photo")) from error
    return Image


def _heif() -> Any:
    try:
        import pillow_heif
    except ImportError as error:
        raise ImportError(missing("HEIC and AVIF need", "pillow-heif", "photo")) from error
    return pillow_heif
