"""The laws that hold on the CPU, on a device; and that both agree."""

import dofsim
import numpy as np
from both_devices import AGREEMENT, LENS_AGREEMENT
from hypothesis import given, settings
from hypothesis import strategies as st

from properties.conftest import CASES
from properties.strategies import Call, calls, plain_calls
from properties.test_laws import REFUSALS

# A software rasteriser translates the shaders of every method and of many of their options.
few = settings(max_examples=max(1, CASES // 5))


@few
@given(calls())
def test_every_call_gives_a_finite_picture_or_says_why_not(gpu, call: Call):
    try:
        out = call.render(device=gpu)
    except REFUSALS:
        return
    assert np.isfinite(out).all()
    assert out.dtype == call.color.dtype.newbyteorder("=")
    assert out.shape == call.render(device="cpu").shape


@few
@given(plain_calls(looks=["random"]))
def test_both_devices_agree(gpu, call: Call):
    apart = np.abs(call.render(device=gpu) - call.render(device="cpu"))
    most = LENS_AGREEMENT if call.options["method"] == "lens" else AGREEMENT
    assert apart.max() <= most * np.abs(call.color).max()


@few
@given(plain_calls(looks=["constant"]))
def test_an_even_picture_stays_even(gpu, call: Call):
    np.testing.assert_allclose(call.render(device=gpu), call.color, rtol=2e-4, atol=1e-30)


@few
@given(plain_calls(looks=["random", "lamps", "black"]))
def test_no_light_is_negative(gpu, call: Call):
    assert call.render(device=gpu).min() >= 0


@few
@given(plain_calls())
def test_a_pinhole_keeps_every_bit(gpu, call: Call):
    for in_metres in ("focal_range", "hyperfocal_factor"):
        call.options.pop(in_metres, None)
    pinhole = call.lens.replace(aperture_radius=0.0)
    np.testing.assert_array_equal(call.render(lens=pinhole, device=gpu), call.color)


@few
@given(plain_calls())
def test_a_scene_renders_what_the_function_does(gpu, call: Call):
    scene = dofsim.Scene(call.color, call.depth, device=gpu)
    expected = call.render(device=gpu)
    for _ in range(2):
        np.testing.assert_array_equal(scene.render(call.lens, **call.options), expected)


@few
@given(plain_calls())
def test_the_layout_in_memory_changes_no_bit(gpu, call: Call):
    color, depth = (np.array(array, np.float32, order="C") for array in (call.color, call.depth))
    there = call.render(device=gpu)
    np.testing.assert_array_equal(there, call.render(color=color, depth=depth, device=gpu))


@few
@given(plain_calls(), st.integers(0, 80))
def test_out_may_overlap_the_picture(gpu, call: Call, offset):
    expected = call.render(device=gpu)
    memory = np.zeros(call.color.size + offset, np.float32)
    color, out = (memory[first:][: call.color.size].reshape(call.color.shape) for first in (0, offset))
    color[...] = call.color
    call.render(color=color, out=out, device=gpu)
    np.testing.assert_array_equal(out, expected)
