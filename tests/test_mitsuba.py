"""dofsim against Mitsuba's thin lens, on small pictures of the project's own scenes.

The pictures are rendered with Mitsuba's scalar variant, which needs nothing but its wheel, from fixed seeds.
The reference comes as two halves with different seeds: how far they differ tells its noise, which is taken
off before a bound is applied, so that the bounds speak of dofsim alone.
"""

import importlib
from functools import cache

import numpy as np
import pytest

mi = pytest.importorskip("mitsuba", reason="Mitsuba 3 is the reference: pip install mitsuba")

import dofsim  # noqa: E402
from dofsim.metrics import psnr  # noqa: E402
from fidelity import noiseless_psnr  # noqa: E402
from oracle.gather import gather  # noqa: E402
from scenes.around import intrinsics, poses, rim  # noqa: E402
from scenes.camera import Camera  # noqa: E402
from scenes.capture import Capture, with_means  # noqa: E402
from scenes.shapes import X_RIGHT, bitmap, glow, wall  # noqa: E402
from scenes.textures import scattered  # noqa: E402
from scenes.variant import choose_variant  # noqa: E402

choose_variant("scalar_rgb")

WIDTH, HEIGHT = 112, 84
BORDER_PX = 12
SUPERSAMPLE = 3

# Twice the aperture of the full-size scenes, so that a quarter of their width still blurs by many pixels.
CAMERA = Camera(aperture_radius=0.16)
HALF_SPP = 256

# What the "lens" method reaches without the reference's noise, in dB, less a margin of MARGIN_DB.
REACHED_DB = {
    "spheres": {"one layer": 34.4, "four layers": 42.6},
    "fence": {"one layer": 27.4, "four layers": 44.6},
    "hair": {"one layer": 28.2, "four layers": 36.0},
    "lights": {"one layer": 18.8, "four layers": 33.7},
    "plane": {"one layer": 43.9, "four layers": 41.6},
}
MARGIN_DB = 1.0


def lens_of(camera):
    return dofsim.Lens(**camera.settings())


@cache
def pictures(name):
    module = importlib.import_module(f"scenes.{name}")
    lamps = module.lamps() if hasattr(module, "lamps") else None
    capture = Capture(module.shapes(), CAMERA, lamps=lamps)
    layers_color, layers_depth = capture.peel(SUPERSAMPLE * WIDTH, SUPERSAMPLE * HEIGHT, layers=4)
    # The middle one of each pixel's three by three samples lies at its centre.
    middle = slice(SUPERSAMPLE // 2, None, SUPERSAMPLE)
    layers_depth_1x = layers_depth[:, middle, middle]
    return {
        "color": capture.pinhole(WIDTH, HEIGHT, 64),
        "depth": layers_depth_1x[0],
        "layers_color_1x": layers_color[:, middle, middle],
        "layers_depth_1x": layers_depth_1x,
        "layers_color": layers_color,
        "layers_depth": layers_depth,
        "halves": [capture.thin_lens(WIDTH, HEIGHT, HALF_SPP, seed=seed) for seed in (1, 2)],
    }


def distance_db(picture, halves):
    return noiseless_psnr(picture, halves, BORDER_PX)


@pytest.mark.parametrize("name", REACHED_DB)
def test_one_layer(name):
    shot = pictures(name)
    out = dofsim.render(shot["color"], shot["depth"], lens_of(CAMERA))
    assert distance_db(out, shot["halves"]) > REACHED_DB[name]["one layer"] - MARGIN_DB


@pytest.mark.parametrize("name", REACHED_DB)
def test_four_layers_at_three_times_the_resolution(name):
    shot = pictures(name)
    out = dofsim.render(shot["layers_color"], shot["layers_depth"], lens_of(CAMERA), supersample=SUPERSAMPLE)
    assert distance_db(out[..., :3], shot["halves"]) > REACHED_DB[name]["four layers"] - MARGIN_DB


@pytest.mark.parametrize("name", ["spheres", "fence", "hair"])
def test_a_second_layer_tells_what_one_can_only_guess(name):
    shot = pictures(name)
    color, depth = shot["layers_color_1x"][:2].copy(), np.ascontiguousarray(shot["layers_depth_1x"][:2])
    color[0] = with_means(color[0], shot["color"])
    two = dofsim.render(color, depth, lens_of(CAMERA))[..., :3]
    one = dofsim.render(shot["color"], shot["depth"], lens_of(CAMERA))
    assert distance_db(two, shot["halves"]) > distance_db(one, shot["halves"]) + 2.0


@pytest.mark.parametrize("name", ["spheres", "fence", "lights"])
def test_what_other_views_saw_is_as_good_as_layers(name):
    shot = pictures(name)
    module = importlib.import_module(f"scenes.{name}")
    lamps = module.lamps() if hasattr(module, "lamps") else None
    capture = Capture(module.shapes(), CAMERA, lamps=lamps)
    at = rim(8, CAMERA.aperture_radius)
    seen = [capture.seen_from(place, WIDTH, HEIGHT, 16, lamp_spp=64, seed=7) for place in at]
    layers, depths = dofsim.layers_from_views(
        [shot["color"], *(color for color, _ in seen)],
        [shot["depth"], *(depth for _, depth in seen)],
        poses(np.concatenate([np.zeros((1, 3)), at])),
        intrinsics(WIDTH, HEIGHT, CAMERA.fov),
        lens=lens_of(CAMERA),
    )
    views = distance_db(dofsim.render(layers, depths, lens_of(CAMERA))[..., :3], shot["halves"])
    color = shot["layers_color_1x"].copy()
    color[0] = with_means(color[0], shot["color"])
    true = dofsim.render(color, np.ascontiguousarray(shot["layers_depth_1x"]), lens_of(CAMERA))[..., :3]
    one = dofsim.render(shot["color"], shot["depth"], lens_of(CAMERA))
    assert views > distance_db(true, shot["halves"]) - 3.0
    assert views > distance_db(one, shot["halves"]) + {"lights": 0.0}.get(name, 2.0)


@pytest.mark.parametrize("name", ["spheres", "fence", "hair", "lights"])
def test_layers_beat_plain_gather_and_no_blur(name):
    shot = pictures(name)
    out = dofsim.render(shot["layers_color"], shot["layers_depth"], lens_of(CAMERA), supersample=SUPERSAMPLE)
    gathered = gather(shot["color"], dofsim.coc(shot["depth"], lens_of(CAMERA)))
    ours = distance_db(out[..., :3], shot["halves"])
    assert ours > distance_db(gathered, shot["halves"]) + 5.0
    assert ours > distance_db(shot["color"], shot["halves"]) + 10.0


# With one layer of fence or hair, what the bars hide is anybody's guess, and a blurred guess scores as well.
@pytest.mark.parametrize("name", ["spheres", "lights"])
def test_one_layer_beats_plain_gather(name):
    shot = pictures(name)
    out = dofsim.render(shot["color"], shot["depth"], lens_of(CAMERA))
    gathered = gather(shot["color"], dofsim.coc(shot["depth"], lens_of(CAMERA)))
    assert distance_db(out, shot["halves"]) > distance_db(gathered, shot["halves"]) + 1.5


def test_in_focus_both_cameras_agree():
    """A card in the focus plane looks the same through the pinhole and the lens, to a fraction of a pixel."""
    z = CAMERA.focus_distance
    card = wall(z, 2.0, 1.5, glow(bitmap(scattered(256, 3), (4.0, 3.0))))
    capture = Capture({"card": card}, CAMERA)
    pinhole, through_lens = capture.pinhole(WIDTH, HEIGHT, 256), capture.thin_lens(WIDTH, HEIGHT, 256)
    difference = through_lens - pinhole
    # To first order a shift by s changes the picture by s times its gradient.
    for axis in (0, 1):
        gradient = np.gradient(pinhole, axis=axis)
        shift_px = float(np.sum(difference * gradient) / np.sum(gradient**2))
        assert abs(shift_px) < 0.01
    assert psnr(pinhole, through_lens) > 40.0
    out = dofsim.render(pinhole, np.full((HEIGHT, WIDTH), z, np.float32), lens_of(CAMERA))
    np.testing.assert_allclose(out, pinhole, atol=1e-5)


@pytest.mark.parametrize("z", [1.8, 2.5, 3.3, 5.0, 8.0, 20.0])
@pytest.mark.parametrize(("right_px", "up_px"), [(0.0, 0.0), (34.0, 22.0)])
def test_coc_is_mitsubas(z, right_px, up_px):
    """The image of a point is a disc of `dofsim.coc`'s radius about its pinhole image, off the axis too."""
    focal_px = 0.5 * WIDTH / np.tan(np.radians(0.5 * CAMERA.fov))
    lamp_radius_px = 0.5
    right, up = right_px * z / focal_px, up_px * z / focal_px
    lamp = {
        "type": "sphere",
        "center": [X_RIGHT * right, up, z],
        "radius": lamp_radius_px * z / focal_px,
        **glow((50.0, 50.0, 50.0)),
    }
    capture = Capture({}, CAMERA, lamps={"lamp": lamp})
    image = capture.thin_lens(WIDTH, HEIGHT, spp=4, lamp_spp=16)[..., 0].astype(np.float64)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    total = image.sum()
    mean_x, mean_y = (image * x).sum() / total, (image * y).sum() / total
    assert mean_x == pytest.approx(0.5 * WIDTH + right_px, abs=0.1)
    assert mean_y == pytest.approx(0.5 * HEIGHT - up_px, abs=0.1)
    # A disc of radius r has the variance r^2 / 4 along each axis; so has the lamp's; a pixel's is 1/12.
    variance = ((image * ((x - mean_x) ** 2 + (y - mean_y) ** 2)).sum() / total) / 2.0
    radius_px = 2.0 * np.sqrt(max(variance - lamp_radius_px**2 / 4.0 - 1.0 / 12.0, 0.0))
    expected = dofsim.coc(np.full((HEIGHT, WIDTH), z, np.float32), lens_of(CAMERA))[0, 0]
    assert np.sign(expected) == np.sign(z - CAMERA.focus_distance)
    assert radius_px == pytest.approx(abs(expected), rel=0.01, abs=0.03)
