"""One scale of relative disparity for all frames of a sequence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dofsim._relative import range_of

from . import work
from .frames import Frame

# Frames and values that are looked at: 16 MiB tell a percentile of any sequence to a thousandth.
_FRAMES = 64
_VALUES = 1 << 16


def depth_range(frames: Sequence[Frame]) -> tuple[float, float] | None:
    """Return one scale of relative disparity for all frames of a sequence.

    Without it each frame has a scale of its own, and a hand that comes near the camera changes the blur of
    everything that has not moved. At most 64 frames are read, evenly spaced; those that cannot be read do not
    count.

    Parameters
    ----------
    frames : sequence of Frame
        The frames of a sequence.

    Returns
    -------
    tuple of float or None
        The disparities that are far and near, for ``depth_range`` among the options of every frame. None if
        no frame has two.

    Examples
    --------
    >>> from dofsim.batch import Frame, depth_range
    >>> lens = {"strength_percent": 3.0, "focus": 1.0}
    >>> depth_range([Frame(color="missing.png", depth="d.png", output="out.png", lens=lens)])
    """
    step = max(1, -(-len(frames) // _FRAMES))
    found = []
    for frame in frames[::step]:
        loaded = work.read(frame, False)
        if isinstance(loaded, work.Loaded):
            values = np.asarray(loaded.depth).ravel()
            found.append(values[:: max(1, values.size // _VALUES)])
    return range_of(np.concatenate(found)) if found else None
