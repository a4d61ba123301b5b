"""At constant depth a lens is a convolution with the picture of its opening, and must be exactly that.

From a radius of 5 px on, the picture of the opening is the part of each pixel that it covers. For smaller
openings that is too coarse, and the law is the lens's transfer function.
"""

import cv2
import dofsim
import numpy as np
import pytest
from scipy.special import j1
from skimage.filters import gaussian

RADII_PX = [0.0, 5.0, 7.0, 31.0]
SMALL_RADII_PX = [0.0, 0.1, 0.3, 0.5, 0.6, 0.75, 1.0, 1.3, 2.0, 2.5, 3.5, 4.5]
# Disparities one unit behind and in front of the focus.
SIDES = {"behind": -1.0, "in front": 1.0}
# The kernels are area-exact on both sides; float32 sums over a disc of radius 31 stay well below this.
MAX_ERROR = 1e-4
# Strips to a pixel, across which areas are summed by the midpoint rule; the chords themselves are exact.
STRIPS = 400


def render(color, radius_px, side, aperture=None):
    """Render a picture at constant depth whose circle of confusion has this radius."""
    lens = dofsim.Lens.from_disparity(strength_px=radius_px, focus=0.0)
    depth = np.full(color.shape[:2], SIDES[side], np.float32)
    return dofsim.render(color, depth, lens, depth_kind="disparity", aperture=aperture)


def strip_positions(radius_px):
    reach = int(np.ceil(radius_px)) + 1
    return reach, (np.arange((2 * reach + 1) * STRIPS) + 0.5) / STRIPS - reach - 0.5


def shares(reach, low, high):
    """Share of each pixel in the figure that lies between `low` and `high` (y) on every strip."""
    edges = np.arange(-reach, reach + 2)[:, None] - 0.5
    covered = np.diff(np.clip(edges, low, np.maximum(low, high)), axis=0)
    area = covered.reshape(2 * reach + 1, 2 * reach + 1, STRIPS).sum(axis=2)
    return area / area.sum()


def disc(radius_px):
    reach, x = strip_positions(radius_px)
    half = np.sqrt(np.maximum(radius_px**2 - x**2, 0.0))
    return shares(reach, -half, half)


def polygon(radius_px, blades, rotation_deg):
    """Regular polygon, its first corner `rotation_deg` counter-clockwise on screen (y down) from +x."""
    reach, x = strip_positions(radius_px)
    low, high = np.full_like(x, -np.inf), np.full_like(x, np.inf)
    inner = radius_px * np.cos(np.pi / blades)
    for i in range(blades):
        middle = np.radians(rotation_deg) + (2 * i + 1) * np.pi / blades
        nx, ny = np.cos(middle), -np.sin(middle)
        # The side's half-plane, nx x + ny y <= inner, bounds y from above or below.
        if ny > 1e-9:
            high = np.minimum(high, (inner - nx * x) / ny)
        elif ny < -1e-9:
            low = np.maximum(low, (inner - nx * x) / ny)
        else:
            low = np.where(nx * x <= inner, low, np.inf)
    low, high = (np.nan_to_num(v, posinf=reach + 1.0, neginf=-reach - 1.0) for v in (low, high))
    return shares(reach, low, high)


def convolve(color, point_picture):
    """Draw every point as `point_picture`; beyond its border a picture is its mirror image."""
    turned = np.ascontiguousarray(point_picture[::-1, ::-1])  # filter2D correlates
    return cv2.filter2D(color.astype(np.float64), -1, turned, borderType=cv2.BORDER_REFLECT)


@pytest.fixture(scope="module")
def color():
    picture = np.random.default_rng(5).random((83, 101, 3)).astype(np.float32)
    picture[:, 60:] *= 0.2
    return picture


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("radius_px", RADII_PX)
def test_disc_is_a_convolution(color, radius_px, side):
    point = disc(radius_px) if radius_px else np.ones((1, 1))
    error = np.abs(render(color, radius_px, side) - convolve(color, point))
    assert error.max() < MAX_ERROR


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("radius_px", RADII_PX)
@pytest.mark.parametrize(("blades", "rotation"), [(6, 15.0), (3, 20.0)])
def test_polygon_is_a_convolution(color, radius_px, side, blades, rotation):
    # In front of the focus the opening is drawn turned by 180 degrees.
    turn = 180.0 if side == "in front" else 0.0
    point = polygon(radius_px, blades, rotation + turn) if radius_px else np.ones((1, 1))
    out = render(color, radius_px, side, dofsim.Aperture(blades=blades, rotation=rotation))
    assert np.abs(out - convolve(color, point)).max() < MAX_ERROR


def contrast_left(render_picture, radius_px, period_px, side):
    """Give what a lens leaves of a sinusoid across the picture: its complex contrast afterwards."""
    size, margin = 96, 12
    phase = 2 * np.pi / period_px * (np.arange(size) - size // 2)
    row = np.broadcast_to(0.5 + 0.4 * np.cos(phase), (size // 2, size))
    out = render_picture(np.repeat(row[..., None], 3, 2).astype(np.float32), radius_px, side)
    # A whole number of periods, away from the borders.
    inside = slice(margin, margin + period_px * ((size - 2 * margin) // period_px))
    middle = out[size // 4, inside, 0].astype(float) - 0.5
    return 2 * np.mean(middle * np.exp(-1j * phase[inside])) / 0.4


def transfer(point, fine, period_px):
    """Transform a point's picture that is sampled `fine` times a pixel."""
    x = (np.arange(point.shape[1]) - point.shape[1] // 2) / fine
    # A point at x is lit by what lies at -x from it.
    return np.sum(point.sum(axis=0) * np.exp(-2j * np.pi / period_px * x))


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("radius_px", SMALL_RADII_PX)
def test_a_small_disc_has_the_transfer_function_of_the_lens(radius_px, side):
    for period_px in (4, 6, 9, 18):
        x = 2 * np.pi / period_px * radius_px
        expected = 2 * j1(x) / x if x else 1.0
        left = contrast_left(render, radius_px, period_px, side)
        assert abs(left - expected) < 0.01, period_px


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("radius_px", [0.3, 0.8, 1.5, 3.5])
@pytest.mark.parametrize(("blades", "rotation"), [(6, 15.0), (3, 20.0)])
def test_a_small_polygon_has_its_own_transfer_function(radius_px, side, blades, rotation):
    fine = 16
    turn = 180.0 if side == "in front" else 0.0
    point = polygon(radius_px * fine, blades, rotation + turn)
    aperture = dofsim.Aperture(blades=blades, rotation=rotation)
    for period_px in (4, 6, 9, 18):
        expected = transfer(point, fine, period_px)
        left = contrast_left(lambda *a: render(*a, aperture=aperture), radius_px, period_px, side)
        # In focus, a triangle's third moment is not rendered.
        assert abs(left - expected) < 0.012, period_px


@pytest.mark.parametrize("side", SIDES)
def test_blur_begins_without_a_step(color, side):
    change = [
        np.abs(render(color, r + 1e-3, side) - render(color, r, side)).max() for r in (0.0, 0.1, 0.3, 0.45)
    ]
    assert max(change) < 1.5e-3
    # Where the exchange with neighbours ends, and where fitted weights do.
    for r in (0.5, 0.75, 3.0, 5.0):
        assert np.abs(render(color, r + 5e-4, side) - render(color, r - 5e-4, side)).max() < 2e-3, r


@pytest.mark.parametrize(("side", "sign"), [("behind", 1.0), ("in front", -1.0)])
@pytest.mark.parametrize("rotation", [0.0, 90.0, 200.0])
def test_first_corner_of_a_triangle_points_along_its_rotation(side, sign, rotation):
    radius_px = 20.0
    point = np.zeros((61, 61), np.float32)
    point[30, 30] = 1.0
    out = render(point, radius_px, side, dofsim.Aperture(blades=3, rotation=rotation))
    along = sign * np.array([np.cos(np.radians(rotation)), -np.sin(np.radians(rotation))])
    x, y = np.meshgrid(np.arange(61) - 30.0, np.arange(61) - 30.0)
    reach = along[0] * x + along[1] * y
    lit = out > 0.5 * out.max()
    # A triangle reaches its circumradius at a corner, and half of it at the side opposite; within a pixel's
    # diagonal, and a little less at the corner, where pixels are less than half covered.
    assert reach[lit].max() == pytest.approx(radius_px, abs=2.5)
    assert reach[lit].min() == pytest.approx(-radius_px / 2, abs=1.5)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("radius_px", RADII_PX)
@pytest.mark.parametrize("aperture", [None, dofsim.Aperture(blades=6), dofsim.Aperture(apodization=0.3)])
def test_a_point_inside_keeps_its_energy(radius_px, side, aperture):
    point = np.zeros((81, 85), np.float32)
    point[40, 42] = 1000.0
    total = render(point, radius_px, side, aperture).sum(dtype=np.float64)
    # Rounding of the weights to float32 is all that may be missing.
    assert total == pytest.approx(1000.0, rel=1e-5)


@pytest.mark.parametrize("radius_px", [16.0, 31.0])
def test_apodized_opening_is_a_gaussian(color, radius_px):
    out = render(color, radius_px, "behind", dofsim.Aperture(apodization=0.25))
    # The rim cuts the Gaussian at 4 standard deviations, where 3e-4 of its light is left; averaging a pixel
    # instead of sampling at their centres adds 1/12 to its 16 px^2: 4e-4 seen at radius 16, 6e-5 at 31.
    linear = color.astype(np.float64)
    expected = gaussian(linear, sigma=0.25 * radius_px, truncate=4.0, channel_axis=2, mode="reflect")
    assert np.abs(out - expected).max() < 8e-4
