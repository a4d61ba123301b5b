"""Pixels whose colour is NaN or infinite: refused by name, or filled from those around them."""

import warnings

import dofsim
import numpy as np
import pytest
from dofsim._dofsim import methods_available

HEIGHT, WIDTH = 40, 60
LENS = dofsim.Lens(aperture_radius=0.03, focus_distance=3.0, fov=40.0)
PINHOLE = LENS.replace(aperture_radius=0.0)


def scene(channels=3, dtype=np.float32):
    rng = np.random.default_rng(channels)
    depth = np.full((HEIGHT, WIDTH), 6.0, np.float32)
    depth[:, 30:] = 2.0
    return rng.random((HEIGHT, WIDTH, channels)).astype(dtype), depth


def spoilt(value=np.nan, channels=3, dtype=np.float32):
    color, depth = scene(channels, dtype)
    color[10:12, 20:23, channels - 1] = value
    color[0, 0, 0] = value
    return color, depth


def filled(color):
    """Fill from the eight neighbours, the rim of a patch first; slow and obvious."""
    color = color.astype(np.float64)
    while (bad := ~np.isfinite(color).all(axis=-1)).any():
        before = color.copy()
        for y, x in np.argwhere(bad):
            near = np.s_[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
            if (good := ~bad[near]).any():
                color[y, x] = before[near][good].mean(axis=0)
    return color


def render(color, depth, lens=LENS, **options):
    words = {"device": "cpu", "invalid_color": "fill"} | options
    return dofsim.render(color, depth, lens, **words)


@pytest.mark.parametrize("method", methods_available())
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_filled_pixels_are_those_of_a_picture_that_had_them(method, value):
    color, depth = spoilt(value)
    with pytest.warns(UserWarning, match=r"^color has 7 pixels that are not finite .*row 0, column 0$"):
        out = render(color, depth, method=method)
    np.testing.assert_allclose(out, render(filled(color).astype(np.float32), depth, method=method), atol=1e-5)


def test_the_gpu_fills_alike(gpu):
    with pytest.warns(UserWarning, match="7 pixels"):
        out = render(*spoilt(), device=gpu)
    good = filled(spoilt()[0]).astype(np.float32)
    np.testing.assert_allclose(out, render(good, spoilt()[1], device=gpu), atol=1e-5)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_every_kind_of_picture_is_filled(channels, dtype):
    color, depth = spoilt(channels=channels, dtype=dtype)
    with pytest.warns(UserWarning, match="color has 7 pixels"):
        out = render(color, depth, PINHOLE, alpha="none")
    expected = filled(color).astype(np.float32)
    np.testing.assert_allclose(out, expected, rtol=1e-3 if dtype == np.float16 else 1e-6)


def test_straight_colours_are_weighed_by_their_coverage():
    color, depth = scene(4)
    color[5, 5, 3] = np.nan
    with pytest.warns(UserWarning, match="color has 1 pixel that is not finite"):
        out = render(color, depth, PINHOLE, alpha="straight")
    around = np.delete(color[4:7, 4:7].reshape(9, 4), 4, axis=0).astype(np.float64)
    alpha = around[:, 3].mean()
    expected = [*(around[:, :3] * around[:, 3:]).mean(axis=0) / alpha, alpha]
    np.testing.assert_allclose(out[5, 5], expected, rtol=1e-5)


def test_layers_are_filled_each_from_its_own():
    color, depth = scene(4)
    layers = np.stack([0.5 * color, color])
    layers[..., 3] = [[[0.5]], [[1.0]]]
    whole = layers.copy()
    layers[1, 7, 8, 0] = np.inf
    whole[1] = filled(layers[1])
    depths = np.stack([depth, depth + 1.0])
    with pytest.warns(UserWarning, match="color has 1 pixel "):
        out = render(layers, depths)
    np.testing.assert_allclose(out, render(whole, depths), atol=1e-5)


def test_the_error_says_how_many_where_and_what_helps():
    color, depth = spoilt()
    color[0, 0, 0] = 0.5
    text = (
        r"^color has 6 pixels that are not finite .*; the first is at row 10, column 20\. "
        r'Pass invalid_color="fill"'
    )
    with pytest.raises(ValueError, match=text):
        dofsim.render(color, depth, LENS, device="cpu")
    with pytest.raises(ValueError, match=text):
        dofsim.Scene(color, depth, invalid_color="raise")
    with pytest.raises(ValueError, match=r'^invalid_color must be one of "raise", "fill"; got "black"'):
        render(color, depth, invalid_color="black")
    with pytest.raises(ValueError, match=r"^color has no finite pixel"):
        render(np.full_like(color, np.nan), depth)


def test_a_scene_says_how_many_it_filled_and_nothing_where_nothing_was():
    with pytest.warns(UserWarning, match="7 pixels"):
        scene_filled = dofsim.Scene(*spoilt(), invalid_color="fill", device="cpu")
    assert scene_filled.filled_pixels == 7
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        good = dofsim.Scene(*scene(), invalid_color="fill", device="cpu")
    assert good.filled_pixels == 0
    np.testing.assert_array_equal(good.render(LENS), render(*scene(), invalid_color="raise"))


def test_a_frame_with_an_absurd_depth_and_an_absurd_colour_is_rendered():
    color, depth = spoilt()
    depth[20, 20], depth[21, 21] = 1e-4, np.nan
    with pytest.warns(UserWarning, match="7 pixels"):
        out = render(color, depth, max_coc_px=20.0, invalid="far")
    assert np.isfinite(out).all()
