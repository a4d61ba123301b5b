"""Frames that a device cannot have in one piece, devices that can do less, and what stays on them."""

import functools

import dofsim
import numpy as np
import pytest
from both_devices import CASES, CLIPPED, FLAWS, metric_scene, random_color
from dofsim._dofsim import device_traffic


def tall(height=1000, width=40):
    """Make a scene of so many rows that it can be had in bands."""
    y, x = np.mgrid[:height, :width]
    depth = np.where((y // 37 + x // 23) % 2 == 0, 6.0, 1.5 + 0.05 * x + 0.001 * y).astype(np.float32)
    color = random_color(size=(height, width))
    color[::29, ::13] = 50.0
    return color, depth


# Larger than what one band at least needs, and smaller than the frame.
BAND_BYTES = {"hexagonal": 900_000}


@pytest.mark.parametrize("flaw", ["thin", "all", "breathing", "full"])
@pytest.mark.parametrize("method", CASES)
def test_frames_in_bands_are_the_same(gpu, restricted, method, flaw):
    """No bit differs at the seams, or anywhere else."""
    if flaw in CLIPPED and method != "lens":
        pytest.skip("only the flagship honours cat_eye")
    color, depth = tall()
    flaw = {"thin": {}, **FLAWS, **CLIPPED}[flaw]
    lens = dofsim.Lens(aperture_radius=0.15, focus_distance=3.0, fov=40.0, **flaw)
    # Few lens points for the slow ones; how many a tile has by itself, the thin lens tells.
    options = {"views": 16} if method == "lens" and flaw else {}
    options |= {"method": method, "supersample": 2}
    call = functools.partial(dofsim.render, color, depth, lens, device=gpu, **options)
    whole = call()
    limit = BAND_BYTES.get(method, 470_000)
    assert limit < color.nbytes * (3 if method == "hexagonal" else 1)
    restricted(max_binding_bytes=limit)
    np.testing.assert_array_equal(call(), whole)


@pytest.mark.parametrize("method", CASES)
def test_scenes_in_bands_stay_on_the_device(gpu, restricted, method):
    restricted(max_binding_bytes=BAND_BYTES.get(method, 470_000))
    color, depth = tall()
    scene = dofsim.Scene(color, depth, device=gpu)
    lens = dofsim.Lens(aperture_radius=0.15, focus_distance=3.0, fov=40.0)
    options = {"views": 16} if method == "lens" else {}
    first = scene.render(lens, method=method, **options)
    before = device_traffic()["uploaded_bytes"]
    np.testing.assert_array_equal(scene.render(lens, method=method, **options), first)
    assert device_traffic()["uploaded_bytes"] - before < color.nbytes


def test_what_does_not_fit_in_bands_is_refused_before_work_starts(gpu, restricted):
    color, depth = tall()
    lens = dofsim.Lens(aperture_radius=0.15, focus_distance=3.0, fov=40.0)
    restricted(max_binding_bytes=20_000)
    before = device_traffic()["uploaded_bytes"]
    with pytest.raises(
        dofsim.DeviceError, match=r"band of the picture would need \d+ MiB .* the device allows"
    ):
        dofsim.render(color, depth, lens, device=gpu, method="taps")
    assert device_traffic()["uploaded_bytes"] == before


@pytest.mark.parametrize("method", CASES)
def test_a_focal_stack_takes_no_picture_to_the_device(gpu, method):
    color, depth = metric_scene()
    scene = dofsim.Scene(color, depth, device=gpu)
    lens = dofsim.Lens(aperture_radius=0.01, focus_distance=3.0, fov=40.0)
    distances = np.linspace(2.0, 5.0, 8)
    scene.focal_stack(lens, distances[[0, -1]], method=method)
    before = device_traffic()["uploaded_bytes"]
    scene.focal_stack(lens, distances, method=method)
    # Tables alone: not even one of the picture's planes.
    assert device_traffic()["uploaded_bytes"] - before < len(distances) * depth.nbytes
