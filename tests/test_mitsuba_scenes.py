"""`dofsim.mitsuba`: what is read off a scene's own sensor, and what is rendered of it."""

import subprocess
import sys
from functools import cache

import numpy as np
import pytest

mi = pytest.importorskip("mitsuba", reason="Mitsuba 3 is the reference: pip install mitsuba")

import dofsim  # noqa: E402
from dofsim import io, metrics  # noqa: E402
from dofsim.mitsuba import compare, find_llvm, rgbd  # noqa: E402
from dofsim.mitsuba._coverage import merged  # noqa: E402
from scenes.variant import choose_variant  # noqa: E402

WIDTH, HEIGHT = 48, 36
# Somewhere, looking askance.
ORIGIN, TARGET = np.array([1.0, 2.0, -3.0]), np.array([0.5, 1.6, 4.0])


@pytest.fixture(autouse=True)
def variant():
    choose_variant("scalar_rgb")


def glow(radiance):
    return {"emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}}}


THIN_LENS = {"type": "thinlens", "aperture_radius": 0.05, "focus_distance": 3.0}


def words(camera=THIN_LENS, **sensor):
    """Describe a wall with a ball before it, in world coordinates, and a ball between the two."""
    towards = (TARGET - ORIGIN) / np.linalg.norm(TARGET - ORIGIN)
    transform = mi.ScalarTransform4f()
    wall = transform.look_at(
        target=list(ORIGIN), origin=list(ORIGIN + 9.0 * towards), up=[0, 1, 0]
    ) @ transform.scale(20.0)
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "camera": {
            "fov": 40.0,
            "fov_axis": "y",
            "to_world": transform.look_at(origin=list(ORIGIN), target=list(TARGET), up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT},
        }
        | camera
        | sensor,
        "wall": {"type": "rectangle", "to_world": wall, **glow([0.2, 0.4, 0.6])},
        "near": {"type": "sphere", "center": list(ORIGIN + 3.0 * towards), "radius": 0.5, **glow([3, 1, 1])},
        "far": {"type": "sphere", "center": list(ORIGIN + 6.0 * towards), "radius": 0.5, **glow([1, 2, 1])},
    }


@cache
def shot():
    return rgbd(words(), spp=4)


def test_depth_is_planar_and_at_pixel_centres():
    """The wall faces the camera: all of it is as far. The ball's depth follows from its equation."""
    depth = shot().depth
    assert depth[0, 0] == pytest.approx(9.0, rel=1e-5)
    assert depth[0, -1] == pytest.approx(9.0, rel=1e-5)
    focal_px = 0.5 * HEIGHT / np.tan(np.radians(20.0))
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    right, down = (x + 0.5 - WIDTH / 2) / focal_px, (y + 0.5 - HEIGHT / 2) / focal_px
    # |z (right, down, 1) - (0, 0, 3)| = 1/2
    a = 1.0 + right**2 + down**2
    root = 36.0 - 4.0 * a * (9.0 - 0.25)
    expected = np.where(root > 0.0, (6.0 - np.sqrt(np.maximum(root, 0.0))) / (2.0 * a), 9.0)
    np.testing.assert_allclose(depth, expected, rtol=1e-4)


def test_lens_is_the_sensors():
    lens = shot().lens
    assert lens.aperture_radius == pytest.approx(0.05)
    assert lens.focus_distance == pytest.approx(3.0)
    y_fov = 2.0 * np.degrees(np.arctan(np.tan(np.radians(0.5 * lens.fov)) * HEIGHT / WIDTH))
    assert y_fov == pytest.approx(40.0, rel=1e-5)


def test_color_is_the_pinholes():
    color, depth, _ = shot()
    np.testing.assert_allclose(color[0, 0], [0.2, 0.4, 0.6], rtol=1e-5)
    np.testing.assert_allclose(color[HEIGHT // 2, WIDTH // 2], [3.0, 1.0, 1.0], rtol=1e-5)
    on_ball = (depth < 4.0).astype(float)
    # A pixel's colour is the mean over its square: only at the ball's edge is it neither.
    mixed = (color[..., 0] > 0.21) & (color[..., 0] < 2.99)
    edge = np.abs(np.gradient(on_ball)[0]) + np.abs(np.gradient(on_ball)[1]) > 0
    assert mixed.any()
    assert edge[mixed].all()


def test_unpacks_into_what_render_takes():
    capture = shot()
    np.testing.assert_array_equal(dofsim.render(*capture), capture.render())
    assert not np.array_equal(capture.render(), capture.render(capture.lens.replace(focus_distance=6.0)))


XML = """<scene version="3.0.0">
    <integrator type="path"/>
    <sensor type="thinlens">
        <float name="fov" value="40"/><float name="aperture_radius" value="0.1"/>
        <float name="focus_distance" value="3"/>
        <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/></film>
    </sensor>
    <shape type="sphere">
        <point name="center" x="0" y="0" z="4"/>
        <emitter type="area"><rgb name="radiance" value="1, 2, 3"/></emitter>
    </shape>
</scene>
"""


def test_takes_loaded_scenes_dictionaries_and_files(tmp_path):
    path = tmp_path / "scene.xml"
    path.write_text(XML)
    scene = {
        "type": "scene",
        "integrator": {"type": "path"},
        "camera": {
            "type": "thinlens",
            "fov": 40.0,
            "aperture_radius": 0.1,
            "focus_distance": 3.0,
            "film": {"type": "hdrfilm", "width": 24, "height": 16},
        },
        "ball": {"type": "sphere", "center": [0, 0, 4], **glow([1, 2, 3])},
    }
    expected = rgbd(scene, spp=4)
    assert expected.depth.min() == pytest.approx(3.0, rel=1e-2)
    for same in (mi.load_dict(scene), path, str(path)):
        color, depth, lens = rgbd(same, spp=4)
        np.testing.assert_allclose(depth, expected.depth, rtol=1e-5)
        np.testing.assert_allclose(color, expected.color, rtol=1e-5)
        assert lens == expected.lens


def test_moved_principal_points_stay_moved():
    capture = rgbd(words({"type": "perspective"}, principal_point_offset_x=0.25), spp=4)
    # The picture moves to the left by a quarter of its width.
    np.testing.assert_allclose(
        capture.depth[:, : WIDTH // 2], shot().depth[:, WIDTH // 4 : -WIDTH // 4], rtol=1e-4
    )
    assert capture.lens.principal_point[0] == pytest.approx(-0.25)


def test_margins_and_finer_pixels_show_the_same():
    scene = words({"type": "perspective"}, principal_point_offset_y=0.1)
    wide, plain = rgbd(scene, spp=1, overscan=5, supersample=3), rgbd(scene, spp=1)
    assert wide.depth.shape == (3 * (HEIGHT + 10), 3 * (WIDTH + 10))
    np.testing.assert_allclose(wide.depth[1::3, 1::3][5:-5, 5:-5], plain.depth, rtol=1e-4)
    assert wide.render().shape == (HEIGHT, WIDTH, 3)


def check_layers(capture):
    """Check that the nearest surface is first, solids have no insides, and no surface is there twice."""
    middle = np.s_[:, HEIGHT // 2, WIDTH // 2]
    np.testing.assert_allclose(capture.depth[middle], [2.5, 5.5, 9.0, np.inf], rtol=2e-3)
    np.testing.assert_allclose(capture.color[middle][:, 3], [1, 1, 1, 0])
    np.testing.assert_allclose(
        capture.color[middle][:3, :3], [[3, 1, 1], [1, 2, 1], [0.2, 0.4, 0.6]], rtol=1e-5
    )
    assert np.isinf(capture.depth[1:, 0, 0]).all()
    np.testing.assert_allclose(capture.depth[0], shot().depth, rtol=1e-4)


def test_layers():
    capture = rgbd(words(), spp=1, layers=4)
    check_layers(capture)
    assert capture.render().shape == (HEIGHT, WIDTH, 4)


def test_surfaces_at_one_depth_are_one_and_hide_themselves():
    """Two rays of a pixel: one meets a ball, its other side and the wall, the other one the wall alone."""
    color, depth = np.zeros((2, 3, 1, 1, 4), np.float32), np.full((2, 3, 1, 1), np.inf, np.float32)
    depth[0, :, 0, 0], depth[1, 0, 0, 0] = [2.0, 2.02, 10.0], 10.2
    color[0, :, 0, 0] = [[4, 0, 0, 1], [0, 4, 0, 1], [0, 0, 4, 1]]
    color[1, 0, 0, 0] = [0, 0, 2, 1]
    out, out_depth = merged(color, depth, gap=0.02)
    np.testing.assert_allclose(out[:, 0, 0], [[2, 0, 0, 0.5], [0, 0, 3, 1], [0, 0, 0, 0]])
    np.testing.assert_allclose(1 / out_depth[:2, 0, 0], [1 / 2.0, (1 / 10.0 + 1 / 10.2) / 2], rtol=1e-6)
    assert np.isinf(out_depth[2, 0, 0])
    apart, _ = merged(color, depth, gap=0.001)
    np.testing.assert_allclose(apart[:, 0, 0, 3], [0.5, 0.5, 1.0])


def test_what_there_is_no_layer_for_is_in_the_last_one():
    color, depth = np.ones((4, 2, 1, 1, 4), np.float32), np.full((4, 2, 1, 1), np.inf, np.float32)
    depth[:, 0, 0, 0] = [1.0, 2.0, 4.0, np.inf]
    color[:, 1] = 0.0
    out, out_depth = merged(color, depth, gap=0.01)
    np.testing.assert_allclose(out[:, 0, 0, 3], [0.25, 0.75])
    np.testing.assert_allclose(1 / out_depth[:, 0, 0], [1.0, (1 / 2 + 1 / 4 + 0) / 3])


def test_alpha_is_the_part_of_a_pixel_that_a_surface_covers():
    color, depth, _ = rgbd(words(), spp=36, layers=3)
    near = np.abs(depth - 2.5) < 0.6
    covered = np.where(near, color[..., 3], 0.0).sum(axis=0)
    rays = rgbd(words(), spp=1, supersample=6).depth < 3.2
    wanted = rays.reshape(HEIGHT, 6, WIDTH, 6).mean(axis=(1, 3))
    assert np.abs(covered - wanted).max() < 0.08
    assert ((covered > 0.1) & (covered < 0.9)).sum() > 20
    # The pinhole sees what it sees of all layers over one another.
    seen, passing = np.zeros((HEIGHT, WIDTH, 3)), np.ones((HEIGHT, WIDTH, 1))
    for layer in color:
        seen += passing * layer[..., :3]
        passing = passing * (1 - layer[..., 3:])
    np.testing.assert_allclose(passing, 0.0, atol=1e-6)
    beauty = rgbd(words(), spp=36).color
    assert np.abs(seen - beauty).mean() < 0.01


def test_a_lamp_that_few_rays_meet_has_its_light():
    # A third of a pixel wide.
    towards = (TARGET - ORIGIN) / np.linalg.norm(TARGET - ORIGIN)
    lamp = {"type": "sphere", "center": list(ORIGIN + 4.0 * towards + [0.05, 0.03, 0.0]), "radius": 0.014}
    scene = words() | {"lamp": lamp | {"emitter": {"type": "area", "radiance": 4000.0}}}
    del scene["near"], scene["far"]
    color, _, _ = rgbd(scene, spp=16, layers=2)
    beauty = rgbd(scene, spp=16).color[..., 0]
    assert beauty.max() > 100.0
    assert color[0, ..., 0].sum() == pytest.approx(beauty.sum(), rel=0.02)


def test_layers_in_focus_are_as_smooth_as_one():
    scene = words()
    del scene["near"], scene["far"]
    checks = {
        "type": "checkerboard",
        "color0": 0.1,
        "color1": 0.9,
        "to_uv": mi.ScalarTransform4f().scale(600),
    }
    scene["wall"]["emitter"] = {"type": "area", "radiance": checks}
    several, single = rgbd(scene, spp=9, layers=2), rgbd(scene, spp=9)
    np.testing.assert_array_equal(several.color[0, ..., :3], single.color)
    np.testing.assert_array_equal(several.color[1:], 0.0)
    assert rgbd(scene, spp=1, layers=2).color[0, ..., 0].std() > 2.0 * single.color[..., 0].std()


def test_colors_of_a_surface_that_ends_before_nothing_are_its_own():
    scene = words()
    del scene["wall"], scene["far"]
    color, depth, _ = rgbd(scene, spp=16, layers=2)
    ball = np.isfinite(depth[0])
    assert 0 < ball.sum() < ball.size
    covered = color[0][ball][:, 3:]
    assert ((covered > 0.0) & (covered < 1.0)).any()
    np.testing.assert_allclose(color[0][ball], covered * [[3.0, 1.0, 1.0, 1.0]], rtol=1e-5)
    np.testing.assert_array_equal(color[0][~ball], 0.0)


@pytest.mark.skipif(
    find_llvm() is None, reason="no LLVM that Mitsuba can use is installed (Debian: libllvm19)"
)
def test_vectorised_variants_give_the_same():
    choose_variant("llvm_ad_rgb")
    check_layers(rgbd(words(), spp=1, layers=4))
    np.testing.assert_allclose(rgbd(words(), spp=1).depth, shot().depth, rtol=1e-4)


def test_the_sky_is_a_layer_at_infinity():
    scene = words() | {"sky": {"type": "constant", "radiance": 0.5}}
    del scene["wall"]
    capture = rgbd(scene, spp=2, layers=3)
    assert np.isinf(capture.depth[0, 0, 0])
    np.testing.assert_allclose(capture.color[0, 0, 0], [0.5, 0.5, 0.5, 1.0], rtol=1e-5)
    np.testing.assert_allclose(capture.color[2, HEIGHT // 2, WIDTH // 2], [0.5, 0.5, 0.5, 1.0], rtol=1e-5)
    np.testing.assert_allclose(capture.color[1:, 0, 0], 0.0)
    if find_llvm():
        choose_variant("llvm_ad_rgb")
        vectorised = rgbd(scene, spp=2, layers=3)
        np.testing.assert_allclose(vectorised.color[0, 0, 0], [0.5, 0.5, 0.5, 1.0], rtol=1e-5)


@cache
def comparison():
    return compare(words(aperture_radius=0.6), spp=200, pinhole_spp=16)


def test_compare_measures_against_the_thin_lens():
    found = comparison()
    inside = {"border": found.border, "mask": found.masks["near edges"]}
    assert found.distances["near edges"].psnr == metrics.psnr(found.picture, found.reference, **inside)
    # Through a lens focused elsewhere it is farther from the reference.
    other = found.capture.render(found.capture.lens.replace(focus_distance=9.0))
    apart = metrics.psnr(other, found.reference, border=found.border)
    assert found.distances["overall"].psnr > apart + 5.0
    assert found.noise.psnr > found.distances["overall"].psnr
    assert all(seconds > 0.0 for seconds in found.seconds.values())


def test_compare_prints_and_plots():
    found = comparison()
    lines = str(found).splitlines()
    assert f"{found.distances['overall'].psnr:.2f}" in lines[1]
    assert lines[-1].startswith("dofsim ")
    assert len(found.plot().axes) == 5


@pytest.mark.parametrize(
    ("call", "words_of_error"),
    [
        (lambda: rgbd(words(), spp=0), "spp"),
        (lambda: rgbd(words(), layers=0), "layers"),
        (lambda: rgbd(words(), sensor=1), "sensor"),
        (lambda: rgbd(words(film={"type": "hdrfilm", "width": 48, "height": 36, "crop_width": 20})), "crop"),
        (lambda: rgbd({"type": "scene", "camera": {"type": "orthographic"}}), "thinlens"),
        (lambda: compare(words({"type": "perspective"})), "thinlens"),
        (lambda: compare(words(), spp=1), "spp"),
    ],
)
def test_bad_values_are_named(call, words_of_error):
    with pytest.raises(ValueError, match=words_of_error):
        call()


def test_what_is_no_scene_is_refused():
    with pytest.raises(TypeError, match="scene"):
        rgbd(3)


def test_other_variants_are_refused():
    choose_variant("scalar_spectral")
    with pytest.raises(ValueError, match="scalar_spectral"):
        rgbd({"type": "scene"})


def test_without_mitsuba_the_error_says_what_to_install():
    code = "import sys; sys.modules['mitsuba'] = None; import dofsim.mitsuba"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "pip install '.[mitsuba]'" in result.stderr


# Cards, glass, and scenes that are none


def card(z, radiance, opacity=None, **bsdf):
    """Describe a card before the camera at the origin, which looks along +z."""
    turned = mi.ScalarTransform4f().translate([0, 0, z]).rotate([0, 1, 0], 180).scale(z)
    diffuse = bsdf or {"type": "diffuse", "reflectance": 0.0}
    words = {"type": "rectangle", "to_world": turned, "bsdf": {"type": "twosided", "b": diffuse}}
    if opacity is not None:
        words["bsdf"] = {"type": "mask", "opacity": opacity, "b": words["bsdf"]}
    return words | glow(radiance)


def straight(**shapes):
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "camera": {
            "type": "thinlens", "fov": 60.0, "aperture_radius": 0.05, "focus_distance": 2.0,
            "film": {"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {"type": "box"}},
        },
        **shapes,
    }  # fmt: skip


def halves_of_a_leaf():
    """Describe an opacity: 1 on one half of a card, 0.2 on the other."""
    values = np.full((64, 64, 1), 0.2, np.float32)
    values[:, :32] = 1.0
    return {"type": "bitmap", "bitmap": mi.Bitmap(values), "raw": True, "filter_type": "nearest"}


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_rgb"])
def test_rays_pass_through_the_transparent_part_of_a_mask(variant):
    if variant.startswith("llvm"):
        if find_llvm() is None:
            pytest.skip("there is no LLVM for Mitsuba")
        choose_variant(variant)
    scene = straight(leaf=card(2.0, [1, 0, 0], halves_of_a_leaf()), wall=card(5.0, [0, 1, 0]))
    depth = rgbd(scene, spp=1).depth
    on_leaf = np.isclose(depth, 2.0, rtol=1e-4)
    assert on_leaf.sum() == depth.size // 2
    np.testing.assert_allclose(depth[~on_leaf], 5.0, rtol=1e-4)
    # Of layers, the wall is the second one behind the leaf, and the first one beside it.
    color, layers, _ = rgbd(scene, spp=1, layers=2)
    np.testing.assert_allclose(layers[0], depth, rtol=1e-5)
    np.testing.assert_allclose(layers[1][on_leaf], 5.0, rtol=1e-4)
    assert np.isinf(layers[1][~on_leaf]).all()
    assert (color[1][~on_leaf] == 0.0).all()


def test_cards_with_a_mask_count_from_both_sides():
    """The second of two leaves shows its back."""
    back = card(3.0, [0, 0, 1], 1.0)
    back["to_world"] = mi.ScalarTransform4f().translate([0, 0, 3]).scale(3)
    scene = straight(leaf=card(2.0, [1, 0, 0], halves_of_a_leaf()), back=back, wall=card(5.0, [0, 1, 0]))
    _, depth, _ = rgbd(scene, spp=1, layers=3)
    on_leaf = np.isclose(depth[0], 2.0, rtol=1e-4)
    np.testing.assert_allclose(depth[1][on_leaf], 3.0, rtol=1e-4)
    np.testing.assert_allclose(depth[2][on_leaf], 5.0, rtol=1e-4)
    np.testing.assert_allclose(depth[0][~on_leaf], 3.0, rtol=1e-4)


def test_glass_and_mirrors_are_named():
    def ball(name, x, bsdf):
        return {name: {"type": "sphere", "center": [x, 0, 3], "radius": 0.3, "bsdf": bsdf}}

    shapes = ball("window", -1, {"type": "dielectric"}) | ball("knob", 0, {"type": "conductor"})
    shapes |= ball("cup", 1, {"type": "plastic"}) | ball("paper", 2, {"type": "diffuse"})
    with pytest.warns(
        UserWarning, match=r"glass or mirrors, knob \(.*\), window \(.*\): what they show"
    ) as caught:
        rgbd(straight(**shapes, wall=card(5.0, [1, 1, 1])), spp=1)
    assert "cup" not in str(caught[0].message)


def test_a_scene_without_a_sensor():
    with pytest.raises(ValueError, match="the scene has no sensor; add a thinlens"):
        rgbd({"type": "scene", "wall": card(5.0, [1, 1, 1])})


def test_a_reference_that_is_there_is_taken(tmp_path, capsys):
    scene = straight(ball={"type": "sphere", "center": [0, 0, 3], "radius": 0.5, **glow([1, 1, 1])})
    first = compare(scene, spp=16, pinhole_spp=16)
    assert first.noise is not None
    assert "reference's noise" in str(first)
    assert "pinhole's noise" in str(first)
    io.write_image(tmp_path / "r.exr", first.reference)
    for reference in (first.reference, tmp_path / "r.exr"):
        again = compare(scene, pinhole_spp=16, reference=reference)
        assert again.noise is None
        assert "reference's noise" not in str(again)
        assert set(again.seconds) == {"dofsim", "pinhole and depth"}
        assert again.distances == first.distances
    with pytest.raises(ValueError, match=r"reference must have the scene's size, \(32, 32, 3\)"):
        compare(scene, reference=np.zeros((32, 31, 3)))
    assert capsys.readouterr().err == ""


def test_a_bar_shows_how_far_mitsuba_is(capsys):
    scene = straight(ball={"type": "sphere", "center": [0, 0, 3], "radius": 0.5, **glow([1, 1, 1])})
    compare(scene, spp=16, pinhole_spp=4, progress=True)
    said = capsys.readouterr().err
    assert "Mitsuba" in said
    assert "100%" in said


def test_captures_and_comparisons_show_themselves():
    scene = straight(ball={"type": "sphere", "center": [0, 0, 3], "radius": 0.5, **glow([1, 1, 1])})
    comparison = compare(scene, spp=16, pinhole_spp=4)
    assert repr(comparison).startswith("<Comparison of 32 x 32 pixels: PSNR")
    assert "data:image/png" in comparison._repr_html_()
    assert "overall" in comparison._repr_html_()
    for layers in (1, 2):
        capture = rgbd(scene, spp=1, layers=layers)
        assert "32 x 32 pixels" in repr(capture)
        assert len(repr(capture)) < 250
        assert capture._repr_png_().startswith(b"\x89PNG")


def test_views_around_the_lens_see_what_the_pinhole_does_not():
    scene = words({"type": "thinlens", "aperture_radius": 0.4, "focus_distance": 9.0})
    capture = rgbd(scene, spp=16, views=6)
    assert capture.color.shape == (2, HEIGHT, WIDTH, 4)
    np.testing.assert_array_equal(capture.color[0, ..., :3], rgbd(scene, spp=16).color)
    np.testing.assert_array_equal(capture.depth[0], rgbd(scene, spp=16).depth)
    behind = capture.color[1, ..., 3] > 0.0
    assert behind.sum() > 40
    # What the near ball hides is the wall, or the far ball.
    assert set(np.round(capture.depth[1][behind])) <= {6.0, 9.0}
    found = compare(scene, spp=64, views=6, pinhole_spp=16, progress=False)
    assert found.one_layer is not None
    # One layer is taken apart at every edge, the first of several beside lamps alone. In so small a picture
    # that is worth more than what is hidden.
    assert found.distances["overall"].psnr > found.one_layer.psnr - 0.5
    assert "overall, one layer" in str(found)
    assert "pinhole, 6 views and depths" in found.seconds
    wider = rgbd(scene, spp=4, views=4, overscan=8, supersample=2)
    assert wider.color.shape[1:] == (2 * (HEIGHT + 16), 2 * (WIDTH + 16), 4)
    assert wider.render().shape == (HEIGHT, WIDTH, 4)
    assert len(wider.color) > 1


def test_views_are_of_a_lens_and_take_the_place_of_layers():
    for options, message in (
        ({"layers": 2}, "views and layers exclude each other; got 2 views and 2 layers"),
        ({"camera": {"type": "perspective"}}, "views are points of a lens, and sensor 0 is a pinhole; got 2"),
    ):
        scene = words(options.pop("camera", THIN_LENS))
        with pytest.raises(ValueError, match=message):
            rgbd(scene, views=2, **options)
    with pytest.raises(ValueError, match="views must be at least 0; got -1"):
        rgbd(words(), views=-1)
