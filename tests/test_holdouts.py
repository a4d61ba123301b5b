"""Laws of holdouts: what blocks the light of a picture and is not seen itself."""

import dofsim
import numpy as np
import pytest
from both_devices import assert_agree
from dofsim import io
from dofsim.cli import run
from test_io_deep import deep_scanlines

HEIGHT, WIDTH = 96, 160
X, Y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
WALL, MIDDLE, NEAR, NEARER = -1.0, 0.0, 1.0, 1.5


def lens(strength_px=9.0, focus=0.0, **words):
    return dofsim.Lens.from_disparity(strength_px=strength_px, focus=focus).replace(**words)


def render(color, depth, holdout=None, *, through=None, **options):
    options = {"depth_kind": "disparity", "device": "cpu", **options}
    return dofsim.render(color, np.float32(depth), through or lens(), holdout=holdout, **options)


def everywhere(value):
    return np.full((HEIGHT, WIDTH), value, np.float32)


def disc(x, y, radius):
    """Give the coverage of a disc with a soft edge."""
    return np.clip(radius + 0.5 - np.hypot(X - x, Y - y), 0, 1).astype(np.float32)


def rgba(color, alpha=1.0):
    """Give a premultiplied picture of this colour and coverage."""
    alpha = np.broadcast_to(np.float32(alpha), (HEIGHT, WIDTH))
    return np.dstack([np.float32(color) * alpha[..., None], alpha]).astype(np.float32)


def texture(seed=1, lamps=0):
    rng = np.random.default_rng(seed)
    color = (0.2 + 0.6 * rng.random((HEIGHT, WIDTH, 3))).astype(np.float32)
    for x, y in zip(rng.integers(8, WIDTH - 8, lamps), rng.integers(8, HEIGHT - 8, lamps), strict=True):
        color[y, x] = 300.0
    return color


def one_layer(lamps=0):
    """Give a picture of a disc before a wall, and its depth."""
    front = disc(60, 50, 22)
    color = texture(1, lamps) * (1 - front[..., None]) + np.float32([0.9, 0.3, 0.1]) * front[..., None]
    return rgba(color), np.where(front >= 0.5, np.float32(NEAR), np.float32(WALL))


def two_layers(lamps=0):
    """Give the same disc as a layer before a whole wall."""
    layers = np.stack([rgba(np.float32([0.9, 0.3, 0.1]), disc(60, 50, 22)), rgba(texture(1, lamps))])
    return layers, np.stack([everywhere(NEAR), everywhere(WALL)])


@pytest.fixture(params=["cpu", "gpu"])
def device(request):
    return "cpu" if request.param == "cpu" else request.getfixturevalue("gpu")


PICTURES = [pytest.param(one_layer, id="one"), pytest.param(two_layers, id="two")]


@pytest.mark.parametrize("picture", PICTURES)
def test_what_covers_nothing_changes_no_bit(picture):
    color, depth = picture(lamps=6)
    nothing = (everywhere(0.0), everywhere(np.nan))
    assert np.array_equal(render(color, depth, nothing), render(color, depth))


@pytest.mark.parametrize("picture", PICTURES)
def test_what_is_behind_everything_changes_no_bit(picture):
    color, depth = picture(lamps=6)
    behind = (disc(60, 60, 30), everywhere(WALL - 0.5))
    assert np.array_equal(render(color, depth, behind), render(color, depth))


@pytest.mark.parametrize("strength_px", [0.0, 0.4, 9.0, 60.0])
@pytest.mark.parametrize("picture", PICTURES)
def test_what_covers_everything_leaves_an_empty_picture(picture, strength_px):
    color, depth = picture(lamps=6)
    cover = (everywhere(1.0), everywhere(NEARER))
    out = render(color, depth, cover, through=lens(strength_px))
    assert not out.any()
    out = render(color[..., :3], depth, cover, through=lens(strength_px)) if color.ndim == 3 else out
    assert not out.any()


def test_half_of_the_light_passes_what_is_half_there():
    color, depth = one_layer()
    color[..., :3] = 0.5
    half = render(color, depth, (everywhere(0.5), everywhere(NEARER)))
    assert np.abs(half - 0.5 * render(color, depth)).max() < 2e-3


@pytest.mark.parametrize("picture", PICTURES)
def test_edges_in_focus_are_those_of_the_matte(picture):
    color, depth = picture()
    matte = disc(90, 40, 20)
    depth = np.full_like(depth, MIDDLE)
    out = render(color, depth, (matte, everywhere(MIDDLE)))
    sharp = render(color, depth)
    whole = (matte == 0) | (matte == 1)
    assert np.array_equal(out[whole], np.where((matte == 0)[..., None], sharp, 0.0)[whole])
    assert np.abs(out - (1 - matte[..., None]) * sharp).max() < 1e-6


def test_a_holdout_in_focus_is_sharp_before_what_is_blurred():
    color, depth = rgba(texture()), everywhere(WALL)
    matte = np.float32((X > 50) & (X < 90))
    out = render(color, depth, (matte, everywhere(MIDDLE)))
    bare = render(color, depth)
    # The rays of a pixel in focus start anywhere within it.
    assert not out[:, 52:89].any()
    assert np.abs(out - bare)[:, :49].max() < 3e-2
    assert np.abs(out - bare)[:, 92:].max() < 3e-2
    assert (out[:, 49, 3] > 0.95).all()
    assert (out[:, 91, 3] > 0.95).all()


@pytest.mark.parametrize("shift", [0.3, 1.0])
def test_it_blocks_as_a_black_surface_does(shift):
    """The light that arrives is what a black layer of the same coverage leaves."""
    layers, depth = two_layers()
    matte, before = disc(96, 44, 25), everywhere(WALL + shift)
    black = np.concatenate([layers[:1], rgba(np.zeros(3), matte)[None], layers[1:]])
    expected = render(black, np.stack([depth[0], before, depth[1]]))
    out = render(layers, depth, (matte, before))
    assert np.abs(out[..., :3] - expected[..., :3]).max() < 3e-3
    assert out[..., 3].min() < 0.05


def accumulated(layers, radius_px):
    """Add up what each of many lens points sees, in f64: layers at a constant blur, moved by whole pixels.

    ``layers`` are near to far: radius in pixels, premultiplied colour and coverage, and whether it is seen.
    """
    steps = np.arange(-radius_px, radius_px + 1) / radius_px
    points = [(x, y) for y in steps for x in steps if x * x + y * y <= 1]
    total = 0.0
    for x, y in points:
        left, seen = 1.0, 0.0
        for radius, picture, is_seen in layers:
            moved = np.roll(picture.astype(np.float64), (round(y * radius), round(x * radius)), (0, 1))
            seen = seen + left * moved * is_seen
            left = left * (1 - moved[..., 3:])
        total = total + seen
    return total / len(points)


@pytest.mark.parametrize(("before", "focus"), [(1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (-0.5, -0.5)])
def test_it_is_what_an_accumulation_buffer_sees(before, focus):
    """An oracle that knows nothing of layers, samples or edges: one picture for each point of the lens."""
    radius = 12
    ball, matte = disc(100, 50, 18), disc(70, 45, 24)
    picture = rgba(np.float32([0.9, 0.3, 0.1]), ball)
    wall = rgba(0.5 + 0.3 * np.float32(np.sin(X / 9) * np.cos(Y / 7))[..., None] * np.ones(3, np.float32))
    layers, depths = np.stack([picture, wall]), np.stack([everywhere(0.5), everywhere(WALL)])
    out = render(layers, depths, (matte, everywhere(before)), through=lens(radius, focus), views=2048)
    surfaces = [(0.5, picture, 1), (WALL, wall, 1), (before, rgba(np.zeros(3), matte), 0)]
    surfaces.sort(key=lambda surface: -surface[0])
    expected = accumulated([(radius * (d - focus), *rest) for d, *rest in surfaces], radius)
    # Whole pixels are moved here, and the frame is repeated rather than mirrored.
    inside = np.s_[2 * radius : -2 * radius, 2 * radius : -2 * radius]
    assert np.abs(out - expected)[inside].max() < 0.06
    assert np.sqrt(np.mean((out - expected)[inside] ** 2)) < 6e-3


@pytest.mark.parametrize("lamps", [0, 5])
def test_pictures_that_hold_each_other_out_add_up_to_the_whole(lamps):
    """What compositors join with plus: each of two renders is held out by the other."""
    first, second = rgba(np.float32([0.9, 0.3, 0.1]), disc(70, 50, 24)), rgba(texture(2, lamps))
    near, far = everywhere(NEAR), everywhere(WALL)
    layers, depths = np.stack([first, second]), np.stack([near, far])
    whole = render(layers, depths)
    nothing = np.zeros_like(first)
    # Two layers, so that nothing is unmixed or filled in either.
    of_first = render(np.stack([first, nothing]), depths, (second[..., 3], far))
    of_second = render(np.stack([nothing, second]), depths, (first[..., 3], near))
    scale = max(1.0, float(whole.max()))
    assert np.abs(of_first + of_second - whole).max() < 4e-3 * scale
    assert np.abs(of_first - whole).max() > 0.3
    assert np.abs((of_first + of_second)[..., 3] - 1).max() < 2e-3


def test_coverage_is_what_is_seen_and_not_held_out():
    """A white picture has its coverage for light, whatever the lens does."""
    color, depth = one_layer()
    color[..., :3] = 1.0
    out = render(color, depth, (disc(80, 50, 30), everywhere(NEARER)))
    assert np.abs(out[..., :3] - out[..., 3:]).max() < 1e-5
    assert out[..., 3].min() < 0.02
    assert out[..., 3].max() == 1.0


def test_the_order_of_layers_does_not_matter():
    color, depth = one_layer(lamps=4)
    alphas = np.stack([disc(50, 40, 20), disc(70, 55, 25), disc(110, 50, 15)])
    depths = np.stack([everywhere(NEARER), everywhere(0.2), everywhere(-0.6)])
    out = render(color, depth, (alphas, depths))
    assert np.array_equal(render(color, depth, (alphas[::-1], depths[::-1])), out)


def test_twice_the_light_is_twice_the_picture():
    color, depth = one_layer(lamps=5)
    holdout = (disc(70, 50, 25), everywhere(0.5))
    doubled = color * np.float32([2, 2, 2, 1])
    out, twice = render(color, depth, holdout), render(doubled, depth, holdout)
    assert np.array_equal(twice[..., :3], 2 * out[..., :3])
    assert np.array_equal(twice[..., 3], out[..., 3])


@pytest.mark.parametrize("shift", [0.0, 0.02, 0.1])
def test_lamps_close_behind_a_holdout_are_hidden(shift, device):
    """A holdout is no part of the surface that a lamp lies on, however close it is."""
    lamps = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    lamps[48, 40:120:16] = [500.0, 500.0, 500.0, 1.0]
    layers = np.stack([lamps, rgba(0.1 * np.ones(3, np.float32))])
    depths = np.stack([everywhere(NEAR), everywhere(WALL)])
    assert render(layers, depths, device=device)[..., 0].max() > 1.0
    cover = (everywhere(1.0), everywhere(NEAR + shift))
    assert render(layers, depths, cover, device=device).max() < 1e-5


@pytest.mark.parametrize("shift", [-0.02, 0.0, 0.02])
def test_a_holdout_does_not_go_on_a_surface_beside_it(shift, device):
    """What undoes the blur of drawing exchanges light along surfaces, and not with the dark of a holdout."""
    there = np.float32(X < 80)
    layers = np.stack([rgba(0.5 * np.ones(3, np.float32), there), rgba(np.zeros(3, np.float32))])
    depths = np.stack([everywhere(NEAR), everywhere(WALL)])
    out = render(layers, depths, (1 - there, everywhere(NEAR + shift)), device=device)
    # Nine pixels from the edge, all of the lens sees the surface.
    assert np.abs(out[:, :71, :3] - 0.5).max() < 1e-5
    assert out[:, 90:].max() < 1e-5


def test_what_a_holdout_hides_beside_its_edge_is_filled_behind_surfaces():
    """Behind the disc of a picture of one layer there is wall, and before that the holdout."""
    color, depth = one_layer()
    color[..., :3] = 0.5
    out = render(color, depth, (everywhere(1.0), everywhere(0.0)))
    # The disc is before the holdout and all that is seen, as soft as it is without.
    alone = render(
        rgba(np.full(3, 0.5), depth > 0)[None].repeat(2, 0) * [[[[1]]], [[[0]]]], np.stack([depth] * 2)
    )
    assert np.abs(out - alone).max() < 0.08
    assert np.abs(out - alone).mean() < 2e-3
    assert (out[..., 3] == 0).any()
    assert out[50, 60, 3] == 1.0


def test_a_range_in_focus_has_sharp_holdouts():
    color, depth = one_layer()
    matte = np.float32(X > 80)
    words = {"in_focus": (2.0, -2.0)}
    out = render(color, depth, (matte, everywhere(NEARER)), **words)
    assert np.array_equal(out, np.where(matte[..., None] > 0, np.float32(0), render(color, depth, **words)))


def test_the_grid_is_that_of_the_picture():
    color, depth = one_layer()
    holdout = (disc(70, 50, 25), everywhere(0.5))
    fine = tuple(np.kron(v, np.ones((2, 2), np.float32)) for v in holdout)
    doubled = np.kron(color, np.ones((2, 2, 1), np.float32)), np.kron(depth, np.ones((2, 2), np.float32))
    coarse = render(color, depth, holdout)
    assert np.abs(render(*doubled, fine, supersample=2) - coarse).mean() < 0.02
    assert render(color, depth, holdout, overscan=8).shape == (HEIGHT - 16, WIDTH - 16, 4)


def test_a_scene_keeps_its_holdouts():
    color, depth = one_layer()
    holdout = (disc(70, 50, 25), everywhere(0.5))
    scene = dofsim.Scene(color, np.float32(depth), holdout=holdout, depth_kind="disparity", device="cpu")
    assert np.array_equal(scene.render(lens()), render(color, depth, holdout))
    stack = scene.focal_stack(lens(), [0.0, 0.5])
    assert np.array_equal(stack[1], render(color, depth, holdout, through=lens(focus=0.5)))


def test_threads_do_not_change_a_bit():
    color, depth = two_layers(lamps=4)
    holdout = (
        np.stack([disc(70, 50, 25), 0.4 * disc(30, 40, 30)]),
        np.stack([everywhere(0.5), everywhere(1.2)]),
    )
    outs = [render(color, depth, holdout, threads=threads) for threads in (1, 3)]
    assert np.array_equal(*outs)


DEVICE_CASES = {
    "before": (disc(80, 50, 26), everywhere(NEARER)),
    "between": (disc(80, 50, 26), everywhere(0.2)),
    "glass": (0.4 * disc(80, 50, 26), everywhere(0.5)),
    "two": (np.stack([disc(40, 40, 20), disc(90, 50, 20)]), np.stack([everywhere(0.2), everywhere(NEARER)])),
    "close": (np.float32(X > 70), everywhere(WALL + 0.01)),
    "slope": (np.float32(X > 70), np.float32(-0.8 + 0.01 * X)),
}
DEVICE_LENSES = {
    "plain": {},
    "sharp": {"strength_px": 0.02},
    "little": {"strength_px": 0.7},
    "near": {"focus": NEAR},
    "axial": {"axial_color": (0.03, 0.0, -0.02)},
}


@pytest.mark.parametrize("name", DEVICE_CASES)
@pytest.mark.parametrize("picture", PICTURES)
def test_both_devices_agree(gpu, picture, name):
    color, depth = picture(lamps=6)
    for words in DEVICE_LENSES.values():
        outs = [
            render(color, depth, DEVICE_CASES[name], through=lens(**words), device=device)
            for device in (gpu, "cpu")
        ]
        assert_agree(*outs, "lens")


ERRORS = {
    "no pair": (everywhere(1.0), TypeError, r"holdout must be a pair \(alpha, depth\) of arrays; got"),
    "three": ((everywhere(1.0),) * 3, TypeError, r"holdout must be a pair \(alpha, depth\) of arrays; got"),
    "alpha": (
        (everywhere(1.5), everywhere(1.0)),
        ValueError,
        "alpha of holdout must be from 0 to 1; got 1.5 at row 0",
    ),
    "nan": (
        (everywhere(np.nan), everywhere(1.0)),
        ValueError,
        "alpha of holdout must be from 0 to 1; got NaN",
    ),
    "size": (
        (everywhere(1.0)[1:], everywhere(1.0)),
        ValueError,
        "alpha of holdout must have the rows and columns of color, 96 x 160, .*; got 95 x 160 in 1 layers",
    ),
    "layers": (
        (everywhere(1.0), np.stack([everywhere(1.0)] * 2)),
        ValueError,
        "depth of holdout must have .* as many layers; got 96 x 160 in 2 layers",
    ),
    "depth": (
        (everywhere(1.0), everywhere(np.nan)),
        ValueError,
        "depth of holdout has 15360 of 15360 values that are not",
    ),
    "list": (([[1.0]], [[1.0]]), TypeError, "alpha of holdout must be a NumPy array"),
    "near": (
        (everywhere(1.0), everywhere(1e6)),
        ValueError,
        "depth of holdout has 15360 of 15360 values that are too near for this lens",
    ),
}


@pytest.mark.parametrize("name", ERRORS)
def test_what_cannot_be_used_is_named(name):
    holdout, error, text = ERRORS[name]
    color, depth = one_layer()
    with pytest.raises(error, match=text):
        render(color, depth, holdout)


def test_what_goes_not_with_a_holdout_is_refused_by_name():
    color, depth = one_layer()
    holdout = (everywhere(1.0), everywhere(1.0))
    with pytest.raises(ValueError, match='holdout is for method="lens"; got method="poisson"'):
        render(color, depth, holdout, method="poisson")
    with pytest.raises(
        ValueError, match=r'depth_kind="relative" .* cannot be used with holdout; pass depth_range'
    ):
        render(color, depth, holdout, depth_kind="relative")


# The command line

LENS_OPTIONS = ["--aperture-radius", "0.05", "--focus-distance", "2", "--fov", "40", "--device", "cpu", "-q"]


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Write a picture, and a holdout before a part of it."""
    monkeypatch.chdir(tmp_path)
    color, metres = rgba(texture()), everywhere(4.0)
    matte, before = disc(80, 50, 30), np.where(disc(80, 50, 31) > 0, np.float32(3.0), np.inf)
    io.write_image("picture.exr", color, depth=metres, dtype="float")
    io.write_image("set.exr", rgba(np.float32([1, 0, 0]), matte), depth=before, dtype="float")
    return color, metres, (matte, before)


def test_a_file_holds_a_picture_out(files):
    color, metres, holdout = files
    assert run(["render", "picture.exr", "-o", "out.exr", "--holdout", "set.exr", *LENS_OPTIONS]) == 0
    through = dofsim.Lens(aperture_radius=0.05, focus_distance=2, fov=40)
    expected = dofsim.render(color, metres, through, holdout=holdout, device="cpu")
    assert np.abs(io.read_color("out.exr").pixels - expected).max() < 2e-3
    assert expected[..., 3].min() == 0


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (
            ["--holdout", "opaque.exr"],
            "opaque.exr: a holdout needs alpha, and the picture in this file has none",
        ),
        (["--holdout", "small.exr"], "small.exr: a holdout must have the pixels of the picture, 160 x 96"),
        (["--holdout", "none.exr"], "none.exr: No such file"),
        (["--holdout", "set.exr", "--method", "taps"], "holdout is for --method lens; got --method taps"),
        (["--holdout", "out.exr"], "out.exr"),
    ],
)
def test_files_that_hold_nothing_out_are_named(files, capsys, options, text):
    color, metres, _ = files
    io.write_image("opaque.exr", color[..., :3], depth=metres)
    io.write_image("small.exr", color[2:], depth=metres[2:])
    assert run(["render", "picture.exr", "-o", "out.exr", *options, *LENS_OPTIONS]) == 2
    err = capsys.readouterr().err
    assert err.startswith("dofsim: ")
    assert text in err


@pytest.mark.usefixtures("files")
def test_deep_samples_hold_out(tmp_path):
    """The samples of a deep file are as many holdouts as there are layers."""
    counts = np.full((HEIGHT, WIDTH), 2)
    samples = np.empty(counts.shape, object)
    for at in np.ndindex(counts.shape):
        samples[at] = np.float32([0.5, 0.5])
    pixels = dict.fromkeys("RGBA", samples)
    depths = samples.copy()
    for at in np.ndindex(counts.shape):
        depths[at] = np.float32([1.0, 3.0])
    (tmp_path / "deep.exr").write_bytes(deep_scanlines({**pixels, "Z": depths}))
    assert run(["render", "picture.exr", "-o", "out.exr", "--holdout", "deep.exr", *LENS_OPTIONS]) == 0
    out = io.read_color("out.exr").pixels
    assert np.abs(out[20:-20, 20:-20, 3] - 0.25).max() < 5e-3
