"""Work is submitted to a device in pieces: they change no bit, and what was cancelled soon ends."""

import functools
import os

import dofsim
import numpy as np
import pytest
from both_devices import CASES, CLIPPED, FLAWS, through
from interrupts import assert_prompt
from test_device_faults import said


@pytest.fixture
def paced(restricted):
    """Set the time that a submission should take until the end of the test."""
    return lambda seconds: restricted(submission_s=seconds)


@pytest.mark.parametrize("flaw", ["thin", "all", "full"])
@pytest.mark.parametrize("method", CASES)
def test_pieces_of_any_size_give_the_same_bits(gpu, paced, method, flaw):
    from dofsim._dofsim import device_submissions

    if flaw in CLIPPED and method != "lens":
        pytest.skip("only the flagship honours cat_eye")
    flaw = {"thin": {}, **FLAWS, **CLIPPED}[flaw]
    call = functools.partial(through, flaw, gpu, method)
    paced(1e3)
    whole = call()
    # The flagship submits at once what lays out a new scene.
    assert device_submissions()[0] == (2 if method == "lens" else 1)
    paced(1e-6)
    for _ in range(3):
        np.testing.assert_array_equal(call(), whole)
    # A submission of each row of tiles or workgroups at least, or of each pass.
    assert device_submissions()[0] > 3 * 2


def test_work_of_two_threads_is_not_mixed_up(gpu, paced):
    from concurrent.futures import ThreadPoolExecutor

    expected = [through(FLAWS["all"], gpu, method) for method in CASES]
    paced(1e-6)
    with ThreadPoolExecutor(4) as pool:
        for _ in range(3):
            found = list(pool.map(functools.partial(through, FLAWS["all"], gpu), CASES))
            for one, other in zip(found, expected, strict=True):
                np.testing.assert_array_equal(one, other)


@pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")
def test_a_device_is_free_soon_after_an_interrupt(gpu):
    """What was recorded but not submitted is not computed: the next picture does not wait for it."""
    out = said(
        """
        one = scene(600, 800, device=device)
        small = scene(20, 20, device=device)
        small.render(lens, method="taps")
        one.render(lens, views=64)
        print(interrupted(lambda: one.render(lens, views=8192), 2.0, wall_s=3.0), flush=True)
        began = time.process_time()
        small.render(lens, method="taps")
        print("interrupted", time.process_time() - began, flush=True)
        os._exit(0)
        """,
        gpu,
    )
    interrupted, waited = out.strip().splitlines()
    if interrupted == "finished":
        pytest.skip("the device was done before it could be interrupted")
    assert_prompt(waited, 1.0)


def test_times_of_all_pieces_are_told(gpu, paced):
    depth = np.linspace(1.0, 4.0, 300)[:, None] * np.ones((1, 300))
    scene = dofsim.Scene(np.ones((300, 300, 3)), depth, device=gpu)
    lens = dofsim.Lens(aperture_radius=0.05, focus_distance=2.0, fov=40.0)
    of_new_scene = dict(scene.profile(lens))
    expected = dict(scene.profile(lens))
    assert of_new_scene.keys() - expected.keys() == {"lens/cells", "lens/spans"}
    paced(1e-6)
    scene.render(lens)
    times = dict(scene.profile(lens))
    assert list(times) == list(expected)
    assert all(milliseconds > 0.0 for milliseconds in times.values())
