"""What both devices are given, and how closely their pictures have to agree."""

import functools

import dofsim
import numpy as np
import pytest

# Of the picture's range. Both paths compute in float32, but the GPU also has the optics in float32, and may
# fuse products into sums.
AGREEMENT = 2e-4

# The flagship adds up hundreds of views, and a ray that just grazes a cell may meet it on one device alone.
LENS_AGREEMENT = 2e-3
LENS_PSNR = 60.0

OPENINGS = [
    dofsim.Aperture(blades=6, rotation=10.0),
    dofsim.Aperture(blades=5, roundness=0.4, ratio=1.5),
    dofsim.Aperture(obstruction=0.5, apodization=0.6),
    dofsim.Aperture(image=np.arange(12.0).reshape(3, 4)),
]

# Every method on the GPU, with the options that change what it does.
CASES = {
    "lens": [{}, {"views": 64}, *({"aperture": opening} for opening in OPENINGS)],
    "gaussian": [{}, {"max_coc_px": 3.0}, {"max_coc_px": 12.0}],
    "poisson": [{}, {"taps": 40, "max_coc_px": 12.0}, {"leak_test": "off"}, {"bokeh": "ring"}],
    "hexagonal": [
        {},
        {"aperture": dofsim.Aperture(blades=6, rotation=17.0)},
        {"aperture": dofsim.Aperture(blades=4, rotation=45.0)},
        {"max_coc_px": 3.0},
    ],
    "levels": [{}, {"c0_px": 1.0}, {"c0_px": 3.0}, {"c0_px": 11.0}],
    "taps": [{"variant": name} for name in ("thirteen", "seven", "six", "four", "four_rings")],
    "sprites": [
        {},
        {"coc_threshold_px": 2.5, "max_coc_px": 4.0},
        {"aperture": OPENINGS[0]},
        {"aperture": dofsim.Aperture(spherical=0.7)},
        {"sprite": np.arange(12.0).reshape(3, 4)},
    ],
}
# Options in metres.
METRIC_CASES = {
    "gaussian": [{"focal_range": 2.0}],
    "taps": [{"hyperfocal_factor": 0.3}, {"hyperfocal_factor": 0.0}],
}

HEIGHT, WIDTH = 70, 151


def flatten(cases):
    return [
        pytest.param(method, options, id="-".join([method, *map(str, options.values())]))
        for method, choices in cases.items()
        for options in choices
    ]


def random_color(channels=3, size=(HEIGHT, WIDTH)):
    return np.random.default_rng(channels).random((*size, channels), dtype=np.float32)


def surfaces():
    """Behind, in and in front of the focus, with edges between them and a slope."""
    disparity = np.full((HEIGHT, WIDTH), -1.0, np.float32)
    disparity[40:, 90:] = 0.0
    disparity[20:50, 30:80] = np.linspace(0.3, 1.0, 50, dtype=np.float32)
    return random_color(), disparity


def noise():
    return random_color(), np.random.default_rng(7).uniform(-1.0, 1.0, (HEIGHT, WIDTH)).astype(np.float32)


def lamps():
    color, disparity = surfaces()
    color[::13, ::17] = 500.0
    return color, disparity


def tilted():
    return random_color(), np.broadcast_to(0.3 + 0.01 * np.arange(WIDTH, dtype=np.float32), (HEIGHT, WIDTH))


def small(height, width):
    rng = np.random.default_rng(5)
    return random_color(size=(height, width)), rng.uniform(-1.0, 1.0, (height, width)).astype(np.float32)


SCENES = {
    "surfaces": surfaces,
    "noise": noise,
    "lamps": lamps,
    "tilted": tilted,
    "1x1": functools.partial(small, 1, 1),
    "1x9": functools.partial(small, 1, 9),
    "9x1": functools.partial(small, 9, 1),
    "3x65": functools.partial(small, 3, 65),
}


def render(color, disparity, device, strength_px=6.0, focus=0.0, **options):
    lens = dofsim.Lens.from_disparity(strength_px=strength_px, focus=focus)
    return dofsim.render(color, disparity, lens, depth_kind="disparity", device=device, **options)


def assert_agree(on_gpu, on_cpu, method):
    """Assert that two pictures are the same to a share of their range."""
    assert on_gpu.shape == on_cpu.shape
    assert on_gpu.dtype == on_cpu.dtype
    assert np.isfinite(on_gpu).all()
    apart = np.abs(on_gpu.astype(np.float64) - on_cpu) / (float(np.ptp(on_cpu)) or 1.0)
    assert apart.max() <= (LENS_AGREEMENT if method == "lens" else AGREEMENT)
    if method == "lens" and apart.any():
        assert -10.0 * np.log10(np.mean(apart**2)) >= LENS_PSNR


# What lenses do beyond a thin one, and what makes the same of each method's picture on both devices.
FLAWS = {
    "tilt": {"tilt": (10.0, -20.0)},
    "field_curvature": {"field_curvature": 0.3},
    "axial_color": {"axial_color": (0.03, 0.0, -0.02)},
    "lateral_color": {"lateral_color": (0.01, 0.0, -0.02)},
    "breathing": {"sensor_mm": 36.0, "breathing_focal_length_mm": 50.0},
    "natural": {"vignetting": "natural"},
    "principal_point": {"principal_point": (0.1, -0.2), "vignetting": "natural", "tilt": (5.0, 5.0)},
    "all": {
        "tilt": (5.0, 10.0),
        "axial_color": (-0.02, 0.0, 0.04),
        "lateral_color": (0.004, 0.0, -0.003),
        "vignetting": "natural",
    },
}
# And those that only the flagship honours.
CLIPPED = {
    "cat_eye": {"cat_eye": 0.7},
    "optical": {"cat_eye": 1.0, "vignetting": "optical"},
    "full": {"cat_eye": 0.5, "vignetting": "full", "tilt": (8.0, 0.0)},
}


def metric_scene(channels=3):
    """Surfaces of several depths with edges and slopes between them, and lamps."""
    depth = np.full((HEIGHT, WIDTH), 6.0, np.float32)
    depth[40:, 90:] = 3.0
    depth[20:50, 30:80] = np.linspace(1.5, 2.5, 50, dtype=np.float32)
    depth[:6, :] = np.inf
    color = random_color(channels)
    color[::13, ::17] = 40.0
    if channels == 4:
        color[..., 3] = random_color(1)[..., 0]
        color[..., :3] *= color[..., 3:]
    return color, depth


def through(flaw, device, method, channels=3, **options):
    lens = dofsim.Lens(aperture_radius=0.08, focus_distance=3.0, fov=40.0, **flaw)
    return dofsim.render(*metric_scene(channels), lens, device=device, method=method, **options)
