"""Wide blur: what is blurred by many pixels is swept in coarser scenes, and nothing of that shows."""

import dofsim
import numpy as np
import pytest
from numpy.testing import assert_allclose

LENS = dofsim.Lens.from_disparity(strength_px=100.0, focus=0.5)


def render(color, shift_px, lens=LENS, **options):
    """Return the picture of a scene whose cells have these shifts: positive in front of the focus."""
    disparity = (0.5 + np.asarray(shift_px) / 100.0).astype(np.float32)
    color = np.ascontiguousarray(color, np.float32)
    return dofsim.render(color, disparity, lens, depth_kind="disparity", device="cpu", **options).astype(
        float
    )


def half_plane(u):
    """Return the part of a unit disc on one side of a line so far from its middle."""
    u = np.clip(u, -1.0, 1.0)
    return 0.5 + (u * np.sqrt(1.0 - u * u) + np.arcsin(u)) / np.pi


@pytest.mark.parametrize("near_px", [9.0, 13.0, 20.0, 45.0, 90.0])
@pytest.mark.parametrize("far_px", [-11.0, -40.0])
def test_an_edge_is_blurred_by_the_lens_whatever_the_size_of_the_cells(near_px, far_px):
    height, width, edge = 96, 288, 131
    is_near = np.broadcast_to(np.arange(width) < edge, (height, width))
    color = np.where(is_near[..., None], [0.8, 0.1, 0.4], [0.2, 0.5, 0.4])
    out = render(color, np.where(is_near, near_px, far_px))
    near = half_plane((edge - 0.5 - np.arange(width)) / near_px)[None, :, None]
    expected = np.where(True, [0.2, 0.5, 0.4], 0.0) + near * np.subtract([0.8, 0.1, 0.4], [0.2, 0.5, 0.4])
    # Half a pixel of the picture over the diameter of the blur, and the noise of 512 lens points.
    assert_allclose(out, np.broadcast_to(expected, out.shape), atol=0.25 / near_px * 0.6 + 4e-3)


def test_a_thin_bar_keeps_its_light():
    height, width = 128, 320
    color = np.full((height, width, 3), 0.1)
    shift = np.full((height, width), -40.0)
    bar = np.zeros((height, width), bool)
    bar[:, 157:160] = True
    color[bar], shift[bar] = 0.9, 30.0
    out = render(color, shift)[height // 2, :, 0] - 0.1
    # The wall is as bright everywhere, so that the light of the bar is its width.
    assert_allclose(out.sum(), 3 * 0.8, rtol=0.02)
    profile = np.sqrt(np.maximum(0.0, 1.0 - ((np.arange(width) - 158.0) / 30.0) ** 2)) * 2.0 / (np.pi * 30.0)
    assert_allclose(out, 3 * 0.8 * profile, atol=4e-3)


def test_light_is_kept_and_no_seam_shows_where_scenes_of_several_sizes_meet():
    height, width = 192, 640
    x = np.arange(width)
    shift = np.broadcast_to(0.3 * (x - 60.0), (height, width))
    even = render(np.full((height, width, 3), 0.37), shift)
    assert_allclose(even, 0.37, rtol=2e-6)
    ramp = render(np.broadcast_to((0.1 + 0.8 * x / width)[None, :, None], (height, width, 3)), shift)
    middle = 255.0 * ramp[40:-40, 16:400]
    bend = np.abs(middle[:, 2:] - 2.0 * middle[:, 1:-1] + middle[:, :-2])
    assert bend.max() < 0.1


def test_a_surface_that_is_sharp_stays_what_it_is_beside_wide_blur():
    rng = np.random.default_rng(4)
    height, width = 192, 320
    color = rng.random((height, width, 3))
    shift = np.full((height, width), 0.0)
    shift[:, 200:] = -60.0
    out = render(color, shift)
    np.testing.assert_array_equal(out[:, :160].astype(np.float32), color[:, :160].astype(np.float32))


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_number_of_threads_changes_no_bit(threads):
    rng = np.random.default_rng(5)
    height, width = 100, 230
    color = rng.random((height, width, 3))
    shift = np.where(np.arange(width) < 90, 35.0, -0.2 * np.arange(height)[:, None])
    np.testing.assert_array_equal(render(color, shift, threads=threads), render(color, shift))
