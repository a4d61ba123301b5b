"""What holds for every picture, lens and option."""

import os

import dofsim
import numpy as np
import pytest
from dofsim._dofsim import simd_available
from hypothesis import given
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
        assert out.dtype == color.dtype
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
