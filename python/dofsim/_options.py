"""The options of the command line, each written once, and the lens that they describe."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

import dofsim

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ApertureRadius = Annotated[
    float | None, typer.Option(help="Radius of the opening in metres.", rich_help_panel="Lens")
]
FocusDistance = Annotated[
    float | None, typer.Option(help="Distance of the plane in focus in metres.", rich_help_panel="Lens")
]
FocusAt = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y", help="Focus on what this pixel of the depth map sees.", rich_help_panel="Lens"
    ),
]
Fov = Annotated[float | None, typer.Option(help="Field of view in degrees.", rich_help_panel="Lens")]
FovAxis = Annotated[
    str | None,
    typer.Option(
        help="What the field of view spans: x (default), y, diagonal, smaller, larger.",
        rich_help_panel="Lens",
    ),
]
FocalLength = Annotated[
    float | None, typer.Option(help="Focal length in millimetres.", rich_help_panel="Lens")
]
FNumber = Annotated[
    float | None, typer.Option(help="Focal length over diameter of the opening.", rich_help_panel="Lens")
]
SensorWidth = Annotated[
    float | None,
    typer.Option(help="Width of the sensor in millimetres (default 36).", rich_help_panel="Lens"),
]
LensFile = Annotated[
    Path | None,
    typer.Option(
        "--lens",
        help="TOML file with the words above, spelt with underscores. Options beside it win.",
        rich_help_panel="Lens",
    ),
]
Blades = Annotated[
    int | None, typer.Option(help="Blades of the aperture; 0 is round.", rich_help_panel="Aperture")
]
Rotation = Annotated[
    float | None, typer.Option(help="Rotation of the blades in degrees.", rich_help_panel="Aperture")
]
DepthKind = Annotated[
    str,
    typer.Option(
        help="What depth measures: z, distance, inverse_z, disparity, zbuffer, distance_from_near.",
        rich_help_panel="Depth",
    ),
]
Near = Annotated[
    float | None, typer.Option(help="Near plane in metres, of z-buffers.", rich_help_panel="Depth")
]
Far = Annotated[
    float | None, typer.Option(help="Far plane in metres, of z-buffers.", rich_help_panel="Depth")
]
DepthScale = Annotated[float, typer.Option(help="Depth is multiplied by it.", rich_help_panel="Depth")]
DepthChannel = Annotated[
    str | None,
    typer.Option(help="Channel of an EXR file, or array of an NPZ file.", rich_help_panel="Depth"),
]
Invalid = Annotated[
    str, typer.Option(help="What to do with depth that is none: raise or far.", rich_help_panel="Depth")
]
Layer = Annotated[str | None, typer.Option(help="Layer of an EXR file that is the picture.")]
Transfer = Annotated[
    str | None, typer.Option(help="What an integer picture holds: srgb (default) or linear.")
]

MethodOptions = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="An option of the method; may be repeated. The value is TOML or a word.",
    ),
]

_THIN = ("aperture_radius", "focus_distance", "fov", "fov_axis")
_CAMERA = ("focal_length_mm", "f_number", "focus_distance", "sensor_width_mm")
_RELATIVE = ("strength_px", "focus")
# What each constructor can do without.
_OPTIONAL = {"fov_axis", "sensor_width_mm"}


def read_settings(
    path: Path | None, lens: Mapping[str, Any], aperture: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read the words of the lens and of the aperture from a file, and put those of the command line first.

    Parameters
    ----------
    path : Path or None
        A TOML file: the words of the lens at its top, those of the aperture in a table ``aperture``.
    lens, aperture : mapping
        The words given as options; None where they are not given.

    Returns
    -------
    tuple of dict
        The words of the lens and those of the aperture.

    Raises
    ------
    ValueError
        If the file is not TOML.
    OSError
        If it cannot be read.
    """
    words: dict[str, Any] = {}
    if path is not None:
        try:
            words = tomllib.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise ValueError(f"{path}: not a TOML file: {error}") from error
    opening = words.pop("aperture", {})
    if not isinstance(opening, dict):
        raise ValueError(f"{path}: aperture must be a table")
    given = {word: value for word, value in lens.items() if value is not None}
    opened = {word: value for word, value in aperture.items() if value is not None}
    return words | given, opening | opened


def read_method_options(settings: list[str]) -> dict[str, Any]:
    """Read the options of a method.

    Parameters
    ----------
    settings : list of str
        Each ``"NAME=VALUE"``. What is not a TOML value is taken for a word.

    Returns
    -------
    dict
        The values by name.

    Raises
    ------
    ValueError
        If a setting has no name, or a name is given twice.

    Examples
    --------
    >>> from dofsim._options import read_method_options
    >>> read_method_options(["variant=seven", "hyperfocal_factor=0.5"])
    {'variant': 'seven', 'hyperfocal_factor': 0.5}
    """
    values: dict[str, Any] = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not (equals and name.isidentifier()):
            raise ValueError(f"--set takes NAME=VALUE; got {setting!r}")
        if name in values:
            raise ValueError(f"--set {name} is given twice")
        try:
            values[name] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            values[name] = text
    return values


def make_lens(words: Mapping[str, Any]) -> dofsim.Lens:
    """Make the lens that a set of words describes.

    Parameters
    ----------
    words : mapping
        The arguments of `dofsim.Lens`, of `Lens.from_camera` or of `Lens.from_disparity`.

    Returns
    -------
    Lens
        The lens.

    Raises
    ------
    ValueError
        If words are missing or belong to different kinds of lenses, or if a value is out of range.
    """
    kinds = (_CAMERA, dofsim.Lens.from_camera), (_RELATIVE, dofsim.Lens.from_disparity)
    known, maker = next(
        (kind for kind in kinds if any(word in kind[0] and word != "focus_distance" for word in words)),
        (_THIN, dofsim.Lens),
    )
    if alien := [word for word in words if word not in known]:
        raise ValueError(f"a lens of {_spell(known)} has no {_spell(alien)}")
    if missing := [word for word in known if word not in words and word not in _OPTIONAL]:
        raise ValueError(
            f"the lens is not complete: {_spell(missing)} missing (a lens is given by {_spell(_THIN)}, by "
            f"{_spell(_CAMERA)}, or by --lens and a file)"
        )
    return maker(**words)


def focused_words(words: Mapping[str, Any], pixel: str, depth: Any, **kind: Any) -> dict[str, Any]:
    """Focus on what a pixel sees.

    Parameters
    ----------
    words : mapping
        The lens, as for `make_lens`; its focus may be missing.
    pixel : str
        Column and row, ``"X,Y"``.
    depth : ndarray
        The depth map, shape (H, W).
    **kind
        ``depth_kind``, ``near`` and ``far`` of `dofsim.Lens.focused_at`.

    Returns
    -------
    dict
        The words with the focus. The lens is made anew from them, because the field of view of a camera
        depends on its focus.

    Raises
    ------
    ValueError
        If the pixel is not two integers, is not in the picture, or has no depth.
    """
    try:
        x, y = (int(number) for number in pixel.split(","))
    except ValueError:
        raise ValueError(f"--focus-at takes a column and a row, X,Y; got {pixel!r}") from None
    focus = "focus" if "strength_px" in words else "focus_distance"
    start = make_lens({**words, focus: 1.0 if focus == "focus" else math.inf})
    try:
        found = start.focused_at(depth, x, y, **kind)
    except IndexError as error:
        raise ValueError(f"--focus-at: {error}") from error
    return {**words, focus: getattr(found, focus)}


def _spell(words: tuple[str, ...] | list[str]) -> str:
    return " ".join("--" + word.replace("_", "-") for word in words)
