"""Photographs as phones and networks give them, made with other libraries and by hand."""

import contextlib

import dofsim
import numpy as np
import pytest
from dofsim import io, metrics, photo
from dofsim.cli import run
from phones import segment, with_dynamic_depth, with_gdepth
from PIL import Image as Pillow
from scipy import ndimage as ndi
from test_profiles import PROFILES

pytest.importorskip("pillow_heif")
pytest.importorskip("defusedxml")

HEIGHT, WIDTH = 96, 128
Y, X = np.mgrid[0:HEIGHT, 0:WIDTH]
SUBJECT = np.hypot(X - 60, Y - 50) < 28
# Smooth, so that JPEG and HEIC keep it to a few codes.
PICTURE = np.stack([np.where(SUBJECT, 200, 60), 80 + 0.5 * X, np.where(SUBJECT, 90, 190)], -1).astype(
    np.uint8
)
NEARNESS = np.where(SUBJECT, 220, 40).astype(np.uint8)


def exif(orientation=1, **tags):
    found = Pillow.Exif()
    found[0x0112] = orientation
    found[0x010F] = "Maker"
    inner = found.get_ifd(0x8769)
    inner |= {0xA405: 28, 0x829D: 1.8, **tags}
    return found


def jpeg(path, picture=PICTURE, **words):
    Pillow.fromarray(picture).save(path, quality=98, subsampling=0, **words)


def png(path, codes):
    Pillow.fromarray(codes).save(path)
    return path


@pytest.mark.parametrize("orientation", range(1, 9))
def test_picture_and_depth_are_turned_alike(tmp_path, orientation):
    jpeg(tmp_path / "in.jpg", exif=exif(orientation))
    with_gdepth(tmp_path / "in.jpg", 255 - NEARNESS)
    shot = photo.read(tmp_path / "in.jpg")
    with Pillow.open(tmp_path / "in.jpg") as stored:
        from PIL import ImageOps

        upright = np.asarray(ImageOps.exif_transpose(stored))
    assert np.abs(shot.image.pixels.astype(int) - upright).max() <= 2
    # Where the picture is red, the depth is near.
    assert shot.depth.shape == shot.image.pixels.shape[:2]
    near = shot.depth > np.mean([shot.depth.min(), shot.depth.max()])
    assert (near == (shot.image.pixels[..., 0] > 130)).mean() > 0.99
    # A map beside it, as it is stored or as it is seen.
    sideways = png(tmp_path / "d.png", NEARNESS)
    seen = photo.read(tmp_path / "in.jpg", sideways)
    if orientation >= 5:
        assert ((seen.depth > 130) == (seen.image.pixels[..., 0] > 130)).mean() > 0.99


def test_the_lens_is_read_and_the_rest_of_exif_kept(tmp_path):
    jpeg(tmp_path / "in.jpg", exif=exif(6))
    shot = photo.read(tmp_path / "in.jpg", png(tmp_path / "d.png", NEARNESS))
    assert (shot.focal_length_35mm, shot.f_number) == (28.0, 1.8)
    for suffix in photo.SUFFIXES:
        out = tmp_path / f"out{suffix}"
        photo.write(out, shot.image.to_linear(), shot)
        again = photo.read(out)
        with Pillow.open(out) as written:
            assert written.getexif()[0x010F] == "Maker"
            assert written.getexif().get(0x0112, 1) == 1
        if "tif" not in suffix:
            assert again.focal_length_35mm == 28.0, suffix
        # It is upright, and says so.
        assert again.image.pixels.shape == shot.image.pixels.shape
        assert np.abs(again.image.pixels.astype(int) - shot.image.pixels).mean() < 3.0


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".heic", ".tif"])
@pytest.mark.parametrize("name", ["Display P3", "Adobe RGB"])
def test_the_profile_is_kept(tmp_path, name, suffix):
    jpeg(tmp_path / "in.jpg", icc_profile=PROFILES[name])
    shot = photo.read(tmp_path / "in.jpg")
    photo.write(tmp_path / f"out{suffix}", shot.image.to_linear(), shot)
    again = photo.read(tmp_path / f"out{suffix}")
    assert again.image.profile.icc == PROFILES[name]
    assert np.abs(again.image.pixels.astype(int) - shot.image.pixels).mean() < 3.0


@pytest.mark.parametrize(("form", "inverse"), [("RangeInverse", True), ("RangeLinear", False)])
def test_gdepth_is_disparity(tmp_path, form, inverse):
    jpeg(tmp_path / "in.jpg")
    codes = np.linspace(0, 255, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH).round().astype(np.uint8)
    with_gdepth(tmp_path / "in.jpg", codes, form)
    share = codes / 255.0
    metres = 1 / ((1 - share) / 1.0 + share / 8.0) if inverse else 1.0 + 7.0 * share
    np.testing.assert_allclose(photo.read(tmp_path / "in.jpg").depth, 1 / metres, rtol=1e-5)


def test_dynamic_depth(tmp_path):
    jpeg(tmp_path / "in.jpg")
    with_dynamic_depth(tmp_path / "in.jpg", 255 - NEARNESS)
    shot = photo.read(tmp_path / "in.jpg")
    np.testing.assert_allclose(shot.depth, NEARNESS / np.float32(255), atol=1e-6)


@pytest.mark.parametrize("suffix", ["heic", "avif"])
def test_heic_and_avif(tmp_path, suffix):
    import pillow_heif

    pillow_heif.register_heif_opener()
    path = tmp_path / f"in.{suffix}"
    Pillow.fromarray(PICTURE).save(path, quality=95, icc_profile=PROFILES["Display P3"], exif=exif(1))
    shot = photo.read(path)
    assert np.abs(shot.image.pixels.astype(int) - PICTURE).mean() < 4.0
    assert shot.image.profile.icc == PROFILES["Display P3"]
    assert shot.focal_length_35mm == 28.0
    # The end of it is missing.
    cut = tmp_path / f"cut.{suffix}"
    cut.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ValueError, match=f"cut.{suffix}: damaged file"):
        photo.read(cut)


def test_a_container_without_a_picture_is_damaged(tmp_path, monkeypatch):
    """Some changed bytes leave all boxes whole and no picture among them."""
    import pillow_heif

    monkeypatch.setattr(pillow_heif, "open_heif", lambda *_, **__: [])
    (tmp_path / "in.heic").write_bytes(b"\0\0\0\x18ftypheic")
    with pytest.raises(ValueError, match=r"in\.heic: damaged file: there is no picture in it"):
        photo.read(tmp_path / "in.heic")


DEPTHS = {
    "grey": NEARNESS,
    "RGB": np.repeat(NEARNESS[..., None], 3, -1),
    "RGBA": np.concatenate(
        [np.repeat(NEARNESS[..., None], 3, -1), np.full((HEIGHT, WIDTH, 1), 255, np.uint8)], -1
    ),
    "a quarter of the size": NEARNESS[2::4, 2::4].copy(),
    "16 bits": NEARNESS.astype(np.uint16) * 257,
}


@pytest.mark.parametrize("name", DEPTHS)
def test_one_command(tmp_path, capsys, name):
    jpeg(tmp_path / "in.jpg", exif=exif(1), icc_profile=PROFILES["Display P3"])
    depth, out = png(tmp_path / "d.png", DEPTHS[name]), tmp_path / "out.jpg"
    assert run(["photo", str(tmp_path / "in.jpg"), str(depth), "-o", str(out), "--focus-at", "60,50"]) == 0
    out_said, said = capsys.readouterr()
    assert out_said == ""
    assert said.count("\n") == 1
    assert f"out.jpg: {WIDTH} x {HEIGHT}" in said
    assert "refined, focus at pixel 60,50, blur radius 0 to" in said
    assert "depth map of " in said
    assert "(larger is nearer) refined" in said
    assert "Display P3" in said
    again = photo.read(out)
    assert again.image.pixels.shape == PICTURE.shape
    assert again.image.profile.icc == PROFILES["Display P3"]
    # The subject stays, its surroundings do not.
    change = np.abs(again.image.pixels.astype(int) - PICTURE).sum(-1)
    inside, rim = np.hypot(X - 60, Y - 50) < 24, np.abs(np.hypot(X - 60, Y - 50) - 31) < 2
    assert change[inside].mean() < 6
    assert change[rim].mean() > 4


def test_quiet_says_nothing_and_verbose_names_the_lens(tmp_path, capsys):
    jpeg(tmp_path / "in.jpg")
    depth = png(tmp_path / "d.png", NEARNESS)
    arguments = ["photo", str(tmp_path / "in.jpg"), str(depth), "-o", str(tmp_path / "out.jpg")]
    assert run([*arguments, "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert run([*arguments, "-v"]) == 0
    assert "Lens.from_disparity(" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--nearest-m", "0"], "--nearest-m must be positive"),
        (["--f-number", "-1"], "--f-number must be positive"),
        (["--quality", "0"], "--quality must be"),
    ],
)
def test_wrong_numbers_are_named_as_options(tmp_path, capsys, options, text):
    jpeg(tmp_path / "in.jpg")
    depth = png(tmp_path / "d.png", NEARNESS)
    arguments = ["photo", str(tmp_path / "in.jpg"), str(depth), "-o", str(tmp_path / "out.jpg")]
    assert run([*arguments, *options]) == 2
    assert text in capsys.readouterr().err
    assert not (tmp_path / "out.jpg").exists()


def test_a_map_of_integers_needs_no_scale(tmp_path):
    np.save(tmp_path / "d.npy", NEARNESS)
    np.testing.assert_array_equal(photo.read_depth(tmp_path / "d.npy"), NEARNESS)


def test_larger_may_be_farther(tmp_path):
    near = photo.read_depth(png(tmp_path / "near.png", NEARNESS))
    far = photo.read_depth(png(tmp_path / "far.png", 255 - NEARNESS), far_is_white=True)
    np.testing.assert_allclose(np.ptp(near), np.ptp(far))
    np.testing.assert_allclose(near - near.min(), far - far.min())


def test_what_is_used_can_be_kept(tmp_path):
    jpeg(tmp_path / "in.jpg")
    depth = png(tmp_path / "d.png", DEPTHS["a quarter of the size"])
    arguments = ["photo", str(tmp_path / "in.jpg"), str(depth), "-o", str(tmp_path / "out.png")]
    assert run([*arguments, "--save-depth", str(tmp_path / "used.png")]) == 0
    used = io.read_depth(tmp_path / "used.png", scale=1.0)
    assert ((used > 32768) == SUBJECT).mean() > 0.97


def test_the_subject_can_be_kept_as_a_matte(tmp_path):
    jpeg(tmp_path / "in.jpg")
    depth = png(tmp_path / "d.png", DEPTHS["a quarter of the size"])
    arguments = ["photo", str(tmp_path / "in.jpg"), str(depth), "-o", str(tmp_path / "out.png")]
    assert run([*arguments, "--focus-at", "60,50", "--save-matte", str(tmp_path / "m.png")]) == 0
    matte = photo.read_matte(tmp_path / "m.png")
    # Within the four pixels of a value of the map.
    inside, rim = ndi.binary_erosion(SUBJECT, iterations=4), ndi.binary_dilation(SUBJECT, iterations=4)
    assert matte[inside].min() == 1.0
    assert matte[~rim].max() == 0.0
    # Its edges are soft, and where the subject's are.
    assert matte.sum() == pytest.approx(SUBJECT.sum(), rel=0.02)
    assert ((matte > 0.1) & (matte < 0.9)).sum() > 30
    assert run([*arguments, "--matte", str(tmp_path / "m.png")]) == 0


def test_two_results_are_no_one_file(tmp_path, capsys):
    jpeg(tmp_path / "in.jpg")
    depth = png(tmp_path / "d.png", NEARNESS)
    out = str(tmp_path / "out.png")
    for options in (["--save-depth", out], ["--save-matte", out]):
        assert run(["photo", str(tmp_path / "in.jpg"), str(depth), "-o", out, *options]) == 2
        assert "cannot hold two of" in capsys.readouterr().err


def test_what_cannot_be_written_is_said_before_the_work(tmp_path, capsys, monkeypatch):
    jpeg(tmp_path / "in.jpg")
    depth = png(tmp_path / "d.png", NEARNESS)
    monkeypatch.setattr(photo, "read", None)
    arguments = ["photo", str(tmp_path / "in.jpg"), str(depth), "-o", str(tmp_path / "out.jpg")]
    assert run([*arguments, "--quality", "101"]) == 2
    assert "--quality must be from 1 to 100; got 101" in capsys.readouterr().err


def test_a_profile_that_is_not_understood_is_said_in_the_words_of_the_command(tmp_path, capsys):
    jpeg(tmp_path / "in.jpg", icc_profile=b"nonsense")
    depth = png(tmp_path / "d.png", NEARNESS)
    assert run(["photo", str(tmp_path / "in.jpg"), str(depth), "-o", str(tmp_path / "out.jpg")]) == 2
    said = capsys.readouterr().err
    assert "in.jpg: damaged file: its colour profile" in said
    assert "save the photograph as sRGB" in said
    assert "transfer" not in said


def test_render_names_the_command_for_photographs(tmp_path, capsys):
    jpeg(tmp_path / "in.jpg")
    depth = png(tmp_path / "d.png", NEARNESS)
    assert run(["render", str(tmp_path / "in.jpg"), str(depth), "-o", str(tmp_path / "out.jpg")]) == 2
    assert "`dofsim photo` writes JPEG and HEIC" in capsys.readouterr().err
    (tmp_path / "in.heic").write_bytes(b"\0\0\0\x18ftypheic")
    assert run(["render", str(tmp_path / "in.heic"), str(depth), "-o", str(tmp_path / "out.png")]) == 2
    assert "`dofsim photo` reads HEIC and AVIF" in capsys.readouterr().err


def test_one_scale_for_all_photographs_of_a_sequence():
    shot = photo.Photo(io.Image(PICTURE, "srgb", "none"))
    depth = NEARNESS.astype(np.float32)
    near = depth.copy()
    near[:20, :40] = 2000.0
    lens = dofsim.Lens.from_disparity(strength_percent=3.0, focus=1.0)
    for words in ({}, {"matte": SUBJECT.astype(np.float32)}, {"keep_grain": True}):
        before, after = (
            photo.render(shot, one, lens, depth_range=(40.0, 220.0), max_coc_px=8.0, **words)
            for one in (depth, near)
        )
        np.testing.assert_allclose(before[60:], after[60:], atol=2e-3)


def test_a_matte_keeps_what_is_half_transparent(tmp_path):
    """Of a soft edge both sides keep their colours: no rim of the subject's in the blurred background."""
    matte = np.clip((30.0 - np.hypot(X - 60, Y - 50)) / 4.0, 0.0, 1.0).astype(np.float32)
    front, back = np.array([0.8, 0.2, 0.1]), np.array([0.1, 0.3, 0.7])
    color = (matte[..., None] * front + (1 - matte[..., None]) * back).astype(np.float32)
    layers, depths = dofsim.layers_from_matte(color, matte, np.where(matte > 0.5, 1.0, 4.0))
    np.testing.assert_allclose(layers[0, ..., 3], matte)
    seen = matte > 0.05
    np.testing.assert_allclose(
        layers[0, seen, :3] / matte[seen, None], np.tile(front, (seen.sum(), 1)), atol=0.03
    )
    np.testing.assert_allclose(
        layers[1, matte < 0.95, :3], np.tile(back, ((matte < 0.95).sum(), 1)), atol=0.03
    )
    whole = layers[0, ..., :3] + (1 - matte[..., None]) * layers[1, ..., :3]
    np.testing.assert_allclose(whole, color, atol=1e-3)
    np.testing.assert_allclose(depths[0, matte > 0.5], 1.0, rtol=0.02)
    np.testing.assert_allclose(depths[1, matte < 0.5], 4.0, rtol=0.1)


def test_foregrounds_are_pymattings():
    pymatting = pytest.importorskip("pymatting")
    rng = np.random.default_rng(0)

    def smooth():
        waves = [np.sin(X / rng.uniform(9, 30) + rng.uniform(0, 6)) for _ in range(3)]
        return 0.5 + 0.4 * np.stack(waves, -1)

    front, back = smooth(), smooth()
    matte = np.clip(0.5 + 0.5 * np.sin(X / 9.0) * np.cos(Y / 11.0) * 1.6, 0.0, 1.0)
    color = matte[..., None] * front + (1 - matte[..., None]) * back
    layers, _ = dofsim.layers_from_matte(
        color.astype(np.float32), matte.astype(np.float32), np.ones(matte.shape)
    )
    theirs = pymatting.estimate_foreground_ml(color, matte)
    seen = matte > 0.2
    ours = layers[0, seen, :3] / matte[seen, None]
    error = np.abs(ours - front[seen]).mean()
    assert error < 1.1 * np.abs(theirs[seen] - front[seen]).mean() + 1e-3


def test_restored_light_is_never_darker_and_bounded():
    rng = np.random.default_rng(0)
    codes = rng.integers(0, 60, (120, 160, 3), dtype=np.uint8)
    codes[60:64, 80:84] = 255
    light = dofsim.restore_highlights(codes, transfer="srgb")
    plain = io.Image(codes, "srgb", "none").to_linear()
    assert (light >= plain).all()
    assert light.max() <= 16.0
    assert light[62, 82].min() > 5.0
    np.testing.assert_array_equal(light[:50], plain[:50])


def test_a_white_wall_is_no_lamp():
    codes = np.full((120, 160, 3), 255, np.uint8)
    codes[:, :40] = 120
    assert dofsim.restore_highlights(codes, transfer="srgb")[:, 80:].max() < 1.05


def test_grain_comes_back_where_it_was_lost():
    rng = np.random.default_rng(0)
    noisy = np.clip(128 + rng.normal(0, 5, (128, 128, 1)), 0, 255).round().astype(np.uint8)
    shot = photo.Photo(io.Image(np.repeat(noisy, 3, -1), "srgb", "none"))
    flat = np.full((128, 128, 3), io.Image(np.full((1, 1), 128, np.uint8), "srgb", "none").to_linear()[0, 0])
    radius = np.where(np.arange(128) < 64, 0.0, 12.0) * np.ones((128, 1))
    grainy = photo.with_grain(flat.astype(np.float32), shot, radius.astype(np.float32))
    np.testing.assert_array_equal(grainy[:, :64], flat[:, :64].astype(np.float32))
    codes = 255 * metrics.srgb(grainy[:, 64:, 0])
    assert np.std(codes) == pytest.approx(5.0, rel=0.25)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda d: jpeg(d / "in.jpg"), "in.jpg: has no depth in it; give a depth map beside it"),
        (
            lambda d: (jpeg(d / "in.jpg"), with_dynamic_depth(d / "in.jpg", NEARNESS, 10**9)),
            "lies outside of it",
        ),
        (lambda d: (jpeg(d / "in.jpg"), with_gdepth(d / "in.jpg", NEARNESS[:20])), "must have the shape of"),
    ],
)
def test_what_cannot_be_used_is_one_line(tmp_path, capsys, make, text):
    make(tmp_path)
    assert run(["photo", str(tmp_path / "in.jpg"), "-o", str(tmp_path / "out.jpg")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert text in said
    assert not (tmp_path / "out.jpg").exists()


def test_a_coloured_map_is_named(tmp_path):
    from matplotlib import colormaps

    codes = (255 * colormaps["turbo"](X / WIDTH)[..., :3]).round().astype(np.uint8)
    with pytest.raises(ValueError, match=r"d\.png: the depth map is coloured by the colour map 'turbo'"):
        photo.read_depth(png(tmp_path / "d.png", codes))


def test_xml_that_grows_is_refused(tmp_path):
    jpeg(tmp_path / "in.jpg")
    bomb = b"<!DOCTYPE l [" + b"".join(
        b'<!ENTITY a%d "%s">' % (i, b"&a%d;" % (i - 1) * 10 if i else b"ha") for i in range(20)
    )
    bomb += b"]><x>&a19;</x>"
    content = (tmp_path / "in.jpg").read_bytes()
    head = segment(b"http://ns.adobe.com/xap/1.0/\0" + bomb)
    (tmp_path / "in.jpg").write_bytes(content[:2] + head + content[2:])
    with pytest.raises(ValueError, match=r"in\.jpg: damaged file: its XMP"):
        photo.read(tmp_path / "in.jpg")


def test_any_bytes_are_read_or_refused(tmp_path):
    """Wrong bytes in the parts that are parsed here are one of the errors that are promised."""
    jpeg(tmp_path / "in.jpg", exif=exif(6), icc_profile=PROFILES["Display P3"])
    with_gdepth(tmp_path / "in.jpg", NEARNESS)
    whole = (tmp_path / "in.jpg").read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(150):
        damaged = bytearray(whole)
        for at in rng.integers(2, len(whole), rng.integers(1, 4)):
            damaged[at] = rng.integers(256)
        (tmp_path / "d.jpg").write_bytes(bytes(damaged))
        with contextlib.suppress(ValueError):
            photo.read(tmp_path / "d.jpg")


def test_what_the_depth_is_taken_for_is_said(tmp_path, capsys):
    jpeg(tmp_path / "in.jpg")
    depth = png(tmp_path / "d.png", NEARNESS)
    arguments = ["photo", str(tmp_path / "in.jpg"), str(depth), "-o", str(tmp_path / "out.jpg")]
    assert run([*arguments, "--depth-far-is-white", "--keep-depth"]) == 0
    assert f"depth map of {WIDTH} x {HEIGHT} (larger is farther) as it is" in capsys.readouterr().err
    with_gdepth(tmp_path / "in.jpg", 255 - NEARNESS)
    assert run(["photo", str(tmp_path / "in.jpg"), "-o", str(tmp_path / "out.jpg")]) == 0
    assert f"its own depth of {WIDTH} x {HEIGHT} refined" in capsys.readouterr().err


def test_a_photograph_without_blur_is_warned_of(tmp_path, capsys):
    jpeg(tmp_path / "in.jpg")
    arguments = ["photo", str(tmp_path / "in.jpg"), str(tmp_path / "d.png"), "-o", str(tmp_path / "out.jpg")]
    png(tmp_path / "d.png", NEARNESS)
    assert run([*arguments, "--f-number", "64"]) == 0
    said = capsys.readouterr().err.splitlines()
    assert any(line.startswith("dofsim: ") and "the blur is too small to see" in line for line in said)
    png(tmp_path / "d.png", np.full_like(NEARNESS, 99))
    assert run(arguments) == 0
    assert "disparity is 99 everywhere" in capsys.readouterr().err


def test_a_render_is_no_photograph(tmp_path, capsys):
    io.write_image(tmp_path / "in.exr", PICTURE.astype(np.float32))
    assert run(["photo", str(tmp_path / "in.exr"), "-o", str(tmp_path / "out.jpg")]) == 2
    assert "`dofsim render`" in capsys.readouterr().err


def test_a_long_photograph_says_how_far_it_is(tmp_path, capsys, monkeypatch):
    from dofsim import _console

    monkeypatch.setattr(_console, "_FIRST_WORD_S", 0.0)
    monkeypatch.setattr(_console, "_LOOK_S", 0.001)
    patience, watched = _console.patience, []

    def watch(what, *, out=None):
        watched.append(out)
        return patience(what, out=out)

    monkeypatch.setattr(_console, "patience", watch)
    jpeg(tmp_path / "in.jpg")
    depth = png(tmp_path / "d.png", NEARNESS)
    arguments = ["photo", str(tmp_path / "in.jpg"), str(depth), "-o", str(tmp_path / "out.jpg")]
    assert run(arguments) == 0
    said = capsys.readouterr().err
    assert f"refining the depth of {WIDTH} x {HEIGHT}: " in said
    assert f"rendering {WIDTH} x {HEIGHT}: " in said
    assert "--method" not in said
    # What is rendered into tells how much is done.
    assert watched[0] is None
    assert watched[1].shape == PICTURE.shape
    assert not np.isnan(watched[1]).any()
