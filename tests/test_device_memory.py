"""The memory of a device: what is planned with, what happens without, and that it is given back."""

import functools

import dofsim
import numpy as np
import pytest
from both_devices import CASES, random_color


@pytest.fixture
def allocated(gpu):
    """Give what devices have allocated, if drivers can be asked."""
    from dofsim._dofsim import device_bytes

    dofsim.render(*frame(64, 64), lens(), device=gpu, method="taps")
    if device_bytes() == 0:
        pytest.skip("this driver does not say what is allocated")
    return device_bytes


def frame(height=1500, width=200):
    y, x = np.mgrid[:height, :width]
    depth = np.where((y // 37 + x // 23) % 2 == 0, 6.0, 1.5 + 0.01 * x + 0.001 * y).astype(np.float32)
    color = random_color(size=(height, width))
    color[::29, ::13] = 50.0
    return color, depth


def lens(**options):
    return dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=40.0, **options)


MEBIBYTE = 1 << 20


def peak(scene, allocated, **options):
    """Render a scene; give the picture, and what it took of the device, which keeps it for the next one."""
    dofsim.release_devices()
    before = allocated()
    return scene.render(**options), allocated() - before


FLAWS = {
    "thin": {},
    "all": {"axial_color": (0.03, 0.0, -0.02), "tilt": (5.0, 0.0), "lateral_color": (0.001, 0.0, -0.001)},
}
flaws = pytest.mark.parametrize("flaw", FLAWS.values(), ids=FLAWS)


@flaws
@pytest.mark.parametrize("method", CASES)
def test_bands_are_planned_by_the_sum_of_buffers(gpu, allocated, restricted, method, flaw):
    options = {"lens": lens(**flaw), "method": method} | ({"views": 16} if method == "lens" else {})
    whole, needed = peak(dofsim.Scene(*frame(), device=gpu), allocated, **options)
    # Buffers are as large as before, so that the sum alone decides.
    memory = int(0.75 * needed)
    restricted(memory_bytes=memory)
    picture, taken = peak(dofsim.Scene(*frame(), device=gpu), allocated, **options)
    np.testing.assert_array_equal(picture, whole)
    assert taken <= 0.8 * memory


@flaws
@pytest.mark.parametrize("method", CASES)
def test_a_frame_without_enough_memory_is_tried_again_in_more_bands(gpu, allocated, restricted, method, flaw):
    options = {"lens": lens(**flaw), "method": method} | ({"views": 16} if method == "lens" else {})
    whole, needed = peak(dofsim.Scene(*frame(), device=gpu), allocated, **options)
    room = int(0.75 * needed)
    restricted(room_bytes=room)
    picture, taken = peak(dofsim.Scene(*frame(), device=gpu), allocated, **options)
    np.testing.assert_array_equal(picture, whole)
    assert taken <= room


def test_a_focal_stack_runs_out_of_memory_and_goes_on(gpu, allocated, restricted):
    scene = dofsim.Scene(*frame(), device=gpu)
    expected = scene.focal_stack(lens(), [2.0, 3.0, 5.0], method="poisson")
    restricted(room_bytes=9 * MEBIBYTE)
    np.testing.assert_array_equal(scene.focal_stack(lens(), [2.0, 3.0, 5.0], method="poisson"), expected)


def test_what_no_band_has_memory_for_is_a_memory_error(gpu, allocated, restricted):
    call = functools.partial(dofsim.render, *frame(), lens(), device=gpu, method="poisson")
    restricted(room_bytes=MEBIBYTE)
    with pytest.raises(MemoryError, match=r'a band of the picture would need \d+ MiB .* use .* device="cpu"'):
        call()
    restricted(memory_bytes=MEBIBYTE)
    with pytest.raises(MemoryError, match=r"would need \d+ MiB of the device's memory of 1 MiB"):
        call()
    restricted()
    assert call().shape == (1500, 200, 3)


def test_memory_is_given_back(gpu, allocated):
    scene = dofsim.Scene(*frame(), device=gpu)
    scene.render(lens(), method="hexagonal")
    used = allocated()
    picture = 4 * 4 * 300_000
    dofsim.release_devices()
    # What the scene keeps is still there.
    assert picture <= allocated() <= used - 96 * 300_000
    del scene
    dofsim.release_devices()
    assert allocated() < MEBIBYTE
