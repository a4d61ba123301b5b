"""The method of a few look-ups: against its formula, and what its text says of it."""

import dofsim
import numpy as np
import pytest
from oracle import taps as oracle

VARIANTS = list(oracle.OFFSETS_PX)
LENS = dofsim.Lens(aperture_radius=0.2, focus_distance=2.0, fov=40.0)


def render(color, depth, variant, lens=LENS, **options):
    return dofsim.render(color, depth, lens, method="taps", variant=variant, **options)


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(5)
    # Not a multiple of the columns that are worked on at once.
    return rng.random((41, 150, 3), dtype=np.float32), 1.0 / rng.uniform(0.05, 1.5, (41, 150))


@pytest.mark.parametrize("variant", VARIANTS)
def test_lens_gives_the_blur_factor_of_the_formula(scene, variant):
    color, depth = scene
    # Some pixels below the cap, some above.
    lens = LENS.replace(aperture_radius=0.01)
    radius_px = dofsim.coc(depth, lens)
    assert 1.9 < np.abs(radius_px).max() < 2.2
    expected = oracle.render(color, radius_px / (2.0 if variant == "thirteen" else 1.0), variant)
    np.testing.assert_allclose(render(color, depth, variant, lens), expected, atol=1e-5)


@pytest.mark.parametrize("variant", VARIANTS)
def test_hyperfocal_factor_scales_distances_from_the_focus_plane(scene, variant):
    color, depth = scene
    expected = oracle.render(color, 0.4 * (depth - LENS.focus_distance), variant)
    np.testing.assert_allclose(render(color, depth, variant, hyperfocal_factor=0.4), expected, atol=1e-5)


def test_thirteen_look_ups_are_the_default(scene):
    np.testing.assert_array_equal(dofsim.render(*scene, LENS, method="taps"), render(*scene, "thirteen"))


@pytest.fixture(scope="module")
def sharp_above_blurred():
    color = np.zeros((20, 30), np.float32)
    color[:10] = 1.0
    depth = np.full((20, 30), np.inf)
    depth[:10] = LENS.focus_distance
    return color, depth


def test_sharp_neighbours_draw_a_ring_only_if_mixed_by_the_centre_alone(sharp_above_blurred):
    # The look-up straight above meets the sharp half whole: the product of the factors is 0 x 0.75.
    np.testing.assert_array_equal(render(*sharp_above_blurred, "four"), sharp_above_blurred[0])
    ringed = render(*sharp_above_blurred, "four_rings")
    np.testing.assert_allclose(ringed[10], 0.75 / 4.0, rtol=1e-6)
    np.testing.assert_array_equal(ringed[11:], 0.0)


@pytest.mark.parametrize("variant", [v for v in VARIANTS if v != "four_rings"])
def test_sharp_things_leak_less_than_with_rings(sharp_above_blurred, variant):
    color, depth = sharp_above_blurred
    leaked = render(color, depth, variant)[10:].sum(axis=0)
    # As if all were blurred: what the same look-ups give where nothing is held back.
    let_in = render(color, np.full_like(depth, np.inf), variant)[10:].sum(axis=0)
    assert (leaked < 0.6 * let_in).all()


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_centre_always_counts(variant):
    color = np.zeros((9, 9), np.float32)
    color[4, 4] = 1.0
    out = render(color, np.full((9, 9), np.inf), variant, hyperfocal_factor=1e3)
    mixed = 0.75 if variant == "four_rings" else 0.75**2
    looked_up = len(oracle.OFFSETS_PX[variant])
    # At least what is left of the centre in each mixture; bilinear look-ups may read some of it too.
    assert out[4, 4] >= (1.0 + looked_up * (1.0 - mixed)) / (looked_up + 1) - 1e-6
    assert out.sum() == pytest.approx(1.0, abs=1e-6)


def test_more_and_farther_look_ups_blur_more(scene):
    noise = np.random.default_rng(6).random((60, 60), dtype=np.float32)
    far = np.full((60, 60), np.inf)
    spread = {v: render(noise, far, v, hyperfocal_factor=1.0).std() for v in ("four", "seven", "thirteen")}
    assert spread["thirteen"] < spread["seven"] < spread["four"] < noise.std()


def test_metres_need_a_lens_that_has_them():
    relative = dofsim.Lens.from_disparity(strength_px=5.0, focus=0.2)
    color, disparity = np.ones((8, 8), np.float32), np.ones((8, 8))
    assert render(color, disparity, "four", relative, depth_kind="disparity").shape == (8, 8)
    with pytest.raises(ValueError, match=r"hyperfocal_factor is in metres.*from_disparity"):
        render(color, disparity, "four", relative, depth_kind="disparity", hyperfocal_factor=0.1)
