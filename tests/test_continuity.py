"""A small change of the lens makes a small change of the picture, wherever two ways of computing meet."""

import dofsim
import numpy as np
from dofsim.metrics import srgb


def test_a_focus_pull_over_a_floor_does_not_jump():
    # From frame to frame the radii change by 0.04 px, and tiles go over from exact discs to sweeps.
    rng = np.random.default_rng(11)
    color = (0.3 + 0.5 * rng.random((96, 128, 1))).repeat(3, axis=2).astype(np.float32)
    disparity = np.linspace(0.2, 0.7, 96)[:, None].repeat(128, axis=1).astype(np.float32)
    lenses = [dofsim.Lens.from_disparity(strength_px=25.0, focus=f) for f in np.arange(0.49, 0.56, 0.0016)]
    frames = [255 * srgb(dofsim.render(color, disparity, lens, depth_kind="disparity")) for lens in lenses]
    # Texture as fine as pixels changes by 2.6 codes by itself.
    assert np.abs(np.diff(frames, axis=0)).max() < 3.5
