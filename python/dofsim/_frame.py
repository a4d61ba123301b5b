"""How a picture in an OpenEXR file relates to what is rendered: its windows and the aspect of its pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from . import _deep, io
from ._dofsim import Aperture, Lens
from ._exr import ExrFile
from ._files import StrPath

__all__ = ["WINDOWS", "Framed", "framed_values", "read_framed", "read_holdout", "squeezed"]

WINDOWS: tuple[io.Window, ...] = get_args(io.Window)
# Kinds of depth along a ray, whose angle depends on the aspect of pixels.
_ALONG_RAYS = ("distance", "distance_from_near")

Sides = tuple[int, int, int, int]


@dataclass(frozen=True, eq=False, kw_only=True)
class Framed:
    """A picture with its depth, laid out for rendering.

    Attributes
    ----------
    rgbd : RGBD
        The picture, its margin around it. What of the display window is not stored is the mirror image of
        what is.
    overscan : int
        The margin on every side, in pixels of the output.
    source : str or path-like, optional
        The OpenEXR file whose attributes the output keeps.
    stored : tuple of slice, optional
        The rows and the columns of the output that the file stores; None for all.
    corner : tuple of int, optional
        Column and row of the file's coordinates where the output begins; None if its pixels are not the
        file's.
    pixel_aspect : float
        The width of a pixel over its height.
    unused : int
        Pixels stored beyond the display window on every side that are not used.
    too_few : int
        Pixels stored there where a wider margin was asked for, which is then cut from the display window.
    """

    rgbd: io.RGBD
    overscan: int
    source: StrPath | None = None
    stored: tuple[slice, slice] | None = None
    corner: tuple[int, int] | None = None
    pixel_aspect: float = 1.0
    unused: int = 0
    too_few: int = 0

    def seen_depth(self, supersample: int) -> NDArray[np.float32]:
        """Give the depth of the output, without its margin."""
        margin = self.overscan * supersample
        height, width = self.rgbd.depth.shape[-2:]
        return self.rgbd.depth[..., margin : height - margin, margin : width - margin]

    def cut(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Give the part of the output that the file stores."""
        return picture if self.stored is None else np.ascontiguousarray(picture[self.stored])


def read_framed(
    color: StrPath,
    depth: StrPath | None,
    *,
    window: io.Window | None = None,
    overscan: int = 0,
    supersample: int = 1,
    **reading: Any,
) -> Framed:
    """Read a picture and its depth, with the margin that is wanted or that is there.

    Parameters
    ----------
    color, depth : str or path-like
        The files, as for `dofsim.io.read_rgbd`.
    window : {"display", "data"}, optional
        By ``"data"`` all of what an OpenEXR file stores beyond its display window, and as much on every side,
        is the margin. By ``"display"`` nothing of it is read, and `overscan` is a part of the display window.
        By default it is read if `overscan` asks for no more than there is.
    overscan : int
        The margin in pixels of the output.
    supersample : int
        Pixels of the picture to one of the output.
    **reading
        As for `dofsim.io.read_rgbd`.

    Returns
    -------
    Framed
        The picture, and how it is rendered.

    Raises
    ------
    ValueError
        If the file has no such margin.
    """
    if window not in (None, *WINDOWS):
        raise ValueError(f"window must be one of {', '.join(WINDOWS)}; got {window!r}")
    if _deep.exr_kind(color) != "flat" or (depth is not None and _deep.exr_kind(depth) == "deep"):
        if window == "data":
            raise ValueError(f"{color}: window='data' is for pictures in flat OpenEXR files")
        return Framed(rgbd=io.read_rgbd(color, depth, **reading), overscan=overscan)
    file = ExrFile.of(color)
    part = file.color_channels(reading.get("layer"))[0].part
    x, y, seen_width, seen_height = file.parts[part].display_window
    sides = file.beyond(part)
    margin = max(0, min(sides)) // supersample
    wanted = _margin(color, margin, window, overscan)
    words: dict[str, Any] = {"source": color, "pixel_aspect": file.parts[part].pixel_aspect}
    left, top, right, bottom = (max(0, -side) for side in sides)
    if not any(sides) or wanted is None or left + right >= seen_width or top + bottom >= seen_height:
        corner = (x, y) if (supersample, overscan) == (1, 0) else None
        rgbd = io.read_rgbd(color, depth, **reading)
        words["too_few" if window is None and overscan > margin else "unused"] = margin
        return Framed(rgbd=rgbd, overscan=overscan, corner=corner, **words)
    if _sides_of_depth(file, depth, (seen_width, seen_height), reading) != sides:
        if window == "data" or overscan:
            raise ValueError(f"{color}: the data window of the depth is another one; pass window='display'")
        return Framed(rgbd=io.read_rgbd(color, depth, **reading), overscan=0, corner=(x, y), **words)
    rgbd = io.read_rgbd(color, depth, window="data", **reading)
    rgbd = replace(
        rgbd,
        color=framed_values(rgbd.color, sides, wanted * supersample),
        depth=framed_values(rgbd.depth, sides, wanted * supersample),
    )
    stored = None
    if min(sides) < 0:
        height, width = seen_height // supersample, seen_width // supersample
        left, top, right, bottom = (missing // supersample for missing in (left, top, right, bottom))
        stored = slice(top, height - bottom), slice(left, width - right)
    return Framed(
        rgbd=rgbd,
        overscan=wanted,
        stored=stored,
        corner=(x + left, y + top) if supersample == 1 else None,
        unused=margin - wanted,
        **words,
    )


def read_holdout(
    path: StrPath, picture: Framed, **words: Any
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Read a holdout of a picture: the alpha and the depth of a file that is laid out as that of the picture.

    Parameters
    ----------
    path : str or path-like
        A picture with depth and alpha.
    picture : Framed
        What it holds out.
    **words
        As for `read_framed`.

    Returns
    -------
    tuple of ndarray of float32
        Alpha and depth, as `dofsim.render` takes them.

    Raises
    ------
    ValueError
        If the file has no alpha, or other pixels than the picture.
    """
    framed = read_framed(path, None, **words)
    image, depth = framed.rgbd.image, framed.rgbd.depth
    if image.alpha == "none":
        raise ValueError(f"{path}: a holdout needs alpha, and the picture in this file has none")
    size, own = (f"{rgbd.depth.shape[-1]} x {rgbd.depth.shape[-2]}" for rgbd in (picture.rgbd, framed.rgbd))
    if (own, framed.overscan) != (size, picture.overscan):
        raise ValueError(
            f"{path}: a holdout must have the pixels of the picture, {size} with a margin of "
            f"{picture.overscan}; got {own} with a margin of {framed.overscan}"
        )
    return np.ascontiguousarray(image.to_linear()[..., -1]), depth


def squeezed(
    lens: Lens, aperture: Aperture | None, pixel_aspect: float, depth_kind: str = "z"
) -> tuple[Lens, Aperture | None]:
    """Give the lens and the aperture that draw round discs with pixels that are not square.

    Parameters
    ----------
    lens : Lens
        The lens. Its field of view along y is of the height as it is seen, and any other of the width.
    aperture : Aperture or None
        Its aperture.
    pixel_aspect : float
        The width of a pixel over its height.
    depth_kind : str
        What the depth measures.

    Returns
    -------
    tuple of Lens and Aperture
        The same for square pixels.

    Raises
    ------
    ValueError
        If depth along rays, or a tilted focus, would depend on the aspect.
    """
    if pixel_aspect == 1.0:
        return lens, aperture
    if depth_kind in _ALONG_RAYS or any(lens.tilt or ()):
        raise ValueError(
            f"the pixels are {pixel_aspect:g} times as wide as high, which neither depth along rays "
            f"(depth_kind={depth_kind!r}) nor a tilted focus goes with; resample the picture to square pixels"
        )
    own = (aperture or Aperture()).ratio
    # The longer half-axis of an opening keeps its length: 1 / own and 1, or 1 and own. Pixels that are wide
    # make all of the picture higher, in pixels.
    across, up = min(1.0 / own, 1.0), pixel_aspect * min(own, 1.0)
    longest = max(across, up)
    if lens.fov_axis == "y":
        longest /= pixel_aspect
    words = {
        name: longest * value
        for name in ("aperture_radius", "strength_px", "strength_percent")
        if (value := getattr(lens, name)) is not None
    }
    given = {} if aperture is None else aperture.__getnewargs_ex__()[1]
    return lens.replace(**words), Aperture(**{**given, "ratio": own * pixel_aspect})


def _margin(path: StrPath, margin: int, window: io.Window | None, overscan: int) -> int | None:
    """Choose how many of the pixels beyond the display window are the margin; None for those within it."""
    if window == "display" or (window is None and overscan > margin):
        return None
    if window is None:
        return overscan
    if overscan > margin:
        raise ValueError(
            f"overscan must be at most {margin}, which {path} stores beyond its display window; got "
            f"{overscan}"
        )
    return overscan or margin


def _sides_of_depth(
    file: ExrFile, depth: StrPath | None, size: tuple[int, int], reading: dict[str, Any]
) -> Sides | None:
    if depth is None:
        found = file.depth_channel(reading.get("depth_channel"), reading.get("layer"))
        return file.beyond(found.part)
    if _deep.exr_kind(depth) != "flat":
        return None
    other = ExrFile.of(depth)
    there = other.depth_channels(reading.get("depth_channel"), None)[0].part
    # A margin of as many pixels of another size is not the same one.
    alike = other.parts[there].display_window[2:] == size
    return other.beyond(there) if alike else None


def framed_values(values: NDArray[Any], sides: Sides, margin: int) -> NDArray[Any]:
    """Cut what is stored to the display window and a margin; what of these is not stored is mirrored."""
    left, top, right, bottom = (side - margin for side in sides)
    height, width = values.shape[:2]
    rows = slice(max(0, top), height - max(0, bottom))
    columns = slice(max(0, left), width - max(0, right))
    missing = [(max(0, -top), max(0, -bottom)), (max(0, -left), max(0, -right))]
    padded = np.pad(values[rows, columns], missing + [(0, 0)] * (values.ndim - 2), mode="symmetric")
    return np.ascontiguousarray(padded)
