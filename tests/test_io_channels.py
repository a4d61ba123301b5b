"""Which channels of an OpenEXR file are taken for the picture and the depth."""

import numpy as np
import OpenEXR
import pytest
from dofsim import io
from dofsim.cli import run


def write(path, *parts):
    """Write parts of named channels, each channel filled with its own number, and return these numbers."""
    numbers, written = {}, []
    for index, (name, channels) in enumerate(parts):
        planes = {}
        for channel in channels:
            numbers[index, channel] = len(numbers) + 1.0
            planes[channel] = np.full((2, 3), numbers[index, channel], np.float32)
        written.append(OpenEXR.Part({"type": OpenEXR.scanlineimage}, planes, name))
    with OpenEXR.File(written) as file:
        file.write(str(path))
    return numbers


RGB = ["R", "G", "B"]


def layer(name, words):
    return [f"{name}.{word}" for word in words]


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ([("", [*RGB, "A", "Z", "ZBack"])], (0, "Z")),
        ([("", [*RGB, "z"])], (0, "z")),
        # Rule 1 before rule 2.
        ([("", ["Z", "depth.Z"])], (0, "Z")),
        # Blender: the layers, and vectors that have a Z of their own.
        ([("", [*layer("ViewLayer.Combined", "RGBA"), "ViewLayer.Depth.Z", *layer("ViewLayer.Pos", "XYZ")])],
         (0, "ViewLayer.Depth.Z")),
        ([("", [*layer("Image", "RGBA"), "Depth.V"])], (0, "Depth.V")),
        ([("", ["depth.Y", *RGB])], (0, "depth.Y")),
        ([("", ["SceneDepth.R", "SceneDepth.G", "SceneDepth.B", *RGB])], (0, "SceneDepth.R")),
        # Rule 2 before rule 4.
        ([("", ["left.Z", "depth.V"])], (0, "depth.V")),
        ([("", [*RGB, "Depth"])], (0, "Depth")),
        ([("", [*RGB, "camera.zdepth"])], (0, "camera.zdepth")),
        ([("", [*RGB, "left.Z"])], (0, "left.Z")),
        # Mitsuba 3 names the distance dd.y.T, and has other AOVs beside it.
        ([("", [*RGB, "dd.y.T", *layer("nn", "XYZ")])], (0, "dd.y.T")),
        ([("", ["anything"])], (0, "anything")),
        # Parts: the name of the part comes before the channel.
        ([("beauty", RGB), ("depth", ["Y"])], (1, "Y")),
        ([("beauty", [*RGB, "Z"]), ("normal", ["X", "Y", "Z"])], (0, "Z")),
        ([("ViewLayer.Depth", ["ViewLayer.Depth.Z"]), ("rgba", RGB)], (0, "ViewLayer.Depth.Z")),
        # Other renderers.
        ([("", [*layer("Ci", "rgba"), "z", *layer("__Pworld", "rgb")])], (0, "z")),
        ([("", [*RGB, "zfiltered", *layer("albedo", "rgb")])], (0, "zfiltered")),
        ([("", [*layer("C", "RGBA"), "Pz", *layer("P", "xyz"), *layer("N", "xyz")])], (0, "Pz")),
        ([("", [*layer("C", "RGBA"), "hitPz"])], (0, "hitPz")),
        ([("", [*RGB, *layer("zbuffer", "RGB")])], (0, "zbuffer.R")),
        ([("", [*RGB, *layer("P", "XYZ"), *layer("N", "XYZ"), "dzdx", "dzdy"])], (0, "P.Z")),
        # A layer called depth goes before others whose names have the word in them.
        ([("", [*RGB, "V.Denoising Depth.Z", "V.Depth.Z", "V.Mist.Z"])], (0, "V.Depth.Z")),
        ([("", [*RGB, *layer("FinalImageWorldDepth", "RGBA"), "Z"])], (0, "Z")),
    ],
)  # fmt: skip
def test_depth_is_chosen_by_name(tmp_path, parts, expected):
    numbers = write(tmp_path / "a.exr", *parts)
    assert io.read_depth(tmp_path / "a.exr")[0, 0] == numbers[expected]


@pytest.mark.parametrize(
    ("parts", "named"),
    [
        ([("", [*RGB, "left.Z", "right.Z"])], ["left.Z", "right.Z"]),
        ([("", ["a.Depth.Z", "b.Depth.Z"])], ["a.Depth.Z", "b.Depth.Z"]),
        ([("a", ["Z"]), ("b", ["Z"])], ["a.Z", "b.Z"]),
        ([("", [*RGB, "A"])], ["A", "B", "G", "R"]),
        ([("", [*layer("normal", "XYZ")])], ["normal.X", "normal.Y", "normal.Z"]),
        ([("", ["u.T", "u.U", "Q"])], ["Q", "u.T", "u.U"]),
        ([("", [*RGB, "SceneDepth.R", "WorldDepth.R"])], ["SceneDepth.R", "WorldDepth.R"]),
        # World space, and no sign of pbrt.
        ([("", [*RGB, *layer("P", "XYZ")])], ["P.X", "P.Y", "P.Z"]),
    ],
)
def test_depth_that_is_not_the_only_choice_is_an_error_that_lists_them(tmp_path, parts, named):
    write(tmp_path / "a.exr", *parts)
    with pytest.raises(ValueError, match=f"a.exr: .*{', '.join(named)}"):
        io.read_depth(tmp_path / "a.exr")


@pytest.mark.parametrize("mist", ["ViewLayer.Mist.Z", "ViewLayer.Mist.V", "Mist.Y", "Mist"])
@pytest.mark.parametrize("color", [[], layer("ViewLayer.Combined", "RGBA")])
def test_mist_is_no_depth(tmp_path, mist, color):
    path = tmp_path / "a.exr"
    numbers = write(path, ("", [*color, mist]))
    with pytest.raises(ValueError, match=rf"a\.exr: {mist} is mist.*not depth"):
        io.read_depth(path)
    assert io.read_depth(path, channel=mist)[0, 0] == numbers[0, mist]


def test_what_was_chosen_is_said(tmp_path):
    names = layer("ViewLayer.Combined", "RGBA")
    write(tmp_path / "a.exr", ("", [*names, "ViewLayer.Depth.Z", "ViewLayer.Mist.Z"]))
    write(tmp_path / "z.exr", ("main", ["dist"]), ("other", ["Z"]))
    rgbd = io.read_rgbd(tmp_path / "a.exr")
    assert (rgbd.color_channels, rgbd.depth_channel) == (tuple(names), "ViewLayer.Depth.Z")
    assert io.read_color(tmp_path / "a.exr").channels == tuple(names)
    rgbd = io.read_rgbd(tmp_path / "a.exr", tmp_path / "z.exr", depth_channel="main.dist")
    assert (rgbd.color_channels, rgbd.depth_channel) == (tuple(names), "main.dist")
    io.write_image(tmp_path / "a.png", np.ones((2, 3, 3)))
    io.write_depth(tmp_path / "z.pfm", np.ones((2, 3)))
    rgbd = io.read_rgbd(tmp_path / "a.png", tmp_path / "z.pfm")
    assert (rgbd.color_channels, rgbd.depth_channel) == ((), None)


def test_commands_say_what_was_chosen(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    io.write_exr("a.exr", dict.fromkeys(["C.R", "C.G", "C.B", "Pz"], np.ones((4, 5))))
    lens = ["--aperture-radius", "0.01", "--focus-distance", "1", "--fov", "40"]
    assert run(["render", "a.exr", "-o", "o.exr", *lens]) == 0
    said = "a.exr: the picture is C.R, C.G, C.B\na.exr: the depth is Pz\no.exr: 5 x 4"
    assert capsys.readouterr().err.startswith(said)
    assert run(["coc", "a.exr", "-o", "o.exr", *lens]) == 0
    assert capsys.readouterr().err.startswith("a.exr: the depth is Pz\no.exr: ")


@pytest.mark.parametrize("suffix", ["png", "exr"])
def test_depth_in_colours_is_read_if_they_are_equal(tmp_path, suffix):
    path = tmp_path / f"z.{suffix}"
    grey = np.arange(6, dtype=np.uint8).reshape(2, 3)
    io.write_image(path, np.stack([grey] * 3, -1), transfer="linear" if suffix == "exr" else "srgb")
    expected = grey if suffix == "png" else grey / np.float32(255)
    np.testing.assert_array_equal(io.read_depth(path, scale=1), expected)
    io.write_image(path, np.stack([grey, grey, grey + 1], -1))
    with pytest.raises(ValueError, match="whose colours differ"):
        io.read_depth(path, scale=1)
    # A picture alone is no depth, however grey.
    io.write_image(path, np.stack([grey] * 3, -1))
    with pytest.raises(ValueError, match=r"no channel is the depth|holds no depth"):
        io.read_rgbd(path)


def test_long_lists_of_hostile_names_are_short_and_escaped(tmp_path):
    path = tmp_path / "a.exr"
    names = {f"{i}\x1b[31m\n{'x' * 200 if i == 1 else ''}": np.ones((2, 2)) for i in range(1000)}
    io.write_exr(path, names)
    for read in (io.read_depth, io.read_color, lambda path: io.read_depth(path, channel="Z")):
        with pytest.raises(ValueError, match="and 976 more") as caught:
            read(path)
        message = str(caught.value)
        assert message.isprintable()
        assert "0\\x1b[31m\\n, " in message
        assert len(message) < len(str(path)) + 1000
    with pytest.raises(ValueError, match="and 976 more"):
        io.read_exr(path, ["Z"])


def test_depth_channel_overrides(tmp_path):
    path = tmp_path / "a.exr"
    numbers = write(path, ("one", [*RGB, "Z", "dist"]), ("two", ["Z", "far"]))
    assert io.read_depth(path, channel="dist")[0, 0] == numbers[0, "dist"]
    assert io.read_depth(path, channel="two.Z")[0, 0] == numbers[1, "Z"]
    assert io.read_rgbd(path, depth_channel="FAR").depth[0, 0] == numbers[1, "far"]
    with pytest.raises(ValueError, match=r"several channels are called 'Z': one\.Z, two\.Z"):
        io.read_depth(path, channel="Z")
    with pytest.raises(ValueError, match=r"no channel 'q'; channels: one\.B"):
        io.read_depth(path, channel="q")


def test_depth_of_the_same_view_layer_comes_first(tmp_path):
    path = tmp_path / "a.exr"
    names = [c for view in ("near", "far") for c in [*layer(f"{view}.Combined", "RGBA"), f"{view}.Depth.Z"]]
    numbers = write(path, ("", names))
    rgbd = io.read_rgbd(path, layer="far.Combined")
    assert rgbd.depth[0, 0] == numbers[0, "far.Depth.Z"]
    assert rgbd.color[0, 0].tolist() == [numbers[0, f"far.Combined.{word}"] for word in "RGBA"]


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ([("", [*RGB, "Z"])], RGB),
        ([("", ["r", "g", "b", "Z"])], ["r", "g", "b"]),
        # Rule 1 before rule 2, rule 2 before rule 3.
        ([("", [*RGB, *layer("beauty", "RGB")])], RGB),
        ([("", [*layer("ViewLayer.Combined", "RGBA"), *layer("ViewLayer.DiffCol", "RGB")])],
         layer("ViewLayer.Combined", "RGBA")),
        ([("", [*layer("any", "RGB"), *layer("depth", "RGB")])], layer("any", "RGB")),
        ([("", ["Y", "A", "Z"])], ["Y", "A"]),
        ([("", ["grey.Y", "depth.Y"])], ["grey.Y"]),
        ([("rgba", [*RGB, "A"]), ("depth", ["Z"]), ("normal", ["X", "Y", "Z"])], [*RGB, "A"]),
        ([("", [*layer("Ci", "rgb"), *layer("__Pworld", "rgb"), "z"])], layer("Ci", "rgb")),
        ([("", [*layer("Composite.Combined", "RGBA"), *layer("ViewLayer.Combined", "RGBA")])],
         layer("Composite.Combined", "RGBA")),
        ([("", [*layer("final", "RGB"), *layer("N_normal", "RGB"), *layer("CryptoMaterial00", "rgba")])],
         layer("final", "RGB")),
    ],
)  # fmt: skip
def test_color_is_chosen_by_name(tmp_path, parts, expected):
    numbers = write(tmp_path / "a.exr", *parts)
    image = io.read_color(tmp_path / "a.exr")
    assert np.atleast_3d(image.pixels)[0, 0].tolist() == [numbers[0, name] for name in expected]
    assert image.alpha == ("premultiplied" if "A" in expected[-1] else "none")


def test_color_that_is_not_the_only_choice_is_an_error_that_lists_them(tmp_path):
    path = tmp_path / "a.exr"
    numbers = write(path, ("", [*layer("left", "RGB"), *layer("right", "RGB"), "depth.Z"]))
    with pytest.raises(ValueError, match=r"a\.exr: several layers.*left, right"):
        io.read_color(path)
    assert io.read_color(path, layer="RIGHT").pixels[0, 0, 0] == numbers[0, "right.R"]
    with pytest.raises(ValueError, match="no layer 'up'; layers: depth, left, right"):
        io.read_color(path, layer="up")
    with pytest.raises(ValueError, match=r"neither R G B nor Y; its channels: depth\.Z"):
        io.read_color(path, layer="depth")
    write(path, ("", ["Z"]))
    with pytest.raises(ValueError, match="no R G B and no Y channel; channels: Z"):
        io.read_color(path)


def test_layer_outside_any_layer_has_an_empty_name(tmp_path):
    numbers = write(tmp_path / "a.exr", ("", [*RGB, *layer("beauty", "RGB")]))
    assert io.read_color(tmp_path / "a.exr", layer="").pixels[0, 0, 0] == numbers[0, "R"]
