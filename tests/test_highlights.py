"""Lamps through the flagship: they have the light that they should, and a surface never hides its own."""

from itertools import pairwise

import dofsim
import numpy as np
import pytest

DARK, LAMP = 0.02, 400.0


def lens(strength_px, focus):
    return dofsim.Lens.from_disparity(strength_px=strength_px, focus=focus)


def light_of(lamps, disparity, strength_px, focus, dark=DARK, **options):
    """Render a dark picture with lamps and without them; the difference is their light."""
    without = np.full((*disparity.shape, 3), dark, np.float32)
    color = without.copy()
    for (y, x), brightness in lamps.items():
        color[y, x] = brightness
    with_lamps, without = (
        dofsim.render(c, disparity, lens(strength_px, focus), depth_kind="disparity", **options).astype(float)
        for c in (color, without)
    )
    return (with_lamps - without)[..., 0]


@pytest.mark.parametrize("slope", [0.3, 0.5, 0.7, 0.9])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_slope_does_not_hide_its_own_lamp(slope, axis):
    # The circle of confusion grows by `slope` a pixel; a ray through the rim of the lens moves by 1 a pixel.
    height, width, k = 280, 120, 70.0
    disparity = np.maximum(0.75 - slope * (np.arange(height) - 80.0) / k, 0.01).astype(np.float32)
    row, column = round(80 + 24 / slope), width // 2
    disparity = np.repeat(disparity[:, None], width, 1)
    place = row, column
    if axis == 1:
        disparity, place = np.ascontiguousarray(disparity.T), place[::-1]
    disc = light_of({place: LAMP}, disparity, k, 0.75)
    assert disc.sum() / (LAMP - DARK) == pytest.approx(1.0, abs=0.02)
    y, x = np.indices(disc.shape)
    inside = disc[np.hypot(y - place[0], x - place[1]) < 22.0]
    assert (inside < 0.3 * np.median(inside)).mean() < 0.005


@pytest.mark.parametrize("radius_px", [20, 60, 120])
@pytest.mark.parametrize("side", [1, 2, 3])
def test_a_lamp_beside_a_pole_does_not_go_on_behind_it(side, radius_px):
    # Rays that leave the pole sideways meet the road at other depths; few of them meet what the lamp is on.
    height, width, first, end = 240, 240, 100, 120
    from_horizon = (height - np.arange(height)) / height
    disparity = np.repeat((1 / (3 + 40 * from_horizon**2))[:, None], width, 1)
    disparity[:, first:end] = 1 / 2
    row = 180
    for column in range(end, end + 5):
        lamps = {(row + i, column + j): 100.0 for i in range(side) for j in range(side)}
        light = light_of(lamps, disparity.astype(np.float32), 3 * radius_px, 1 / 6, dark=0.05).sum()
        # Half a pixel of it may be behind the edge.
        assert light / (side * (side + 0.5) * (100.0 - 0.05)) < 1.01


@pytest.mark.parametrize("distance", [0, 2, 8, 20])
def test_a_lamp_beside_the_border_is_one_disc_cut_off(distance):
    disparity = np.full((100, 140), 0.2, np.float32)
    # Something in focus in a corner, so that visibility is resolved in some tiles and not in others.
    disparity[80:, 110:] = 0.8
    middle, beside = (light_of({(50, x): 300.0}, disparity, 50.0, 0.8) for x in (70, distance))
    expected = np.zeros_like(middle)
    moved = 70 - distance
    expected[:, : 140 - moved] = middle[:, moved:]
    # What is not drawn apart, five times the surroundings, is mirrored with them.
    open_to = np.s_[:, :80]
    np.testing.assert_allclose(beside[open_to], expected[open_to], atol=1e-3 * middle.max())


def test_a_screen_in_focus_cuts_discs_off_sharply():
    disparity = np.full((96, 160), 0.2, np.float32)
    whole = light_of({(48, 80): LAMP}, disparity, 40.0, 0.8)
    disparity[:, 90:] = 0.8
    cut = light_of({(48, 80): LAMP}, disparity, 40.0, 0.8)
    np.testing.assert_allclose(cut[:, :89], whole[:, :89], atol=0.01 * whole.max())
    assert np.abs(cut[:, 91:]).max() < 1e-3 * whole.max()


def test_a_near_screen_bites_its_shadow_out_of_a_disc():
    # Seen from the lamp, the edge of a screen half as far away from the focus has twice its distance.
    disparity = np.full((128, 160), 0.4, np.float32)
    whole = light_of({(64, 60): LAMP}, disparity, 40.0, 0.8)
    disparity[:, 70:] = 0.6
    cut = light_of({(64, 60): LAMP}, disparity, 40.0, 0.8)
    shadow = 60 + 2 * (69.5 - 60)
    y, x = np.mgrid[:128, :160]
    inside = np.hypot(x - 60, y - 64) < 14
    np.testing.assert_allclose(cut[inside & (x < shadow - 1.5)], whole[inside].mean(), rtol=0.03)
    behind = (x > shadow + 1.5) & (x < 90)
    assert cut[behind].max(initial=0.0) < 0.02 * whole.max()


def test_a_surface_of_another_layer_hides_lamps_however_near_it_is():
    color = np.zeros((2, 64, 80, 4), np.float32)
    color[..., :3], color[..., 3] = DARK, 1.0
    color[1, 32, 40, :3] = LAMP
    disparity = np.full((2, 64, 80), 0.5, np.float32)
    disparity[1] -= 0.5 / 30.0
    out = dofsim.render(color, disparity, lens(30.0, 0.9), depth_kind="disparity")
    np.testing.assert_allclose(out[..., :3], DARK, rtol=1e-4)


@pytest.mark.parametrize("radius_px", [0.1, 0.3, 0.45, 0.8, 3.0, 12.0])
def test_the_picture_has_no_step_where_a_highlight_begins(radius_px):
    """Where the cell outshines its surroundings by just so much that it is drawn apart."""
    disparity = np.full((96, 120), 0.2, np.float32)
    disparity[60:, 80:] = 0.8
    brightness = DARK * np.linspace(4.0, 6.0, 41)
    lamps = [light_of({(40, 50): b}, disparity, radius_px / 0.6, 0.8) for b in brightness]
    steps = [np.abs(b - a).max() for a, b in pairwise(lamps)]
    assert max(steps) < 2.0 * np.median(steps)


@pytest.mark.parametrize("radius_px", [20.0, 60.0])
def test_a_large_lamp_is_cheap_and_keeps_its_light(radius_px):
    """A lamp of many cells is few clusters; what hides it is found once for each."""
    side = int(radius_px / 4.0)
    disparity = np.full((256, 320), 0.2, np.float32)
    disparity[:, 300:] = 0.8
    lamps = {(120 + j, 120 + i): LAMP for j in range(side) for i in range(side)}
    disc = light_of(lamps, disparity, radius_px / 0.6, 0.8)
    assert disc.sum() / ((LAMP - DARK) * side**2) == pytest.approx(1.0, abs=2e-3)
