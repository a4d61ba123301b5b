"""Laws of the plain gather that others are measured against."""

import numpy as np
import pytest
from oracle.gather import disc, gather


@pytest.mark.parametrize("radius_px", [0.3, 0.5, 1.0, 2.25, 7.6, 20.0])
def test_disc_has_the_area_and_spread_of_a_circle(radius_px):
    share = disc(radius_px)
    offset = np.arange(len(share)) - len(share) // 2
    # Exact along y, in strips along x: what the strips cost shows as a difference between the two.
    np.testing.assert_allclose(share, share.T, atol=2e-3 * share.max())
    np.testing.assert_allclose(share, share[::-1, ::-1], atol=1e-12)
    # A pixel that lies inside the circle has the share of one square pixel.
    if radius_px > 1.0:
        assert share.max() == pytest.approx(1.0 / (np.pi * radius_px**2), rel=1e-3)
    # Moving area to pixel centres changes the variance by no more than a pixel's own.
    assert (share.sum(axis=0) * offset**2).sum() == pytest.approx(radius_px**2 / 4.0, abs=1.0 / 6.0)


def test_zero_radius_changes_nothing():
    picture = np.random.default_rng(1).random((9, 12, 3))
    np.testing.assert_allclose(gather(picture, np.zeros((9, 12))), picture, atol=1e-12)


def test_even_picture_stays_even_up_to_the_border():
    coc_px = np.random.default_rng(2).uniform(-6.0, 6.0, (20, 24))
    np.testing.assert_allclose(gather(np.full((20, 24, 2), 0.7), coc_px), 0.7, atol=1e-12)


def test_one_point_becomes_a_disc():
    picture = np.zeros((21, 25, 1))
    picture[10, 12] = 1.0
    reach = 5
    out = gather(picture, np.full((21, 25), 4.5))[..., 0]
    expected = disc(4.5)
    half = len(expected) // 2
    np.testing.assert_allclose(out[10 - half : 11 + half, 12 - half : 13 + half], expected, atol=1e-12)
    assert out[10, 12 + reach + 1] == pytest.approx(0.0, abs=1e-12)


def test_radii_between_steps_are_interpolated():
    picture = np.random.default_rng(3).random((30, 30, 1))
    low, middle, high = (gather(picture, np.full((30, 30), r)) for r in (2.25, 2.35, 2.5))
    np.testing.assert_allclose(middle, 0.6 * low + 0.4 * high, atol=1e-12)
