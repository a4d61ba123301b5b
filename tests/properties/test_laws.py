"""What holds for every picture, lens and option."""

import os
from dataclasses import replace

import dofsim
import numpy as np
import pytest
from dofsim._dofsim import simd_available
from hypothesis import assume, given
from hypothesis import strategies as st

from properties.strategies import Call, calls, depths, lenses, plain_calls, shapes

REFUSALS = (ValueError, TypeError, dofsim.DeviceError)


@given(calls())
def test_every_call_gives_a_finite_picture_or_says_why_not(call: Call):
    color, depth = call.color.copy(), call.depth.copy()
    try:
        out = call.render()
    except REFUSALS:
        out = None
    np.testing.assert_array_equal(call.color, color)
    np.testing.assert_array_equal(call.depth, depth)
    if out is not None:
        assert out.dtype == color.dtype.newbyteorder("=")
        assert np.isfinite(out).all()
        scale, margin = call.options["supersample"], call.options["overscan"]
        expected = tuple(n // scale - 2 * margin for n in color.shape[:2]) + color.shape[2:]
        assert out.shape == expected


@given(plain_calls(), st.sampled_from([2.0**-20, 0.5, 2.0, 2.0**40, 2.0**100]))
def test_twice_the_light_is_twice_the_picture(call: Call, factor):
    factor = np.float32(factor)
    np.testing.assert_array_equal(call.render(color=factor * call.color), factor * call.render())


@given(plain_calls(looks=["constant"]))
def test_an_even_picture_stays_even(call: Call):
    np.testing.assert_allclose(call.render(), call.color, rtol=2e-5, atol=1e-30)


@given(plain_calls(looks=["random", "lamps", "black"]))
def test_no_light_is_negative(call: Call):
    assert call.render().min() >= 0


@given(plain_calls())
def test_what_is_in_focus_stays(call: Call):
    flat = np.full_like(call.depth, np.float32(call.lens.focus_distance))
    lens = call.lens.replace(focus_distance=float(flat.flat[0]))
    # Disparity is rounded to single precision, 6e-8 of itself, at up to 12 m; blur may grow within 0.1 m.
    # The flagship takes so little for none.
    atol = 0 if call.options["method"] == "lens" else 1e-5 * np.abs(call.color).max()
    np.testing.assert_allclose(call.render(depth=flat, lens=lens), call.color, rtol=0, atol=atol)


@given(plain_calls())
def test_a_pinhole_keeps_every_bit(call: Call):
    lens = call.lens.replace(aperture_radius=0.0)
    if call.options["method"] == "gaussian" and "focal_range" in call.options:
        del call.options["focal_range"]
    if call.options["method"] == "taps" and "hyperfocal_factor" in call.options:
        del call.options["hyperfocal_factor"]
    np.testing.assert_array_equal(call.render(lens=lens), call.color)


@given(plain_calls(), st.integers(1, 5))
def test_threads_change_no_bit(call: Call, threads):
    np.testing.assert_array_equal(call.render(threads=1), call.render(threads=threads))


@pytest.mark.skipif(len(simd_available()) < 2, reason="this processor has one instruction set")
@given(plain_calls())
def test_instruction_sets_change_no_bit(call: Call):
    pictures = []
    for name in simd_available():
        os.environ["DOFSIM_SIMD"] = name
        try:
            pictures.append(call.render())
        finally:
            del os.environ["DOFSIM_SIMD"]
    for picture in pictures[1:]:
        np.testing.assert_array_equal(picture, pictures[0])


@given(plain_calls())
def test_a_scene_renders_what_the_function_does(call: Call):
    scene = dofsim.Scene(call.color, call.depth)
    expected = call.render()
    for _ in range(2):
        np.testing.assert_array_equal(scene.render(call.lens, **call.options), expected)
    stack = scene.focal_stack(call.lens, [1.5, call.lens.focus_distance], **call.options)
    np.testing.assert_array_equal(stack[1], expected)


@given(plain_calls())
def test_nothing_beside_out_is_written(call: Call):
    around = np.full((call.color.shape[0] + 2, *call.color.shape[1:]), -7, np.float32)
    call.render(out=around[1:-1])
    assert (around[[0, -1]] == -7).all()
    np.testing.assert_array_equal(around[1:-1], call.render())


@given(plain_calls())
def test_the_layout_in_memory_changes_no_bit(call: Call):
    color, depth = (np.array(array, np.float32, order="C") for array in (call.color, call.depth))
    np.testing.assert_array_equal(call.render(), call.render(color=color, depth=depth))


@given(plain_calls(), st.integers(0, 80))
def test_out_may_overlap_the_picture(call: Call, offset):
    expected = call.render()
    memory = np.zeros(call.color.size + offset, np.float32)
    color, out = (memory[first:][: call.color.size].reshape(call.color.shape) for first in (0, offset))
    color[...] = call.color
    call.render(color=color, out=out)
    np.testing.assert_array_equal(out, expected)


@given(shapes().flatmap(lambda shape: depths(shape)), lenses(plain=True), st.floats(1, 10))
def test_a_wider_opening_blurs_no_less(depth, lens, factor):
    wider = lens.replace(aperture_radius=factor * lens.aperture_radius)
    narrow, wide = (np.abs(dofsim.coc(depth, each)) for each in (lens, wider))
    assert (wide >= narrow * (1 - 1e-6)).all()
    np.testing.assert_allclose(wide, factor * narrow, rtol=1e-4, atol=1e-30)


@given(plain_calls(looks=["random"]), st.permutations(range(3)))
def test_colours_do_not_know_their_names(call: Call, order):
    color = np.repeat(call.color[..., None] if call.color.ndim == 2 else call.color[..., :1], 3, -1)
    color = color * np.float32([1.0, 0.5, 0.25])
    there = call.render(color=color)[..., order]
    back = call.render(color=np.ascontiguousarray(color[..., order]))
    np.testing.assert_allclose(there, back, rtol=1e-4, atol=1e-5)


def flat(call: Call):
    """Put all of the picture at one depth."""
    return replace(call, depth=np.full_like(call.depth, call.depth.flat[0]))


def is_separate(call: Call):
    """Whether no pixel is taken apart into surfaces by its colour, as the flagship does at edges."""
    return call.options["method"] != "lens"


@given(plain_calls(looks=["random", "negative"]), st.integers(0, 2**32 - 1))
def test_light_adds_up(call: Call, seed):
    call = call if is_separate(call) else flat(call)
    other = np.random.default_rng(seed).random(call.color.shape, dtype=np.float32)
    together = call.render(color=call.color + other)
    apart = call.render().astype(np.float64) + call.render(color=other)
    np.testing.assert_allclose(together, apart, rtol=0, atol=2e-5 * np.abs(together).max())


@given(plain_calls(looks=["random", "lamps", "negative"]))
def test_channels_know_nothing_of_each_other(call: Call):
    assume(call.color.ndim == 3)
    # All channels tell which cells the flagship draws apart as lamps.
    assume(is_separate(call) or np.abs(call.color).max() < 100.0)
    call = call if is_separate(call) else flat(call)
    together = call.render()
    for c in range(call.color.shape[2]):
        alone = call.render(color=np.ascontiguousarray(call.color[..., c]))
        np.testing.assert_array_equal(together[..., c], alone)


# Which methods do not know up from down and left from right, or rows from columns, of which pictures. Others
# have taps that are no mirror image of themselves, or compute at half the size, as levels do of wide blurs.
MIRRORED = {"lens": "one surface", "levels": "all", "taps": "all"}
TURNED = {"lens": "one surface", "levels": "all"}


def whole_blocks(call: Call) -> Call:
    """Repeat the picture to whole blocks: what outshines its surroundings is told by blocks of 16 pixels."""
    more = [(0, -side % 16) for side in call.depth.shape]
    color = np.pad(call.color, [*more, *[(0, 0)] * (call.color.ndim - 2)], mode="wrap")
    return replace(call, color=color, depth=np.pad(call.depth, more, mode="wrap"))


def assert_the_same_when(moved, call: Call, where):
    kind = where.get(call.options["method"])
    assume(kind is not None)
    call = whole_blocks(flat(call)) if kind == "one surface" else call
    call.options |= {"levels": {"c0_px": 4.0}, "taps": {"variant": "thirteen"}}.get(
        call.options["method"], {}
    )
    # The same pixels to the focal length, whichever way the frame is turned.
    call = replace(call, lens=call.lens.replace(fov_axis="diagonal"))
    there = call.render(
        **{name: np.ascontiguousarray(moved(getattr(call, name))) for name in ("color", "depth")}
    )
    np.testing.assert_allclose(there, moved(call.render()), rtol=0, atol=1e-5 * np.abs(call.color).max())


@given(plain_calls(), st.sampled_from([(0,), (1,), (0, 1)]))
def test_what_is_mirrored_comes_out_mirrored(call: Call, axes):
    assert_the_same_when(lambda array: np.flip(array, axes), call, MIRRORED)


@given(plain_calls())
def test_what_is_turned_comes_out_turned(call: Call):
    assert_the_same_when(np.rot90, call, TURNED)


@given(plain_calls(looks=["random", "lamps", "negative"]), st.integers(1, 2), st.integers(0, 1))
def test_what_is_moved_comes_out_moved(call: Call, by, axis):
    # Some methods compute at a power of two of the size.
    call, steps = flat(call), 8 * by
    call.options.pop("c0_px", None)
    reach = 2 * int(np.ceil(np.abs(dofsim.coc(call.depth, call.lens)).max())) + 40
    assume(reach < 80)
    if call.options["method"] == "levels":
        call.options["c0_px"] = 16.0
    ways = [(reach + 16, reach + 16), (reach + 16, reach + 16)] + [(0, 0)] * (call.color.ndim - 2)
    color = np.pad(call.color, ways)
    depth = np.full(color.shape[:2], call.depth.flat[0])
    lens = call.lens.replace(aperture_radius=call.lens.aperture_radius * call.color.shape[1] / color.shape[1])
    there = call.render(color=np.roll(color, steps, axis), depth=depth, lens=lens)
    back = np.roll(call.render(color=color, depth=depth, lens=lens), steps, axis)
    np.testing.assert_allclose(there, back, rtol=0, atol=2e-5 * np.abs(color).max())
