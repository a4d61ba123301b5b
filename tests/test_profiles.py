"""Colour profiles: read, worked on in linear light of the same primaries, and written back."""

import struct

import dofsim
import numpy as np
import pytest
from dofsim import io
from PIL import Image as Pillow
from PIL import ImageCms

# CIE XYZ of D50, as ICC profiles have them.
P3 = [(0.51512, 0.2412, -0.00105), (0.29198, 0.69225, 0.04189), (0.1571, 0.06657, 0.78407)]
ADOBE = [(0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457)]
SRGB_CURVE = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)


def fixed(value):
    return struct.pack(">i", round(value * 65536))


def profile(primaries, curve, space=b"RGB ", name="a profile"):
    """Make an ICC profile by hand; the curve is a gamma, a table or parameters of sRGB's kind."""
    text = name.encode() + b"\0"
    tags = {b"desc": b"desc\0\0\0\0" + struct.pack(">I", len(text)) + text + bytes(78)}
    if curve is None:
        trc = b""
    elif np.isscalar(curve):
        trc = b"curv\0\0\0\0" + struct.pack(">IH", 1, round(curve * 256))
    elif len(curve) == 5:
        trc = b"para\0\0\0\0" + struct.pack(">HH", 3, 0) + b"".join(map(fixed, curve))
    else:
        trc = b"curv\0\0\0\0" + struct.pack(f">I{len(curve)}H", len(curve), *curve)
    if curve is not None:
        tags |= {b"kTRC": trc} if space == b"GRAY" else {b"rTRC": trc, b"gTRC": trc, b"bTRC": trc}
    tags[b"wtpt"] = b"XYZ \0\0\0\0" + b"".join(map(fixed, (0.9642, 1.0, 0.8249)))
    if space == b"RGB ":
        for tag, xyz in zip((b"rXYZ", b"gXYZ", b"bXYZ"), primaries, strict=True):
            tags[tag] = b"XYZ \0\0\0\0" + b"".join(map(fixed, xyz))
    table, data = b"", b""
    start = 128 + 4 + 12 * len(tags)
    for tag, body in tags.items():
        table += tag + struct.pack(">II", start + len(data), len(body))
        data += body + bytes(-len(body) % 4)
    header = bytearray(128)
    header[0:4] = struct.pack(">I", start + len(data))
    header[8:12] = b"\x02\x40\0\0"
    header[12:16], header[16:20], header[20:24] = b"mntr", space, b"XYZ "
    header[24:36] = struct.pack(">6H", 2026, 1, 1, 0, 0, 0)
    header[36:40] = b"acsp"
    header[68:80] = b"".join(map(fixed, (0.9642, 1.0, 0.8249)))
    return bytes(header) + struct.pack(">I", len(tags)) + table + data


PROFILES = {
    "Display P3": profile(P3, SRGB_CURVE, name="Display P3"),
    "Adobe RGB": profile(ADOBE, 563 / 256, name="Adobe RGB (1998)"),
    "gamma 1.8": profile(ADOBE, 1.8, name="gamma 1.8"),
    "table": profile(P3, [round(65535 * (i / 1023) ** 2.2) for i in range(1024)], name="a table"),
    "sRGB": ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes(),
}
CODES = np.random.default_rng(0).integers(0, 256, (12, 20, 3), dtype=np.uint8)
SUFFIXES = {"png": {}, "jpg": {"quality": 95}, "tif": {}, "webp": {"lossless": True}}


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", PROFILES)
def test_a_picture_comes_back_with_its_profile(tmp_path, name, suffix):
    path = tmp_path / f"in.{suffix}"
    Pillow.fromarray(CODES).save(path, icc_profile=PROFILES[name], **SUFFIXES[suffix])
    image = io.read_color(path)
    assert image.profile is not None
    assert image.profile.icc == PROFILES[name]
    for out in ("out.png", "out.tif"):
        io.write_image(tmp_path / out, image.to_linear(), profile=image.profile, dtype="uint8")
        with Pillow.open(tmp_path / out) as written:
            assert written.info["icc_profile"] == PROFILES[name]
            np.testing.assert_array_equal(np.asarray(written), image.pixels)


@pytest.mark.parametrize("gamma", [1.8, 563 / 256, 2.2])
def test_linear_light_is_that_of_the_curve(tmp_path, gamma):
    Pillow.fromarray(CODES).save(tmp_path / "in.png", icc_profile=profile(ADOBE, gamma))
    image = io.read_color(tmp_path / "in.png")
    assert image.transfer == "profile"
    exact = round(gamma * 256) / 256
    np.testing.assert_allclose(image.to_linear(), (CODES / 255.0) ** exact, atol=2e-6)


def test_display_p3_is_coded_as_srgb(tmp_path):
    Pillow.fromarray(CODES).save(tmp_path / "in.png", icc_profile=PROFILES["Display P3"])
    Pillow.fromarray(CODES).save(tmp_path / "plain.png")
    image = io.read_color(tmp_path / "in.png")
    assert image.transfer == "srgb"
    np.testing.assert_array_equal(image.to_linear(), io.read_color(tmp_path / "plain.png").to_linear())


def test_what_is_rendered_from_a_profile_has_it(tmp_path):
    from dofsim.cli import run

    Pillow.fromarray(CODES).save(tmp_path / "in.png", icc_profile=PROFILES["Adobe RGB"])
    io.write_depth(tmp_path / "depth.npy", np.full((12, 20), 2.0))
    lens = ["--aperture-radius", "0.01", "--focus-distance", "2", "--fov", "40"]
    files = [str(tmp_path / "in.png"), str(tmp_path / "depth.npy"), "-o", str(tmp_path / "out.png")]
    assert run(["render", *files, *lens]) == 0
    with Pillow.open(tmp_path / "out.png") as written:
        assert written.info["icc_profile"] == PROFILES["Adobe RGB"]
        # In focus nothing changes.
        np.testing.assert_array_equal(np.asarray(written), CODES)


def test_codes_of_a_profile_are_not_taken_for_others(tmp_path):
    Pillow.fromarray(CODES).save(tmp_path / "in.png", icc_profile=PROFILES["Adobe RGB"])
    image = io.read_color(tmp_path / "in.png")
    lens = dofsim.Lens(aperture_radius=0.01, focus_distance=2.0, fov=40.0)
    with pytest.raises(ValueError, match="transfer"):
        dofsim.render(image.pixels, np.full((12, 20), 2.0), lens, transfer=image.transfer)


def test_floats_are_written_with_the_primaries_of_rec_709(tmp_path):
    Pillow.fromarray(CODES).save(tmp_path / "in.png", icc_profile=PROFILES["Display P3"])
    image = io.read_color(tmp_path / "in.png")
    io.write_image(tmp_path / "out.exr", image.to_linear(), profile=image.profile)
    expected = image.to_linear() @ image.profile.to_rec709.T
    np.testing.assert_allclose(io.read_color(tmp_path / "out.exr").pixels, expected, atol=1e-5)
    # Greys are greys in both.
    np.testing.assert_allclose(image.profile.to_rec709.sum(1), 1.0, atol=2e-3)


def test_grey_pictures(tmp_path):
    grey = profile(None, 2.2, space=b"GRAY", name="grey")
    Pillow.fromarray(CODES[..., 0]).save(tmp_path / "in.png", icc_profile=grey)
    image = io.read_color(tmp_path / "in.png")
    np.testing.assert_allclose(image.to_linear(), (CODES[..., 0] / 255.0) ** (563 / 256), atol=2e-6)
    io.write_image(tmp_path / "out.png", image.to_linear(), profile=image.profile, dtype="uint8")
    np.testing.assert_array_equal(io.read_color(tmp_path / "out.png").pixels, CODES[..., 0])


def test_sixteen_bits(tmp_path):
    codes = np.random.default_rng(1).integers(0, 65536, (9, 11, 3), dtype=np.uint16)
    parsed = io.ColorProfile.parse(PROFILES["Adobe RGB"], 3)
    io.write_image(tmp_path / "a.png", codes, profile=parsed)
    image = io.read_color(tmp_path / "a.png")
    np.testing.assert_array_equal(image.pixels, codes)
    io.write_image(tmp_path / "b.png", image.to_linear(), profile=image.profile, dtype="uint16")
    np.testing.assert_array_equal(io.read_color(tmp_path / "b.png").pixels, codes)


@pytest.mark.parametrize(
    ("icc", "text"),
    [
        (profile(P3, None, name="no curves"), "'?\"?no curves.*without tone curves"),
        (profile(P3, [65535, 0, 65535]), "do not lead from black to white"),
        (profile(None, 2.2, space=b"CMYK"), "of Cmyk for a picture of 3 channels"),
        (profile(None, 2.2, space=b"Lab "), "of Lab"),
        (b"nonsense", "damaged file: its colour profile"),
        (PROFILES["sRGB"][:200], "damaged file: its colour profile"),
    ],
)
def test_what_is_not_understood_is_an_error(tmp_path, icc, text):
    Pillow.fromarray(CODES).save(tmp_path / "in.png", icc_profile=icc)
    with pytest.raises(ValueError, match=text):
        io.read_color(tmp_path / "in.png")
    # Whoever knows better can say so; depth has no colours.
    assert io.read_color(tmp_path / "in.png", transfer="srgb").profile is None
    Pillow.fromarray(CODES[..., 0]).save(tmp_path / "depth.png", icc_profile=icc)
    assert io.read_depth(tmp_path / "depth.png", scale=1.0).shape == (12, 20)
