"""At constant depth a lens is a convolution with the picture of its opening, and must be exactly that."""

import cv2
import dofsim
import numpy as np
import pytest
from skimage.filters import gaussian

RADII_PX = [0.0, 0.3, 1.0, 2.5, 7.0, 31.0]
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
