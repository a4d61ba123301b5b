"""Layers that light passes through: fog, glass, and what is thinner than a pixel."""

import dofsim
import numpy as np
import pytest
from dofsim._dofsim import simd_available

HEIGHT, WIDTH = 40, 96
# Away from the border, whose mirror image is as exact, but of another picture.
INSIDE = np.s_[12:-12, 20:-20]
RAMP = np.broadcast_to(np.linspace(-1.0, 1.0, WIDTH, dtype=np.float32), (HEIGHT, WIDTH))


def fog(opacities, grays):
    """Make even layers: (L, H, W, 4)."""
    color = np.zeros((len(opacities), HEIGHT, WIDTH, 4), np.float32)
    for layer, opacity, gray in zip(color, opacities, grays, strict=True):
        layer[...] = opacity * np.array([gray, 0.5 * gray, 1.0, 1.0])
    return color


def through(color, depth, device, strength_px=12.0, **options):
    lens = dofsim.Lens.from_disparity(strength_px=strength_px, focus=0.0)
    return dofsim.render(color, np.float32(depth), lens, depth_kind="disparity", device=device, **options)


@pytest.fixture(params=["cpu", "gpu"])
def device(request):
    return "cpu" if request.param == "cpu" else request.getfixturevalue("gpu")


def over(color):
    """Composite layers as the pinhole sees them."""
    out = np.zeros(color.shape[1:])
    for layer in color[::-1]:
        out = layer + (1.0 - layer[..., 3:]) * out
    return out


@pytest.mark.parametrize("strength_px", [2.0, 20.0])
@pytest.mark.parametrize("disparities", [(0.3, 0.2), (0.3, 0.29), (0.5, -0.4), (0.4, 0.0)], ids=str)
def test_even_layers_are_what_the_pinhole_sees(device, disparities, strength_px):
    color = fog((0.3, 0.5), (1.0, 2.0))
    depth = np.stack([np.full((HEIGHT, WIDTH), d) for d in disparities])
    out = through(color, depth, device, strength_px)
    np.testing.assert_allclose(out[INSIDE], over(color)[INSIDE], rtol=0, atol=1e-5)


@pytest.mark.parametrize("slope", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("count", [1, 3])
def test_fog_on_a_ramp_through_the_focus_has_no_dip(device, count, slope):
    # Behind it is what stops nothing: a single layer would be a picture, whose alpha is a channel.
    color = fog([0.3] * count + [0.0], [1.0] * (count + 1))
    depth = np.stack([slope * RAMP + 0.3 - 0.1 * i for i in range(count + 1)])
    out = through(color, depth, device, strength_px=9.0, views=64)
    found = out[INSIDE][..., 3] - (1.0 - 0.7**count)
    assert found.min() > -1e-5
    # Of 64 rays, two may meet the slope twice where four pixels touch.
    assert found.max() < 2.5 / 64.0 * 0.3
    assert found.mean() < 1.0 / 64.0 * 0.3


def test_glass_dims_what_is_behind_it(device):
    # A pane of which an edge is in the picture, before stripes that are in focus.
    pane, stripes = fog((0.6, 1.0), (0.0, 1.0))
    pane[:, WIDTH // 2 :] = 0.0
    stripes[:, ::4, :3] = 0.0
    depth = np.stack([np.full((HEIGHT, WIDTH), 0.5), np.zeros((HEIGHT, WIDTH))])
    out = through(np.stack([pane, stripes]), depth, device)
    rows = np.s_[12:-12]
    dimmed, bare = np.s_[rows, 16:36], np.s_[rows, 60:80]
    np.testing.assert_allclose(out[dimmed][..., 0], 0.4 * stripes[dimmed][..., 0], rtol=0, atol=1e-5)
    np.testing.assert_allclose(out[bare][..., :3], stripes[bare][..., :3], rtol=0, atol=1e-5)
    # Across its edge the pane dims by the part of the lens that looks past it.
    edge = out[rows, 36:60][..., 0] / np.maximum(stripes[rows, 36:60, 0], 1e-6)
    lit = stripes[rows, 36:60, 0] > 0
    assert edge[lit].min() > 0.4 - 1e-5
    assert edge[lit].max() < 1.0 + 1e-5
    assert np.all(np.diff(edge.mean(0)[np.arange(36, 60) % 4 != 0]) > -1e-5)


@pytest.mark.parametrize("instructions", simd_available())
@pytest.mark.parametrize("threads", [1, 3])
def test_threads_and_instruction_sets_change_no_bit(monkeypatch, instructions, threads):
    rng = np.random.default_rng(3)
    color = fog((0.4, 0.7), (1.0, 3.0)) * rng.uniform(0.5, 1.0, (2, HEIGHT, WIDTH, 1)).astype(np.float32)
    depth = np.stack([0.4 * RAMP + 0.2, rng.uniform(-0.9, -0.3, (HEIGHT, WIDTH))])
    expected = through(color, depth, "cpu")
    monkeypatch.setenv("DOFSIM_SIMD", instructions)
    np.testing.assert_array_equal(through(color, depth, "cpu", threads=threads), expected)
