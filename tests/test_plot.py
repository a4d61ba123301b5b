"""Plots show the numbers that they are made from, and look as they did when a person looked at them."""

import base64
import io
import re

import dofsim
import numpy as np
import plots
import pytest
from dofsim import metrics, plot
from dofsim._blur import Blur
from dofsim.falsecolor import false_color
from PIL import Image

CAMERA = dofsim.Lens.from_camera(focal_length_mm=50, f_number=2.8, focus_distance=3.0)
SIZE = 960, 540

# Root mean square of the differences of code values, of 255, of pictures a quarter as large: fonts and
# layout move by a pixel or so between versions of matplotlib. Wrong colours, or a part that is missing, are
# above 10.
LOOKS_DIFFERENT = 6.0


def small(picture):
    grey = np.asarray(picture.convert("RGB"), dtype=float)
    rows, columns = (side // 4 * 4 for side in grey.shape[:2])
    return grey[:rows, :columns].reshape(rows // 4, 4, columns // 4, 4, 3).mean(axis=(1, 3))


def drawn(figure, **options):
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", **options)
    return Image.open(buffer)


@pytest.mark.parametrize("name", plots.PLOTS)
def test_looks_as_it_did(name):
    now = small(drawn(plots.PLOTS[name](), dpi=60))
    kept = small(Image.open(plots.BASELINE / f"{name}.png"))
    assert now.shape == kept.shape
    assert np.sqrt(np.mean((now - kept) ** 2)) < LOOKS_DIFFERENT


@pytest.mark.parametrize("lens", [CAMERA, CAMERA.replace(tilt=(40.0, 10.0), field_curvature=2.0)])
def test_blur_is_that_of_coc_and_of_the_camera(lens):
    blur = Blur.of(lens, SIZE)
    for distance in (0.7, 3.0, 20.0, np.inf):
        seen = dofsim.coc(np.full((SIZE[1], SIZE[0]), distance), CAMERA)[0, 0]
        assert float(blur.radius_px(distance)) == pytest.approx(seen, rel=1e-5, abs=1e-5)
    # A radius in pixels is a diameter in millimetres on the sensor.
    millimetres = 2.0 * 0.5 / SIZE[0] * 36.0
    assert blur.limits(0.5) == pytest.approx(CAMERA.depth_of_field(millimetres), rel=1e-5)
    # The camera counts from where the lens moves to when it is focused there, which is f / u nearer.
    assert blur.hyperfocal(0.5) == pytest.approx(CAMERA.hyperfocal_distance(millimetres), rel=0.02)


def test_blur_of_lenses_at_the_ends():
    far = Blur.of(CAMERA.replace(focus_distance=np.inf), SIZE)
    assert far.limits(0.5) == (pytest.approx(far.hyperfocal(0.5)), np.inf)
    assert Blur.of(CAMERA.replace(aperture_radius=0.0), SIZE).limits(0.5) == (0.0, np.inf)
    with pytest.raises(ValueError, match="metric"):
        plot.depth_of_field(dofsim.Lens.from_disparity(strength_px=3.0, focus=0.5))


def test_depth_of_field_draws_the_blur():
    ax = plot.depth_of_field(CAMERA, size=SIZE).axes[0]
    blur = Blur.of(CAMERA, SIZE)
    front, behind = (line.get_xydata() for line in ax.lines[1:3])
    for line, sign in ((front, -1.0), (behind, 1.0)):
        np.testing.assert_allclose(line[:, 1], sign * blur.radius_px(line[:, 0]), atol=1e-9)
    assert front[-1, 0] < 3.0 < behind[0, 0]


def test_coc_is_red_in_front_and_blue_behind():
    depth = np.full((20, 30), 2.0)
    depth[:, 10:20], depth[:, 20:] = plots.LENS.focus_distance / 2, np.inf
    figure = plot.coc(np.where(depth == 2.0, plots.LENS.focus_distance, depth), plots.LENS, limit_px=0.1)
    image = figure.axes[0].images[0]
    shown = image.to_rgba(image.get_array(), bytes=True)[..., :3]
    expected = false_color(np.sign(dofsim.coc(depth, plots.LENS)), 1.0)
    assert np.abs(shown[:, 10:].astype(int) - expected[:, 10:]).max() <= 1
    assert figure.axes[1].get_ylim() == (-0.1, 0.1)


def test_compare_writes_the_numbers_of_metrics():
    color, depth = plots.scene()
    other = 0.9 * color
    masks = {"card": depth < 1.21}
    table = plot.compare(other, color, masks=masks, border=3).axes[-1].tables[0]
    written = [table[1, column].get_text().get_text() for column in range(4)]
    assert written[0] == "card"
    assert float(written[1]) == pytest.approx(
        metrics.psnr(other, color, mask=masks["card"], border=3), abs=0.01
    )
    assert float(written[2]) == pytest.approx(
        metrics.ssim(other, color, mask=masks["card"], border=3), abs=1e-4
    )
    assert float(written[3]) == pytest.approx(
        metrics.flip(other, color, mask=masks["card"], border=3), abs=1e-4
    )


def test_plots_go_where_they_are_told():
    from matplotlib.figure import Figure

    mine = Figure()
    left, right = mine.subplots(1, 2)
    assert plot.coc(plots.scene()[1], plots.LENS, ax=left) is mine
    assert plot.depth_of_field(plots.LENS, ax=right) is mine
    assert left.images
    assert right.lines


def test_a_notebook_shows_a_figure():
    assert plot.coc(plots.scene()[1], plots.LENS)._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: plot.coc(plots.scene()[1], plots.LENS, limit_px=-1.0), "limit_px"),
        (lambda: plot.depth_of_field(CAMERA, sharp_radius_px=0.0), "sharp_radius_px"),
        (lambda: plot.depth_of_field(CAMERA, size=(0, 3)), "size"),
        (lambda: plot.aperture(dofsim.Aperture(), radius_px=1.0), "radius_px"),
        (lambda: plot.focal_stack([], []), "pictures"),
        (lambda: plot.focal_stack(np.zeros((2, 8, 8)), [1.0]), "distances"),
        (lambda: plot.focal_stack(np.zeros((1, 8, 8)), [1.0], columns=0), "columns"),
    ],
)
def test_bad_values_are_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_kinds_of_pictures_that_are_shown():
    for picture in (
        np.zeros((8, 8)),
        np.zeros((8, 8, 1)),
        np.zeros((8, 8, 4)),
        np.zeros((8, 8, 3), np.uint16),
    ):
        shown = plot.focal_stack([picture], [1.0]).axes[0].images[0].get_array()
        assert shown.shape == (8, 8, 3)
    white = np.full((8, 8), 65535, np.uint16)
    assert plot.focal_stack([white], [1.0]).axes[0].images[0].get_array().min() == 255


LENSES = [
    CAMERA,
    dofsim.Lens(aperture_radius=0.0, focus_distance=float("inf"), fov=40.0),
    CAMERA.replace(focus_distance=float("inf"), axial_color=(0.1, 0.0, -0.1), cat_eye=0.5),
    dofsim.Lens.from_disparity(strength_percent=2.0, focus=-0.25),
]


@pytest.mark.parametrize("lens", LENSES)
def test_the_repr_of_a_lens_can_be_pasted(lens):
    assert eval(repr(lens), {"Lens": dofsim.Lens}) == lens
    html = lens._repr_html_()
    pasted = re.search(r"<code>(.*?)</code>", html)[1].replace("&#x27;", "'")
    assert eval(pasted, {"Lens": dofsim.Lens}) == lens
    assert "<script" not in html
    assert "http" not in html


def test_html_of_a_lens_says_what_is_sharp():
    nearest, farthest = Blur.of(CAMERA, (1920, 1080)).limits(0.5)
    assert f"{nearest:.3g} m to {farthest:.3g} m" in CAMERA._repr_html_()


def test_an_opening_shows_itself():
    png = dofsim.Aperture(blades=3, rotation=90.0)._repr_png_()
    picture = np.asarray(Image.open(io.BytesIO(png))).astype(float)
    side = picture.shape[0]
    behind, before = picture[:, :side], picture[:, side:]
    # In front of the focus the image is upside down.
    assert np.abs(behind - before[::-1, ::-1]).mean() < 2.0
    assert np.abs(behind - before).mean() > 20.0
    html = dofsim.Aperture(blades=3, rotation=90.0)._repr_html_()
    assert base64.b64decode(re.search(r"base64,([^']+)", html)[1]) == png
    assert "alt='" in html


def test_blur_is_said_to_be_a_radius():
    lens = dofsim.Lens.from_camera(focal_length_mm=50, f_number=1.4, focus_distance=1.5)
    assert "blur radius at \N{INFINITY}" in lens._repr_html_()
    assert "blur radius" in dofsim.Lens.from_disparity(strength_percent=3, focus=0.5)._repr_html_()
