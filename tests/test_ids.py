"""Laws of Cryptomatte's ids through a lens."""

import dofsim
import numpy as np
import pytest
from dofsim import _ids

HEIGHT, WIDTH, COUNT = 72, 900, 30
SIZE = (HEIGHT, WIDTH)
LENS = dofsim.Lens(aperture_radius=0.06, focus_distance=3.0, fov=42.0)


@pytest.fixture(scope="module")
def scene():
    """Discs at many depths before nothing: three ranks of ids, whose edges are soft, depth, and the guide."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    ids, depth = np.zeros((*SIZE, 6), np.float32), np.full(SIZE, 6.0, np.float32)
    for number in range(COUNT):
        disc = np.hypot(x - rng.uniform(0, WIDTH), y - rng.uniform(0, HEIGHT)) - rng.uniform(6, 16)
        covers = np.clip(0.5 - disc, 0, 1).astype(np.float32)
        for rank in (2, 1):
            ids[..., 2 * rank : 2 * rank + 2] = np.where(
                (covers > 0)[..., None], ids[..., 2 * rank - 2 : 2 * rank], ids[..., 2 * rank : 2 * rank + 2]
            )
        ids[..., 3::2] *= np.where(covers > 0, 1 - covers, 1)[..., None]
        ids[..., 0] = np.where(covers > 0, number + 1.5, ids[..., 0])
        ids[..., 1] = np.where(covers > 0, covers, ids[..., 1])
        depth[disc < 0] = rng.uniform(1.5, 5.0)
    alpha = ids[..., 1::2].sum(axis=-1)
    color = 0.2 + 0.6 * rng.random((*SIZE, 3), dtype=np.float32)
    return ids, depth, np.dstack([color * alpha[..., None], alpha]).astype(np.float32)


@pytest.fixture(scope="module")
def rendered(scene):
    ids, depth, guide = scene
    return dofsim.render_ids(ids, depth, LENS, guide=guide)


def test_coverage_adds_up_to_the_coverage_of_the_picture(scene, rendered):
    _, depth, guide = scene
    alpha = dofsim.render(guide[..., 3], depth, LENS, guide=guide, kinds="matte")
    np.testing.assert_allclose(rendered[..., 1::2].sum(-1), np.maximum(alpha, 0), atol=2e-6)


def test_ranks_fall_and_no_id_is_there_twice(rendered):
    names, coverage = rendered[..., 0::2], rendered[..., 1::2]
    assert np.all(coverage >= 0)
    assert np.mean(np.diff(coverage, axis=-1) > 0) < 1e-3  # Pixels that nothing moved keep their order.
    for first, second in ((0, 1), (0, 2), (1, 2)):
        assert not np.any((names[..., first] == names[..., second]) & (coverage[..., second] > 0))


def test_an_id_covers_what_its_matte_covers(scene, rendered):
    ids, depth, guide = scene
    for name in (1.5, 12.5, 29.5):
        given = np.where(ids[..., 0::2] == name, ids[..., 1::2], 0).sum(-1).astype(np.float32)
        matte = dofsim.render(given, depth, LENS, guide=guide, kinds="matte")
        own = np.where(rendered[..., 0::2] == name, rendered[..., 1::2], 0).sum(-1)
        # Where more than three ids are seen, the others are shared among these.
        assert np.mean(np.abs(own - matte) > 1e-5) < 0.02
        assert np.abs(own - matte).max() < 0.35


def test_ids_that_share_a_channel_are_told_apart(scene, rendered, monkeypatch):
    counts = []
    shared = _ids._channels
    monkeypatch.setattr(
        _ids, "_channels", lambda boxes: counts.append(max(shared(boxes)) + 1) or range(len(boxes))
    )
    ids, depth, guide = scene
    np.testing.assert_array_equal(dofsim.render_ids(ids, depth, LENS, guide=guide), rendered)
    assert counts[0] < COUNT / 2


def test_what_is_in_focus_keeps_every_bit(scene):
    ids, depth, guide = scene
    closed = LENS.replace(aperture_radius=1e-9)
    np.testing.assert_array_equal(dofsim.render_ids(ids, depth, closed, guide=guide), ids)


def test_a_picture_without_coverage_has_that_of_its_ids(scene):
    ids, depth, guide = scene
    out = dofsim.render_ids(ids, depth, LENS, guide=guide[..., :3])
    total = dofsim.render(ids[..., 1::2].sum(-1), depth, LENS, guide=guide[..., :3], kinds="matte")
    np.testing.assert_allclose(out[..., 1::2].sum(-1), np.maximum(total, 0), atol=2e-6)


def test_no_ids_are_no_ids(scene):
    ids, depth, guide = scene
    out = dofsim.render_ids(np.zeros_like(ids), depth, LENS, guide=guide, overscan=4)
    assert out.shape == (HEIGHT - 8, WIDTH - 8, 6)
    assert not np.any(out)


@pytest.mark.parametrize(
    ("ids", "text"),
    [
        (np.zeros((8, 8, 3), np.float32), r"ids must have shape \(H, W, 2 R\)"),
        (np.zeros((8, 8), np.float32), r"ids must have shape \(H, W, 2 R\)"),
        (np.zeros((8, 8, 2), np.float16), "ids must have dtype float32 or float64"),
        (np.full((8, 8, 2), 2.0, np.float32), "coverage from 0 to 1; got 2 in rank 0 at row 0, column 0"),
        (np.zeros((9, 8, 2), np.float32), "guide must have the rows and columns"),
    ],
)
def test_what_cannot_be_used_is_refused(ids, text):
    with pytest.raises((ValueError, TypeError), match=text):
        dofsim.render_ids(ids, np.ones((8, 8)), LENS, guide=np.ones((8, 8, 3), np.float32))
