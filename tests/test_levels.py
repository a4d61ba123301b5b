"""Filter levels: against their formula, and what their paper says of them."""

import cv2
import dofsim
import numpy as np
import pytest
from oracle import levels as oracle
from skimage.filters import gaussian


def render(color, coc_px, **options):
    """Render with this signed circle of confusion at every pixel."""
    lens = dofsim.Lens.from_disparity(strength_px=1.0, focus=0.0)
    disparity = -np.asarray(coc_px, np.float32)
    return dofsim.render(color, disparity, lens, depth_kind="disparity", method="levels", **options)


@pytest.fixture(scope="module")
def color():
    return np.random.default_rng(3).random((53, 90, 3), dtype=np.float32)


@pytest.fixture(scope="module")
def coc_px():
    return np.random.default_rng(4).uniform(-12.0, 12.0, (53, 90)).astype(np.float32)


@pytest.mark.parametrize("c0_px", [None, 0.7, 1.5, 3.0, 4.0, 9.0, 16.0])
def test_it_is_its_formula(color, coc_px, c0_px):
    expected = oracle.render(color, coc_px, c0_px=c0_px)
    np.testing.assert_allclose(render(color, coc_px, c0_px=c0_px), expected, atol=1e-5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_blur_begins_at_c0_and_is_full_at_twice_that(color, sign):
    third, fifth = oracle.targets(color, 6.0)
    for diameter, expected in [
        (0.0, color),
        (5.9, color),
        (6.0, color),
        (7.5, 0.5 * (color + third)),
        (9.0, third),
        (10.5, 0.5 * (third + fifth)),
        (12.0, fifth),
        (50.0, fifth),
    ]:
        out = render(color, np.full(color.shape[:2], sign * 0.5 * diameter), c0_px=6.0)
        np.testing.assert_allclose(out, expected, atol=1e-5, err_msg=f"diameter {diameter}")


@pytest.mark.parametrize("c0_px", [1.0, 3.0, 5.0, 12.0, 30.0])
def test_the_strongest_level_is_as_wide_as_the_disc_of_twice_c0(c0_px):
    y, x = np.mgrid[:256, :256]
    moments = []
    # All places within a large pixel, along the diagonal.
    for at in range(128, 136):
        point = np.zeros((256, 256), np.float32)
        point[at, at] = 1.0
        out = render(point, np.full(point.shape, c0_px), c0_px=c0_px).astype(np.float64)
        moments.append([(out * (i - at) ** 2).sum() for i in (x, y)])
    # A disc of diameter d has variance d^2/16 along each axis.
    np.testing.assert_allclose(np.mean(moments, axis=0), c0_px**2 / 4.0, rtol=1e-3)


@pytest.mark.parametrize(("c0_px", "close"), [(3.0, 0.04), (8.0, 0.2), (14.0, 0.2)])
def test_the_strongest_level_is_close_to_a_gaussian(c0_px, close):
    # A whole number of large pixels: the mirror image begins after the last of them.
    color = np.random.default_rng(5).random((64, 96, 3), dtype=np.float32)
    out = render(color, np.full(color.shape[:2], c0_px), c0_px=c0_px)
    sigma = 0.5 * c0_px
    linear = color.astype(np.float64)
    expected = gaussian(linear, sigma=sigma, truncate=6.0, channel_axis=2, mode="reflect")
    size = 2 * int(np.ceil(6.0 * sigma)) + 1
    other = cv2.GaussianBlur(linear, (size, size), sigma, borderType=cv2.BORDER_REFLECT)
    # Of what a Gaussian leaves of white noise. Large pixels are interpolated from 8 on.
    for gauss in (expected, other):
        assert np.sqrt(np.mean((out - gauss) ** 2)) < close * gauss.std()


def test_without_c0_the_largest_blur_is_the_strongest_level(color, coc_px):
    largest = float(np.abs(coc_px).max())
    np.testing.assert_allclose(render(color, coc_px), render(color, coc_px, c0_px=largest), atol=1e-5)


def test_the_papers_look_up_table_holds_what_the_lens_says():
    focal_length, f_stop, width, film = 0.05, 2.0, 640, 0.036
    camera = np.linspace(0.8, 30.0, 1024)
    focus = np.linspace(1.0, 10.0, 16)
    c0 = 2e-4
    table = oracle.level(oracle.circle_of_confusion(camera[None], focus[:, None], focal_length, f_stop), c0)
    for row, distance in zip(table, focus, strict=True):
        lens = dofsim.Lens.from_camera(
            focal_length_mm=50.0, f_number=f_stop, focus_distance=distance, sensor_width_mm=36.0
        )
        depth = np.broadcast_to(camera[:width], (4, width))
        diameter_px = 2.0 * np.abs(dofsim.coc(depth, lens)[0])
        expected = oracle.level(diameter_px, c0 / film * width)
        np.testing.assert_allclose(row[:width], expected, atol=1e-4)


@pytest.mark.parametrize(
    ("c0_px", "error"), [(0.0, ValueError), (float("nan"), ValueError), ("wide", TypeError)]
)
def test_a_diameter_that_is_none_is_refused(color, coc_px, c0_px, error):
    with pytest.raises(error, match=r"^c0_px must be "):
        render(color, coc_px, c0_px=c0_px)
