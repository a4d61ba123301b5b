"""What goes to a device and back: the picture and its depth, tables, and one picture."""

import functools

import dofsim
import numpy as np
import pytest
from both_devices import CASES, random_color
from dofsim._dofsim import device_traffic
from test_device_bands import tall

HEIGHT, WIDTH = 300, 400
PIXELS = HEIGHT * WIDTH
LENS = dofsim.Lens(aperture_radius=0.02, focus_distance=3.0, fov=40.0)


def went(call):
    """Count what a call takes to the device and back; give it with the result of the call."""
    before = device_traffic()
    result = call()
    return {name: count - before[name] for name, count in device_traffic().items()}, result


def options_of(method):
    return {"method": method} | ({"views": 16} if method == "lens" else {})


def slope():
    """Make a floor from before the focus to behind it."""
    depth = np.broadcast_to(np.linspace(4.0, 2.0, HEIGHT, dtype=np.float32)[:, None], (HEIGHT, WIDTH))
    return random_color(size=(HEIGHT, WIDTH)), np.ascontiguousarray(depth)


def cluttered():
    """Make a floor with discs and bars before it, which hide a part of it all over the picture."""
    color, depth = slope()
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    depth[np.hypot(x % 130 - 60, y % 110 - 50) < 30] = 1.8
    depth[(x + y) % 97 < 6] = 1.5
    return color, depth


def uploads(gpu, scene, method):
    """Count the bytes a pixel that a new frame takes to the device: all, and without the tables of its plan.

    A render of the prepared scene takes the tables alone.
    """
    scene = dofsim.Scene(*scene, device=gpu)
    render = functools.partial(scene.render, LENS, **options_of(method))
    (new, first), (again, second) = went(render), went(render)
    np.testing.assert_array_equal(first, second)
    new, again = new["uploaded_bytes"], again["uploaded_bytes"]
    return new / PIXELS, (new - again) / PIXELS


# Three channels and a depth of four bytes.
OWN = 16


def test_a_picture_without_edges_takes_itself_its_depth_and_a_bit_a_pixel(gpu):
    _, without_tables = uploads(gpu, slope(), "lens")
    assert OWN < without_tables < OWN + 1 / 8 + 0.01


def test_a_new_frame_takes_little_more_than_its_picture_and_its_depth(gpu):
    with_tables, without_tables = uploads(gpu, cluttered(), "lens")
    assert OWN + 2 < without_tables < with_tables < 24


@pytest.mark.parametrize("method", [method for method in CASES if method != "lens"])
def test_other_methods_take_the_picture_and_its_depth(gpu, method):
    _, without_tables = uploads(gpu, cluttered(), method)
    # Parameters of passes are tables, too, whose number depends on the pieces. Pictures of sprites are kept.
    assert without_tables > OWN - 0.01
    assert without_tables < OWN + 0.01 or method == "sprites"


@pytest.mark.parametrize("submission_s", [1e3, 1e-6], ids=["whole", "pieces"])
@pytest.mark.parametrize("method", CASES)
def test_nothing_comes_back_before_the_picture(gpu, restricted, method, submission_s):
    """Neither of a new scene nor of a prepared one, however many pieces it is computed in."""
    restricted(submission_s=submission_s)
    scene = dofsim.Scene(*cluttered(), device=gpu)
    for _ in range(2):
        frame, picture = went(lambda: scene.render(LENS, **options_of(method)))
        assert frame["readbacks"] == 1
        # The picture, and at most two times of 1024 passes.
        assert picture.nbytes <= frame["downloaded_bytes"] <= picture.nbytes + 2 * 8 * 1024


def test_every_band_comes_back_once(gpu, restricted):
    color, depth = tall()
    lens = LENS.replace(aperture_radius=0.15)
    restricted(max_binding_bytes=470_000)
    frame, picture = went(lambda: dofsim.render(color, depth, lens, device=gpu, **options_of("lens")))
    assert frame["readbacks"] > 1
    assert frame["submissions"] >= 2 * frame["readbacks"]
    assert 0 <= frame["downloaded_bytes"] - picture.nbytes <= frame["readbacks"] * 2 * 8 * 1024
