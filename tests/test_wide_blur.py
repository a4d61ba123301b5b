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
    # Not so bright that it would be a highlight, which mirror images do not have.
    color[:, bar], shift[:, bar] = 0.4, 110.0
    out = render(color, shift, resolution=resolution)[16:-16, :, 0].mean(0) - 0.1
    # The wall is as bright everywhere, so that the light of the bar is its width.
    assert_allclose(out.sum(), 3 * 0.3, rtol=0.03)
    place = (np.arange(width) - middle) / 110.0
    profile = 3 * 0.3 * np.sqrt(np.maximum(0.0, 1.0 - place**2)) * 2.0 / (np.pi * 110.0)
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


def ramp(height, width):
    """Return a picture whose mean over all mirror images is 0.5."""
    x = (np.arange(width) + 0.5) / width
    return np.broadcast_to((0.2 + 0.6 * x)[None, :, None], (height, width, 3))


@pytest.mark.parametrize("shift_px", [300.0, 1000.0, 5000.0, -2500.0])
@pytest.mark.parametrize("shape", [(40, 70), (120, 200)])
def test_a_blur_that_is_much_wider_than_the_picture_is_its_mean(shape, shift_px):
    lens = dofsim.Lens.from_disparity(strength_px=20000.0, focus=0.5)
    disparity = np.full(shape, 0.5 + shift_px / 20000.0, np.float32)
    out = dofsim.render(
        ramp(*shape).astype(np.float32), disparity, lens, depth_kind="disparity", device="cpu"
    )
    # Along an axis, a disc of radius R leaves J1(w R) / (w R) / 2 of the picture's lowest frequency.
    assert_allclose(out, 0.5, atol=0.3 * min(1.0, (shape[1] / abs(shift_px)) ** 1.5))


def test_memory_does_not_grow_with_the_blur():
    """The padded frame of 33 000 x 33 000 pixels would take 40 GB."""
    shape = (300, 400)
    lens = dofsim.Lens.from_disparity(strength_px=20000.0, focus=0.5)
    shift = np.where(np.arange(shape[1]) < 150, 16000.0, 0.0) * np.ones((shape[0], 1))
    disparity = (0.5 + shift / 20000.0).astype(np.float32)
    out = dofsim.render(
        ramp(*shape).astype(np.float32), disparity, lens, depth_kind="disparity", device="cpu", views=64
    )
    assert np.isfinite(out).all()


@pytest.mark.parametrize("reach_px", [200.0, 700.0])
@pytest.mark.parametrize("shape", [(33, 47), (96, 130)])
def test_mirror_images_of_mirror_images_are_those_of_a_larger_frame(shape, reach_px):
    """A frame that holds one whole period of mirror images has the same surroundings as a part of it."""
    rng = np.random.default_rng(8)
    height, width = shape
    color = rng.random((height, width, 3)).astype(np.float32)
    shift = np.where(rng.random((height // 8 + 1, width // 8 + 1)) < 0.3, 0.2, 1.0) * reach_px
    shift = shift.repeat(8, 0).repeat(8, 1)[:height, :width]

    def mirrored(a, times):
        for axis in (0, 1):
            a = np.concatenate([a, np.flip(a, axis)] * times, axis)
        return a

    once, larger = (
        render(mirrored(color, n), mirrored(shift, n), resolution="full", views=256) for n in (1, 4)
    )
    # Mixed pixels at the border of a frame see less around them than inside.
    assert_allclose(larger[: 2 * height, : 2 * width], once, atol=0.01)


@pytest.mark.parametrize("reach_px", [100.0, 900.0])
def test_gpu_and_cpu_agree_on_blur_that_is_wider_than_the_picture(gpu, reach_px):
    rng = np.random.default_rng(8)
    color = rng.random((96, 130, 3)).astype(np.float32)
    color[[30, 70], [20, 100]] = 400.0
    shift = np.where(rng.random((12, 17)) < 0.3, 0.2, 1.0) * reach_px
    disparity = (0.5 + shift.repeat(8, 0).repeat(8, 1)[:, :130] / 1000.0).astype(np.float32)
    lens = dofsim.Lens.from_disparity(strength_px=1000.0, focus=0.5)
    on_gpu, on_cpu = (
        dofsim.render(
            color, disparity, lens, depth_kind="disparity", device=device, resolution="full", views=64
        )
        for device in (gpu, "cpu")
    )
    assert_allclose(on_gpu, on_cpu, atol=1e-4)


@pytest.mark.parametrize(
    "asked", [{"resolution": "full"}, {"lens": LENS.replace(cat_eye=0.5)}, {"layers": 2}], ids=str
)
def test_a_radius_that_is_too_large_for_full_resolution_is_refused(asked):
    shift = np.full((24, 30), 3000.0)
    color = np.ones((24, 30, 4))
    if asked.pop("layers", 1) == 2:
        color, shift = np.stack([0.5 * color, color]), np.stack([shift, shift - 1.0])
    with pytest.raises(ValueError, match=r"radii of up to 3000 px; of more than 2048 px.*max_coc_px"):
        render(color, shift, **asked)


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
