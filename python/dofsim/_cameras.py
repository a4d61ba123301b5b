"""Cameras of other programs: their dictionaries and files as plain numbers."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ._files import check_regular, open_regular, read_text
from ._names import shortened

# A parameter's value may name other parameters, so that a short hostile file could stand for gigabytes.
_LONGEST_VALUE = 4096


def mitsuba_sensor(sensor: Any) -> dict[str, Any]:
    """Read a Mitsuba sensor: a loaded one, its dictionary, or an XML scene file with one sensor.

    Raises
    ------
    ValueError
        If the sensor is of another type or lacks a parameter, or the file has not one sensor.
    """
    words = _scene_file(sensor) if _is_path(sensor) else sensor
    if not isinstance(words, dict):
        return _loaded_sensor(sensor)
    kind = _text(words, "type", "")
    if kind == "thinlens":
        aperture_radius = _required(words, "the thinlens sensor", "aperture_radius")
        focus_distance = _required(words, "the thinlens sensor", "focus_distance")
    elif kind == "perspective":
        aperture_radius, focus_distance = 0.0, 1.0
    else:
        raise ValueError(f'sensor must be of type "thinlens" or "perspective"; got {_quoted(kind)}')
    focal_length_mm = None
    if "focal_length" in words:
        written = _text(words, "focal_length", "")
        focal_length_mm = _parsed(re.sub(r"(mm)+\Z", "", written))
        if focal_length_mm is None:
            raise ValueError(f'focal_length must be like "50mm"; got {_quoted(written)}')
    return {
        "aperture_radius": aperture_radius,
        "focus_distance": focus_distance,
        "fov": _required(words, "the sensor", "fov") if focal_length_mm is None else 0.0,
        "fov_axis": _text(words, "fov_axis", "x") if focal_length_mm is None else "diagonal",
        "focal_length_mm": focal_length_mm,
        "principal_point_offset": [_number(words, f"principal_point_offset_{axis}") or 0.0 for axis in "xy"],
    }


def blender_camera(camera: Any) -> dict[str, Any]:
    """Read the lens of a Blender camera: a dictionary, or a JSON file that holds one.

    Raises
    ------
    ValueError
        If an entry is missing, or the camera is shifted.
    TypeError
        If it is something else, or an entry is no number.
    """
    words = _blender_words(camera)
    for name in ("shift_x", "shift_y"):
        if _number(words, name):
            raise ValueError(
                f"{name} must be 0: how far it shifts the picture depends on its size. Give the lens a "
                "principal_point instead"
            )
    lens_mm = _required(words, "the camera", "lens")
    fstop = _required(words, "the camera", "fstop", "aperture_fstop")
    focus_distance = _required(words, "the camera", "focus_distance")
    fit = _text(words, "sensor_fit", "AUTO")
    ratio = _number(words, "aperture_ratio")
    return {
        "lens_mm": lens_mm,
        "fstop": fstop,
        "focus_distance": focus_distance,
        "sensor_fit": fit,
        "sensor_mm": _number(words, "sensor_height" if fit == "VERTICAL" else "sensor_width"),
        "aperture_ratio": 1.0 if ratio is None else ratio,
    }


def blender_aperture(camera: Any) -> tuple[float, float, float]:
    """Read the blades of a Blender camera, their rotation in radians, and the ratio of the opening."""
    words = _blender_words(camera)
    blades = _number(words, "aperture_blades") or 0.0
    rotation = _number(words, "aperture_rotation") if blades >= 3.0 else None
    ratio = _number(words, "aperture_ratio")
    return blades, rotation or 0.0, 1.0 if ratio is None else ratio


def blender_view(camera: Any) -> dict[str, Any]:
    """Read what a Blender camera sees: its focal length, its sensor, and how far the picture is shifted."""
    words = _blender_words(camera)
    fit = _text(words, "sensor_fit", "AUTO")
    if fit not in ("AUTO", "HORIZONTAL", "VERTICAL"):
        raise ValueError(f'sensor_fit must be "AUTO", "HORIZONTAL" or "VERTICAL"; got {_quoted(fit)}')
    name, default = ("sensor_height", 24.0) if fit == "VERTICAL" else ("sensor_width", 36.0)
    return {
        "lens_mm": _required(words, "the camera", "lens"),
        "sensor_fit": fit,
        "sensor_mm": _number(words, name) or default,
        "shift_x": _number(words, "shift_x") or 0.0,
        "shift_y": _number(words, "shift_y") or 0.0,
    }


def _loaded_sensor(sensor: Any) -> dict[str, Any]:
    """Read a loaded sensor through Mitsuba's traverse; its field of view is always along x."""
    import mitsuba

    parameters = mitsuba.traverse(sensor)

    def value(name: str, default: float | None = None) -> float:
        if name in parameters:
            return _scalar(parameters[name])
        if default is None:
            raise ValueError(f"sensor has no {_quoted(name)}; a thinlens or perspective sensor has")
        return default

    return {
        "aperture_radius": value("aperture_radius", 0.0),
        "focus_distance": value("focus_distance", 1.0),
        "fov": value("x_fov"),
        "fov_axis": "x",
        "focal_length_mm": None,
        "principal_point_offset": [value(f"principal_point_offset_{axis}", 0.0) for axis in "xy"],
    }


def _scalar(value: Any) -> float:
    """Give a number that Mitsuba keeps in single precision as it was written: 0.1, not 0.10000000149."""
    try:
        kept = float(value)
    except (TypeError, ValueError, RuntimeError):
        kept = float(value[0])
    with np.errstate(over="ignore"):
        single = np.float32(kept)
    return float(str(single)) if single == kept else kept


def _scene_file(path: Any) -> dict[str, Any]:
    """Read the one sensor of a Mitsuba scene file as the dictionary that it would be loaded from."""

    def refused(why: str) -> ValueError:
        return ValueError(f"{path}: {why}")

    with open_regular(path) as file:
        try:
            root = ElementTree.parse(file).getroot()
        except OSError:
            raise
        except Exception:
            raise refused("no XML file") from None
    sensors = list(root.iter("sensor"))
    if len(sensors) != 1:
        raise refused(f"one sensor is needed; there are {len(sensors)}")
    filled = _parameters(root, refused)
    words: dict[str, Any] = {"type": sensors[0].get("type", "")}
    # The sensor's other children say where it stands, and describe its film and its sampler.
    for child in sensors[0]:
        if child.tag not in ("float", "integer", "string"):
            continue
        name, value = child.get("name", ""), filled(child)
        if missing := re.search(r"\$\w*", value):
            raise refused(f"the parameter {shortened(missing[0])} has no default")
        words[name] = value if child.tag == "string" else _parsed(value)
        if words[name] is None:
            raise refused(f"{shortened(name)} must be a number; got {_quoted(shortened(value))}")
    return words


def _parameters(
    root: ElementTree.Element, refused: Callable[[str], ValueError]
) -> Callable[[ElementTree.Element], str]:
    """Read the parameters of a scene file; return what fills them into an element's value."""
    defaults: dict[str, str] = {}

    def default_of(found: re.Match[str]) -> str:
        # The longest name comes first: $ab is not $a and a b.
        for end in range(len(found[1]), 0, -1):
            if (value := defaults.get(found[1][:end])) is not None:
                return value + found[1][end:]
        return found[0]

    def bounded(value: str) -> str:
        if len(value) > _LONGEST_VALUE:
            raise refused(f"a value is longer than {_LONGEST_VALUE} characters")
        return value

    def filled(element: ElementTree.Element) -> str:
        return bounded(re.sub(r"\$([^\s$]+)", default_of, bounded(element.get("value", ""))))

    for default in root.iter("default"):
        # Parameters may refer to those before them.
        defaults.setdefault(default.get("name", ""), filled(default))
    return filled


def _blender_words(camera: Any) -> dict[str, Any]:
    words = json_file(camera) if _is_path(camera) else camera
    if not isinstance(words, dict):
        raise TypeError(
            "camera must be a dictionary or the path of a JSON file that holds one; got "
            f"{shortened(repr(words))}"
        )
    return words


def json_file(path: Any) -> Any:
    check_regular(path)
    try:
        return json.loads(read_text(path))
    except ValueError as error:
        raise ValueError(f"{path}: not a JSON file: {error}") from error
    except RecursionError as error:
        raise ValueError(f"{path}: not a JSON file: it is nested too deeply") from error


def _is_path(value: Any) -> bool:
    return isinstance(value, (str, os.PathLike))


def _required(words: dict[str, Any], what: str, *names: str) -> float:
    value = _number(words, *names)
    if value is None:
        raise ValueError(f"{what} has no {_quoted(names[0])}")
    return value


def _number(words: dict[str, Any], *names: str) -> float | None:
    """Give the number under the first of several names that there is."""
    for name in names:
        if name in words:
            value = words[name]
            try:
                # A text is not a number, though float() reads it.
                if not isinstance(value, (str, bytes, bytearray)):
                    return float(value)
            except (TypeError, ValueError, OverflowError):
                pass
            raise TypeError(f"{name} must be a number; got {shortened(repr(value))}")
    return None


def _text(words: dict[str, Any], name: str, default: str) -> str:
    value = words.get(name, default)
    if not isinstance(value, str):
        raise TypeError(f"'{type(value).__name__}' object is not an instance of 'str'")
    return value


def _parsed(text: str) -> float | None:
    """Read a number as files write it: Python's own 1_000 is none."""
    try:
        return float(text) if text.isascii() and "_" not in text else None
    except ValueError:
        return None


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
