"""Which channels of an OpenEXR file are taken for the picture and the depth."""

import numpy as np
import OpenEXR
import pytest
from dofsim import io


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
    ],
)
def test_depth_that_is_not_the_only_choice_is_an_error_that_lists_them(tmp_path, parts, named):
    write(tmp_path / "a.exr", *parts)
    with pytest.raises(ValueError, match=f"a.exr: .*{', '.join(named)}"):
        io.read_depth(tmp_path / "a.exr")


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
