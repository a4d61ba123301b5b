"""Lens maps given for a grid of places: lenses that no rotation keeps."""

import pickle

import dofsim
import numpy as np
import pytest
from dofsim import LensMap
from dofsim._lens_map import lens_points
from numpy.testing import assert_allclose, assert_array_equal
from scipy import ndimage

HEIGHT, WIDTH = 120, 160
LENS = dofsim.Lens.from_disparity(strength_px=1.0, focus=0.0)
POINTS = lens_points(33)
# The half diagonal is 1: the half width is 0.8, and the half height 0.6.
COLUMNS, ROWS = np.linspace(-1.2, 1.2, 61), np.linspace(-1.2, 1.2, 61)


def render(color, shift, lens, **options):
    shift = np.full((HEIGHT, WIDTH), float(shift)) if np.ndim(shift) == 0 else shift
    return dofsim.render(color, shift, lens, depth_kind="disparity", **{"device": "cpu", **options})


def picture(lamps=0):
    """Give texture as a camera has it, of at most 1, with lamps, and a disc before a wall."""
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    color = ndimage.gaussian_filter(rng.random((HEIGHT, WIDTH, 3)), (1.5, 1.5, 0))
    color = ((color - color.min()) / (color.max() - color.min())).astype(np.float32)
    color[rng.integers(5, HEIGHT - 5, lamps), rng.integers(5, WIDTH - 5, lamps)] = 20.0
    return color, np.where(np.hypot(x - 100, y - 50) < 25, 8.0, -7.0)


def squeezed(height, away, points):
    """Make the map of a lens of rotational symmetry at a place: coma, and discs that are squeezed."""
    across = np.stack([-away[..., 1], away[..., 0]], axis=-1)
    u, v = (points * away).sum(-1), (points * across).sum(-1)

    def turned(along, beside):
        return along[..., None] * away + beside[..., None] * across

    behind = turned((1 - 0.4 * height) * u + 0.1 * height * v * v, v)
    return behind, 0.02 * height[..., None] * turned(3 * u * u + v * v, 2 * u * v)


def symmetric():
    heights = np.linspace(0.0, 1.5, 31)
    behind, focused = squeezed(heights[:, None, None], np.array([1.0, 0.0]), POINTS)
    return LensMap(heights, behind, in_front=0.9 * behind, focused=focused)


def gridded(columns=COLUMNS, rows=ROWS, middle=(0.0, 0.0)):
    """Give the same lens as a grid of places, around a middle that may be elsewhere."""
    x, y = np.meshgrid(columns - middle[0], rows - middle[1])
    height = np.hypot(x, y)
    away = np.stack([x, y], axis=-1) / np.maximum(height, 1e-12)[..., None]
    away[height < 1e-9] = [1.0, 0.0]
    behind, focused = squeezed(height[..., None, None], away[..., None, None, :], POINTS)
    return LensMap((columns, rows), behind, in_front=0.9 * behind, focused=focused)


@pytest.mark.parametrize("shift", [-9.0, 0.0, 9.0, "both"])
@pytest.mark.parametrize("lamps", [0, 6])
def test_a_symmetric_lens_as_a_grid_is_that_lens(shift, lamps):
    color, depth = picture(lamps)
    depth = depth if shift == "both" else np.full_like(depth, shift)
    # Of as many lens points: how many there are by themselves follows from bounds, of the places around.
    words = {"views": 512}
    radial, grid = (render(color, depth, LENS.replace(psf=psf), **words) for psf in (symmetric(), gridded()))
    assert np.abs(radial - render(color, depth, LENS)).max() > 0.05
    error = np.abs(grid - radial)
    assert np.sqrt(np.mean(error**2)) < 2.5e-4
    if not lamps:
        assert np.quantile(error, 0.999) < 1e-3


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_grid_that_is_turned_turns_the_picture(turns):
    """Rotate everything by quarters of a turn: places, lens points, offsets, and the picture."""
    rng = np.random.default_rng(2)
    places = np.array([-1.0, 1.0])
    everywhere = np.array([0.3, 0.15])
    offsets = [POINTS + everywhere + 0.2 * rng.standard_normal((2, 2, 1, 1, 2)) for _ in range(2)]
    focused = 0.01 * rng.standard_normal((2, 2, 1, 1, 2)) * (POINTS + POINTS**2)

    def turned(v):
        """Turn by quarters to the left: what is at (x, y) goes to (y, -x), and so do vectors."""
        for _ in range(turns):
            v = np.rot90(np.rot90(v, axes=(0, 1)), axes=(2, 3))
            v = np.stack([v[..., 1], -v[..., 0]], axis=-1)
        return v

    def through(color, depth, lens):
        words = {"views": 1024, "device": "cpu", "depth_kind": "disparity"}
        return dofsim.render(np.ascontiguousarray(color), np.ascontiguousarray(depth), lens, **words)

    # A square of whole tiles in either direction: rays are those of the corners of tiles.
    color, depth = (v[:HEIGHT, :HEIGHT] for v in picture())
    color, depth = (np.pad(v, [(0, 8)] * 2 + [(0, 0)] * (v.ndim - 2), "symmetric") for v in (color, depth))
    maps = [offsets[0], offsets[1], focused]
    own, other = (
        LensMap((places, places), behind, in_front=in_front, focused=sharp)
        for behind, in_front, sharp in (maps, [turned(v) for v in maps])
    )
    straight = np.rot90(through(color, depth, LENS.replace(psf=own)), turns)
    color, depth = np.rot90(color, turns), np.rot90(depth, turns)
    error = np.abs(through(color, depth, LENS.replace(psf=other)) - straight).mean()
    assert error < 0.15 * np.abs(through(color, depth, LENS.replace(psf=own)) - straight).mean()
    assert error < 0.15 * np.abs(through(color, depth, LENS) - straight).mean()


def test_a_decentred_lens_is_one_around_another_point():
    """A symmetric lens has a principal point, which may be elsewhere; a grid says the same of any place."""
    color, depth = picture()
    middle = (0.2, -0.1)
    half_diagonal_px = 0.5 * np.hypot(WIDTH, HEIGHT)
    off = tuple(half_diagonal_px * v / side for v, side in zip(middle, (WIDTH, HEIGHT), strict=True))
    words = {"views": 512}
    moved = render(color, depth, LENS.replace(psf=symmetric(), principal_point=off), **words)
    grid = render(color, depth, LENS.replace(psf=gridded(middle=middle)), **words)
    assert np.sqrt(np.mean((grid - moved) ** 2)) < 3e-4
    centred = render(color, depth, LENS.replace(psf=symmetric()), **words)
    assert np.sqrt(np.mean((grid - centred) ** 2)) > 5e-3


def test_one_place_is_everywhere():
    color, depth = picture()
    behind = POINTS * np.array([0.7, 1.0])
    one = LENS.replace(psf=LensMap(([0.0], [0.0]), behind[None, None]))
    four = LENS.replace(
        psf=LensMap(([-1.0, 1.0], [-1.0, 1.0]), np.broadcast_to(behind, (2, 2, *behind.shape)))
    )
    assert_allclose(render(color, depth, one), render(color, depth, four), atol=1e-6)
    # A pair of numbers is two distances.
    radial = LensMap((0.0, 1.0), np.stack([behind] * 2))
    assert_array_equal(radial.field, [0.0, 1.0])


def test_light_that_does_not_arrive_at_a_place_is_missing_there():
    behind = np.stack([POINTS, np.where(POINTS[..., :1] > 0, np.nan, POINTS)])[None]
    lens = LENS.replace(psf=LensMap(([-0.4, 0.4], [0.0]), behind))
    color = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    color[60, [20, 140]] = 1000.0
    out = render(color, -10.0, lens)[..., 0]
    assert out[60, 26] > 0.5 * out[60, 14] > 0
    # Light of the left half of the lens lands on the left.
    assert out[55:65, 134].min() > 0
    assert out[55:65, 146].max() == 0


def test_grids_are_values(tmp_path):
    rng = np.random.default_rng(3)
    behind = POINTS + 0.1 * rng.standard_normal((2, 3, 33, 33, 2))
    one = LensMap(([-1.0, 0.0, 1.0], [-0.5, 0.5]), behind, focused=0.01 * behind)
    other = LensMap(([-1.0, 0.0, 1.0], [-0.5, 0.5]), behind, focused=0.01 * behind)
    assert one == other
    assert hash(one) == hash(other)
    assert one != LensMap(([-1.0, 0.0, 2.0], [-0.5, 0.5]), behind, focused=0.01 * behind)
    assert repr(one).startswith("LensMap(([-1.0, 0.0, 1.0], [-0.5, 0.5]), <33 x 33, ")
    assert pickle.loads(pickle.dumps(one)) == one
    assert_array_equal(one.behind, behind)
    assert_array_equal(one.field[0], [-1.0, 0.0, 1.0])
    assert_array_equal(one.field[1], [-0.5, 0.5])
    one.save(tmp_path / "lens.npz")
    assert LensMap.load(tmp_path / "lens.npz") == one


def test_pictures_of_points_are_at_their_places():
    at = (np.arange(48) + 0.5) / 24 - 1
    inside = np.hypot(at, at[:, None]) <= 1
    left, whole = inside * (at < 0), inside * 1.0
    lens_map = LensMap.from_pictures(([-0.4, 0.4], [0.0]), np.stack([whole, left])[None])
    assert lens_map.behind.shape == (1, 2, 65, 65, 2)
    lens = LENS.replace(psf=lens_map)
    color = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    color[60, [20, 140]] = 1000.0
    out = render(color, -12.0, lens)[..., 0]
    assert out[60, 28] > 0.5 * out[60, 12] > 0
    assert out[60, 148] < 0.02 * out[60, 132]


GIVEN = np.broadcast_to(POINTS, (1, 2, *POINTS.shape))


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (
            lambda: LensMap(([0.0, 1.0], [1.0, 0.0]), np.stack([GIVEN[0]] * 2)),
            "^field must be rising columns",
        ),
        (lambda: LensMap(([], [0.0]), GIVEN[:, :0]), "^field must be rising columns"),
        (
            lambda: LensMap(([0.0, 1.0], [0.0]), GIVEN[0]),
            r"^behind must be numbers of shape \(Y, X, N, N, 2\)",
        ),
        (
            lambda: LensMap(([0.0], [0.0, 1.0]), GIVEN),
            "^behind must have shape .* with 2 x 1 places as field",
        ),
        (lambda: LensMap(([0.0, 1.0], [0.0]), 9 * GIVEN), r"field \(0, 0\), lens point"),
        (lambda: LensMap((["a"], [0.0]), GIVEN), "^x of field must be numbers"),
        (
            lambda: LensMap.from_pictures(([0.0, 1.0], [0.0]), np.ones((2, 8, 8))),
            r"^behind must have shape \(Y, X, H, W\) with 1 x 2 pictures",
        ),
    ],
)
def test_bad_grids_are_named(make, match):
    with pytest.raises(ValueError, match=match):
        make()
