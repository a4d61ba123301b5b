"""The lenses that options and files give."""

import json

import dofsim
import pytest
from command_lines import LENS, LENS_OPTIONS, fails
from dofsim.cli import run


def lens_of(monkeypatch, *arguments):
    """Give the lens and the aperture that a command comes to."""
    calls = []

    def render(color, depth, lens, *, aperture=None, **_):
        calls.append((lens, aperture))
        return color

    monkeypatch.setattr(dofsim, "render", render)
    assert run(["render", "a.exr", "-o", "o.exr", *arguments]) == 0
    return calls[0]


def test_lens_of_a_camera(scene, monkeypatch):
    arguments = ["--focal-length-mm", "50", "--f-number", "1.8", "--focus-distance", "3"]
    lens, _ = lens_of(monkeypatch, *arguments)
    assert lens == dofsim.Lens.from_camera(focal_length_mm=50, f_number=1.8, focus_distance=3.0)
    lens, _ = lens_of(monkeypatch, *arguments, "--sensor-width-mm", "24")
    assert lens == dofsim.Lens.from_camera(
        focal_length_mm=50, f_number=1.8, focus_distance=3.0, sensor_width_mm=24
    )


def test_lens_of_a_file_and_options_beside_it(scene, tmp_path, monkeypatch):
    path = tmp_path / "lens.toml"
    path.write_text('aperture_radius = 0.03\nfocus_distance = 3\nfov = 40.0\nfov_axis = "y"\n')
    lens, aperture = lens_of(monkeypatch, "--lens", "lens.toml")
    assert lens == dofsim.Lens(**LENS, fov_axis="y")
    # Without a word of it, the method chooses its own.
    assert aperture is None
    lens, _ = lens_of(monkeypatch, "--lens", "lens.toml", "--focus-distance", "5")
    assert lens.focus_distance == 5.0
    path.write_text(path.read_text() + "[aperture]\nblades = 5\nrotation = 10.0\n")
    _, aperture = lens_of(monkeypatch, "--lens", "lens.toml", "--rotation", "20")
    assert aperture == dofsim.Aperture(blades=5, rotation=20.0)


def test_a_file_has_all_words_of_a_lens_and_an_aperture(scene, tmp_path, monkeypatch):
    path = tmp_path / "lens.toml"
    path.write_text(
        "focal_length_mm = 50\nf_number = 2\nfocus_distance = 3\nsensor = 'aps-c'\nbreathing = true\n"
        "tilt = [20.0, -5.0]\naxial_color = [-0.1, 0.0, 0.1]\ncat_eye = 0.5\nvignetting = 'full'\n"
        "[aperture]\nimage = 'a.png'\nratio = 2.0\n"
    )
    lens, aperture = lens_of(monkeypatch, "--lens", "lens.toml")
    camera = dofsim.Lens.from_camera(
        focal_length_mm=50, f_number=2, focus_distance=3.0, sensor="aps-c", breathing=True
    )
    flaws = {"axial_color": (-0.1, 0.0, 0.1), "cat_eye": 0.5, "vignetting": "full"}
    assert lens == camera.replace(tilt=(20.0, -5.0), **flaws)
    assert aperture == dofsim.Aperture(image="a.png", ratio=2.0)
    lens, _ = lens_of(monkeypatch, "--lens", "lens.toml", "--focus-at", "25,15")
    assert abs(dofsim.coc(scene[1], lens)[15, 25]) < 1e-4


def test_lens_over_relative_disparity(scene, tmp_path, monkeypatch):
    (tmp_path / "lens.toml").write_text("strength_px = 20.0\nfocus = 0.5\n")
    lens, _ = lens_of(monkeypatch, "--lens", "lens.toml", "--depth-kind", "disparity")
    assert lens == dofsim.Lens.from_disparity(strength_px=20.0, focus=0.5)
    (tmp_path / "lens.toml").write_text("strength_percent = 2.0\nfocus = 0.5\n")
    lens, _ = lens_of(monkeypatch, "--lens", "lens.toml", "--depth-kind", "relative")
    assert lens == dofsim.Lens.from_disparity(strength_percent=2.0, focus=0.5)


def test_focus_at_a_pixel(scene, monkeypatch):
    lens, _ = lens_of(monkeypatch, "--aperture-radius", "0.03", "--fov", "40", "--focus-at", "25,15")
    assert lens.focus_distance == pytest.approx(1.5)
    assert lens == dofsim.Lens(**LENS).replace(focus_distance=lens.focus_distance)
    # The field of view of a camera depends on its focus.
    lens, _ = lens_of(monkeypatch, "--focal-length-mm", "50", "--f-number", "2", "--focus-at", "25,15")
    camera = dofsim.Lens.from_camera(focal_length_mm=50, f_number=2.0, focus_distance=1.5)
    assert (lens.focus_distance, lens.fov) == pytest.approx((1.5, camera.fov))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--aperture-radius --focus-distance --fov missing"),
        (["--fov", "40", "--focus-distance", "3"], "--aperture-radius missing"),
        (["--f-number", "2", "--focus-distance", "3"], "--focal-length-mm missing"),
        ([*LENS_OPTIONS, "--f-number", "2"], "--aperture-radius --fov cannot be given with --f-number"),
        (["--lens", "no.toml"], "no.toml: No such file"),
        (["--lens", "a.exr"], "a.exr: not a TOML file"),
    ],
)
def test_lenses_that_are_none(scene, capsys, arguments, message):
    assert message in fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *arguments)


def test_cameras_of_other_programs_are_lens_files(scene, tmp_path, monkeypatch):
    words = {"lens": 50.0, "fstop": 1.8, "focus_distance": 2.0, "sensor_width": 36.0, "aperture_blades": 7}
    (tmp_path / "camera.json").write_text(json.dumps(words))
    lens, aperture = lens_of(monkeypatch, "--lens", "camera.json")
    assert lens == dofsim.Lens.from_blender(words)
    assert aperture == dofsim.Aperture.from_blender(words)
    lens, aperture = lens_of(monkeypatch, "--lens", "camera.json", "--focus-distance", "3", "--blades", "5")
    assert lens == dofsim.Lens.from_blender(words).replace(focus_distance=3.0)
    assert aperture.blades == 5
    (tmp_path / "scene.xml").write_text(
        '<scene version="3.0.0"><sensor type="thinlens"><float name="fov" value="40"/>'
        '<float name="aperture_radius" value="0.1"/><float name="focus_distance" value="3"/></sensor></scene>'
    )
    lens, aperture = lens_of(monkeypatch, "--lens", "scene.xml")
    assert lens == dofsim.Lens.from_mitsuba(str(tmp_path / "scene.xml"))
    assert aperture is None
