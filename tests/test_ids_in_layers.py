"""Laws of Cryptomatte's ids in layers, which go through a lens by a guide in layers."""

import dofsim
import numpy as np
import pytest
from dofsim import _ids
from test_channels_in_layers import (
    NEAR,
    SIZE,
    WALL,
    a_peeled_picture,
    disc,
    everywhere,
    fog_before_a_ball_before_a_wall,
    lens,
    rgba,
    smooth,
    texture,
)

FOG_ID, BALL_ID, LEFT_ID, RIGHT_ID = 1.5, 2.5, 3.5, 4.5
HALF = SIZE[1] // 2


def pairs(*ranks):
    """Give ids and coverage of one layer, of two ranks."""
    planes = [np.broadcast_to(np.float32(v), SIZE) for rank in ranks for v in rank]
    return np.dstack(planes + [np.zeros(SIZE, np.float32)] * (4 - len(planes)))


def beside(left, right):
    """Give what is one thing in the left half and another in the right one."""
    return np.where(np.arange(SIZE[1]) < HALF, np.float32(left), np.float32(right))


@pytest.fixture(scope="module")
def scene():
    """Fog, a ball with a soft edge and a wall of two halves: ids, guide and depth, four ranks in all."""
    guide, depth = fog_before_a_ball_before_a_wall(texture(3))
    ids = np.stack(
        [
            pairs((FOG_ID, guide[0, ..., 3])),
            pairs((BALL_ID, guide[1, ..., 3])),
            pairs((beside(LEFT_ID, RIGHT_ID), guide[2, ..., 3])),
        ]
    )
    empty = np.zeros_like(ids[..., :4])
    return np.concatenate([ids, empty], axis=-1), guide, np.float32(depth)


def render_ids(ids, depth, guide, through=None, **options):
    return dofsim.render_ids(ids, depth, through or lens(), guide=guide, depth_kind="disparity", **options)


def matte(plane, depth, guide, through=None):
    through = through or lens()
    return dofsim.render(plane, depth, through, guide=guide, kinds="matte", depth_kind="disparity")


def coverage_of(name, ranks):
    return np.where(ranks[..., 0::2] == np.float32(name), ranks[..., 1::2], 0).sum(-1)


def test_coverage_adds_up_to_the_alpha_of_the_picture(scene):
    ids, guide, depth = scene
    hole = guide.copy()
    # The wall ends: there is nothing behind the ball's left part.
    hole[2, :, :HALF] = 0.0
    ids = ids.copy()
    ids[2, :, :HALF] = 0.0
    ranks = render_ids(ids, depth, hole)
    assert ranks.shape == (*SIZE, 8)
    alpha = matte(hole[..., 3], depth, hole)
    np.testing.assert_allclose(ranks[..., 1::2].sum(-1), np.maximum(alpha, 0), atol=2e-6)
    beauty = dofsim.render(hole, depth, lens(), depth_kind="disparity", device="cpu")[..., 3]
    np.testing.assert_allclose(ranks[..., 1::2].sum(-1), beauty, atol=2e-3)
    assert 0.2 < alpha.min() < 0.5 < 0.99 < alpha.max()


def test_an_id_covers_what_its_matte_covers(scene):
    ids, guide, depth = scene
    ranks = render_ids(ids, depth, guide)
    for name in (FOG_ID, BALL_ID, LEFT_ID, RIGHT_ID):
        own = np.where(ids[..., 0::2] == np.float32(name), ids[..., 1::2], 0).sum(-1, dtype=np.float32)
        np.testing.assert_allclose(coverage_of(name, ranks), matte(own, depth, guide), atol=5e-6)
    assert np.all(np.diff(ranks[..., 1::2], axis=-1) <= 0)


def test_what_travels_along_changes_nothing(scene, monkeypatch):
    ids, guide, depth = scene
    ranks = render_ids(ids, depth, guide)
    monkeypatch.setattr(_ids, "_AT_ONCE", 1)
    monkeypatch.setattr(_ids, "_channels", lambda boxes: range(len(boxes)))
    np.testing.assert_array_equal(render_ids(ids, depth, guide), ranks)


def test_in_focus_ids_are_those_of_the_layers_over_one_another(scene):
    ids, guide, depth = scene
    ranks = render_ids(ids, depth, guide, lens(1e-6))
    fog, ball = guide[0, ..., 3], guide[1, ..., 3]
    seen = {FOG_ID: fog, BALL_ID: (1 - fog) * ball}
    seen |= {LEFT_ID: (1 - fog) * (1 - ball) * beside(1, 0), RIGHT_ID: (1 - fog) * (1 - ball) * beside(0, 1)}
    for name, coverage in seen.items():
        np.testing.assert_allclose(coverage_of(name, ranks), coverage, atol=1e-5)


def test_a_surface_in_two_layers_has_one_id():
    guide, depth = a_peeled_picture(smooth([1.0, 0.8, 0.6]))
    there = guide[..., 3]
    in_front = depth[0] == np.float32(NEAR)
    ids = np.stack(
        [
            pairs((np.where(in_front, BALL_ID, LEFT_ID), there[0])),
            pairs((LEFT_ID, there[1])),
        ]
    )
    ranks = render_ids(ids, np.float32(depth), guide)
    both = coverage_of(BALL_ID, ranks) + coverage_of(LEFT_ID, ranks)
    np.testing.assert_allclose(both, matte(there, np.float32(depth), guide), atol=2e-6)
    # The lens sees past the ball's edge to the wall of the second layer.
    edge = (disc(60, 50, 20) == 1) & (disc(60, 50, 16) == 0)
    assert coverage_of(LEFT_ID, ranks)[edge].mean() > 0.2


def test_a_holdout_takes_coverage(scene):
    ids, guide, depth = scene
    before = disc(60, 50, 23), everywhere(NEAR + 1.0)
    held = render_ids(ids, depth, guide, holdout=before)
    free = render_ids(ids, depth, guide)
    assert held[50, 60, 1::2].sum() < 0.01 < 0.99 < free[50, 60, 1::2].sum()
    np.testing.assert_allclose(held[:7, :, 1::2].sum(-1), free[:7, :, 1::2].sum(-1), atol=1e-5)


def test_a_picture_of_one_layer_is_that_of_no_layers():
    guide = rgba(texture(5), disc(60, 50, 40))
    depth = np.where(np.arange(SIZE[1]) < HALF, np.float32(NEAR), np.float32(WALL)) + everywhere(0)
    ids = pairs((beside(LEFT_ID, RIGHT_ID), guide[..., 3]))
    flat = render_ids(ids, depth, guide)
    for name in (LEFT_ID, RIGHT_ID):
        layered = render_ids(ids[None], depth[None], guide[None])
        assert np.abs(coverage_of(name, layered) - coverage_of(name, flat)).mean() < 0.01


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            lambda ids, guide: (ids[0], guide),
            "guide must have the rows and columns of ids, and as many layers",
        ),
        (
            lambda ids, guide: (ids, guide[0]),
            "guide must have the rows and columns of ids, and as many layers",
        ),
        (
            lambda ids, guide: (ids[:2], guide),
            "guide must have the rows and columns of ids, and as many layers",
        ),
        (lambda ids, guide: (ids[..., :3], guide), r"or \(L, H, W, 2 R\) of layers"),
        (lambda ids, guide: (ids + np.float32(1), guide), "got 1.3 in rank 0 at row 0, column 0 of layer 0"),
    ],
)
def test_what_cannot_be_used_is_refused(scene, change, text):
    ids, guide, depth = scene
    ids, guide = change(ids, guide)
    with pytest.raises(ValueError, match=text):
        render_ids(ids, depth, guide)
