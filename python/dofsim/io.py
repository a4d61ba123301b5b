"""Pictures and depth maps from files and back: OpenEXR, PNG, TIFF, PFM, NPY and NPZ.

Other kinds are read only, among them Sintel's depth and, with the extra ``hdf5``, HDF5.
Deep OpenEXR files are read as layers.

What kind of light a file holds follows from its type, unless the caller says otherwise:

* integer files (PNG, integer TIFF) hold code values with straight alpha: those of their colour profile, or of
  sRGB if they have none. Their pixels keep their integer type, and the transfer function is stated beside
  them for `dofsim.render`;
* float files hold linear light. Alpha is premultiplied in OpenEXR, and taken to be so in NumPy files.

Files are recognised by their first bytes when they are read and by their suffix when they are written. They
are written under a temporary name in the same folder and renamed when they are whole.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

from . import _arrays, _datasets, _deep, _dofsim, _shown
from ._alpha import premultiply
from ._channels import Channel
from ._exr import ExrFile, list_channels, read_exr, write_exr
from ._files import StrPath
from ._options import INTEGER_DEPTH
from ._profile import ColorProfile
from ._save import (
    ALPHAS,
    SAMPLE_TYPES,
    SUFFIXES,
    TRANSFERS,
    Alpha,
    Transfer,
    holds,
    write_depth,
    write_image,
)

__all__ = [
    "ALPHAS",
    "READABLE_SUFFIXES",
    "RGBD",
    "SAMPLE_TYPES",
    "SUFFIXES",
    "TRANSFERS",
    "ColorProfile",
    "Image",
    "holds",
    "list_channels",
    "read_color",
    "read_depth",
    "read_exr",
    "read_rgbd",
    "write_depth",
    "write_exr",
    "write_image",
]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)


Window = Literal["display", "data"]
Coding = Literal["linear", "srgb", "profile"]

# Suffixes that files of the kinds read here have; they are recognised by their contents all the same.
READABLE_SUFFIXES = (*SUFFIXES, ".jpg", ".jpeg", ".webp", ".bmp", ".hdr", ".dpt", ".h5", ".hdf5")
# Names that the arrays of a picture and of its depth have in an NPZ file.
COLOR_ARRAYS = ("color", "rgba", "rgb")
DEPTH_ARRAYS = ("depth", "z")


@dataclass(frozen=True, eq=False)
class Image:
    """The pixels of a file, and what they mean.

    Attributes
    ----------
    pixels : ndarray
        Shape (H, W) or (H, W, C), C from 2 to 4, in the type of the file; half floats of OpenEXR are widened
        to float32.
    transfer : {"linear", "srgb", "profile"}
        How the values stand for light; by the curves of ``profile`` if these are not sRGB's.
    alpha : {"none", "straight", "premultiplied"}
        What the last channel is if C is 2 or 4.
    channels : tuple of str
        The full names of the channels of an OpenEXR file that were read; empty for other files.
    profile : ColorProfile, optional
        The colour profile of a file of integers that has one.
    """

    pixels: NDArray[Any]
    transfer: Coding
    alpha: Alpha
    channels: tuple[str, ...] = ()
    profile: ColorProfile | None = None

    def __repr__(self) -> str:
        """Return the size, the type and what the values mean."""
        return f"<Image of {_shown.described(self.pixels)}, transfer={self.transfer!r}, alpha={self.alpha!r}>"

    def _repr_png_(self) -> bytes:
        """Return the picture."""
        return _shown.png([self.pixels if self.transfer == "srgb" else self.to_linear()])

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the pixels."""
        return np.array(self.pixels, dtype) if copy else np.asarray(self.pixels, dtype)

    def to_linear(self) -> NDArray[np.float32]:
        """Return the pixels as float32, linear light of the picture's own primaries, premultiplied.

        Returns
        -------
        ndarray of float32
            The shape of ``pixels``.
        """
        if self.transfer == "profile" and self.profile is not None:
            values = self.profile.decode(self.pixels)
        elif np.issubdtype(self.pixels.dtype, np.integer):
            values = _dofsim.decode_codes(
                np.ascontiguousarray(self.pixels), srgb=self.transfer == "srgb", alpha=self.alpha != "none"
            )
        else:
            values = self.pixels.astype(np.float32)
        return premultiply(values) if self.alpha == "straight" else values


@dataclass(frozen=True, eq=False)
class RGBD:
    """A picture and its depth. Unpacks into the two arrays: ``color, depth = read_rgbd(path)``.

    Attributes
    ----------
    color : ndarray
        Shape (H, W) or (H, W, C), in the type of the file; of layers, (L, H, W, 4).
    depth : ndarray of float32
        Shape (H, W); of layers, (L, H, W).
    transfer : {"linear", "srgb", "profile"}
        How the values of ``color`` stand for light.
    alpha : {"none", "straight", "premultiplied"}
        What the last channel of ``color`` is if C is 2 or 4.
    color_channels : tuple of str
        The full names of the channels of an OpenEXR file that ``color`` was read from; empty for other files.
    depth_channel : str, optional
        The full name of the channel of an OpenEXR file that ``depth`` was read from; None for other files.
    profile : ColorProfile, optional
        The colour profile of ``color``.
    """

    color: NDArray[Any]
    depth: NDArray[np.float32]
    transfer: Coding
    alpha: Alpha
    color_channels: tuple[str, ...] = ()
    depth_channel: str | None = None
    profile: ColorProfile | None = None

    @property
    def image(self) -> Image:
        """The picture, with what its values mean."""
        return Image(self.color, self.transfer, self.alpha, self.color_channels, self.profile)

    def __repr__(self) -> str:
        """Return the size, the type and what the values mean."""
        kind = f"transfer={self.transfer!r}, alpha={self.alpha!r}"
        return f"<RGBD of {_shown.described(self.color)}, {kind}, depth of shape {self.depth.shape}>"

    def _repr_png_(self) -> bytes:
        """Return the picture, and its depth as grey: near is light."""
        layers = self.color.ndim == 4
        shown = self.color if layers or self.transfer == "srgb" else self.image.to_linear()
        return _shown.png([shown, _shown.grey(self.depth)])

    def __iter__(self) -> Iterator[NDArray[Any]]:
        """Yield the colour, then the depth."""
        return iter((self.color, self.depth))


def read_color(
    path: StrPath,
    *,
    layer: str | None = None,
    transfer: Transfer | None = None,
    window: Window = "display",
) -> Image:
    """Return the picture that a file holds.

    Parameters
    ----------
    path : str or path-like
        An OpenEXR, PNG, JPEG, WebP, BMP, Radiance HDR, TIFF, PFM, NPY or NPZ file, or with h5py an HDF5 file.
    layer : str, optional
        Which layer of an OpenEXR file (``"ViewLayer.Combined"``; ``""`` for channels outside any layer) or
        which array of an NPZ or HDF5 file. Without it the layer is chosen by its name, see
        `dofsim._channels`; in an NPZ file it is ``color`` or the only array.
    transfer : {"linear", "srgb"}, optional
        What an integer file holds. By default its colour profile says it, and of a file without one it is
        ``"srgb"``.
    window : {"display", "data"}, optional
        Which pixels of an OpenEXR file: those to be seen, transparent black where nothing is stored, or those
        that are stored.

    Returns
    -------
    Image
        The pixels, their transfer function and their alpha.

    Raises
    ------
    ValueError
        If the file is damaged or of another kind, or if the layer is not there or not the only choice.
    OSError
        If the file cannot be opened or read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from dofsim.io import read_color, write_image
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "grey.png")
    ...     write_image(path, np.full((2, 3), 0.5))
    ...     image = read_color(path)
    >>> image.pixels.dtype, image.transfer, int(image.pixels[0, 0])
    (dtype('uint8'), 'srgb', 188)
    """
    kind = _datasets.file_kind(path)
    alpha: Alpha = "none"
    icc: bytes | None = None
    if kind == "exr":
        file = ExrFile.of(path)
        channels = file.color_channels(layer)
        return _exr_image(path, file.read(channels, data=window == "data", fill=0.0), channels, transfer)
    if kind == "npz":
        pixels = _arrays.read_npz(path, layer, COLOR_ARRAYS)
    elif kind == "npy":
        pixels = _arrays.read_npy(path)
    elif kind == "hdf5":
        pixels = _datasets.read_hdf5(path, layer)
    else:
        pixels, alpha, beside = _dofsim.read_raster(path)
        icc = beside.profile
    numpy_file = kind in ("npy", "npz")
    integer = _check_color(path, pixels, layers=numpy_file, transfer=transfer)
    if numpy_file and pixels.ndim > 2 and pixels.shape[-1] in (2, 4):
        alpha = "straight" if integer else "premultiplied"
    if icc is None or transfer is not None or not integer:
        return Image(pixels, (transfer or "srgb") if integer else "linear", alpha)
    try:
        return image_of_profile(path, pixels, alpha, icc)
    except ValueError as error:
        raise ValueError(f"{error}; or say what it holds (transfer)") from error


def image_of_profile(path: StrPath, pixels: NDArray[Any], alpha: Alpha, icc: bytes) -> Image:
    """Give integers of a file the meaning that their colour profile has."""
    lights = (1 if pixels.ndim == 2 else pixels.shape[-1]) - (alpha != "none")
    try:
        profile = ColorProfile.parse(icc, lights)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return Image(pixels, "srgb" if profile.is_srgb_coded else "profile", alpha, profile=profile)


def read_depth(
    path: StrPath,
    *,
    channel: str | None = None,
    scale: float | None = None,
    missing: float | None = None,
    background: float | None = None,
    layer: str | None = None,
    window: Window = "display",
) -> NDArray[np.float32]:
    """Return the depth map that a file holds.

    Parameters
    ----------
    path : str or path-like
        A file of any kind that `read_color` reads, or Sintel's ``.dpt``. All but OpenEXR, NPZ and HDF5 must
        have a single channel, or several colours that are equal in every pixel.
    channel : str, optional
        Which channel of an OpenEXR file or which array of an NPZ or HDF5 file. Without it the channel is
        chosen by its name, see `dofsim._channels`; in an NPZ file it is ``depth``, ``z`` or the only array.
    scale : float, optional
        The values are multiplied by it: 0.001 for millimetres in a 16-bit PNG, 1/256 for KITTI, -1 for depth
        along -z as of OpenGL's or Mantra's cameras. It must be given for integers, which have no unit of
        their own: 1 takes them as they are, such as a network's disparity.
    missing : float, optional
        The value in the file that means no reading, such as 0; becomes NaN.
    background : float, optional
        The value in the file that means the background, such as Blender's 1e10; it and what is above become
        infinite. See `dofsim.presets` for what data sets have.
    layer : str, optional
        The colour layer that the depth belongs to; decides between equals in an OpenEXR file.
    window : {"display", "data"}, optional
        Which pixels of an OpenEXR file: those to be seen, infinitely far where nothing is stored, or those
        that are stored.

    Returns
    -------
    ndarray of float32
        Shape (H, W). What the values measure is for the user to know, see ``depth_kind`` of `dofsim.render`.

    Raises
    ------
    ValueError
        If the file is damaged or of another kind, or if the channel is not there or not the only choice.
    OSError
        If the file cannot be opened or read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from dofsim.io import read_depth, write_depth
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "depth.exr")
    ...     write_depth(path, np.array([[1.0, 2.5, np.inf]]))
    ...     read_depth(path)
    array([[1. , 2.5, inf]], dtype=float32)
    """
    depth, _ = read_named_depth(
        path,
        channel=channel,
        scale=scale,
        missing=missing,
        background=background,
        layer=layer,
        window=window,
    )
    return depth


def read_rgbd(
    color_path: StrPath,
    depth_path: StrPath | None = None,
    *,
    layer: str | None = None,
    depth_channel: str | None = None,
    depth_scale: float | None = None,
    depth_missing: float | None = None,
    depth_background: float | None = None,
    transfer: Transfer | None = None,
    window: Window = "display",
    max_layers: int = _deep.MAX_LAYERS,
    same_size: bool = True,
) -> RGBD:
    """Return a picture and its depth, read from one file or two.

    Parameters
    ----------
    color_path : str or path-like
        The file of the picture; see `read_color`.
    depth_path : str or path-like, optional
        The file of the depth; see `read_depth`. Without it the depth is in the file of the picture, which
        is then OpenEXR or NPZ.
    layer : str, optional
        Which layer is the picture.
    depth_channel : str, optional
        Which channel is the depth.
    depth_scale : float, optional
        ``scale`` of `read_depth`; it must be given for a depth map of integers.
    depth_missing, depth_background : float, optional
        ``missing`` and ``background`` of `read_depth`.
    transfer : {"linear", "srgb"}, optional
        What an integer picture holds. The default is ``"srgb"``.
    window : {"display", "data"}, optional
        Which pixels of OpenEXR files.
    max_layers : int, optional
        The most layers that the samples of a deep OpenEXR file are merged to, without loss of light.
    same_size : bool, optional
        Whether to refuse a picture and a depth of different sizes, which only `dofsim.refine_depth` and
        ``refine=True`` take.

    Returns
    -------
    RGBD
        Unpacks into ``color, depth``; of layers, shapes (L, H, W, 4) and (L, H, W).

    Raises
    ------
    ValueError
        As the two readers, and if picture and depth differ in size.
    OSError
        If a file cannot be opened or read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from dofsim.io import read_rgbd, write_image
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "rgbz.exr")
    ...     write_image(path, np.ones((4, 6, 3)), depth=np.full((4, 6), 2.0))
    ...     color, depth = read_rgbd(path)
    >>> color.shape, depth.shape
    ((4, 6, 3), (4, 6))
    """
    _check_scale(depth_scale, "depth_scale")
    if depth_path is None:
        exr_kind = _deep.exr_kind(color_path)
        if exr_kind == "deep":
            if layer is not None or depth_channel is not None:
                raise ValueError(
                    f"{color_path}: layer and depth_channel are not for deep files, which have one picture"
                )
            layers, depths = _deep.read_deep(color_path, max_layers, data=window == "data")
            measured = _measured(depths, depth_scale or 1.0, depth_missing, depth_background)
            return RGBD(layers, measured, "linear", "premultiplied")
        if exr_kind == "flat":
            file = ExrFile.of(color_path)
            channels = file.color_channels(layer)
            chosen = file.depth_channel(depth_channel, layer)
            pixels, plane = file.read_both(channels, chosen, data=window == "data")
            image = _exr_image(color_path, pixels, channels, transfer)
            depth = _measured(plane, depth_scale or 1.0, depth_missing, depth_background)
            return _checked_rgbd(color_path, image, depth, chosen.full)
        if (kind := _datasets.file_kind(color_path)) != "npz":
            raise ValueError(
                f"{color_path}: a file of kind {kind} holds no depth beside the picture; give the depth in a "
                "file of its own"
            )
    image = read_color(color_path, layer=layer, transfer=transfer, window=window)
    plane, name = read_named_depth(
        color_path if depth_path is None else depth_path,
        channel=depth_channel,
        scale=depth_scale,
        missing=depth_missing,
        background=depth_background,
        layer=layer if depth_path is None else None,
        window=window,
    )
    if same_size:
        return _checked_rgbd(color_path, image, plane, name)
    return RGBD(image.pixels, plane, image.transfer, image.alpha, image.channels, name, image.profile)


def read_named_depth(
    path: StrPath,
    *,
    channel: str | None = None,
    scale: float | None = None,
    missing: float | None = None,
    background: float | None = None,
    layer: str | None = None,
    window: Window = "display",
) -> tuple[NDArray[np.float32], str | None]:
    """Read the depth of a file as `read_depth` does, and the full name of its channel in an OpenEXR file."""
    kind = _datasets.file_kind(path)
    _check_scale(scale, "scale")
    name = None
    if kind == "exr":
        file = ExrFile.of(path)
        chosen = file.depth_channels(channel, layer)
        name = chosen[0].full
        depth = file.read(chosen, data=window == "data", fill=math.inf)
    elif kind == "npz":
        depth = _arrays.read_npz(path, channel, DEPTH_ARRAYS)
    elif kind == "npy":
        depth = _arrays.read_npy(path)
    elif kind == "hdf5":
        depth = _datasets.read_hdf5(path, channel)
    elif kind == "dpt":
        depth = _datasets.read_dpt(path)
    else:
        depth, _, _ = _dofsim.read_raster(path)
    layers = kind in ("npy", "npz") and depth.ndim == 3
    if not layers:
        depth = _of_one_colour(path, depth)
    if depth.dtype.kind not in "fui" or (depth.ndim != 2 and not layers) or depth.size == 0:
        raise ValueError(f"{path}: found {_describe(depth)}; a depth map has one channel of numbers")
    if scale is None and depth.dtype.kind in "ui":
        raise ValueError(f"{path}: the depth is integers of {8 * depth.dtype.itemsize} bits, {INTEGER_DEPTH}")
    return _measured(depth, 1.0 if scale is None else scale, missing, background), name


def _of_one_colour(path: StrPath, depth: NDArray[Any]) -> NDArray[Any]:
    """Take one channel of a map whose colours are all equal, as programs without grey pictures write it."""
    if depth.ndim != 3 or depth.shape[-1] not in (3, 4):
        return depth
    if not all(np.array_equal(depth[..., 0], depth[..., one]) for one in (1, 2)):
        raise ValueError(
            f"{path}: found {_describe(depth)}, whose colours differ; a depth map has one channel of "
            "numbers, or equal ones"
        )
    return np.ascontiguousarray(depth[..., 0])


def _exr_image(
    path: StrPath, pixels: NDArray[np.float32], channels: list[Channel], transfer: Transfer | None
) -> Image:
    """Give the pixels of an OpenEXR file their meaning: linear light, premultiplied."""
    _check_color(path, pixels, layers=False, transfer=transfer)
    has_alpha = pixels.ndim == 3 and pixels.shape[-1] in (2, 4)
    names = tuple(channel.full for channel in channels)
    return Image(pixels, "linear", "premultiplied" if has_alpha else "none", names)


def _checked_rgbd(
    path: StrPath,
    image: Image,
    depth: NDArray[np.float32],
    depth_channel: str | None,
) -> RGBD:
    """Put a picture and its depth together, if they are of one size."""
    if image.pixels.shape[: depth.ndim] != depth.shape or image.pixels.ndim > depth.ndim + 1:
        layers = depth.ndim - 2
        sizes = [" x ".join(map(str, one.shape[layers : layers + 2][::-1])) for one in (image.pixels, depth)]
        if sizes[0] == sizes[1] or layers:
            sizes = [_describe(image.pixels), _describe(depth)]
        raise ValueError(
            f"{path}: the picture is {sizes[0]}, its depth {sizes[1]}; depth of another size must be refined "
            "(refine_depth)"
        )
    return RGBD(
        image.pixels, depth, image.transfer, image.alpha, image.channels, depth_channel, image.profile
    )


def _check_scale(scale: float | None, name: str) -> None:
    if scale is not None and (not math.isfinite(scale) or scale == 0):
        raise ValueError(f"{name} must be finite and not 0; got {scale}")


def _measured(
    depth: NDArray[Any], scale: float, missing: float | None, background: float | None
) -> NDArray[np.float32]:
    """Take the values of a file for depth: infinite beyond float32, NaN where they mean nothing."""
    with np.errstate(over="ignore", invalid="ignore"):
        values = depth.astype(np.float32)
        distances = values * np.float32(scale)
    if scale < 0:
        # What is infinitely far is so in either direction.
        distances[np.isinf(values)] = np.inf
    if missing is not None:
        distances[values == np.float32(missing)] = np.nan
    if background is not None:
        distances[values >= np.float32(background)] = np.inf
    return distances


def _check_color(path: StrPath, pixels: NDArray[Any], *, layers: bool, transfer: Transfer | None) -> bool:
    """Whether the pixels are integers; refuses what cannot be a picture of this transfer function."""
    integer = pixels.dtype in (np.uint8, np.uint16)
    known = integer or pixels.dtype in (np.float16, np.float32, np.float64)
    shaped = pixels.ndim == 2 or (2 < pixels.ndim < (5 if layers else 4) and 1 <= pixels.shape[-1] <= 4)
    if not known or not shaped or pixels.size == 0:
        raise ValueError(
            f"{path}: found {_describe(pixels)}; a picture has 1 to 4 channels of uint8, uint16 or floats"
        )
    if transfer == "srgb" and not integer:
        raise ValueError(f"{path}: holds floats, which are linear light; transfer='srgb' is for integers")
    return integer


def _describe(array: NDArray[Any]) -> str:
    return f"{array.dtype} of shape {array.shape}"
