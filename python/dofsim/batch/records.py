"""The record of a frame: how it was made, from what, and that it is whole."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import dofsim
from dofsim import _dofsim
from dofsim._files import read_text

from .frames import Frame


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
    inputs = [_stamp(path) for path in (frame.color, frame.depth) if path is not None]
    words = {name: value for name, value in _parameters(frame).items() if name not in ("color", "depth")}
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
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    if isinstance(value, Path) or (isinstance(value, float) and not math.isfinite(value)):
        return str(value)
    return value
