"""The GPU path computes what the CPU path computes: lenses and openings."""

import dofsim
import numpy as np
import pytest
from both_devices import (
    CASES,
    CLIPPED,
    FLAWS,
    HEIGHT,
    OPENINGS,
    WIDTH,
    assert_agree,
    lamps,
    noise,
    render,
    surfaces,
    through,
)


@pytest.mark.parametrize("flaw", FLAWS)
@pytest.mark.parametrize("method", CASES)
def test_gpu_and_cpu_agree_on_lenses(gpu, method, flaw):
    on_gpu, on_cpu = (through(FLAWS[flaw], device, method) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, method)


@pytest.mark.parametrize("flaw", CLIPPED)
@pytest.mark.parametrize("aperture", [None, OPENINGS[1]], ids=["disc", "blades"])
def test_gpu_and_cpu_agree_on_barrels(gpu, flaw, aperture):
    on_gpu, on_cpu = (through(CLIPPED[flaw], d, "lens", aperture=aperture) for d in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "lens")


@pytest.mark.parametrize("flaw", ["axial_color", "all"])
@pytest.mark.parametrize("method", CASES)
def test_gpu_and_cpu_agree_on_colors_with_coverage(gpu, method, flaw):
    on_gpu, on_cpu = (through(FLAWS[flaw], device, method, channels=4) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, method)


@pytest.mark.parametrize(("strength_px", "views"), [(60.0, 384), (100.0, 256)])
def test_gpu_and_cpu_agree_on_many_views_of_many_cells(gpu, strength_px, views):
    color, disparity = (plane[:33, :66] for plane in noise())
    words = {"strength_px": strength_px, "views": views, "resolution": "full"}
    on_gpu, again, on_cpu = (render(color, disparity, device, **words) for device in (gpu, gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "lens")
    np.testing.assert_array_equal(again, on_gpu)


def covered():
    """Make surfaces of one colour on both sides of the focus, with pixels at their edges that show two."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    share = np.clip(0.5 * x + 0.31 * y - 40.0, 0.0, 1.0)[..., None]
    color = share * [0.9, 0.2, 0.1] + (1.0 - share) * [0.1, 0.5, 0.8]
    nearer = np.where(x > 90, 0.2, -0.5)
    return color.astype(np.float32), np.where(share[..., 0] > 0.5, nearer, -1.0).astype(np.float32)


@pytest.mark.parametrize("scene", [covered, surfaces, noise, lamps])
@pytest.mark.parametrize("spherical", [0.6, -0.6])
def test_gpu_and_cpu_agree_on_aberrated_openings(gpu, scene, spherical):
    scene, aperture = scene(), dofsim.Aperture(spherical=spherical)
    on_gpu, on_cpu = (render(*scene, device, aperture=aperture) for device in (gpu, "cpu"))
    assert_agree(on_gpu, on_cpu, "lens")
