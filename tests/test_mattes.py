"""Laws of what compositors pass through a lens: mattes, emission, and lights that add up; on both devices."""

import dofsim
import numpy as np
import pytest

HEIGHT, WIDTH = 96, 136
SIZE = (HEIGHT, WIDTH)
X, Y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
SLOPE = np.float32(-0.6 + 0.008 * X)
# To the rounding of sums of a few hundred lens points, of values up to 1; GPUs may fuse products into sums.
ROUNDING = 2e-5


def lens(strength_px=9.0):
    return dofsim.Lens.from_disparity(strength_px=strength_px, focus=0.0)


@pytest.fixture(params=["cpu", "gpu"])
def device(request):
    return "cpu" if request.param == "cpu" else request.getfixturevalue("gpu")


def render(color, depth=SLOPE, *, strength_px=9.0, **options):
    return dofsim.render(
        np.float32(color), depth, lens(strength_px), **{"depth_kind": "disparity", "device": "cpu", **options}
    )


def light(*base, phase=0.0):
    """Give light that varies over a surface, as of a lamp that is somewhere else."""
    wave = 0.5 + 0.1 * np.sin(X / 9 + phase) * np.cos(Y / 7 - phase)
    return wave[..., None] * np.array(base)


KEY, FILL = light(1.0, 0.8, 0.6), light(0.3, 0.5, 0.9, phase=2.0)
MATTE = np.clip(0.5 + 0.01 * (X - 60) + 0.01 * (Y - 40), 0.3, 0.9)


def lamps(count=5):
    rng = np.random.default_rng(3)
    color = np.zeros((*SIZE, 3))
    color[rng.integers(10, HEIGHT - 10, count), rng.integers(10, WIDTH - 10, count)] = 200.0
    return color


def with_alpha(color, alpha):
    return np.dstack([color, np.broadcast_to(alpha, SIZE)])


def in_layers(color):
    """Give this light of two layers, a soft disc before a wall, with coverage."""
    alpha = np.clip(25.5 - np.hypot(X - 60, Y - 45), 0, 1)
    return np.stack([with_alpha(color * alpha[..., None], alpha), with_alpha(0.7 * color, 1.0)])


LAYERS_DEPTH = np.stack([np.full(SIZE, 1.0, np.float32), np.full(SIZE, -1.0, np.float32)])
STRENGTHS = pytest.mark.parametrize("strength_px", [0.4, 9.0])


@STRENGTHS
def test_lights_add_up(device, strength_px):
    words = {"device": device, "strength_px": strength_px}
    total = render(KEY + FILL, **words)
    np.testing.assert_allclose(render(KEY, **words) + render(FILL, **words), total, atol=ROUNDING)


@STRENGTHS
def test_lights_of_layers_add_up(device, strength_px):
    words = {"depth": LAYERS_DEPTH, "device": device, "strength_px": strength_px}
    key, fill, total = (render(in_layers(v), **words) for v in (KEY, FILL, KEY + FILL))
    np.testing.assert_allclose(key[..., :3] + fill[..., :3], total[..., :3], atol=ROUNDING)
    np.testing.assert_allclose(key[..., 3], total[..., 3], atol=ROUNDING)


@STRENGTHS
def test_an_alpha_alone_is_the_alpha_of_its_picture(device, strength_px):
    words = {"device": device, "strength_px": strength_px}
    picture = render(with_alpha(KEY * MATTE[..., None], MATTE), **words)
    np.testing.assert_allclose(render(MATTE, **words), picture[..., 3], atol=ROUNDING)
    # A picture without light has its alpha.
    dark = render(with_alpha(0 * KEY, MATTE), **words)
    np.testing.assert_allclose(dark[..., 3], picture[..., 3], atol=ROUNDING)
    assert not dark[..., :3].any()


@STRENGTHS
def test_an_emission_alone_is_what_it_adds(device, strength_px):
    """A pass that shines and covers nothing has no alpha; what it shines on has one."""
    words = {"device": device, "strength_px": strength_px}
    covered = with_alpha(KEY * MATTE[..., None], MATTE)
    alone = render(with_alpha(FILL, 0.0), **words)
    np.testing.assert_allclose(alone[..., :3], render(FILL, **words), atol=ROUNDING)
    assert not alone[..., 3].any()
    total = render(covered + with_alpha(FILL, 0.0), **words)
    np.testing.assert_allclose(render(covered, **words) + alone, total, atol=ROUNDING)


@STRENGTHS
def test_lamps_add_to_what_is_lit(device, strength_px):
    """A lamp is the same disc whatever else is lit, but for a few times its surroundings."""
    words = {"device": device, "strength_px": strength_px}
    lit, both = render(KEY, **words), render(KEY + lamps(), **words)
    alone = render(0.01 * KEY + lamps(), **words) - 0.01 * lit
    scale = float(alone.max())
    assert np.abs(lit + alone - both).max() < 4e-3 * scale
    # Nothing lands beyond the border.
    assert alone.sum() == pytest.approx(lamps().sum(), rel=2e-3)


# By a guide


def led(channels, guide, depth=SLOPE, *, kinds="light", **words):
    return render(channels, depth, guide=np.float32(guide), kinds=kinds, **words)


BALL = np.where(np.hypot(X - 60, Y - 45) < 25, np.float32(1.0), np.float32(-1.0))
GUIDES = {
    "surface": (with_alpha(KEY, 1.0), SLOPE),
    "edges": (with_alpha(KEY + FILL * (BALL > 0)[..., None], 1.0), BALL),
    "lamps": (with_alpha(KEY + lamps(), 1.0), BALL),
    "layers": (in_layers(KEY + lamps()), LAYERS_DEPTH),
}


def spread(channels, guide):
    """Give channels of the shape of a guide in layers, if it is one."""
    return np.broadcast_to(channels, (*guide.shape[:-1], channels.shape[-1])) * (guide[..., 3:] > 0)


@pytest.mark.parametrize("strength_px", [0.4, 9.0, 40.0])
@pytest.mark.parametrize("name", GUIDES)
def test_passes_add_up_by_a_guide(name, strength_px):
    """All of them have the same weights, lamps in the guide, in a channel, in both or in none."""
    guide, depth = GUIDES[name]
    parts = spread(np.concatenate([KEY, FILL, lamps()], axis=-1), guide)
    total = parts[..., :3] + parts[..., 3:6] + parts[..., 6:]
    words = {"depth": depth, "strength_px": strength_px}
    out = led(np.concatenate([parts, total], axis=-1), guide, **words)
    sums = out[..., :3] + out[..., 3:6] + out[..., 6:9]
    np.testing.assert_allclose(sums, out[..., 9:], atol=3e-6 * max(1.0, float(out.max())), rtol=1e-5)
    for kind in ("light", "matte"):
        alone = led(parts[..., 6], guide, kinds=kind, **words)
        np.testing.assert_array_equal(alone, out[..., 6])


@pytest.mark.parametrize("strength_px", [0.4, 9.0, 40.0])
@pytest.mark.parametrize("name", GUIDES)
def test_mattes_of_parts_add_up_to_the_alpha(name, strength_px):
    guide, depth = GUIDES[name]
    alpha = guide[..., 3]
    left = np.broadcast_to(np.clip((X - 50) / 9, 0, 1), alpha.shape)
    three = np.stack([left * alpha, (1 - left) * alpha, alpha], axis=-1)
    out = led(three, guide, depth, kinds="matte", strength_px=strength_px)
    np.testing.assert_allclose(out[..., 0] + out[..., 1], out[..., 2], atol=ROUNDING)


@pytest.mark.parametrize("name", ["surface", "edges"])
def test_a_whole_matte_stays_whole(name):
    guide, depth = GUIDES[name]
    out = led(np.ones(SIZE), guide, depth, kinds="matte")
    np.testing.assert_allclose(out, 1.0, atol=2e-5)
