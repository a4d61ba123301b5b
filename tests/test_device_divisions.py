"""No picture hangs on the last bit of a quotient: Vulkan lets it be 2.5 units in the last place off.

Here every quotient of every shader is one rounding off, up or down.
"""

import dofsim
import numpy as np
import pytest
from both_devices import (
    CASES,
    CLIPPED,
    FLAWS,
    SCENES,
    assert_agree,
    flatten,
    metric_scene,
    random_color,
    render,
    through,
)


@pytest.fixture(params=[np.nextafter(np.float32(1), 2), np.nextafter(np.float32(1), 0)], ids=["up", "down"])
def perturbed(gpu, restricted, request):
    """Make every quotient too large, or too small, until the end of the test."""
    try:
        restricted(quotient=float(request.param))
    except ValueError as error:
        pytest.skip(str(error))
    return gpu


@pytest.mark.parametrize("name", ["surfaces", "lamps", "tilted"])
@pytest.mark.parametrize(("method", "options"), flatten(CASES))
def test_devices_agree_all_the_same(perturbed, method, options, name):
    scene = SCENES[name]()
    on_cpu = render(*scene, "cpu", method=method, **options)
    assert_agree(render(*scene, perturbed, method=method, **options), on_cpu, method)


@pytest.mark.parametrize("flaw", [*FLAWS, *CLIPPED])
def test_lenses_agree_all_the_same(perturbed, flaw):
    flaw = {**FLAWS, **CLIPPED}[flaw]
    assert_agree(through(flaw, perturbed, "lens"), through(flaw, "cpu", "lens"), "lens")


@pytest.mark.parametrize("flaw", ["breathing", "full"])
def test_channels_agree_all_the_same(perturbed, flaw):
    lens = dofsim.Lens(aperture_radius=0.08, focus_distance=3.0, fov=40.0, **{**FLAWS, **CLIPPED}[flaw])
    guide, depth = metric_scene(4)
    channels = random_color(4) + guide[..., 1:2]
    options = {"guide": guide, "kinds": ["light", "light", "matte", "data"]}
    rendered = [dofsim.render(channels, depth, lens, device=d, **options) for d in (perturbed, "cpu")]
    for c in range(4):
        assert_agree(*(one[..., c] for one in rendered), "lens")


# The look-ups of "taps" divide only where depth is infinite.
@pytest.mark.parametrize("method", [method for method in CASES if method != "taps"])
def test_quotients_that_are_far_off_are_found_out(perturbed, restricted, method):
    restricted(quotient=1.01)
    scene = SCENES["surfaces"]()
    with pytest.raises(AssertionError):
        assert_agree(render(*scene, perturbed, method=method), render(*scene, "cpu", method=method), method)


def test_a_quotient_is_a_number():
    from dofsim._dofsim import restrict_devices

    with pytest.raises(ValueError, match="quotient must be "):
        restrict_devices(quotient=float("nan"))
