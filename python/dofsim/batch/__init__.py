"""Thousands of frames: read, rendered and written side by side, and resumed where they were left.

`map_frames` does the work; `pair_files` and `read_manifest` find it, and `depth_range` gives frames of
relative disparity one scale. How nothing is lost:

* A frame is done when its record, a JSON file beside its output, is there. It is written last, after every
  output of the frame, and taken away first when the frame is to be made anew. Every file appears under its
  name only when it is whole. So a run may be killed at any moment.
* The record holds a fingerprint of the frame's parameters and of its inputs' sizes and times of change.
  Contents are not hashed: reading every byte again can take as long as the rendering. A file that was touched
  is made again; one that was replaced by another of the same size and time is not noticed.
* What goes wrong with a frame is its own result, and a line of ``failures.jsonl``; the others go on.

It guards against the death of processes, not of the machine: files are not forced out to the disk one by one.
"""

from .frames import OUTPUTS, Frame, Neighbour, Result
from .manifest import Row, read_manifest
from .neighbours import with_neighbours
from .pairs import Pairing, pair_files
from .pipeline import map_frames
from .relative import depth_range

__all__ = [
    "OUTPUTS",
    "Frame",
    "Neighbour",
    "Pairing",
    "Result",
    "Row",
    "depth_range",
    "map_frames",
    "pair_files",
    "read_manifest",
    "with_neighbours",
]


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(__all__)
