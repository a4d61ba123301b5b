"""Laws of channels that a guide leads past holdouts, and of holdouts in batches."""

import dofsim
import numpy as np
import pytest
from dofsim import io
from dofsim._dofsim import simd_available
from dofsim.batch import Frame, map_frames
from dofsim.cli import run
from test_holdouts import (
    DEVICE_CASES,
    LENS_OPTIONS,
    MIDDLE,
    NEARER,
    PICTURES,
    WALL,
    X,
    Y,
    disc,
    everywhere,
    lens,
    one_layer,
    render,
    rgba,
    texture,
    two_layers,
)

HOLDOUT = (disc(80, 50, 26), everywhere(0.2))
KINDS = ["light"] * 3 + ["matte"]


def led(channels, depth, guide, holdout=None, *, kinds="light", **options):
    return render(channels, depth, holdout, guide=guide, kinds=kinds, **options)


def smooth(color):
    """Take the texture out of a picture, so that nothing limits how far its cells are sharpened."""
    color = np.array(color)
    wave = 0.5 + 0.1 * np.sin(X / 9) * np.cos(Y / 7)
    color[..., :3] = (wave[..., None] * np.float32([1.0, 0.8, 0.6])).astype(np.float32) * color[..., 3:]
    return color


@pytest.mark.parametrize("name", DEVICE_CASES)
def test_a_picture_that_leads_itself_is_the_picture(name):
    """Of one surface, nothing is taken apart: the bits are those of the picture without a guide."""
    color, depth = smooth(rgba(texture())), np.float32(-0.5 + 0.004 * X)
    holdout = DEVICE_CASES[name]
    out = led(color, depth, color, holdout, kinds=KINDS)
    # The alpha of a picture is bounded by 1, and a matte only rounded.
    out[..., 3] = np.minimum(out[..., 3], 1)
    np.testing.assert_array_equal(out, render(color, depth, holdout))


@pytest.mark.parametrize("name", DEVICE_CASES)
@pytest.mark.parametrize("picture", PICTURES)
def test_a_picture_that_leads_itself_is_nearly_its_render(picture, name):
    """Not more differs than without a holdout: single pixels of texture, edges and lamps."""
    color, depth = picture(lamps=5)
    holdout = DEVICE_CASES[name]
    off = np.abs(led(color, depth, color, holdout, kinds=KINDS) - render(color, depth, holdout))
    bare = np.abs(led(color, depth, color, kinds=KINDS) - render(color, depth))
    assert off.mean() < 1.2 * bare.mean() + 1e-4
    assert off[..., 3].mean() < 1e-3


@pytest.mark.parametrize("picture", PICTURES)
@pytest.mark.parametrize("kind", ["light", "matte", "data"])
def test_what_covers_nothing_and_what_is_behind_all_change_nothing(picture, kind):
    color, depth = picture(lamps=6)
    channels = np.random.default_rng(2).standard_normal((*depth.shape, 5), dtype=np.float32)
    plain = led(channels, depth, color, kinds=kind)
    for holdout in ((everywhere(0.0), everywhere(np.nan)), (disc(60, 60, 30), everywhere(WALL - 0.5))):
        np.testing.assert_array_equal(led(channels, depth, color, holdout, kinds=kind), plain)


@pytest.mark.parametrize("picture", PICTURES)
@pytest.mark.parametrize("strength_px", [0.0, 0.4, 9.0])
def test_what_covers_everything_leaves_nothing(picture, strength_px):
    color, depth = picture(lamps=6)
    cover = (everywhere(1.0), everywhere(NEARER))
    channels = np.ones((*depth.shape, 3), np.float32)
    out = led(channels, depth, color, cover, kinds=["light", "matte", "data"], through=lens(strength_px))
    assert not out.any()


@pytest.mark.parametrize("name", DEVICE_CASES)
@pytest.mark.parametrize("picture", PICTURES)
def test_coverage_adds_up(picture, name):
    """What of a white channel is seen past a holdout is the coverage that is."""
    color, depth = picture()
    alpha = color[..., 3]
    parts = np.stack([alpha * (X < 60), alpha * (X >= 60), alpha], axis=-1).astype(np.float32)
    out = led(parts, depth, color, DEVICE_CASES[name], kinds="matte")
    np.testing.assert_allclose(out[..., 0] + out[..., 1], out[..., 2], atol=2e-5)
    assert out[..., 2].min() > -1e-5
    # Whole coverage before and behind a holdout, and by channels that hold each other out.
    assert out[..., 2].max() < 1 + 1e-5


@pytest.mark.parametrize("name", DEVICE_CASES)
@pytest.mark.parametrize("picture", PICTURES)
def test_lights_add_up(picture, name):
    color, depth = picture(lamps=6)
    light = color[..., :3]
    key = (0.3 * light).astype(np.float32)
    three = np.concatenate([key, light - key, light], axis=-1)
    out = led(three, depth, color, DEVICE_CASES[name])
    scale = max(1.0, float(np.abs(out).max()))
    assert np.abs(out[..., :3] + out[..., 3:6] - out[..., 6:]).max() < 3e-6 * scale


@pytest.mark.parametrize("name", DEVICE_CASES)
def test_a_channel_does_not_depend_on_those_that_travel_along(name):
    color, depth = two_layers(lamps=4)
    channels = np.random.default_rng(3).standard_normal((*depth.shape, 6), dtype=np.float32)
    kinds = ["light", "data", "matte", "light", "data", "light"]
    together = led(channels, depth, color, DEVICE_CASES[name], kinds=kinds)
    for c in range(6):
        alone = led(channels[..., c], depth, color, DEVICE_CASES[name], kinds=kinds[c])
        np.testing.assert_array_equal(together[..., c], alone)


@pytest.mark.parametrize("covered", [False, True])
def test_means_are_of_what_is_seen(covered):
    """A position behind a holdout is no darker where less of it is seen."""
    color, depth = one_layer()
    guide = color if covered else np.ascontiguousarray(color[..., :3])
    number = np.where(depth > 0, np.float32(5.0), np.float32(7.0))
    holdout = (disc(80, 50, 26), everywhere(NEARER))
    out = led(number, depth, guide, holdout, kinds="data")
    seen = out != 0
    assert np.all((out[seen] >= 5 - 1e-4) & (out[seen] <= 7 + 1e-4))
    assert not seen[48:52, 78:82].any()
    # Where the wall alone is seen, beside and through the soft edge of the holdout, it is whole.
    np.testing.assert_allclose(out[:, 130:], 7.0, rtol=1e-5)
    ramp = led(np.ones_like(number), depth, guide, holdout, kinds="matte")
    half = (ramp > 0.2) & (ramp < 0.8) & (X > 95)
    assert half.any()
    np.testing.assert_allclose(out[half], 7.0, rtol=1e-4)


@pytest.mark.parametrize("picture", PICTURES)
def test_what_is_in_focus_keeps_every_bit_beside_a_holdout(picture):
    color, depth = picture()
    depth = np.full_like(depth, MIDDLE)
    channels = np.random.default_rng(5).standard_normal((*depth.shape, 3), dtype=np.float32)
    matte = np.float32(disc(90, 40, 20) > 0.5)
    kinds = ["light", "matte", "data"]
    bare = led(channels, depth, color, kinds=kinds)
    out = led(channels, depth, color, (matte, everywhere(MIDDLE)), kinds=kinds)
    np.testing.assert_array_equal(out, np.where(matte[..., None] > 0, np.float32(0), bare))


def test_threads_and_instructions_change_no_bit(monkeypatch):
    color, depth = two_layers(lamps=4)
    channels = np.random.default_rng(6).standard_normal((*depth.shape, 6), dtype=np.float32)
    plain = led(channels, depth, color, DEVICE_CASES["glass"], threads=1)
    np.testing.assert_array_equal(led(channels, depth, color, DEVICE_CASES["glass"], threads=3), plain)
    for name in simd_available():
        monkeypatch.setenv("DOFSIM_SIMD", name)
        np.testing.assert_array_equal(led(channels, depth, color, DEVICE_CASES["glass"]), plain)


def test_ids_are_held_out_as_their_mattes():
    color, depth = one_layer()
    near = depth > 0
    ids = np.dstack([np.where(near, 1.5, 2.5), np.ones_like(depth), *[np.zeros_like(depth)] * 2])
    through = lens()
    words = {"depth_kind": "disparity", "holdout": HOLDOUT}
    ranks = dofsim.render_ids(ids.astype(np.float32), depth, through, guide=color, **words)
    for name, mask in ((1.5, near), (2.5, ~near)):
        matte = led(np.float32(mask), depth, color, HOLDOUT, kinds="matte")
        own = np.where(ranks[..., 0::2] == name, ranks[..., 1::2], 0).sum(-1)
        # Sharpening takes mattes of sharp edges a little beyond 0 and 1, and what ids cover stays between.
        np.testing.assert_allclose(own, np.clip(matte, 0, 1), atol=1e-2)
    alpha = led(color[..., 3], depth, color, HOLDOUT, kinds="matte")
    np.testing.assert_allclose(ranks[..., 1::2].sum(-1), np.maximum(alpha, 0), atol=1e-5)


# The command line and batches


@pytest.fixture
def shot(tmp_path, monkeypatch):
    """Write two frames, a holdout for each, and one for both; the wall has a pass beside the beauty."""
    monkeypatch.chdir(tmp_path)
    for folder in ("rgb", "roto"):
        (tmp_path / folder).mkdir()
    for number in range(2):
        picture, metres = rgba(texture(number)), everywhere(4.0)
        planes = {name: picture[..., c] for c, name in enumerate("RGBA")}
        planes |= {f"key.{name}": 0.5 * picture[..., c] for c, name in enumerate("RGB")} | {"Z": metres}
        io.write_exr(f"rgb/{number:04}.exr", planes)
        matte = disc(60 + 40 * number, 50, 25)
        before = np.where(matte > 0, np.float32(3.0), np.inf)
        io.write_image(f"roto/{number:04}.exr", rgba(np.zeros(3), matte), depth=before, dtype="float")
    return tmp_path


def expected(number, roto):
    color, metres = io.read_rgbd(f"rgb/{number:04}.exr")
    holder, before = io.read_rgbd(f"roto/{roto:04}.exr")
    through = dofsim.Lens(aperture_radius=0.05, focus_distance=2, fov=40)
    return color, metres, (np.ascontiguousarray(holder[..., 3]), before), through


@pytest.mark.usefixtures("shot")
def test_channels_are_held_out_from_the_command_line():
    options = ["--holdout", "roto/0001.exr", "--channels", "*", *LENS_OPTIONS]
    assert run(["render", "rgb/0000.exr", "-o", "out.exr", *options]) == 0
    color, metres, holdout, through = expected(0, 1)
    out = io.read_exr("out.exr")
    passes = np.dstack([0.5 * color[..., 0], color[..., 3]])
    rendered = dofsim.render(
        passes, metres, through, guide=color, kinds=["light", "matte"], holdout=holdout, device="cpu"
    )
    np.testing.assert_array_equal(out["key.R"], rendered[..., 0])
    np.testing.assert_array_equal(out["A"], rendered[..., 1])
    assert out["A"].min() < 1e-3


@pytest.mark.usefixtures("shot")
@pytest.mark.parametrize("where", ["roto", "roto/*.exr", "roto/0001.exr", "manifest"])
def test_frames_of_a_batch_are_held_out(where, tmp_path):
    both = where.endswith("0001.exr")
    arguments = ["rgb", "--holdout", where]
    if where == "manifest":
        lines = ["color,holdout", *(f"rgb/{n:04}.exr,roto/{n:04}.exr" for n in range(2))]
        (tmp_path / "frames.csv").write_text("\n".join(lines))
        arguments = ["--manifest", "frames.csv"]
    assert run(["batch", *arguments, "-o", "out", "--dtype", "float", *LENS_OPTIONS]) == 0
    folder = "out/rgb" if where == "manifest" else "out"
    for number in range(2):
        color, metres, holdout, through = expected(number, 1 if both else number)
        rendered = dofsim.render(color, metres, through, holdout=holdout, device="cpu")
        np.testing.assert_array_equal(io.read_color(f"{folder}/{number:04}.exr").pixels, rendered)
        assert rendered[..., 3].min() < 1e-3


@pytest.mark.usefixtures("shot")
def test_another_holdout_is_another_frame():
    frame = Frame(
        color="rgb/0000.exr",
        output="out/a.exr",
        lens={"aperture_radius": 0.05, "focus_distance": 2.0, "fov": 40.0},
        holdout="roto/0000.exr",
    )
    assert [one.status for one in map_frames([frame])] == ["written"]
    assert [one.status for one in map_frames([frame])] == ["skipped"]
    io.write_image("roto/0000.exr", rgba(np.zeros(3), disc(20, 20, 9)), depth=everywhere(1.0), dtype="half")
    assert [one.status for one in map_frames([frame])] == ["written"]
    own = Frame(**{**vars(frame), "output": "roto/0000.exr"})
    with pytest.raises(ValueError, match=r"roto/0000.exr: is one of the inputs"):
        list(map_frames([frame, own]))


@pytest.mark.usefixtures("shot")
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--holdout", "none"], "none: No such file"),
        (
            ["--holdout", "roto/0000.exr", "--method", "taps"],
            "holdout is for --method lens; got --method taps",
        ),
        (["--holdout", "few"], "rgb/0001.exr: has no holdout in few, as 1 of 2 frames"),
        (["-o", "roto", "--holdout", "roto"], "is one of the inputs, which are not overwritten"),
    ],
)
def test_what_holds_nothing_out_is_named(arguments, text, tmp_path, capsys):
    (tmp_path / "few").mkdir()
    (tmp_path / "few" / "0000.exr").write_bytes((tmp_path / "roto" / "0000.exr").read_bytes())
    output = [] if "-o" in arguments else ["-o", "out"]
    assert run(["batch", "rgb", *output, *arguments, *LENS_OPTIONS]) == 2
    err = capsys.readouterr().err
    assert err.startswith("dofsim: ")
    assert text in err
