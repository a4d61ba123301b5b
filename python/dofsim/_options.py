"""The words that describe a lens, an aperture and depth, as commands and manifests have them."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import dofsim

from ._files import check_regular, read_text
from ._names import listed

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

THIN_WORDS = ("aperture_radius", "focus_distance", "fov", "fov_axis")
CAMERA_WORDS = ("focal_length_mm", "f_number", "focus_distance", "sensor_width_mm", "sensor")
RELATIVE_WORDS = ("strength_px", "strength_percent", "focus")
# What a lens has in focus: a plane, or a range in its place.
FOCUS_WORDS = ("focus_distance", "focus", "in_focus")
# What lenses may have beyond that; each constructor or `Lens.replace` says which of them it takes.
FURTHER_WORDS = (
    "tilt",
    "field_curvature",
    "axial_color",
    "lateral_color",
    "cat_eye",
    "coma",
    "astigmatism",
    "barn_doors",
    "psf",
    "vignetting",
    "principal_point",
    "sensor_mm",
    "breathing_focal_length_mm",
    "breathing",
)
# All words of a lens, each once.
LENS_WORDS = tuple(dict.fromkeys((*THIN_WORDS, *CAMERA_WORDS, *RELATIVE_WORDS, *FOCUS_WORDS, *FURTHER_WORDS)))
# What openings have; see `dofsim.Aperture`.
APERTURE_WORDS = (
    "blades",
    "rotation",
    "roundness",
    "ratio",
    "obstruction",
    "apodization",
    "spherical",
    "image",
)
# Why depth of integers is refused, and the way out. The command line says the same in its own words.
INTEGER_DEPTH = (
    "which have no unit of their own. Pass scale=0.001 (or depth_scale=0.001) for millimetres, 1 for a "
    "network's relative disparity, or the reading of one of dofsim.presets.PRESETS"
)
# What whole numbers that were taken for metres may be, likewise.
UNITS = 'Is it millimetres (depth_scale=0.001) or disparity (depth_kind="relative")?'
# No pixel and no opening is beyond it, and whole numbers of 64 bits end there.
_LARGEST = 2**63
# What each constructor can do without, or says itself when it is missing.
_OPTIONAL = {"fov_axis", "sensor_width_mm", "sensor", "strength_px", "strength_percent"}


def read_settings(
    path: Path | None, lens: Mapping[str, Any], aperture: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read the words of the lens and of the aperture from a file, and put those of the command line first.

    Parameters
    ----------
    path : Path or None
        A TOML file: the words of the lens at its top, those of the aperture in a table ``aperture``. Or a
        camera of Blender (``.json``) or a scene of Mitsuba (``.xml``).
    lens, aperture : mapping
        The words given as options; None where they are not given.

    Returns
    -------
    tuple of dict
        The words of the lens and those of the aperture.

    Raises
    ------
    ValueError
        If the file is not TOML, or its aperture has other words.
    OSError
        If it cannot be read.
    """
    words: dict[str, Any] = {}
    if path is not None and path.suffix.lower() in _CAMERAS:
        words = _CAMERAS[path.suffix.lower()](path)
    elif path is not None:
        check_regular(path)
        try:
            words = tomllib.loads(read_text(path))
        except ValueError as error:
            raise ValueError(f"{path}: not a TOML file: {error}") from error
        except RecursionError as error:
            raise ValueError(f"{path}: not a TOML file: it is nested too deeply") from error
    opening = words.pop("aperture", {})
    if not isinstance(opening, dict):
        raise ValueError(f"{path}: aperture must be a table")
    if alien := [word for word in opening if word not in APERTURE_WORDS]:
        raise ValueError(f"{path}: [aperture] has no {_quoted(alien)}; it has {', '.join(APERTURE_WORDS)}")
    if alien := [word for word in words if word not in LENS_WORDS]:
        raise ValueError(f"{path}: a lens has no {_quoted(alien)}; it has {', '.join(LENS_WORDS)}")
    given = {word: value for word, value in lens.items() if value is not None}
    opened = {word: value for word, value in aperture.items() if value is not None}
    return merged(words, given), opening | opened


def _blender_words(path: Path) -> dict[str, Any]:
    """Read the camera that ``docs/blender_camera.py`` writes."""
    opening = dofsim.Aperture.from_blender(os.fspath(path))
    return {
        **_words_of(dofsim.Lens.from_blender(os.fspath(path))),
        "aperture": opening.__getnewargs_ex__()[1],
    }


def _mitsuba_words(path: Path) -> dict[str, Any]:
    """Read the sensor of a scene of Mitsuba."""
    return _words_of(dofsim.Lens.from_mitsuba(os.fspath(path)))


def _words_of(lens: dofsim.Lens) -> dict[str, Any]:
    """Give the words of a lens that was read from a camera's file."""
    words = {name: getattr(lens, name) for name in (*THIN_WORDS, "principal_point", "sensor_mm")}
    return {name: value for name, value in words.items() if value not in (None, (0.0, 0.0))}


# Files of cameras, by their suffixes; all others are TOML.
_CAMERAS: dict[str, Callable[[Path], dict[str, Any]]] = {".json": _blender_words, ".xml": _mitsuba_words}


def merged(words: Mapping[str, Any], first: Mapping[str, Any]) -> dict[str, Any]:
    """Put the words of two lenses together, where the second's count first; its focus replaces any other."""
    focused = not set(FOCUS_WORDS).isdisjoint(first)
    kept = {word: value for word, value in words.items() if not (focused and word in FOCUS_WORDS)}
    return {**kept, **first}


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
        except (tomllib.TOMLDecodeError, RecursionError):
            values[name] = text
    return values


def make_lens(words: Mapping[str, Any]) -> dofsim.Lens:
    """Make the lens that a set of words describes.

    Parameters
    ----------
    words : mapping
        The arguments of `dofsim.Lens`, of `Lens.from_camera` or of `Lens.from_disparity`, and those of
        `Lens.replace`, such as ``in_focus`` in place of a plane in focus.

    Returns
    -------
    Lens
        The lens.

    Raises
    ------
    ValueError
        If words are missing or belong to different kinds of lenses, or if a value is out of range.
    """
    if "in_focus" in words:
        return _make_lens_of_range(words)
    kinds = (CAMERA_WORDS, dofsim.Lens.from_camera), (RELATIVE_WORDS, dofsim.Lens.from_disparity)
    known, maker = next(
        (kind for kind in kinds if any(word in kind[0] and word != "focus_distance" for word in words)),
        (THIN_WORDS, dofsim.Lens),
    )
    # TOML and JSON have lists where Python's words are tuples.
    words = {word: tuple(value) if isinstance(value, list) else value for word, value in words.items()}
    further = {word: value for word, value in words.items() if word in FURTHER_WORDS}
    if isinstance(further.get("psf"), str):
        further["psf"] = dofsim.LensMap.load(further["psf"])
    words = {word: value for word, value in words.items() if word not in further}
    if alien := [word for word in words if word not in known]:
        given = [word for word in known if word in words and word not in FOCUS_WORDS]
        raise ValueError(f"{_spell(alien)} cannot be given with {_spell(given)}")
    if missing := [word for word in known if word not in words and word not in _OPTIONAL]:
        raise ValueError(f"the lens is not complete: {_spell(missing)} missing. {_complete(missing)}")
    if "breathing" in further and maker is dofsim.Lens.from_camera:
        words["breathing"] = further.pop("breathing")
    return maker(**words).replace(**further)


def _complete(missing: list[str]) -> str:
    """Say what a whole lens is; of a focus alone, the other ways to give it."""
    if set(missing) <= {"focus", "focus_distance"}:
        return "Give it, --focus-at X,Y or --in-focus NEAR,FAR"
    return (
        "A lens is --aperture-radius --focus-distance --fov; or --focal-length-mm --f-number "
        "--focus-distance; "
        "or, for relative depth, --strength-percent --focus; or --lens FILE"
    )


def _make_lens_of_range(words: Mapping[str, Any]) -> dofsim.Lens:
    focus, in_focus = focus_word(words), tuple(words["in_focus"])
    if focus in words:
        raise ValueError(f"{_spell([focus])} and --in-focus exclude each other")
    # The field of view of a camera depends on its focus: the lens is made anew with that of the range.
    middle = make_lens(without_focus(words)).replace(in_focus=in_focus)
    plane = {word: value for word, value in words.items() if word != "in_focus"}
    return make_lens({**plane, focus: getattr(middle, focus)}).replace(in_focus=in_focus)


def one_of(option: str, value: str | None, accepted: tuple[Any, ...]) -> Any:
    """Give a word back if it is one of those accepted, or None."""
    if value is not None and value not in accepted:
        raise ValueError(f"{option} takes {', '.join(accepted)}; got {value!r}")
    return value


def read_numbers(option: str, text: str, kind: type[int] | type[float], what: str) -> tuple[Any, Any]:
    """Read two numbers with a comma between them.

    Parameters
    ----------
    option : str
        The option that they belong to, for the error.
    text : str
        The numbers.
    kind : type
        ``int`` or ``float``.
    what : str
        What the numbers are, for the error.

    Returns
    -------
    tuple of int or float
        The numbers.

    Raises
    ------
    ValueError
        If the text is something else.
    """
    try:
        first, second = (kind(number) for number in text.split(","))
        if not (math.isfinite(first) and math.isfinite(second) and max(abs(first), abs(second)) < _LARGEST):
            raise ValueError
    except (ValueError, OverflowError):
        raise ValueError(f"{option} takes {what}; got {text!r}") from None
    return first, second


def read_preset(
    name: str | None, kind: str | None, scale: float | None, missing: float | None
) -> tuple[str, dict[str, Any]]:
    """Read what the depth in the file means; what is said outright goes before the preset.

    Parameters
    ----------
    name : str or None
        A preset of `dofsim.presets`.
    kind, scale, missing
        The options of the same names; None where they are not given.

    Returns
    -------
    tuple of str and dict
        The kind of depth, and the arguments about depth of `dofsim.io.read_rgbd`. Where nothing says what
        the values are, the scale is None, by which integers are refused.

    Raises
    ------
    ValueError
        If there is no such preset.
    """
    from .presets import PRESETS, DepthPreset

    chosen = one_of("--preset", name, tuple(PRESETS))
    preset = DepthPreset() if chosen is None else PRESETS[chosen]
    unstated = {"depth_scale": None} if chosen is None and kind is None else {}
    given = {"depth_scale": scale, "depth_missing": missing}
    words = {word: value for word, value in given.items() if value is not None}
    return kind or preset.depth_kind, {**preset.reading, **unstated, **words}


def read_range(text: str) -> tuple[float, float]:
    """Read the two ends that follow ``--in-focus``, of which one may be infinite."""
    try:
        near, far = (float(number) for number in text.split(","))
    except ValueError:
        raise ValueError(f"--in-focus takes the nearer and the farther end, NEAR,FAR; got {text!r}") from None
    return near, far


def read_pixel(text: str) -> tuple[int, int]:
    """Read the column and the row that follow ``--focus-at``."""
    return read_numbers("--focus-at", text, int, "a column and a row, X,Y")


def without_focus(words: Mapping[str, Any]) -> dict[str, Any]:
    """Give a lens some focus, far away, for what does not depend on it; a tilted one needs a finite focus."""
    far = 1e9 if "tilt" in words else math.inf
    return merged(words, {focus_word(words): 1.0 if focus_word(words) == "focus" else far})


def focus_word(words: Mapping[str, Any]) -> str:
    """Name the word of the focus in a lens."""
    relative = "strength_px" in words or "strength_percent" in words
    return "focus" if relative else "focus_distance"


def focused_words(
    words: Mapping[str, Any], pixel: tuple[int, int], depth: Any, **kind: Any
) -> dict[str, Any]:
    """Focus on what a pixel sees.

    Parameters
    ----------
    words : mapping
        The lens, as for `make_lens`; its focus may be missing.
    pixel : tuple of int
        Column and row.
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
        If the pixel is not in the picture, or has no depth.
    """
    focus, focused = focus_word(words), without_focus(words)
    try:
        # Where a tilted plane meets the axis depends a little on the field of view, and that on the focus.
        for _ in range(3):
            found = make_lens(focused).focused_at(depth, *pixel, **kind)
            focused = merged(words, {focus: getattr(found, focus)})
    except IndexError as error:
        raise ValueError(f"--focus-at: {error}") from error
    except ValueError:
        # What is wrong with all of the depth says more than that this pixel has none.
        dofsim.coc(depth, make_lens(focused), **kind, invalid="far")
        raise
    return focused


def _quoted(words: list[str]) -> str:
    return ", ".join(f'"{word}"' for word in listed(words).split(", "))


def _spell(words: tuple[str, ...] | list[str]) -> str:
    # A sensor by its name is a word of files alone.
    return " ".join("--" + word.replace("_", "-") for word in words if word != "sensor")
