"""The hexagonal blur: against its formula, and what its text says of it."""

import cv2
import dofsim
import numpy as np
import pytest
from oracle import hexagonal as oracle
from test_constant_depth import polygon

# The article's hexagon has a corner straight up.
UPRIGHT = 90.0


def render(color, coc_px, aperture=None, **options):
    """Render with this signed circle of confusion at every pixel."""
    lens = dofsim.Lens.from_disparity(strength_px=1.0, focus=0.0)
    disparity = -np.asarray(coc_px, np.float32)
    return dofsim.render(
        color, disparity, lens, depth_kind="disparity", method="hexagonal", aperture=aperture, **options
    )


def blades(n, rotation):
    return dofsim.Aperture(blades=n, rotation=rotation)


@pytest.fixture(scope="module")
def color():
    return np.random.default_rng(3).random((53, 90, 3), dtype=np.float32)


@pytest.fixture(scope="module")
def edges():
    """Surfaces in front, in focus and behind, most of them sloped."""
    y, x = np.mgrid[:53, :90]
    coc_px = np.where(x < 40, -6.5 + 0.05 * y, np.where(y < 25, 0.0, 4.0 + 0.1 * x))
    coc_px[30:40, 60:70] = 1.3
    return coc_px.astype(np.float32)


@pytest.fixture(scope="module")
def noise():
    return np.random.default_rng(4).uniform(-6.0, 6.0, (53, 90)).astype(np.float32)


@pytest.mark.parametrize("scene", ["edges", "noise"])
@pytest.mark.parametrize(("n", "rotation"), [(6, 90.0), (6, 0.0), (6, 17.0), (4, 10.0), (4, 45.0)])
def test_it_is_its_formula(request, color, scene, n, rotation):
    coc_px = request.getfixturevalue(scene)
    expected = oracle.render(color, coc_px, blades=n, rotation=rotation)
    np.testing.assert_allclose(render(color, coc_px, blades(n, rotation)), expected, atol=1e-5)


def test_regions_of_one_kind_are_their_formula_too():
    """Where all around is in front, in focus or behind, work is left out."""
    height, width = 260, 330
    y, x = np.mgrid[:height, :width]
    bands = [np.full_like(x, -3.0, float), 0.0 * x, 4.0 + 0.004 * x, -2.0 - 0.01 * x]
    coc_px = np.choose(y // 65, bands).astype(np.float32)
    coc_px[:, 280:] = np.where(y[:, 280:] < 130, 2.5, 0.0)
    color = np.random.default_rng(5).random((height, width, 3), dtype=np.float32)
    expected = oracle.render(color, coc_px)
    np.testing.assert_allclose(render(color, coc_px), expected, atol=1e-5)
    # What is left out where nothing is blurred is everything.
    np.testing.assert_array_equal(render(color, np.where(y < 200, 0.0, coc_px))[:150], color[:150])


def test_without_an_aperture_it_is_the_upright_hexagon(color, edges):
    np.testing.assert_array_equal(render(color, edges), render(color, edges, blades(6, UPRIGHT)))


def point(radius_px, n=6, rotation=UPRIGHT, size=81):
    picture = np.zeros((size, size), np.float32)
    picture[size // 2, size // 2] = 1.0
    return render(picture, np.full((size, size), radius_px), blades(n, rotation))


def inside(n, rotation, inner_px, size=81):
    """Pixels of a regular polygon whose sides are `inner_px` from the centre."""
    y, x = np.mgrid[:size, :size] - size // 2
    angles = np.radians(rotation + (np.arange(n) + 0.5) * 360.0 / n)
    return np.all([x * np.cos(a) - y * np.sin(a) < inner_px for a in angles], axis=0)


@pytest.mark.parametrize("radius_px", [8.0, 16.0, -16.0, 31.5])
@pytest.mark.parametrize(("n", "rotation"), [(6, 90.0), (6, 0.0), (6, 17.0), (4, 45.0), (4, 10.0)])
def test_a_bright_point_is_an_even_polygon(radius_px, n, rotation):
    out = point(radius_px, n, rotation)
    apothem = abs(radius_px) * np.cos(np.pi / n)
    area = n * apothem * abs(radius_px) * np.sin(np.pi / n)
    brightness = out * area
    # Lines cross pixels at a slant, which leaves a weave; an even one of the right brightness all the same.
    even = brightness[inside(n, rotation, apothem - 2.0)]
    assert even.mean() == pytest.approx(1.0, abs=0.02)
    assert even.std() < 0.06
    assert brightness[~inside(n, rotation, apothem + 2.0)].max() < 0.03
    assert out.sum() == pytest.approx(1.0, abs=1e-5)


def test_no_rhombus_is_brighter_than_the_others():
    # Dividing by two in both passes, which the comments discuss, would give 1.5, 0.75 and 0.75.
    out = point(24.0)
    y, x = np.mgrid[:81, :81] - 40
    sector = np.degrees(np.arctan2(-y, x)) % 360.0
    far_inside = inside(6, UPRIGHT, 18.0)
    means = [out[far_inside & (abs(sector - middle) < 50.0)].mean() for middle in (60.0, 180.0, 300.0)]
    np.testing.assert_allclose(means, np.mean(means), rtol=0.01)


@pytest.mark.parametrize("radius_px", [8.0, 16.0, 31.5])
@pytest.mark.parametrize(("n", "rotation"), [(6, 90.0), (6, 17.0), (4, 45.0)])
def test_constant_depth_is_a_convolution_with_the_polygon(radius_px, n, rotation):
    y, x = np.mgrid[:120, :140]
    # What a blur is made for: a texture of some pixels' width, and an edge.
    picture = (0.5 + 0.2 * np.sin(x / 3.0) + 0.2 * np.sin(y / 4.0) + 0.3 * (x > 70)).astype(np.float32)
    out = render(picture, np.full(picture.shape, radius_px), blades(n, rotation))
    kernel = polygon(radius_px, n, rotation)
    expected = cv2.filter2D(picture.astype(np.float64), -1, kernel, borderType=cv2.BORDER_REFLECT)
    # Half a pixel's brush and the steps of the lines: seen are up to 0.005.
    assert np.abs(out - expected).max() < 0.01


def bar(coc_bar, coc_rest, height=60, width=120):
    coc_px = np.full((height, width), coc_rest, np.float32)
    coc_px[:, :60] = coc_bar
    color = np.zeros((height, width), np.float32)
    color[:, :60] = 1.0
    return color, coc_px


def test_near_bleeds_over_sharp_edges():
    color, coc_px = bar(-12.0, 0.0)
    row = render(color, coc_px)[30]
    # An upright hexagon is narrower than its corners by a factor of cos(30 deg).
    reach = 60 + 12.0 * np.cos(np.pi / 6)
    assert (row[60 : int(reach) - 1] > 0.005).all()
    assert (row[int(reach) + 2 :] == 0.0).all()
    # It fades from half to nothing, and goes on without a step inside.
    assert row[59:61].mean() == pytest.approx(0.5, abs=0.05)
    assert np.abs(np.diff(row)).max() < 0.1
    np.testing.assert_array_less(np.diff(row), 1e-6)
    np.testing.assert_allclose(row[:40], 1.0, atol=1e-5)


def test_far_does_not_bleed_over_sharp_edges():
    color, coc_px = bar(12.0, 0.0)
    out = render(color, coc_px)
    np.testing.assert_array_equal(out[:, 60:], 0.0)
    # Neither does what is sharp bleed into it.
    np.testing.assert_allclose(out[:, :60], 1.0, atol=1e-6)


@pytest.mark.parametrize(("factor", "bleeds"), [(1.5, True), (1.9, True), (2.1, False), (4.0, False)])
def test_far_bleeds_over_far_only_within_a_factor_of_two(factor, bleeds):
    color, coc_px = bar(5.0 * factor, 5.0)
    out = render(color, coc_px)
    assert (out[30, 61] > 0.05) == bleeds
    # Less blurred, and so nearer, surfaces always bleed over more blurred ones.
    assert out[30, 58] < 0.95


def test_near_hands_its_circle_of_confusion_on_to_the_second_pass():
    # A near point on sharp ground: pixels between would not spread the light on along the second line.
    picture = np.zeros((61, 61), np.float32)
    picture[30, 30] = 1.0
    coc_px = np.zeros((61, 61))
    coc_px[30, 30] = -16.0
    out = render(picture, coc_px)
    assert (out > 0.3 * out.max()).sum() == pytest.approx(1.5 * np.sqrt(3.0) * 256.0, rel=0.1)
    # Its own pixel is as opaque as a point can be, and black ground is all that is behind it.
    assert out.sum() == pytest.approx(1.0, abs=0.02)


def test_sizes_change_without_a_step():
    picture = np.zeros((61, 61), np.float32)
    picture[30, 30] = 1.0
    radii = np.arange(4.0, 7.0, 0.125)
    # On the rim of the smallest, inside the largest: brightness grows with the hexagon, not by whole pixels.
    seen = np.array([render(picture, np.full((61, 61), r))[26, 28] for r in radii])
    assert seen[0] < 0.3 * seen.max()
    assert np.abs(np.diff(seen)).max() < 0.15 * seen.max()


def test_circles_of_confusion_are_cut_at_their_largest(color, edges):
    np.testing.assert_array_equal(
        render(color, edges, max_coc_px=3.0), render(color, np.clip(edges, -3.0, 3.0))
    )
    assert (render(color, edges, max_coc_px=3.0) != render(color, edges)).any()


def test_scale_and_bias_on_a_z_buffer_are_the_lens():
    focal_length, focus, near, far, diameter = 0.05, 3.0, 0.5, 40.0, 0.02
    z = np.linspace(0.6, 39.0, 200).reshape(10, 20)
    z_buffer = (far / (far - near)) * (1.0 - near / z)
    # The article's formula, for the diameter on the film; its comments put the difference into the bias.
    scale = diameter * focal_length * focus * (far - near) / ((focus - focal_length) * near * far)
    bias = diameter * focal_length * (near - focus) / ((focus - focal_length) * near)
    film_width = 0.036
    radius_px = 0.5 * (z_buffer * scale + bias) * z.shape[1] / film_width

    lens = dofsim.Lens.from_camera(
        focal_length_mm=1e3 * focal_length,
        f_number=focal_length / diameter,
        focus_distance=focus,
        sensor_width_mm=1e3 * film_width,
    )
    seen = dofsim.coc(z_buffer, lens, depth_kind="zbuffer", near=near, far=far)
    np.testing.assert_allclose(seen, radius_px, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("aperture", "message"),
    [
        (dofsim.Aperture(), 'aperture: method="hexagonal" draws clear openings of 4 or 6 blades'),
        (blades(5, 0.0), "aperture: .*got another one"),
        (dofsim.Aperture(blades=6, apodization=0.3), "aperture .*which cannot draw apodization"),
    ],
)
def test_other_openings_are_refused(color, edges, aperture, message):
    with pytest.raises(ValueError, match=message):
        render(color, edges, aperture)
