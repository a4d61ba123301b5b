"""The record of a frame: how it was made, from what, and that it is whole."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import dofsim
from dofsim import _dofsim
from dofsim._files import read_text
from dofsim._report import distribution

from .frames import Frame, Neighbour

# The distribution over the frames of a run, in the folder of the results.
SUMMARY = "summary.json"


def fingerprint(frame: Frame) -> str:
    """Hash what a frame's outputs depend on: parameters, its inputs' sizes and times of change, the version.

    The folders of the inputs are left out, so that a data set may be moved between two runs.

    Parameters
    ----------
    frame : Frame
        The frame.

    Returns
    -------
    str
        64 hexadecimal digits.

    Raises
    ------
    OSError
        If an input is not there.
    """
    inputs = [_stamp(path) for path in frame.inputs]
    files = ("color", "depth", "holdout")
    words = {name: value for name, value in _parameters(frame).items() if name not in files}
    words["neighbours"] = [one.camera for one in frame.neighbours]
    if frame.holdout is not None:
        words["holdout"] = frame.depth is not None
    text = json.dumps(_plain([dofsim.__version__, inputs, words]), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def is_done(frame: Frame, mark: str) -> bool:
    """Whether all outputs of a frame are there, whole, and made as this fingerprint says."""
    try:
        record = json.loads(read_text(frame.record))
        return bool(
            record["fingerprint"] == mark
            and record["sizes"] == {path.name: path.stat().st_size for path in frame.files.values()}
        )
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        # A record that is not there or not one of ours says nothing.
        return False


def write_record(frame: Frame, mark: str, found: dict[str, Any]) -> None:
    """Declare a frame done.

    Parameters
    ----------
    frame : Frame
        The frame, all of whose files are written.
    mark : str
        Its fingerprint.
    found : dict
        What was chosen while it was rendered: the lens, the pixel in focus, the distances of the stack.
    """
    record = {
        "fingerprint": mark,
        "version": dofsim.__version__,
        **_parameters(frame),
        **found,
        "files": {name: path.name for name, path in frame.files.items()},
        "sizes": {path.name: path.stat().st_size for path in frame.files.values()},
    }
    text = json.dumps(_plain(record), indent=1) + "\n"
    _dofsim.write_bytes(frame.record, text.encode())


def summarise(frames: Iterable[Frame], folder: Path) -> dict[str, Any]:
    """Write the distribution of what the records of some frames say, as ``summary.json``.

    Parameters
    ----------
    frames : iterable of Frame
        The frames; those without a record are left out.
    folder : Path
        Where it is written.

    Returns
    -------
    dict
        What was written: the number of ``frames``, the quantiles of ``largest_blur_radius_px`` and
        ``median_blur_radius_px``, the ``depth_range`` of all with its ``depth_quantity`` and ``depth_unit``
        (None where frames differ in these), and for each kind of ``suspicions`` how many frames have it and
        what it says of the first. Empty without records.
    """
    largest, median, least, greatest = [], [], [], []
    quantities: set[tuple[str, str]] = set()
    suspicions: dict[str, dict[str, Any]] = {}
    for frame in frames:
        try:
            record = json.loads(read_text(frame.record))
            radius = record["blur_radius_px"]
            quantities.add((str(record["depth_quantity"]), str(record["depth_unit"])))
            largest.append(float(radius["max"]))
            median.append(float(radius["median"]))
            if record["depth_range"] is not None:
                least.append(float(record["depth_range"][0]))
                greatest.append(float(record["depth_range"][1]))
            for about, sentence in record["suspicions"].items():
                found = suspicions.setdefault(str(about), {"frames": 0, "first": frame.output.name})
                found["frames"] += 1
                found.setdefault("says", str(sentence))
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            continue
    if not largest:
        return {}
    # Metres and disparities have no common range.
    quantity, unit = quantities.pop() if len(quantities) == 1 else (None, None)
    summary = {
        "frames": len(largest),
        "largest_blur_radius_px": distribution(largest),
        "median_blur_radius_px": distribution(median),
        "depth_range": [min(least), max(greatest)] if least and quantity is not None else None,
        "depth_quantity": quantity,
        "depth_unit": unit,
        "suspicions": suspicions,
    }
    text = json.dumps(_plain(summary), indent=1) + "\n"
    _dofsim.write_bytes(folder / SUMMARY, text.encode())
    return summary


def _stamp(path: Path) -> tuple[str, int, int]:
    status = path.stat()
    return path.name, status.st_size, status.st_mtime_ns


def _parameters(frame: Frame) -> dict[str, Any]:
    """Everything that was asked for, by name; the number of threads changes nothing and is left out."""
    words = {name: value for name, value in vars(frame).items() if name != "output"}
    options = {name: value for name, value in frame.options.items() if name != "threads"}
    return words | {"options": options}


def _plain(value: Any) -> Any:
    """Put into the words that JSON has; infinity has none and becomes text, which ``float`` understands."""
    if isinstance(value, dofsim.Aperture):
        return _plain(value.__getnewargs_ex__()[1])
    if isinstance(value, Neighbour):
        return _plain(vars(value))
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    if isinstance(value, Path) or (isinstance(value, float) and not math.isfinite(value)):
        return str(value)
    return value
