"""dofsim against lenses that Mitsuba has only by adding up pinhole views: polygons and tilted focus planes.

The references are kept under build/scenes/, as they take a minute each; see `scenes.views`.
"""

import hashlib
import inspect
from functools import cache
from pathlib import Path

import numpy as np
import pytest

mi = pytest.importorskip("mitsuba", reason="Mitsuba 3 is the reference: pip install mitsuba")

import dofsim  # noqa: E402
from dofsim.metrics import psnr  # noqa: E402
from oracle import openings  # noqa: E402
from scenes import camera, spheres, views  # noqa: E402
from scenes.capture import Capture  # noqa: E402
from scenes.variant import choose_variant  # noqa: E402

WIDTH, HEIGHT, BORDER_PX = 256, 192, 24
VIEWS = 256
SUPERSAMPLE = 3
KEPT = Path(__file__).parent.parent / "build" / "scenes"

CAMERA = camera.Camera(aperture_radius=0.12)
DISC = openings.disc

# Every lens with its opening, its tilt in degrees, and what of dofsim's it is.
LENSES = {
    "disc": (DISC, (0.0, 0.0), dofsim.Aperture()),
    "triangle": (openings.polygon(3, 20.0), (0.0, 0.0), dofsim.Aperture(blades=3, rotation=20.0)),
    "hexagon": (openings.polygon(6, 10.0), (0.0, 0.0), dofsim.Aperture(blades=6, rotation=10.0)),
    "leaning back": (DISC, (30.0, 0.0), dofsim.Aperture()),
    "leaning": (DISC, (20.0, -20.0), dofsim.Aperture()),
}
# How much worse than the disc's a picture may be, in dB: each shows other places sharp, which differ so much.
MARGIN_DB = 1.5


def source() -> str:
    """Tell apart what references are made from."""
    texts = [inspect.getsource(module) for module in (camera, spheres, views, openings)]
    return hashlib.sha256("".join([*texts, repr(CAMERA)]).encode()).hexdigest()[:12]


@cache
def capture() -> Capture:
    choose_variant("scalar_rgb")
    return Capture(spheres.shapes(), CAMERA)


def kept(name, make):
    path = KEPT / f"views_{name.replace(' ', '_')}_{WIDTH}x{HEIGHT}_{source()}.npz"
    if not path.is_file():
        arrays = make()
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, **arrays)
    with np.load(path) as arrays:
        return dict(arrays)


@cache
def picture():
    def make():
        size = SUPERSAMPLE * WIDTH, SUPERSAMPLE * HEIGHT
        color, depth = capture().peel(*size, layers=4)
        return {"pinhole": capture().pinhole(WIDTH, HEIGHT, 64), "color": color, "depth": depth}

    return kept("picture", make)


@cache
def reference(name):
    inside, tilt, _ = LENSES[name]
    points = openings.lens_points(inside, VIEWS)

    def make():
        return {"reference": views.add_up(capture().scene, CAMERA, points, WIDTH, HEIGHT, tilt, spp=1)}

    return kept(name, make)["reference"]


@cache
def distance_db(name, layers):
    """PSNR of dofsim's picture to the reference of the lens."""
    _, tilt, aperture = LENSES[name]
    lens = dofsim.Lens(**CAMERA.settings(), tilt=tilt)
    shot = picture()
    if layers:
        out = dofsim.render(shot["color"], shot["depth"], lens, supersample=SUPERSAMPLE, aperture=aperture)
    else:
        middle = slice(SUPERSAMPLE // 2, None, SUPERSAMPLE)
        out = dofsim.render(shot["pinhole"], shot["depth"][0, middle, middle], lens, aperture=aperture)
    return psnr(out[..., :3], reference(name), border=BORDER_PX)


@pytest.mark.parametrize("layers", [False, True], ids=["one layer", "four layers"])
@pytest.mark.parametrize("name", [name for name in LENSES if name != "disc"])
def test_other_lenses_are_as_close_as_the_disc(name, layers):
    assert distance_db(name, layers) > distance_db("disc", layers) - MARGIN_DB


def test_the_views_of_a_disc_are_the_thin_lens():
    shot = kept("thin lens", lambda: {"picture": capture().thin_lens(WIDTH, HEIGHT, 128)})
    assert psnr(shot["picture"], reference("disc"), border=BORDER_PX) > 40.0


@pytest.mark.parametrize("name", [name for name in LENSES if name != "disc"])
def test_another_lens_is_another_picture(name):
    shot = picture()
    out = dofsim.render(
        shot["color"], shot["depth"], dofsim.Lens(**CAMERA.settings()), supersample=SUPERSAMPLE
    )
    assert psnr(out[..., :3], reference(name), border=BORDER_PX) < distance_db(name, True) - 2.0
