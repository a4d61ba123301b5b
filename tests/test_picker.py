"""`dofsim.FocusPicker` without a browser: requests go in, frames come out."""

import base64
import io
import subprocess
import sys

import dofsim
import numpy as np
import pytest
from PIL import Image

pytest.importorskip("anywidget", reason="FocusPicker needs anywidget: pip install anywidget")

from dofsim import metrics

LENS = dofsim.Lens(aperture_radius=0.05, focus_distance=3.0, fov=42.0)
WIDTH, HEIGHT = 1100, 620
NEAR, FAR = (100, 300), (1000, 300)


@pytest.fixture(scope="module")
def scene():
    """Noise, near on the left and far on the right."""
    color = np.random.default_rng(5).random((HEIGHT, WIDTH, 3), np.float32)
    depth = np.full((HEIGHT, WIDTH), 1.5, np.float32)
    depth[:, WIDTH // 2 :] = 6.0
    return color, depth


@pytest.fixture
def picker(scene):
    return dofsim.FocusPicker(*scene, LENS)


def ask(picker, **change):
    """Do what the browser does."""
    request = picker._request
    picker.set_state({"_request": {**request, "dragging": False, **change, "number": request["number"] + 1}})
    return picker._frame


def pixels(png):
    return np.asarray(Image.open(io.BytesIO(png))).astype(int)


def codes(linear):
    return np.rint(255.0 * metrics.srgb(linear)).astype(int)


def test_a_click_focuses_on_the_depth_there(picker, scene):
    for x, y in (NEAR, FAR):
        frame = ask(picker, focus=[x, y])
        assert picker.lens.focus_distance == pytest.approx(scene[1][y, x], rel=1e-6)
        assert picker.lens == LENS.focused_at(scene[1], x, y)
        assert frame["repr"] == repr(picker.lens)
        assert frame["number"] == picker._request["number"]


def test_the_frame_is_the_picture_through_the_lens(picker, scene):
    frame = ask(picker, focus=list(FAR))
    np.testing.assert_array_equal(pixels(frame["picture"]), codes(dofsim.render(*scene, picker.lens)))
    np.testing.assert_array_equal(pixels(frame["pinhole"]), codes(scene[0]))
    np.testing.assert_array_equal(codes(picker.render()), pixels(frame["picture"]))
    assert frame["full"]


def test_a_range_in_focus_stays_until_a_click_and_the_blur_is_bounded(scene):
    lens = LENS.replace(in_focus=(1.0, 2.0))
    picker = dofsim.FocusPicker(*scene, lens, max_coc_px=9.0)
    frame = ask(picker, exposure=0.0)
    expected = dofsim.render(*scene, lens, max_coc_px=9.0)
    np.testing.assert_array_equal(pixels(frame["picture"]), codes(expected))
    assert frame["readout"].startswith("focused at 1 m to 2 m")
    frame = ask(picker, focus=list(FAR))
    assert picker.lens == LENS.focused_at(scene[1], *FAR)
    expected = dofsim.render(*scene, picker.lens, max_coc_px=9.0)
    np.testing.assert_array_equal(pixels(frame["picture"]), codes(expected))


def test_a_bad_pixel_is_filled_if_that_was_said(scene):
    color, depth = scene
    color = color.copy()
    color[40, 50] = np.nan
    with pytest.warns(UserWarning, match="color has 1 pixel "):
        picker = dofsim.FocusPicker(color, depth, LENS, invalid_color="fill")
    with pytest.warns(UserWarning, match="color has 1 pixel "):
        frame = ask(picker, focus=list(FAR))
    assert pixels(frame["pinhole"])[40, 50].tolist() == [0, 0, 0]


def test_dragging_shows_a_reduced_picture(picker):
    frame = ask(picker, focus=list(NEAR), dragging=True)
    picture = pixels(frame["picture"])
    assert max(picture.shape) <= 512
    assert pixels(frame["pinhole"]).shape == picture.shape
    assert not frame["full"]
    whole = pixels(ask(picker)["picture"])
    assert whole.shape == (HEIGHT, WIDTH, 3)
    # The same but for what reducing does: means over squares of what is blurred are much the same.
    blocks = (
        whole[: HEIGHT // 3 * 3, : WIDTH // 3 * 3].reshape(HEIGHT // 3, 3, WIDTH // 3, 3, 3).mean(axis=(1, 3))
    )
    inside = np.s_[20:-20, WIDTH // 3 // 2 + 20 : -20]
    assert np.abs(blocks - picture)[inside].mean() < 3.0


def test_a_large_picture_is_shown_reduced_and_rendered_whole():
    """A page cannot decode tens of megabytes at each click."""
    width, height = 4200, 24
    color = np.random.default_rng(5).random((height, width, 3), np.float32)
    depth = np.full((height, width), 6.0, np.float32)
    depth[:, :70] = 1.5
    depth[5, 4001] = 2.5
    picker = dofsim.FocusPicker(color, depth, LENS.replace(aperture_radius=0.001))
    frame = ask(picker, focus=[4001, 5])
    # The focus is on that very pixel, which the reduced picture has not.
    assert picker.lens.focus_distance == pytest.approx(2.5)
    assert pixels(frame["picture"]).shape == (8, 1400, 3)
    assert picker.render().shape == color.shape


def test_the_sliders(picker, scene):
    ask(picker, stops=-2.0)
    assert picker.lens.aperture_radius == pytest.approx(0.025)
    frame = ask(picker, stops=0.0, blades=6, exposure=1.0)
    assert picker.aperture == dofsim.Aperture(blades=6)
    expected = dofsim.render(*scene, picker.lens, aperture=picker.aperture)
    np.testing.assert_array_equal(pixels(frame["picture"]), codes(2.0 * expected))
    np.testing.assert_array_equal(pixels(frame["pinhole"]), codes(2.0 * scene[0]))
    ask(picker, blades=2)
    assert picker.aperture == dofsim.Aperture()


def test_blades_keep_the_rest_of_the_opening(scene):
    opening = dofsim.Aperture(blades=5, rotation=10.0, roundness=0.5)
    picker = dofsim.FocusPicker(*scene, LENS, aperture=opening)
    ask(picker, blades=7)
    assert picker.aperture == dofsim.Aperture(blades=7, rotation=10.0, roundness=0.5)
    heart = dofsim.Aperture(image=np.eye(8))
    picker = dofsim.FocusPicker(*scene, LENS, aperture=heart)
    assert not picker._setup["hasBlades"]
    ask(picker, blades=7)
    assert picker.aperture == heart


def test_the_overlay_of_blur_is_red_in_front_blue_behind_and_clear_in_focus(picker, scene):
    assert ask(picker)["overlay"] is None
    colors = pixels(ask(picker, overlay="coc", focus=list(FAR))["overlay"])
    red, green, blue, cover = colors[NEAR[1], NEAR[0]]
    assert red > max(green, blue)
    assert cover > 128
    assert colors[FAR[1], FAR[0], 3] == 0
    red, green, blue, cover = pixels(ask(picker, focus=list(NEAR))["overlay"])[FAR[1], FAR[0]]
    assert blue > max(red, green)
    assert cover > 128


def test_the_outline_runs_around_what_is_sharp(picker, scene):
    line = pixels(ask(picker, overlay="outline", focus=list(FAR))["overlay"])[..., 3] > 0
    assert line[:, WIDTH // 2 - 1].all()
    assert line.sum() == HEIGHT


def test_a_picture_where_scripts_do_not_run(picker):
    picker.focus_at(*NEAR)
    data, _ = picker._repr_mimebundle_()
    still = pixels(base64.b64decode(data["image/png"]))
    assert max(still.shape) <= 512
    np.testing.assert_array_equal(still, pixels(ask(picker, dragging=True)["picture"]))
    assert repr(picker.lens) in data["text/plain"]
    assert "application/vnd.jupyter.widget-view+json" in data


def test_changes_can_be_observed(picker):
    seen = []
    picker.observe(lambda change: seen.append(change["new"].focus_distance), names="lens")
    picker.focus_at(*NEAR)
    picker.focus_at(*FAR)
    assert seen == pytest.approx([1.5, 6.0], rel=1e-6)


def test_a_pixel_without_depth_says_so_and_keeps_the_lens(scene):
    depth = scene[1].copy()
    depth[:50, :50] = np.nan
    picker = dofsim.FocusPicker(scene[0], depth, LENS, invalid="far")
    frame = ask(picker, focus=[10, 10])
    assert picker.lens == LENS
    assert "depth" in frame["readout"]
    with pytest.raises(ValueError, match="depth"):
        picker.focus_at(10, 10)


def test_lenses_over_relative_disparity(scene):
    lens = dofsim.Lens.from_disparity(strength_px=12.0, focus=0.5)
    picker = dofsim.FocusPicker(scene[0], 1.0 / scene[1], lens, depth_kind="disparity")
    picker.focus_at(*NEAR)
    assert picker.lens.focus == pytest.approx(1.0 / 1.5)
    ask(picker, stops=2.0)
    assert picker.lens.strength_px == pytest.approx(24.0)
    small = pixels(ask(picker, dragging=True, overlay="coc")["picture"])
    # The reduced picture is blurred by as many pixels fewer: what is left of its noise is as in the whole
    # one, reduced.
    far = np.s_[40:160, 240:340]
    whole = pixels(ask(picker)["picture"])[: HEIGHT // 3 * 3, : WIDTH // 3 * 3]
    reduced = whole.reshape(HEIGHT // 3, 3, WIDTH // 3, 3, 3).mean(axis=(1, 3))
    assert small[far].std() == pytest.approx(reduced[far].std(), rel=0.25)


def test_layers_and_integers(scene):
    color, depth = scene
    front = np.concatenate([color, np.ones_like(color[..., :1])], axis=-1)
    front[:, WIDTH // 2 :] = 0.0
    behind = np.concatenate([color, np.ones_like(color[..., :1])], axis=-1)
    layers = dofsim.FocusPicker(np.stack([front, behind]), np.stack([depth, np.full_like(depth, 6.0)]), LENS)
    np.testing.assert_array_equal(pixels(ask(layers, focus=list(FAR))["pinhole"]), codes(color))
    assert layers.lens.focus_distance == pytest.approx(6.0, rel=1e-6)
    eight = np.rint(255 * color).astype(np.uint8)
    picker = dofsim.FocusPicker(eight, depth, LENS, transfer="srgb")
    np.testing.assert_array_equal(pixels(ask(picker)["pinhole"]), eight)
    grey = dofsim.FocusPicker(color[..., 0], depth, LENS)
    assert pixels(ask(grey)["picture"]).shape == (HEIGHT, WIDTH, 3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"lens": LENS.replace(aperture_radius=0.0)}, "opening"),
        ({"color": np.zeros((HEIGHT, WIDTH, 3), np.uint8)}, "transfer"),
        ({"color": np.zeros((3, 4, 3), np.float32)}, "size"),
        ({"depth_kind": "metres"}, "depth_kind"),
        ({"method": "fast"}, "method"),
    ],
)
def test_bad_values_are_named(scene, change, words):
    given = {"color": scene[0], "depth": scene[1], "lens": LENS, **change}
    with pytest.raises(ValueError, match=words):
        dofsim.FocusPicker(given.pop("color"), given.pop("depth"), given.pop("lens"), **given)


def test_without_anywidget_the_error_says_what_to_install():
    code = "import sys; sys.modules['anywidget'] = None; import dofsim; dofsim.FocusPicker"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "pip install '.[notebook]'" in result.stderr
    with pytest.raises(AttributeError, match="Picker"):
        _ = dofsim.Picker


def test_the_script_asks_for_nothing_outside(picker):
    for text in (str(picker._esm), str(picker._css)):
        assert "http" not in text
        assert "import " not in text
        assert "@import" not in text
