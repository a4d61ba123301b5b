"""Gain maps of phones: lamps get the light that the file says, in each of the three ways to say it."""

import struct
from types import SimpleNamespace

import dofsim
import numpy as np
import pytest
from dofsim import io, photo
from dofsim.photo import _gain_map
from phones import gain_jpeg, iso_gain, segment, with_further, xmp
from PIL import Image as Pillow

pytest.importorskip("defusedxml")

HEIGHT, WIDTH = 64, 96
LAMP = np.hypot(*(np.mgrid[0:HEIGHT, 0:WIDTH] - np.array([30, 40])[:, None, None])) < 5
PICTURE = np.where(LAMP[..., None], 255, 20).astype(np.uint8) * np.ones(3, np.uint8)
# At half the size, as phones have it; even, so that JPEG keeps it.
CODES = np.full((HEIGHT // 2, WIDTH // 2), 255, np.uint8)
HDRGM = 'xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0" '
APPLE = (
    'xmlns:apdi="http://ns.apple.com/pixeldatainfo/1.0/" xmlns:m="http://ns.apple.com/HDRGainMap/1.0/" '
    f'apdi:AuxiliaryImageType="{_gain_map.APPLE}" m:HDRGainMapVersion="131072" '
)


def packet(attributes, inner=""):
    return segment(b"http://ns.adobe.com/xap/1.0/\0" + xmp(attributes, inner))


def shot(tmp_path, *parts, codes=CODES):
    path = tmp_path / "in.jpg"
    Pillow.fromarray(PICTURE).save(path, quality=98, subsampling=0)
    with_further(path, gain_jpeg(codes, *parts))
    return photo.read(path)


SEQUENCE = "".join(
    f"<hdrgm:{name}><rdf:Seq>{''.join(f'<rdf:li>{v}</rdf:li>' for v in values)}</rdf:Seq></hdrgm:{name}>"
    for name, values in (("GainMapMax", (2, 3, 4)), ("GainMapMin", (0, 0, 0)))
)
# Two headrooms; then least and greatest stops, gamma, and the offsets of both pictures.
ISO = [(0, 1), (3, 1), (0, 1), (3, 1), (1, 1), (1, 64), (1, 64)]
KINDS = {
    "Ultra HDR": (packet(HDRGM + 'hdrgm:GainMapMax="3" hdrgm:GainMapMin="0"'), 65 / 64 * 8 - 1 / 64),
    "without offsets": (
        packet(HDRGM + 'hdrgm:GainMapMax="2.5" hdrgm:OffsetSDR="0" hdrgm:OffsetHDR="0"'),
        2**2.5,
    ),
    "ISO 21496-1": (iso_gain(*ISO), 65 / 64 * 8 - 1 / 64),
    "Apple": (packet(APPLE + 'm:HDRGainMapHeadroom="6.5"'), 6.5),
    "none": (b"", None),
    "the base is HDR": (packet(HDRGM + 'hdrgm:BaseRenditionIsHDR="True"'), None),
}


@pytest.mark.parametrize("kind", KINDS)
def test_white_is_as_bright_as_the_file_says(tmp_path, kind):
    part, expected = KINDS[kind]
    found = shot(tmp_path, part)
    if expected is None:
        assert found.gains is None
        return
    assert found.gains.shape == CODES.shape
    np.testing.assert_allclose(found.gains, expected, rtol=1e-5)
    light = dofsim.restore_highlights(found.image.to_linear(), gains=found.gains)
    assert light[30, 40].max() == pytest.approx(expected, rel=0.01)
    # What is not clipped keeps its light.
    np.testing.assert_array_equal(light[50:], found.image.to_linear()[50:])


def test_channels_of_their_own(tmp_path):
    codes = np.repeat(CODES[..., None], 3, -1)
    attributes = HDRGM + 'hdrgm:OffsetSDR="0" hdrgm:OffsetHDR="0"'
    np.testing.assert_allclose(
        shot(tmp_path, packet(attributes, SEQUENCE), codes=codes).gains, (4 + 8 + 16) / 3, rtol=1e-5
    )


def test_a_gamma_and_the_common_denominator(tmp_path):
    codes = np.full_like(CODES, 128)
    numbers = struct.pack(">IIIiiIii", 100, 0, 300, 0, 300, 200, 0, 0)
    part = segment(b"urn:iso:std:iso:ts:21496:-1\0" + struct.pack(">HHB", 0, 0, 8) + numbers, 0xE2)
    np.testing.assert_allclose(
        shot(tmp_path, part, codes=codes).gains, 2 ** (3 * (128 / 255) ** 0.5), rtol=1e-4
    )


def test_the_map_goes_before_the_guess(tmp_path):
    found = shot(tmp_path, KINDS["Ultra HDR"][0])
    depth = np.ones((HEIGHT, WIDTH), np.float32)
    lens = dofsim.Lens.from_disparity(strength_px=0.0, focus=0.0)
    light = photo.render(found, depth, lens, restore_highlights=True, depth_range=(0.0, 2.0))
    assert light[30, 40].max() == pytest.approx(8.1, rel=0.02)


def test_apples_headroom_stands_in_its_notes():
    def exif(strong, local):
        entries = struct.pack(">HHII", 33, 10, 1, 42) + struct.pack(">HHII", 48, 10, 1, 50)
        values = struct.pack(">iiii", round(strong * 1000), 1000, round(local * 1000), 1000)
        found = Pillow.Exif()
        notes = b"Apple iOS\0\0\1MM" + struct.pack(">H", 2) + entries + bytes(2) + values
        found.get_ifd(0x8769)[0x927C] = notes
        return found.tobytes()

    assert _gain_map.headroom(exif(1.2, 0.0)) == pytest.approx(2.0**3.0)
    assert _gain_map.headroom(exif(0.5, 0.0)) == pytest.approx(2.0**1.8)
    assert _gain_map.headroom(exif(1.2, 1.0)) == pytest.approx(2.0**2.0)
    assert _gain_map.headroom(None) == 1.0
    assert _gain_map.headroom(b"nonsense") == 1.0
    picture = SimpleNamespace(
        info={"aux": {_gain_map.APPLE: [7]}}, get_aux_image=lambda i: np.full((4, 6), 255, np.uint8)
    )
    np.testing.assert_allclose(_gain_map.of_heif("a.heic", picture, exif(1.2, 0.0)), 8.0)


@pytest.mark.parametrize(
    "part",
    [
        packet(HDRGM + 'hdrgm:GainMapMax="many"'),
        packet(HDRGM + 'hdrgm:GainMapMax="1e9"'),
        packet(HDRGM + 'hdrgm:Gamma="0"'),
        packet(HDRGM + 'hdrgm:Gamma="1 2"'),
        iso_gain(*ISO[:4]),
        iso_gain(*ISO[:2], (0, 0), *ISO[3:]),
    ],
)
def test_nonsense_is_damaged(tmp_path, part):
    with pytest.raises(ValueError, match=r"in\.jpg: damaged file: its gain map"):
        shot(tmp_path, part)


def test_a_directory_whose_pictures_are_gone_is_none(tmp_path):
    path = tmp_path / "in.jpg"
    Pillow.fromarray(PICTURE).save(path)
    whole = len(path.read_bytes())
    with_further(path, gain_jpeg(CODES, KINDS["Ultra HDR"][0]))
    path.write_bytes(path.read_bytes()[: whole + 90])
    assert photo.read(path).gains is None


def test_pictures_of_other_libraries_have_none(tmp_path):
    first, second = Pillow.fromarray(PICTURE), Pillow.fromarray(CODES)
    first.save(tmp_path / "in.jpg", format="MPO", save_all=True, append_images=[second])
    assert photo.read(tmp_path / "in.jpg").gains is None


@pytest.mark.parametrize(
    ("gains", "text"),
    [
        (np.full((4, 6), np.nan), "gains must be finite and not negative; got NaN"),
        (np.full((4, 60), 2.0), "gains must have the shape of color, 96 x 64"),
        (np.ones((2, 4, 6)), "gains must have one layer; got 2"),
        (np.ones(6), "gains must have shape"),
    ],
)
def test_gains_that_are_none(gains, text):
    with pytest.raises(ValueError, match=text):
        dofsim.restore_highlights(PICTURE, gains=gains, transfer="srgb")


def test_gains_are_bounded_and_nothing_gets_darker():
    light = dofsim.restore_highlights(PICTURE, gains=np.full((4, 6), 1e6), transfer="srgb", max_gain=20.0)
    assert light.max() == pytest.approx(20.0, rel=1e-3)
    plain = dofsim.restore_highlights(PICTURE, gains=np.zeros((4, 6)), transfer="srgb")
    np.testing.assert_array_equal(plain, io.Image(PICTURE, "srgb", "none").to_linear())
