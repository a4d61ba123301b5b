"""The separable blur of a half-size copy: against the formula, and against plain Gaussians."""

import cv2
import dofsim
import numpy as np
import pytest
from oracle import gaussian as oracle
from skimage.filters import gaussian as skimage_gaussian

# Spread of the full blur along x and y, the middle of the half-size copy's interpolation included.
SIGMA_PX = (10.75, 13.07)
LENS = dofsim.Lens.from_disparity(strength_px=24.0, focus=0.0)


def render(color, disparity, lens=LENS, **options):
    return dofsim.render(color, disparity, lens, depth_kind="disparity", method="gaussian", **options)


@pytest.mark.parametrize("size", [(60, 150), (61, 151), (5, 3), (1, 1)])
@pytest.mark.parametrize("max_coc_px", [None, 15.0])
def test_formula(size, max_coc_px):
    rng = np.random.default_rng(8)
    color, disparity = rng.random((*size, 3), dtype=np.float32), rng.uniform(-1.0, 1.0, size)
    disparity[size[0] // 3 :, size[1] // 3 :] = 0.0
    blurriness = np.minimum(24.0 * np.abs(disparity) / (max_coc_px or 24.0), 1.0)
    out = render(color, disparity, max_coc_px=max_coc_px)
    np.testing.assert_allclose(out, oracle.render(color, blurriness), atol=1e-5)


def test_formula_of_the_focal_range():
    rng = np.random.default_rng(9)
    color, depth = rng.random((40, 70, 3), dtype=np.float32), rng.uniform(1.0, 4.0, (40, 70))
    depth[3] = np.inf
    lens = dofsim.Lens(aperture_radius=0.05, focus_distance=2.0, fov=40.0)
    out = dofsim.render(color, depth, lens, method="gaussian", focal_range=1.5)
    expected = oracle.render(color, np.minimum(np.abs(depth - 2.0) / 1.5, 1.0))
    np.testing.assert_allclose(out, expected, atol=1e-5)
    with pytest.raises(ValueError, match="focal_range is in metres"):
        render(color, depth, focal_range=1.5)


@pytest.fixture(scope="module")
def smooth():
    """Noise without anything finer than the blur."""
    noise = np.random.default_rng(10).random((240, 320, 3)).astype(np.float32)
    return cv2.GaussianBlur(noise, (0, 0), 12.0)


def test_full_blur_is_a_gaussian_of_the_same_spread(smooth):
    out = render(smooth, np.ones(smooth.shape[:2]))
    by_cv2 = cv2.GaussianBlur(smooth, (0, 0), SIGMA_PX[0], sigmaY=SIGMA_PX[1], borderType=cv2.BORDER_REFLECT)
    by_skimage = skimage_gaussian(smooth, SIGMA_PX[::-1], mode="reflect", channel_axis=-1)
    contrast = np.ptp(smooth)
    # The article's table along y ends at 24 px with half of its greatest weight, which no Gaussian has.
    for expected in (by_cv2, by_skimage):
        assert np.abs(out - expected).max() < 0.016 * contrast
        assert np.sqrt(np.mean((out - expected) ** 2)) < 0.0035 * contrast
    # It is indeed a blur, and the spread along each axis is what decides.
    assert np.abs(out - smooth).max() > 0.1 * contrast
    turned = cv2.GaussianBlur(smooth, (0, 0), SIGMA_PX[1], sigmaY=SIGMA_PX[0], borderType=cv2.BORDER_REFLECT)
    assert np.mean((out - turned) ** 2) > 2.0 * np.mean((out - by_cv2) ** 2)


def test_a_point_spreads_as_far_as_its_circle():
    point = np.zeros((129, 129), np.float32)
    point[64, 64] = 1.0
    out = render(point, np.ones((129, 129))).astype(np.float64)
    offset = np.arange(129) - 64.0
    for axis, sigma in zip((0, 1), SIGMA_PX, strict=True):
        along = out.sum(axis=axis)
        spread = (along * offset**2).sum() - (along * offset).sum() ** 2
        # A point off the middle of its two by two pixels shifts by a half.
        assert np.sqrt(spread) == pytest.approx(sigma, abs=0.1)


def test_blurriness_lays_the_blur_over_the_picture(smooth):
    # With the half-size copy's weights all alike, half the blurriness is half of each, of a narrower blur.
    full, half = (render(smooth, np.full(smooth.shape[:2], d)) for d in (1.0, 0.5))
    assert 0.3 < np.std(half - smooth) / np.std(full - smooth) < 0.5


def test_what_is_sharp_does_not_spread():
    color = np.full((96, 96), 0.1, np.float32)
    color[40:56, 40:56] = 1.0
    blurred = np.full((96, 96), -1.0)
    before = blurred.copy()
    before[40:56, 40:56] = 0.0
    around = np.ones(color.shape, bool)
    around[38:58, 38:58] = False
    spread = (render(color, blurred) - color)[around].sum()
    thresholded = (render(color, before) - color)[around].sum()
    assert spread > 30.0
    # What is sharp counts a hundredth, to leave no pixel without any weight.
    assert 0.0 <= thresholded < 0.03 * spread


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"focal_range": 0.0}, "focal_range must be a distance in metres, .*; got 0"),
        ({"max_coc_px": -2.0}, "max_coc_px must be a radius in pixels, .*; got -2"),
        ({"max_coc_px": 9.0, "focal_range": 1.0}, "only one may be given"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        render(np.ones((4, 4), np.float32), np.ones((4, 4)), **options)
