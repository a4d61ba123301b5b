"""Focus planes that lean, curved ones, and where a lens is focused."""

import dofsim
import numpy as np
import pytest
from numpy.testing import assert_allclose

HEIGHT, WIDTH = 96, 128
LENS = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=50.0)


def places(width=WIDTH, height=HEIGHT, fov=50.0):
    """Give where pixels look, in focal lengths to the right and up."""
    focal_px = 0.5 * width / np.tan(np.radians(0.5 * fov))
    x, y = np.meshgrid(np.arange(width) - 0.5 * (width - 1), np.arange(height) - 0.5 * (height - 1))
    return x / focal_px, -y / focal_px


def leaning(tilt, distance=3.0, **frame):
    """Give the depth of the plane through the focus that leans by the angles."""
    right, up = places(**frame)
    top, side = (np.tan(np.radians(angle)) for angle in tilt)
    return (distance / (1.0 - side * right - top * up)).astype(np.float64)


TILTS = [(30.0, 0.0), (0.0, -40.0), (25.0, 20.0)]


@pytest.fixture(scope="module")
def color():
    return np.random.default_rng(7).random((HEIGHT, WIDTH, 3), dtype=np.float32)


@pytest.mark.parametrize("method", ["lens", "poisson", "hexagonal", "levels", "taps", "gaussian", "sprites"])
@pytest.mark.parametrize("tilt", TILTS)
def test_a_textured_plane_in_focus_is_unchanged_however_it_leans(color, tilt, method):
    lens = LENS.replace(tilt=tilt, aperture_radius=0.3)
    out = dofsim.render(color, leaning(tilt), lens, method=method)
    assert_allclose(out, color, atol=1e-5)
    # It would not be if it leant the other way.
    other = dofsim.render(color, leaning(tilt), lens.replace(tilt=(-tilt[0], -tilt[1])), method=method)
    assert np.abs(other - color).max() > 0.1


@pytest.mark.parametrize("tilt", TILTS)
def test_circles_of_confusion_are_those_of_the_leaning_plane(tilt):
    depth = np.full((HEIGHT, WIDTH), 4.0)
    focal_px = 0.5 * WIDTH / np.tan(np.radians(25.0))
    expected = 0.05 * focal_px * (1.0 / leaning(tilt) - 1.0 / depth)
    assert_allclose(dofsim.coc(depth, LENS.replace(tilt=tilt)), expected, atol=1e-5)


def test_the_sharp_line_of_an_upright_wall_lies_where_scheimpflug_puts_it():
    # A wall behind the focus: the plane that leans back meets it on one horizontal line.
    angle, wall = 50.0, 3.4
    color = np.tile(np.random.default_rng(8).random((1, WIDTH), dtype=np.float32), (HEIGHT, 1))
    out = dofsim.render(color, np.full((HEIGHT, WIDTH), wall), LENS.replace(tilt=(angle, 0.0)))
    contrast = out[:, 20:-20].std(axis=1)
    up = (wall - 3.0) / np.tan(np.radians(angle)) / wall
    focal_px = 0.5 * WIDTH / np.tan(np.radians(25.0))
    row = 0.5 * (HEIGHT - 1) - up * focal_px
    sharp = np.flatnonzero(contrast > 0.999 * contrast.max())
    assert sharp.mean() == pytest.approx(row, abs=1.0)


def test_a_leaning_plane_shifts_and_scales_discs_as_the_ray_equation_says():
    # A lamp on a wall; its light meets the pixels p with q = p + l / (1 - b . l) t.
    tilt, height, width = (-70.0, 0.0), 160, 200
    lens = dofsim.Lens(aperture_radius=0.2, focus_distance=1.5, fov=50.0, tilt=tilt)
    depth = np.full((height, width), 2.4)
    color = np.full((height, width), 1e-8, np.float32)
    q = np.array([100, 80])
    color[q[1], q[0]] = 1e4
    out = dofsim.render(color, depth, lens).astype(np.float64) / 1e4
    focal_px = 0.5 * width / np.tan(np.radians(25.0))
    k, slope = 0.2 * focal_px, np.tan(np.radians(tilt[0]))
    gradient = slope / (1.5 * focal_px)  # of the disparity in focus, a pixel down the picture
    angles = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    angles, rings = np.meshgrid(angles, np.sqrt((np.arange(60) + 0.5) / 60))
    points = np.stack([rings * np.cos(angles), rings * np.sin(angles)], axis=-1).reshape(-1, 2)
    in_focus = 1.0 / 1.5 + gradient * (q[1] - 0.5 * (height - 1))
    # t solves t = k (d - d_f(p)), p = q - l t.
    t = k * (1.0 / 2.4 - in_focus) / (1.0 - k * gradient * points[:, 1])
    p = q - points * t[:, np.newaxis]
    y, x = np.mgrid[:height, :width]
    for axis, places_of in ((0, x), (1, y)):
        mean = (out * places_of).sum() / out.sum()
        spread = np.sqrt((out * (places_of - mean) ** 2).sum() / out.sum())
        assert mean == pytest.approx(p[:, axis].mean(), abs=0.05)
        assert spread == pytest.approx(p[:, axis].std(), rel=0.01)


def test_a_curved_field_focuses_a_sphere_about_the_lens():
    lens = LENS.replace(field_curvature=1.0 / 3.0)
    right, up = places()
    sphere = 3.0 / np.sqrt(1.0 + right**2 + up**2)
    assert np.abs(dofsim.coc(sphere, LENS)).max() > 0.3
    assert np.abs(dofsim.coc(sphere, lens)).max() < 0.03


def test_steep_planes_and_relative_lenses_are_refused():
    color, depth = np.ones((48, 64, 3), np.float32), np.full((48, 64), 2.0)
    steep = dofsim.Lens(aperture_radius=0.3, focus_distance=0.5, fov=50.0, tilt=(60.0, 0.0))
    with pytest.raises(ValueError, match=r"tilt: the plane in focus passes the lens"):
        dofsim.render(color, depth, steep)
    relative = dofsim.Lens.from_disparity(strength_px=3.0, focus=0.0)
    with pytest.raises(TypeError, match="tilt"):
        relative.replace(tilt=(1.0, 0.0))
    with pytest.raises(ValueError, match="tilt must be two angles"):
        LENS.replace(tilt=(90.0, 0.0))


# Focus control


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (30.0, -20.0)])
def test_focusing_at_a_pixel_puts_it_on_the_focus_surface(tilt):
    depth = np.random.default_rng(9).uniform(2.0, 6.0, (HEIGHT, WIDTH))
    lens = LENS.replace(tilt=tilt).focused_at(depth, 100, 20)
    assert lens.tilt == pytest.approx(tilt)
    assert abs(dofsim.coc(depth, lens)[20, 100]) < 1e-4


def test_a_patch_is_robust_against_wrong_depths():
    depth = np.full((HEIGHT, WIDTH), 4.0)
    depth[30, 40], depth[30, 41], depth[31, 40] = 0.1, np.nan, 80.0
    assert LENS.focused_at(depth, 40, 30, radius_px=2).focus_distance == pytest.approx(4.0)
    assert LENS.focused_at(depth, 40, 30).focus_distance == pytest.approx(0.1)
    with pytest.raises(ValueError, match="no depth at row 30, column 41"):
        LENS.focused_at(depth, 41, 30)


def test_targets():
    depth = np.full((HEIGHT, WIDTH), 4.0)
    depth[:, :20], depth[:, -20:], depth[40:56, 56:72] = 2.0, 9.0, 5.0
    depth[0, :3], depth[-1, :3] = 0.2, 500.0
    found = {name: LENS.focused_on(depth, name).focus_distance for name in ("nearest", "farthest", "centre")}
    assert found == pytest.approx({"nearest": 2.0, "farthest": 9.0, "centre": 5.0})
    mask = np.zeros(depth.shape, bool)
    mask[:, -20:] = True
    assert LENS.focused_on(depth, mask).focus_distance == pytest.approx(9.0)
    none = mask & False
    none = mask & False
    for target, error in [("left", ValueError), (mask[:5], ValueError), (none, ValueError), (3, TypeError)]:
        with pytest.raises(error, match="target"):
            LENS.focused_on(depth, target)


@pytest.mark.parametrize("tilt", TILTS)
def test_a_plane_through_three_pixels_is_in_focus(tilt):
    depth = leaning(tilt, distance=2.2)
    lens = LENS.focused_on_plane(depth, [(5, 5), (120, 10), (60, -3)])
    assert lens.tilt == pytest.approx(tilt, abs=1e-3)
    assert lens.focus_distance == pytest.approx(2.2, rel=1e-5)
    with pytest.raises(ValueError, match="one line"):
        LENS.focused_on_plane(depth, [(5, 5), (10, 10), (20, 20)])
    with pytest.raises(IndexError):
        LENS.focused_on_plane(depth, [(5, 5), (10, 10), (500, 20)])


def test_a_pull_moves_the_focus_from_key_to_key():
    rng = np.random.default_rng(10)
    scene = dofsim.Scene(rng.random((40, 60, 3), dtype=np.float32), rng.uniform(1.0, 8.0, (40, 60)))
    frames = list(dofsim.focus_pull(scene, LENS, [(0, 1.0), (4, 4.0), (6, float("inf"))], easing="linear"))
    assert len(frames) == 7
    # Half-way in disparity: 2 / (1 + 1/4).
    for i, focus in ((0, 1.0), (2, 1.6), (4, 4.0), (5, 8.0), (6, float("inf"))):
        np.testing.assert_array_equal(frames[i], scene.render(LENS.replace(focus_distance=focus)))


@pytest.mark.parametrize("easing", ["linear", "smooth", "in", "out"])
def test_easings_go_from_one_end_to_the_other(easing):
    from dofsim._focus import _EASINGS, _positions

    lens = dofsim.Lens.from_disparity(strength_px=1.0, focus=0.0)
    found = np.array(list(_positions(lens, [(0, 0.0), (20, 1.0)], _EASINGS[easing])))
    assert (found[0], found[-1], len(found)) == (0.0, 1.0, 21)
    steps = np.diff(found)
    assert (steps > 0.0).all()
    assert (steps[0] < 0.5 * steps.mean()) == (easing in ("smooth", "in"))
    assert (steps[-1] < 0.5 * steps.mean()) == (easing in ("smooth", "out"))


def test_bad_pulls_are_refused_before_the_first_frame():
    scene = dofsim.Scene(np.ones((8, 8), np.float32), np.ones((8, 8)))
    for keyframes, easing, match in [
        ([], "smooth", "keyframes"),
        ([(0, 1.0), (0, 2.0)], "smooth", "keyframes"),
        ([(0, 1.0), (3, -2.0)], "smooth", "keyframes"),
        ([(0, 1.0)], "bouncy", "easing"),
    ]:
        with pytest.raises(ValueError, match=match):
            dofsim.focus_pull(scene, LENS, keyframes, easing=easing)
    with pytest.raises(ValueError, match="in_focus would hold the focus still"):
        dofsim.focus_pull(scene, LENS, [(0, 1.0)], in_focus=(1.0, 2.0))
