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


@pytest.mark.parametrize("near_px", [13.0, 36.0, 60.0, 130.0])
@pytest.mark.parametrize("far_px", [-11.0, -70.0])
def test_an_edge_is_blurred_by_the_lens_whatever_the_size_of_the_cells(near_px, far_px):
    height, width, edge = 96, 416, 203
    is_near = np.broadcast_to(np.arange(width) < edge, (height, width))
    color = np.where(is_near[..., None], [0.8, 0.1, 0.4], [0.2, 0.5, 0.4])
    out = render(color, np.where(is_near, near_px, far_px))
    near = half_plane((edge - 0.5 - np.arange(width)) / near_px)[None, :, None]
    expected = np.where(True, [0.2, 0.5, 0.4], 0.0) + near * np.subtract([0.8, 0.1, 0.4], [0.2, 0.5, 0.4])
    # Half a pixel of the picture over the diameter of the blur, and the noise of 512 lens points.
    assert_allclose(out, np.broadcast_to(expected, out.shape), atol=0.25 / near_px * 0.6 + 8e-3)


@pytest.mark.parametrize("resolution", ["adaptive", "full"])
def test_a_thin_bar_keeps_its_light(resolution):
    height, width, middle = 128, 512, 253.0
    color = np.full((height, width, 3), 0.1)
    shift = np.full((height, width), -60.0)
    bar = np.abs(np.arange(width) - middle) < 2
    color[:, bar], shift[:, bar] = 0.9, 110.0
    out = render(color, shift, resolution=resolution)[16:-16, :, 0].mean(0) - 0.1
    # The wall is as bright everywhere, so that the light of the bar is its width.
    assert_allclose(out.sum(), 3 * 0.8, rtol=0.03)
    place = (np.arange(width) - middle) / 110.0
    profile = 3 * 0.8 * np.sqrt(np.maximum(0.0, 1.0 - place**2)) * 2.0 / (np.pi * 110.0)
    # Some ten of 512 lens points see the bar from a pixel, and of those of an eighth of the disc a hundred.
    seen, expected = (np.convolve(v, np.full(27, 1 / 27), mode="same") for v in (out, profile))
    assert_allclose(seen, expected, atol=0.1 * expected.max())


def test_light_is_kept_and_no_seam_shows_where_scenes_of_several_sizes_meet():
    height, width = 192, 640
    x = np.arange(width)
    shift = np.broadcast_to(0.3 * (x - 60.0), (height, width))
    even = render(np.full((height, width, 3), 0.37), shift)
    assert_allclose(even, 0.37, rtol=1e-5)
    color = np.broadcast_to((0.1 + 0.8 * x / width)[None, :, None], (height, width, 3))
    adaptive, full = (255.0 * render(color, shift, resolution=name) for name in ("adaptive", "full"))
    assert np.abs(adaptive - full).max() < 0.4
    middle = adaptive[:, 16:400]
    bend = np.abs(middle[:, 2:] - 2.0 * middle[:, 1:-1] + middle[:, :-2])
    assert bend.max() < 0.1


def test_texture_is_blurred_as_much_as_at_full_resolution():
    rng = np.random.default_rng(4)
    height, width = 240, 480
    color = rng.random((height // 8, width // 8, 3)).repeat(8, 0).repeat(8, 1)
    shift = np.where(np.arange(width) < 200, 90.0, -70.0 - 0.1 * np.arange(height)[:, None])
    adaptive, full = (255.0 * render(color, shift, resolution=name) for name in ("adaptive", "full"))
    assert not np.array_equal(adaptive, full)
    assert np.sqrt(np.mean((adaptive - full) ** 2)) < 1.0
    spread = [np.std(picture[:, 260:440] - picture[:, 260:440].mean((0, 1))) for picture in (adaptive, full)]
    assert_allclose(spread[0], spread[1], rtol=0.1)


def test_a_surface_that_is_sharp_stays_what_it_is_beside_wide_blur():
    rng = np.random.default_rng(4)
    height, width = 192, 320
    color = rng.random((height, width, 3)).astype(np.float32)
    shift = np.where(np.arange(width) < 200, 0.0, np.full((height, width), -90.0))
    out = render(color, shift)
    assert_allclose(out[:, :160], color[:, :160], atol=2e-5)


@pytest.mark.parametrize("option", ["half", 1])
def test_an_unknown_resolution_is_refused(option):
    with pytest.raises((ValueError, TypeError), match="resolution"):
        render(np.zeros((8, 8, 3)), np.zeros((8, 8)), resolution=option)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_number_of_threads_changes_no_bit(threads):
    rng = np.random.default_rng(5)
    height, width = 100, 230
    color = rng.random((height, width, 3))
    shift = np.where(np.arange(width) < 90, 75.0, -60.0 - 0.2 * np.arange(height)[:, None])
    np.testing.assert_array_equal(render(color, shift, threads=threads), render(color, shift))
