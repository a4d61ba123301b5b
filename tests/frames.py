"""Frames on disk, for tests of batches."""

from pathlib import Path

import numpy as np
from dofsim import io


def write_frames(count, seed):
    """Write so many small pictures into ``rgb/`` and their depth into ``depth/``, under the same names."""
    rng = np.random.default_rng(seed)
    for folder in ("rgb", "depth"):
        Path(folder).mkdir()
    for index in range(count):
        io.write_image(f"rgb/{index:04}.exr", rng.random((40, 56, 3), dtype=np.float32))
        io.write_depth(f"depth/{index:04}.pfm", rng.uniform(2, 9, (40, 56)))
