"""Laws that hold for the metrics, and checks against independent implementations."""

import doctest
import sys

import numpy as np
import pytest
from dofsim import metrics
from dofsim.metrics import error_map, flip, psnr, srgb, ssim

SCALARS = [psnr, ssim, flip]
CLOSER_IS_HIGHER = {psnr: True, ssim: True, flip: False}


@pytest.fixture
def picture():
    rng = np.random.default_rng(3)
    return rng.uniform(0.0, 1.2, (48, 64, 3))


def noisy(picture, sigma, seed=5):
    return np.maximum(picture + np.random.default_rng(seed).normal(0.0, sigma, picture.shape), 0.0)


def needs(metric):
    """Skip where the package behind a metric is missing."""
    module = {ssim: "skimage", flip: "flip_evaluator"}.get(metric)
    if module:
        pytest.importorskip(module)


def test_srgb_agrees_with_skimage(picture):
    linear_of = pytest.importorskip("skimage.color").rgb2xyz
    codes = srgb(np.clip(picture, 0.0, 1.0))
    # skimage decodes sRGB on its way to XYZ; the linear XYZ of the codes must be that of the picture.
    to_xyz = linear_of(np.eye(3)[None])[0]
    np.testing.assert_allclose(linear_of(codes), np.clip(picture, 0.0, 1.0) @ to_xyz, atol=1e-6)


@pytest.mark.parametrize("metric", SCALARS)
def test_equal_pictures_score_best(metric, picture):
    needs(metric)
    best = {psnr: np.inf, ssim: 1.0, flip: 0.0}[metric]
    assert metric(picture, picture) == pytest.approx(best, abs=1e-6)


@pytest.mark.parametrize("metric", SCALARS)
def test_symmetric(metric, picture):
    needs(metric)
    other = noisy(picture, 0.1)
    assert metric(picture, other) == pytest.approx(metric(other, picture), rel=1e-5)


@pytest.mark.parametrize("metric", SCALARS)
def test_more_noise_is_farther(metric, picture):
    needs(metric)
    scores = [metric(picture, noisy(picture, sigma)) for sigma in (0.01, 0.05, 0.2)]
    assert scores == sorted(scores, reverse=CLOSER_IS_HIGHER[metric])


@pytest.mark.parametrize("metric", SCALARS)
def test_highlights_count_as_white(metric, picture):
    needs(metric)
    assert metric(picture, np.where(picture > 1.0, 50.0, picture)) == metric(picture, picture)


@pytest.mark.parametrize("metric", SCALARS)
def test_border_and_mask_leave_pixels_out(metric, picture):
    needs(metric)
    border = 6
    damaged = picture.copy()
    # Nothing of the damage may reach what is compared, so leave the window of SSIM and FLIP some room.
    damaged[0] = 1.0 - damaged[0]
    inside = np.zeros(picture.shape[:2], bool)
    inside[24:] = True
    assert metric(picture, damaged, mask=inside) == pytest.approx(metric(picture, picture), abs=1e-6)
    assert metric(picture, damaged, border=border) != metric(picture, damaged)
    everything = np.ones(picture.shape[:2], bool)
    assert metric(picture, damaged, border=border, mask=everything) == metric(picture, damaged, border=border)


def test_psnr_agrees_with_skimage(picture):
    theirs = pytest.importorskip("skimage.metrics").peak_signal_noise_ratio
    other = noisy(picture, 0.1)
    border = 4
    inside = np.s_[border:-border, border:-border]
    expected = theirs(srgb(picture)[inside], srgb(other)[inside], data_range=1.0)
    assert psnr(picture, other, border=border) == pytest.approx(expected, abs=1e-9)


def test_psnr_of_a_known_difference():
    linear = np.full((8, 8), 0.001)
    # On sRGB's straight part the codes are 12.92 times the values.
    assert psnr(linear, 2.0 * linear) == pytest.approx(-20.0 * np.log10(12.92 * 0.001))


def test_ssim_agrees_with_its_definition(picture):
    pytest.importorskip("skimage")
    gaussian = pytest.importorskip("scipy.ndimage").gaussian_filter
    a, b = srgb(picture), srgb(noisy(picture, 0.1))

    def mean(x):
        return gaussian(x, 1.5, axes=(0, 1), truncate=3.5)

    mu_a, mu_b = mean(a), mean(b)
    var_a, var_b, cov = mean(a * a) - mu_a**2, mean(b * b) - mu_b**2, mean(a * b) - mu_a * mu_b
    c1, c2 = 0.01**2, 0.03**2
    local = (2 * mu_a * mu_b + c1) * (2 * cov + c2) / ((mu_a**2 + mu_b**2 + c1) * (var_a + var_b + c2))
    border = 8
    expected = local[border:-border, border:-border].mean()
    assert ssim(picture, noisy(picture, 0.1), border=border) == pytest.approx(expected, abs=1e-9)


def test_flip_is_the_evaluators_own_mean(picture):
    evaluate = pytest.importorskip("flip_evaluator").evaluate
    other = noisy(picture, 0.1)
    theirs = evaluate(srgb(picture).astype("f4"), srgb(other).astype("f4"), "LDR", applyMagma=False)
    assert flip(picture, other) == pytest.approx(theirs[1], rel=1e-5)


@pytest.mark.parametrize("metric", SCALARS)
def test_grey_counts_as_three_equal_channels(metric, picture):
    needs(metric)
    grey, other = picture[..., 0], noisy(picture, 0.1)[..., 0]
    tripled = metric(np.stack([grey] * 3, axis=-1), np.stack([other] * 3, axis=-1))
    assert metric(grey, other) == pytest.approx(tripled, rel=1e-6)
    assert metric(grey[..., None], other[..., None]) == pytest.approx(tripled, rel=1e-6)


def test_error_map_averages_to_the_metric(picture):
    pytest.importorskip("flip_evaluator")
    other = noisy(picture, 0.1)
    assert error_map(picture, other, metric="flip").mean() == pytest.approx(flip(picture, other), rel=1e-5)
    difference = error_map(picture, other)
    assert difference.shape == picture.shape[:2]
    assert difference.dtype == np.float32
    np.testing.assert_allclose(difference, np.abs(srgb(picture) - srgb(other)).mean(axis=-1), rtol=1e-6)


def test_inputs_stay_as_they_were(picture):
    other = noisy(picture, 0.1)
    before = picture.copy(), other.copy()
    psnr(picture, other, border=2)
    error_map(picture, other)
    np.testing.assert_array_equal(picture, before[0])
    np.testing.assert_array_equal(other, before[1])


@pytest.mark.parametrize("metric", SCALARS)
@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"b": np.zeros((5, 5, 3))}, ValueError, "different shapes"),
        ({"a": np.zeros(7), "b": np.zeros(7)}, ValueError, r"\(H, W\)"),
        ({"border": -1}, ValueError, "negative"),
        ({"border": 24}, ValueError, "no pixel"),
        ({"mask": np.zeros((48, 64), bool)}, ValueError, "no pixel"),
        ({"mask": np.ones((48, 64))}, TypeError, "boolean"),
        ({"mask": np.ones((2, 2), bool)}, ValueError, "mask has the shape"),
        ({"b": np.full((48, 64, 3), np.nan)}, ValueError, "9216 values .* NaN"),
    ],
)
def test_wrong_arguments_are_named(metric, change, error, message):
    arguments = {"a": np.zeros((48, 64, 3)), "b": np.zeros((48, 64, 3)), **change}
    a, b = arguments.pop("a"), arguments.pop("b")
    with pytest.raises(error, match=message):
        metric(a, b, **arguments)


def test_flip_wants_one_or_three_channels():
    two_channels = np.zeros((16, 16, 2))
    with pytest.raises(ValueError, match="1 or 3 channels, not 2"):
        flip(two_channels, two_channels)


def test_error_map_names_its_choices(picture):
    with pytest.raises(ValueError, match="'difference' or 'flip', not 'ssim'"):
        error_map(picture, picture, metric="ssim")


@pytest.mark.parametrize(("metric", "module"), [(ssim, "skimage.metrics"), (flip, "flip_evaluator")])
def test_missing_package_names_the_extra(metric, module, monkeypatch, picture):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=r"pip install '\.\[metrics\]'"):
        metric(picture, picture)


def test_examples_run():
    pytest.importorskip("skimage")
    pytest.importorskip("flip_evaluator")
    result = doctest.testmod(metrics)
    assert result.attempted > 0
    assert result.failed == 0


def test_regions_are_those_of_their_definition():
    rng = np.random.default_rng(3)
    radius = rng.choice([-4.0, 0.0, 0.4, 2.5, 6.0], (24, 30)).repeat(2, axis=0)[:24]
    radius[6:18, 5:25] = 0.5
    edges = {}
    for y, x in np.ndindex(radius.shape):
        for other in ((y, x + 1), (y + 1, x)):
            if other[0] < 24 and other[1] < 30 and abs(radius[y, x] - radius[other]) > 1.0:
                larger = max(abs(radius[y, x]), abs(radius[other]))
                for pixel in ((y, x), other):
                    edges[pixel] = max(edges.get(pixel, 0.0), larger)
    near = np.array(
        [
            [any(np.hypot(y - v, x - u) <= np.ceil(r) for (v, u), r in edges.items()) for x in range(30)]
            for y in range(24)
        ]
    )
    found = metrics.regions(radius)
    assert near.any()
    assert not near.all()
    np.testing.assert_array_equal(found["near edges"], near)
    np.testing.assert_array_equal(found["in focus"], np.abs(radius) <= 1.0)
    np.testing.assert_array_equal(found["behind"], radius > 1.0)
    np.testing.assert_array_equal(found["in front"], radius < -1.0)
    with pytest.raises(ValueError, match="coc_px"):
        metrics.regions(radius[0])
