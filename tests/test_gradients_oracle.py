"""Gradients against an oracle in float64: the same formulas, differentiated by PyTorch."""

import dofsim
import numpy as np
import pytest
from scipy import ndimage as ndi

torch = pytest.importorskip("torch")

from oracle import gradients as oracle  # noqa: E402

SHAPE = (48, 72)
FOCUS = 0.5
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
# How much of each pixel a disc covers.
INSIDE = np.clip(16.5 - np.hypot(X - 35.5, Y - 23.5), 0.0, 1.0)[..., None]


def texture(seed):
    # Without detail that blur by a pixel, which bilinear sampling is, would take away.
    smooth = ndi.gaussian_filter(np.random.default_rng(seed).standard_normal((*SHAPE, 3)), (3.0, 3.0, 0.0))
    return 0.5 + 0.2 * smooth / smooth.std()


def slope():
    """Give a surface that goes through the focus, and nothing in front of it."""
    return np.zeros((*SHAPE, 4)), texture(1), np.full(SHAPE, 0.8), 1.0 / (1.5 + 3.0 * X / SHAPE[1])


def disc():
    """Give an uneven disc before a wall without texture: what the disc hides is no guess."""
    near = INSIDE * np.concatenate([texture(2), np.ones((*SHAPE, 1))], axis=2)
    uneven = 1.0 / (1.3 + 0.1 * np.sin(X / 15.0) * np.cos(Y / 12.0))
    return near, np.full((*SHAPE, 3), 0.3), uneven, np.full(SHAPE, 0.2)


def seen(near, far, near_disparity, far_disparity, k, d_focus=FOCUS):
    """Give the oracle's picture."""
    planes = [torch.tensor(np.moveaxis(picture, 2, 0)) for picture in (near, far)]
    shifts = [torch.tensor(k * (disparity - d_focus)) for disparity in (near_disparity, far_disparity)]
    return np.moveaxis(oracle.picture(*planes, *shifts, oracle.disc_points(200)).numpy(), 0, 2)


def of_one_layer(near, far, near_disparity, far_disparity):
    """Give the same scene as a picture with disparity."""
    color = near[..., :3] + (1.0 - near[..., 3:]) * far
    return color.astype(np.float32), np.where(near[..., 3] >= 0.5, near_disparity, far_disparity)


def lens_of(k, shape=SHAPE):
    """Give the lens that shifts by `k` pixels for each dioptre."""
    lens = dofsim.Lens(aperture_radius=0.01, focus_distance=1.0 / FOCUS, fov=42.0)
    own = abs(float(dofsim.coc(np.ones(shape), lens)[0, 0])) / (1.0 - FOCUS)
    return lens.replace(aperture_radius=0.01 * k / own)


@pytest.mark.parametrize("k", [10.0, 20.0])
@pytest.mark.parametrize("scene", [slope, disc])
def test_derivatives_are_those_of_the_oracle(scene, k):
    near, far, *disparities = scene()
    color, disparity = of_one_layer(near, far, *disparities)
    lens = lens_of(k)
    bumps = [
        np.exp(-((X - x) ** 2 + (Y - y) ** 2) / (2.0 * 6.0**2)) for x, y in ((25, 24), (44, 20), (36, 38))
    ]
    step = 1e-4

    def ends(change):
        return (change(step) - change(-step)) / (2.0 * step)

    directions = {
        "aperture": ends(lambda by: seen(near, far, *disparities, k * (1.0 + by))),
        "focus": ends(lambda by: seen(near, far, *disparities, k, FOCUS + by)),
    }
    for i, bump in enumerate(bumps):
        directions[i] = ends(lambda by, bump=bump: seen(near, far, *(d + by * bump for d in disparities), k))
    wrt = ("aperture_radius", "focus_distance", "disparity")
    for name, change in directions.items():
        # Weighted by the change nothing cancels; without detail it hardly matters that the oracle blurs.
        weights = ndi.gaussian_filter(change, (2.0, 2.0, 0.0)).astype(np.float32)
        found = dofsim.vjp(color, 1.0 / disparity, lens, weights, wrt=wrt, views=1024)
        along = {
            "aperture": found["aperture_radius"] * lens.aperture_radius,
            "focus": -found["focus_distance"] / FOCUS**2,
            **{i: np.vdot(found["disparity"], bump) for i, bump in enumerate(bumps)},
        }
        # Bumps on the disc reach over its silhouette.
        part = 0.06 if isinstance(name, str) else 0.08
        assert along[name] == pytest.approx(np.vdot(weights, change), rel=part)


WAVES = [
    (0.27, 0.4, 1.0), (0.33, 2.2, 5.0), (0.19, 1.3, 3.0), (0.41, 2.9, 0.5), (0.24, 0.9, 2.0), (0.37, 1.8, 4.0)
]  # fmt: skip


def waves(x, y):
    """Give a texture without detail that pixels could not hold."""
    return 0.5 + sum(0.05 * np.cos(w * (np.cos(a) * x + np.sin(a) * y) + p) for w, a, p in WAVES)


SURFACES = {
    "wall": lambda x, y: 0.25 + 0.0 * x,
    "slope": lambda x, y: 0.22 + 0.2 * x / 160.0,
    "diagonal": lambda x, y: 0.9 - 0.15 * x / 160.0 - 0.15 * y / 96.0,
    "bowl": lambda x, y: 0.05 + 0.3 * (((x - 80.0) / 80.0) ** 2 + ((y - 48.0) / 80.0) ** 2),
    "dome": lambda x, y: 0.95 - 0.3 * (((x - 80.0) / 80.0) ** 2 + ((y - 48.0) / 80.0) ** 2),
    "through the focus": lambda x, y: 0.3 + 0.4 * x / 160.0,
}


@pytest.mark.parametrize("radius_px", [6.0, 12.0])
@pytest.mark.parametrize("surface", SURFACES)
def test_on_a_surface_depth_has_the_gradient_of_the_lens_integral(surface, radius_px):
    y, x = np.mgrid[:96, :160].astype(float)
    disparity = SURFACES[surface](x, y)
    k = radius_px / np.abs(disparity - FOCUS).max()
    lens = lens_of(k, disparity.shape)
    color = np.repeat(waves(x, y)[..., None], 3, axis=2).astype(np.float32)
    # As far from the border as light comes.
    inside = (abs(x - 80.0) < 56.0) & (abs(y - 48.0) < 28.0)
    pixels, step = (x[inside], y[inside]), 1e-4

    def ends(change):
        ends = [
            oracle.of_surface(waves, lambda x, y, by=by: k * change(x, y, by), pixels) for by in (step, -step)
        ]
        return (ends[0] - ends[1]) / (2.0 * step)

    def along(change, found, part):
        weights = np.zeros(color.shape, np.float32)
        weights[inside] = change[:, None]
        gradient = dofsim.vjp(color, 1.0 / disparity, lens, weights, wrt=wrt, views=1024)
        assert found(gradient) == pytest.approx(3.0 * np.vdot(change, change), rel=part)

    wrt = ("aperture_radius", "disparity")
    shift = SURFACES[surface]
    along(
        ends(lambda x, y, by: (1.0 + by) * (shift(x, y) - FOCUS)),
        lambda found: found["aperture_radius"] * lens.aperture_radius,
        0.02,
    )
    # On borders of tiles, and between them. A pixel of an exact disc has the blur of its own depth, in the
    # render as in its gradient, which misses some of a bump that is hardly wider than the blur.
    for at_x, at_y in ((48, 48), (64, 32), (96, 50)):

        def bump(x, y, at_x=at_x, at_y=at_y):
            return np.exp(-((x - at_x) ** 2 + (y - at_y) ** 2) / (2.0 * 8.0**2))

        along(
            ends(lambda x, y, by, bump=bump: shift(x, y) + by * bump(x, y) - FOCUS),
            lambda found, bump=bump: np.vdot(found["disparity"], bump(x, y)),
            0.25,
        )


def test_the_oracle_is_differentiable():
    random = np.random.default_rng(3)
    points = oracle.disc_points(5)

    def of(*numbers):
        near, far, near_disparity, far_disparity, k, d_focus = numbers
        shifts = [k * (disparity - d_focus) for disparity in (near_disparity, far_disparity)]
        return oracle.picture(near, far, *shifts, points)

    shapes = [(3, 6, 7), (2, 6, 7), (6, 7), (6, 7)]
    numbers = [torch.tensor(0.3 + 0.4 * random.random(shape), requires_grad=True) for shape in shapes]
    settings = [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in (2.3, 0.41)]
    assert torch.autograd.gradcheck(of, [*numbers, *settings])
