"""A small change of the lens makes a small change of the picture, wherever two ways of computing meet."""

import dofsim
import numpy as np
import pytest
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


@pytest.mark.parametrize(("front_px", "back_px"), [(6, 1), (7.3, 2.3), (8, 0), (12, -4)])
def test_nothing_jumps_as_the_lens_sees_one_pixel_farther_behind_a_silhouette(front_px, back_px):
    y, x = np.indices((96, 128))
    texture = (0.3 + 0.2 * np.sin(x / 3) + 0.2 * np.cos(y / 4))[..., None].repeat(3, axis=2)
    is_front = np.hypot(x - 64, y - 48) < 25
    color = np.where(is_front[..., None], texture, 1 - texture).astype(np.float32)
    lens = dofsim.Lens.from_disparity(strength_px=100.0, focus=0.5)

    def picture(of_front_px):
        disparity = 0.5 + 0.01 * np.where(is_front, of_front_px, back_px)
        return dofsim.render(color, disparity.astype(np.float32), lens, depth_kind="disparity")

    before, behind = (picture(front_px + change_px) for change_px in (-1e-5, 1e-5))
    assert np.abs(before - behind).max() < 1e-4
