"""Laws of channels in layers, which go through a lens by a guide in layers."""

import time

import dofsim
import numpy as np
import pytest
from dofsim._dofsim import simd_available

HEIGHT, WIDTH = 96, 136
SIZE = (HEIGHT, WIDTH)
X, Y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
WALL, MIDDLE, NEAR = -1.0, 0.0, 1.0
KINDS = ["light"] * 3 + ["matte"]


def lens(strength_px=9.0, **words):
    return dofsim.Lens.from_disparity(strength_px=strength_px, focus=0.0).replace(**words)


def render(color, depth, *, through=None, **options):
    options = {"depth_kind": "disparity", "device": "cpu", **options}
    return dofsim.render(color, np.float32(depth), through or lens(), **options)


def led(channels, depth, guide, *, kinds="light", **options):
    return render(channels, depth, guide=guide, kinds=kinds, **options)


def disc(x, y, radius):
    """Give the coverage of a disc with a soft edge."""
    return np.clip(radius + 0.5 - np.hypot(X - x, Y - y), 0, 1).astype(np.float32)


def rgba(color, alpha=1.0):
    """Give a premultiplied picture of this colour and coverage."""
    alpha = np.broadcast_to(np.float32(alpha), SIZE)
    return np.dstack([np.float32(color) * alpha[..., None], alpha]).astype(np.float32)


def everywhere(value):
    return np.full(SIZE, value, np.float32)


def smooth(base):
    wave = 0.5 + 0.1 * np.sin(X / 9) * np.cos(Y / 7)
    return (wave[..., None] * np.float32(base)).astype(np.float32)


def texture(seed=1, lamps=0):
    rng = np.random.default_rng(seed)
    color = (0.2 + 0.6 * rng.random((*SIZE, 3))).astype(np.float32)
    for x, y in zip(rng.integers(8, WIDTH - 8, lamps), rng.integers(8, HEIGHT - 8, lamps), strict=True):
        color[y, x] = 300.0
    return color


def fog_before_a_ball_before_a_wall(wall):
    """Give three layers: what light passes through, a soft edge, and what is whole."""
    layers = [rgba(np.full(3, 0.7), 0.3), rgba(BALL, disc(60, 50, 22)), rgba(wall)]
    return np.stack(layers), np.stack([everywhere(1.4), everywhere(NEAR), everywhere(WALL)])


def a_peeled_picture(wall, lamp=0.0):
    """Give a first layer without gaps, and behind it what it hides: a wall, in part."""
    front = disc(60, 50, 22)
    color = wall * (1 - front[..., None]) + BALL * front[..., None]
    # A lamp in part behind the edge of the disc.
    edge = (front > 0) & (front < 1) & (Y < 50)
    color[edge] += lamp
    behind = np.float32((np.hypot(X - 60, Y - 50) < 23) & (X < 70))
    layers = np.stack([rgba(color), rgba(smooth([0.7, 0.8, 0.5]), behind)])
    depth = np.where(front >= 0.5, np.float32(NEAR), np.float32(WALL))
    return layers, np.stack([depth, everywhere(WALL)])


BALL = np.float32([0.6, 0.5, 0.4])
SMOOTH = {
    "fog": fog_before_a_ball_before_a_wall(smooth([1.0, 0.8, 0.6])),
    "peeled": a_peeled_picture(smooth([1.0, 0.8, 0.6])),
}
BRIGHT = {
    "fog": fog_before_a_ball_before_a_wall(texture(lamps=6)),
    "peeled": a_peeled_picture(texture(lamps=6), lamp=40.0),
}


@pytest.mark.parametrize("strength_px", [0.4, 3.0, 9.0, 40.0])
@pytest.mark.parametrize("name", SMOOTH)
def test_layers_that_lead_themselves_are_their_render(name, strength_px):
    """Nothing of given layers is taken apart: where no sharpening is limited, all bits are the same."""
    layers, depth = SMOOTH[name]
    through = lens(strength_px)
    out = led(layers, depth, layers, kinds=KINDS, through=through)
    plain = render(layers, depth, through=through)
    if name == "peeled":
        # What the last layer hides is filled with a mean, by weights that are rounded once more.
        np.testing.assert_array_max_ulp(out, plain, 4)
    else:
        np.testing.assert_array_equal(out, plain)


@pytest.mark.parametrize("name", BRIGHT)
def test_lamps_and_texture_that_lead_themselves_are_nearly_their_render(name):
    layers, depth = BRIGHT[name]
    out, plain = led(layers, depth, layers, kinds=KINDS), render(layers, depth)
    error = np.abs(np.log1p(np.maximum(out, 0)) - np.log1p(plain))
    assert error[..., :3].mean() < 1e-3
    assert np.quantile(error[..., :3], 0.99) < 0.02
    # What of a matte lies where a lamp is goes as far as the lamp's light does.
    assert error[..., 3].mean() < 1e-3
    assert error[..., 3].max() < 0.03


@pytest.mark.parametrize("name", BRIGHT)
def test_the_result_of_a_sum_is_the_sum_of_the_results(name):
    layers, depth = BRIGHT[name]
    light = layers[..., :3]
    key = (0.3 * light).astype(np.float32)
    out = led(np.concatenate([key, light - key, light], axis=-1), depth, layers)
    scale = max(1.0, float(np.abs(out).max()))
    assert np.abs(out[..., :3] + out[..., 3:6] - out[..., 6:]).max() < 3e-6 * scale


@pytest.mark.parametrize("name", BRIGHT)
@pytest.mark.parametrize("count", [1, 3, 7, 11])
def test_a_channel_does_not_depend_on_those_that_travel_along(name, count):
    layers, depth = BRIGHT[name]
    channels = np.random.default_rng(4).standard_normal((*depth.shape, count), dtype=np.float32)
    kinds = (["light", "data", "matte"] * 4)[:count]
    together = led(channels, depth, layers, kinds=kinds)
    assert together.shape == (*SIZE, count)
    for c in {0, count // 2, count - 1}:
        alone = led(channels[..., c], depth, layers, kinds=kinds[c])
        assert alone.shape == SIZE
        np.testing.assert_array_equal(together[..., c], alone)


@pytest.mark.parametrize("name", BRIGHT)
def test_one_layer_before_nothing_is_one_layer(name):
    """Of what a whole layer has, a second one without coverage changes nothing."""
    layers, depth = BRIGHT[name]
    alpha = layers[..., 3]
    one = np.random.default_rng(5).random((*depth.shape, 2), dtype=np.float32) * alpha[..., None]
    padded = [np.concatenate([v, np.zeros_like(v[:1])]) for v in (one, layers)]
    deeper = np.concatenate([depth, everywhere(-2.0)[None]])
    out = led(padded[0], deeper, padded[1])
    np.testing.assert_allclose(out, led(one, depth, layers), atol=1e-5)


@pytest.mark.parametrize("name", SMOOTH)
def test_data_are_means_of_what_each_layer_shows(name):
    layers, depth = SMOOTH[name]
    number = np.broadcast_to(np.arange(1, len(layers) + 1, dtype=np.float32)[:, None, None], depth.shape)
    out = led(number, depth, layers, kinds="data")
    assert out.min() >= 1 - 1e-5
    assert out.max() <= len(layers) + 1e-5
    # A weighted mean is that of the values by the coverage that each layer leaves to the next.
    weighted = led(layers[..., 3] * number, depth, layers, kinds="matte")
    alpha = led(layers[..., 3], depth, layers, kinds="matte")
    np.testing.assert_allclose(out, weighted / alpha, atol=0.03)
    assert np.abs(out - weighted / alpha).mean() < 1e-3


def test_what_is_infinite_in_a_layer_has_no_weight():
    layers, depth = SMOOTH["fog"]
    distance = np.stack([everywhere(np.inf), everywhere(2.0), everywhere(5.0)])
    out = led(distance, depth, layers, kinds="data")
    assert np.isfinite(out).all()
    assert out.min() > 2 - 1e-4
    assert out.max() < 5 + 1e-4


@pytest.mark.parametrize("name", SMOOTH)
def test_in_focus_the_layers_are_composited(name):
    layers, depth = BRIGHT[name]
    channels = np.random.default_rng(7).standard_normal((*depth.shape, 5), dtype=np.float32)
    out = led(channels, depth, layers, through=lens(0.0))
    left, expected = np.ones(SIZE), np.zeros((*SIZE, 5))
    for planes, alpha in zip(channels, layers[..., 3], strict=True):
        expected += left[..., None] * planes
        left = left * (1 - alpha)
    np.testing.assert_allclose(out, expected, atol=1e-5)


def test_threads_and_instructions_change_no_bit(monkeypatch):
    layers, depth = BRIGHT["fog"]
    channels = np.random.default_rng(8).standard_normal((*depth.shape, 6), dtype=np.float32)
    plain = led(channels, depth, layers, threads=1)
    np.testing.assert_array_equal(led(channels, depth, layers, threads=3), plain)
    for name in simd_available():
        monkeypatch.setenv("DOFSIM_SIMD", name)
        np.testing.assert_array_equal(led(channels, depth, layers), plain)


def test_layers_of_channels_are_held_out():
    layers, depth = SMOOTH["fog"]
    holdout = (disc(90, 50, 20), everywhere(0.2))
    out = led(layers, depth, layers, kinds=KINDS, holdout=holdout)
    np.testing.assert_array_equal(out, render(layers, depth, holdout=holdout))


def test_a_scene_of_layers_is_a_stack():
    layers, depth = BRIGHT["peeled"]
    scene = dofsim.Scene(layers[..., :3], depth, guide=layers, depth_kind="disparity")
    stack = scene.focal_stack(lens(), [0.0, 1.0])
    assert stack.shape == (2, *SIZE, 3)
    np.testing.assert_array_equal(stack[0], led(layers[..., :3], depth, layers))


def test_four_channels_in_layers_are_their_own_guide():
    layers, depth = BRIGHT["fog"]
    own = render(layers, depth, kinds=KINDS)
    np.testing.assert_array_equal(own, led(layers, depth, layers, kinds=KINDS))


def test_a_further_channel_costs_little():
    """What all channels share is the visibility; processors' time, the least of some runs in turn."""
    rng = np.random.default_rng(9)
    base = fog_before_a_ball_before_a_wall(texture())
    layers, depth = (np.tile(v, (1, 3, 3, 1) if v.ndim == 4 else (1, 3, 3)) for v in base)
    channels = rng.random((*depth.shape, 23), dtype=np.float32)

    def seconds(count):
        start = time.process_time()
        led(np.ascontiguousarray(channels[..., :count]), depth, layers, through=lens(12.0), threads=2)
        return time.process_time() - start

    few, many = np.min([[seconds(3), seconds(23)] for _ in range(4)], axis=0)
    assert (many - few) / 20 < 0.15 * few


REFUSED = [
    ({"guide": np.ones((3, 8, 8, 4), np.float32)}, "guide must have the layers, rows and columns of color"),
    (
        {"color": np.ones((8, 8), np.float32)},
        r"color must have shape \(L, H, W\) or \(L, H, W, C\) with guide",
    ),
    ({"guide": np.ones((2, 8, 8, 3), np.float32)}, "guide in layers must have 4 channels"),
    (
        {"color": np.full((2, 8, 8, 5), np.nan, np.float32)},
        "got NaN in channel 0 at row 0, column 0 of layer 0",
    ),
    ({"depth": np.ones((8, 8), np.float32)}, "depth must have the same layers"),
]


@pytest.mark.parametrize(("changed", "text"), REFUSED, ids=[str(i) for i in range(len(REFUSED))])
def test_what_cannot_be_used_is_refused_by_name(changed, text):
    layers = np.ones((2, 8, 8, 4), np.float32)
    words = {"color": np.ones((2, 8, 8, 5), np.float32), "depth": layers[..., 0], "guide": layers} | changed
    with pytest.raises((ValueError, TypeError), match=text) as caught:
        render(words["color"], words["depth"], guide=words["guide"])
    assert "\n" not in str(caught.value)


def test_a_layered_guide_is_no_picture_of_three_planes():
    """Three axes are rows, columns and channels beside a flat guide, and layers beside one in layers."""
    layers, depth = SMOOTH["fog"]
    planes = np.ascontiguousarray(layers[..., 0])
    np.testing.assert_array_equal(led(planes, depth, layers), led(planes[..., None], depth, layers)[..., 0])
