"""`dofsim render`: what it writes and what it refuses."""

import dofsim
import numpy as np
import pytest
from command_lines import HEIGHT, LENS, LENS_OPTIONS, WIDTH, fails
from dofsim import io
from dofsim.cli import run


def test_render_writes_what_the_function_gives(scene, capsys):
    color, depth = scene
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    seen = "depth 1.5 to 6 m and the background, focus 3 m"
    said = f"o.exr: {WIDTH} x {HEIGHT}, {seen}, blur radius 0.4 to 0.9 px, "
    assert err.startswith(said)
    assert err.count("\n") == 1
    expected = dofsim.render(color, depth, dofsim.Lens(**LENS))
    np.testing.assert_array_equal(io.read_color("o.exr").pixels, expected)
    assert np.abs(expected - color).max() > 0.1


def test_depth_along_the_other_direction_is_negated(scene):
    color, depth = scene
    io.write_image("negative.exr", color, depth=-depth)
    for name, extra in (("a.exr", []), ("negative.exr", ["--depth-scale", "-1"])):
        assert run(["render", name, "-o", f"o-{name}", *LENS_OPTIONS, *extra]) == 0
    np.testing.assert_array_equal(io.read_color("o-a.exr").pixels, io.read_color("o-negative.exr").pixels)


def test_z_buffers_of_any_direction(scene):
    color, depth = scene
    near, far = 0.5, 50.0
    t = (1 / near - 1 / depth) / (1 / near - 1 / far)
    t[~np.isfinite(depth)] = 1.0
    cases = [
        ("zbuffer", t, near, far),
        ("zbuffer", 1 - t, far, near),
        ("opengl_ndc", 2 * t - 1, near, far),
        ("zbuffer", near / depth, "inf", near),
    ]
    results = []
    for kind, values, first, last in cases:
        io.write_image("z.exr", color, depth=values)
        words = ["--depth-kind", kind, "--near", str(first), "--far", str(last)]
        assert run(["render", "z.exr", "-o", "o.exr", *LENS_OPTIONS, *words]) == 0
        results.append(io.read_color("o.exr").pixels)
    for result in results[1:3]:
        np.testing.assert_allclose(result, results[0], atol=2e-3)
    # Here the background is infinitely far, and there at the far plane.
    np.testing.assert_allclose(results[3][8:], results[0][8:], atol=0.1)


def test_render_of_integers_in_two_files(scene):
    _, depth = scene
    assert run(["render", "a.png", "z.pfm", "-o", "o.png", *LENS_OPTIONS]) == 0
    codes = io.read_color("a.png").pixels
    expected = dofsim.render(codes, depth, dofsim.Lens(**LENS), transfer="srgb")
    result = io.read_color("o.png").pixels
    assert result.dtype == np.uint8
    # The function rounds straight to integers, the command on its way through float32 files.
    assert np.abs(result.astype(int) - expected.astype(int)).max() <= 1
    assert run(["render", "a.png", "z.pfm", "-o", "linear.png", *LENS_OPTIONS, "--transfer", "linear"]) == 0
    assert np.abs(io.read_color("linear.png").pixels.astype(int) - result).max() > 5


def test_render_keeps_sixteen_bits(scene):
    color, _ = scene
    io.write_image("deep.png", color, dtype="uint16")
    assert run(["render", "deep.png", "z.pfm", "-o", "o.png", *LENS_OPTIONS]) == 0
    assert io.read_color("o.png").pixels.dtype == np.uint16
    assert run(["render", "deep.png", "z.pfm", "-o", "o8.png", *LENS_OPTIONS, "--dtype", "uint8"]) == 0
    assert io.read_color("o8.png").pixels.dtype == np.uint8


def test_render_passes_every_option_on(scene, monkeypatch):
    color, depth = scene
    calls = []

    def render(*arguments, **options):
        calls.append((arguments, options))
        return color

    monkeypatch.setattr(dofsim, "render", render)
    # The planes of a z-buffer, which a distance does not go with.
    monkeypatch.setattr("dofsim._report.coc", lambda depth, *_, **__: 0.0 * depth)
    extra = {
        "--method": "lens", "--device": "cpu", "--blades": "6", "--rotation": "15", "--near": "0.5",
        "--far": "20", "--depth-kind": "distance", "--invalid": "far", "--overscan": "2",
        "--supersample": "4", "--threads": "3", "--depth-scale": "2", "--set": "views=128",
        "--max-coc-px": "90", "--invalid-color": "fill",
    }  # fmt: skip
    flags = [word for pair in extra.items() for word in pair]
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--fov-axis", "y", *flags]) == 0
    ((arguments, options),) = calls
    assert options.pop("out").shape == (HEIGHT // 4 - 4, WIDTH // 4 - 4, 3)
    np.testing.assert_array_equal(arguments[0], color)
    np.testing.assert_array_equal(arguments[1], 2 * depth)
    assert arguments[2] == dofsim.Lens(**LENS, fov_axis="y")
    assert options == {
        "method": "lens", "device": "cpu", "aperture": dofsim.Aperture(blades=6, rotation=15.0),
        "depth_kind": "distance", "near": 0.5, "far": 20.0, "invalid": "far", "alpha": "none",
        "transfer": "linear", "overscan": 2, "supersample": 4, "threads": 3, "views": 128,
        "max_coc_px": 90.0, "invalid_color": "fill",
    }  # fmt: skip


def test_coc_takes_a_range_in_focus_and_a_bound(scene, capsys):
    _, depth = scene
    words = [
        f"--{name.replace('_', '-')}={value}" for name, value in LENS.items() if name != "focus_distance"
    ]
    arguments = ["z.pfm", "-o", "coc.exr", *words, "--in-focus", "2,inf", "--max-coc-px", "0.4"]
    assert run(["coc", *arguments]) == 0
    lens = dofsim.Lens(**LENS).replace(in_focus=(2.0, np.inf))
    np.testing.assert_array_equal(io.read_exr("coc.exr")["coc"], dofsim.coc(depth, lens, max_coc_px=0.4))
    assert "focus 2 m to infinity" in capsys.readouterr().err


def test_options_of_a_method_are_toml_or_words(scene):
    color, depth = scene
    flags = ["--method", "taps", "--set", "variant=four", "--set", "hyperfocal_factor=0.5"]
    assert run(["render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, *flags]) == 0
    expected = dofsim.render(
        color, depth, dofsim.Lens(**LENS), method="taps", variant="four", hyperfocal_factor=0.5
    )
    np.testing.assert_array_equal(io.read_color("o.exr").pixels, expected)


def test_an_input_under_another_name_is_not_overwritten(scene, tmp_path, capsys):
    (tmp_path / "link.exr").symlink_to(tmp_path / "a.exr")
    assert "link.exr: is one of the inputs" in fails(
        capsys, 2, "render", "a.exr", "-o", "link.exr", *LENS_OPTIONS
    )


def test_render_of_alpha(scene, monkeypatch):
    color, depth = scene
    cover = np.full((HEIGHT, WIDTH, 1), 0.5, np.float32)
    cover[10:30, 20:40] = 0.25
    io.write_image("alpha.exr", np.concatenate([color * cover, cover], axis=-1), depth=depth)
    assert run(["render", "alpha.exr", "-o", "o.exr", *LENS_OPTIONS]) == 0
    result = io.read_color("o.exr")
    assert result.alpha == "premultiplied"
    expected = dofsim.render(
        io.read_color("alpha.exr").pixels, depth, dofsim.Lens(**LENS), alpha="premultiplied"
    )
    np.testing.assert_array_equal(result.pixels, expected)
    stated = []
    real = dofsim.render
    monkeypatch.setattr(dofsim, "render", lambda *a, **o: (stated.append(o["alpha"]), real(*a, **o))[1])
    assert run(["render", "alpha.exr", "-o", "s.exr", *LENS_OPTIONS, "--alpha", "straight"]) == 0
    assert stated == ["premultiplied"]
    straight = io.read_color("s.exr").pixels
    np.testing.assert_allclose(straight[34:, :, :3], result.pixels[34:, :, :3] / 2, atol=1e-3)


def test_depth_channel_and_layer(scene):
    color, depth = scene
    layers = {f"sharp.{name}": color[..., index] for index, name in enumerate("RGB")}
    layers |= {f"dull.{name}": np.zeros_like(depth) for name in "RGB"}
    io.write_exr("layers.exr", {**layers, "left.Z": depth, "right.Z": depth * 2})
    arguments = ["render", "layers.exr", *LENS_OPTIONS, "--layer", "sharp", "--depth-channel", "left.Z"]
    assert run([*arguments, "-o", "o.exr"]) == 0
    expected = dofsim.render(color, depth, dofsim.Lens(**LENS))
    np.testing.assert_array_equal(io.read_color("o.exr").pixels, expected)


def test_ambiguous_files_list_their_channels(scene, capsys):
    io.write_exr("two.exr", {"Y": np.ones((2, 2)), "left.Z": np.ones((2, 2)), "right.Z": np.ones((2, 2))})
    message = fails(capsys, 2, "render", "two.exr", "-o", "o.exr", *LENS_OPTIONS)
    assert "two.exr: several channels may be the depth: left.Z, right.Z" in message


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["a.exr", "-o", "a.exr"], 2, "a.exr: is one of the inputs"),
        (["a.png", "z.pfm", "-o", "./z.pfm"], 2, "is one of the inputs"),
        (["a.exr", "-o", "o.jpg"], 2, "suffix '.jpg' is not one of .exr"),
        (["a.exr", "-o", "no/o.exr"], 2, "no: there is no such folder"),
        (["a.png", "-o", "o.exr"], 2, "holds no depth"),
        (["a.exr", "no.pfm", "-o", "o.exr"], 2, "no.pfm: No such file"),
        (["a.exr", "-o", "o.exr", "--transfer", "rec709"], 2, "--transfer takes linear, srgb"),
        (["a.exr", "-o", "o.exr", "--dtype", "double"], 2, "--dtype takes half, float"),
        (["a.exr", "-o", "o.exr", "--depth-kind", "meters"], 2, "--depth-kind must be one of"),
        (["a.exr", "-o", "o.exr", "--blades", "2"], 2, "--blades must be 0"),
        (["a.exr", "-o", "o.exr", "--threads", "-1"], 2, "--threads must be a whole number"),
        (["a.exr", "-o", "o.exr", "--overscan", str(2**63)], 2, "--overscan must be a whole number"),
        (["a.exr", "-o", "o.exr", "--supersample", str(10**400)], 2, "--supersample must be a whole"),
        (["a.exr", "-o", "o.exr", "--depth-scale", "0"], 2, "--depth-scale must be finite and not 0"),
        (["a.exr", "-o", "o.exr", "--depth-scale", "-1"], 2, "negate them (--depth-scale -1)"),
        (["a.exr", "-o", "o.exr", "--lens", "deep.toml"], 2, "deep.toml: not a TOML file: it is nested too"),
        (
            ["a.exr", "-o", "o.exr", "--lens", "odd.toml"],
            2,
            'odd.toml: [aperture] has no "wings"; it has blades',
        ),
        (["a.exr", "-o", "o.exr", "--set", f"views={'[' * 9999}"], 2, "views must be a whole number"),
        (["a.exr", "-o", "iris.png", "--lens", "iris.toml"], 2, "iris.png: is one of the inputs"),
        (["a.exr", "-o", "o.exr", "--supersample", "7"], 2, "supersample"),
        (["a.exr", "-o", "o.exr", "--method", "fast"], 2, 'method must be one of "lens"'),
        (["a.exr", "-o", "o.exr", "--set", "variant=six"], 2, "variant is not an option of --method lens"),
        (["a.exr", "-o", "o.exr", "--method", "taps", "--set", "variant=ten"], 2, "variant must be one of"),
        (["a.exr", "-o", "o.exr", "--set", "views"], 2, "--set takes NAME=VALUE; got 'views'"),
        (["a.exr", "-o", "o.exr", "--set", "views=64", "--set", "views=32"], 2, "views is given twice"),
        (
            ["a.exr", "-o", "o.exr", "--set", "overscan=1"],
            2,
            "--set overscan: it is an option of its own, --overscan",
        ),
        (["a.exr", "-o", "o.exr", "--focus-at", "3"], 2, "--focus-at takes a column and a row"),
        (["a.exr", "-o", "o.exr", "--focus-at", "64,0"], 2, "--focus-at: x must lie within 64"),
    ],
)
def test_what_render_refuses(scene, tmp_path, capsys, arguments, status, message):
    (tmp_path / "deep.toml").write_text("a = " + "[" * 100_000)
    (tmp_path / "odd.toml").write_text("[aperture]\nwings = 3\n")
    (tmp_path / "iris.toml").write_text('[aperture]\nimage = "iris.png"\n')
    io.write_image("iris.png", np.ones((5, 5)))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert message in fails(capsys, status, "render", *arguments, *LENS_OPTIONS)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_machine_at_fault_is_status_one(scene, capsys, monkeypatch):
    def render(*_, **__):
        raise dofsim.DeviceError("there is no GPU")

    monkeypatch.setattr(dofsim, "render", render)
    message = fails(capsys, 1, "render", "a.exr", "-o", "o.exr", "--device", "gpu", *LENS_OPTIONS)
    assert "there is no GPU" in message
    monkeypatch.setattr(dofsim, "render", lambda *_, **__: 1 / 0)
    assert "internal error: ZeroDivisionError" in fails(
        capsys, 1, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS
    )


def test_a_photograph_with_relative_depth(scene, capsys):
    _, depth = scene
    disparity = np.where(np.isinf(depth), 0.0, 1.0 / depth)
    np.save("d.npy", (40 + 900 * disparity).astype(np.float32))
    words = ["--depth-kind", "relative", "--strength-percent", "8"]
    assert run(["render", "a.png", "d.npy", "-o", "o.png", *words, "--focus", "0.2"]) == 0
    said = capsys.readouterr().err
    assert (
        "relative disparity 40 to 640 (taken as 0 to 1, outliers aside), focus at disparity 0.2, blur radius"
        in said
    )
    assert " m," not in said
    lens = dofsim.Lens.from_disparity(strength_percent=8, focus=0.2)
    codes = io.read_color("a.png").pixels
    expected = dofsim.render(codes, np.load("d.npy"), lens, depth_kind="relative", transfer="srgb")
    assert np.abs(io.read_color("o.png").pixels.astype(int) - expected.astype(int)).max() <= 1
    message = fails(capsys, 2, "render", "a.png", "d.npy", "-o", "o.png", *words)
    assert "--focus missing. Give it, --focus-at X,Y or --in-focus" in message


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_integers_are_taken_for_nothing_by_themselves(scene, capsys, dtype):
    codes = (np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH) % 200 + 40).astype(dtype)
    io.write_image("z.png", codes, transfer="linear", dtype=dtype)
    codes = io.read_depth("z.png", scale=1)
    arguments = ["render", "a.png", "z.png", "-o", "o.png"]
    message = fails(capsys, 2, *arguments, *LENS_OPTIONS)
    for way in ("--depth-kind relative", "--depth-scale 0.001", "--preset NAME", "kitti"):
        assert way in message
    assert "--depth-kind relative" in fails(capsys, 2, "coc", "z.png", "-o", "c.exr", *LENS_OPTIONS)
    for ways in (["--depth-scale", "0.05"], ["--preset", "kitti"], ["--depth-kind", "z"]):
        assert run([*arguments, *LENS_OPTIONS, *ways]) == 0
    relative = ["--depth-kind", "relative", "--strength-px", "3", "--focus", "0"]
    assert run([*arguments, *relative]) == 0


def test_coarse_depth_is_refined_if_asked(scene, capsys):
    color, depth = scene
    coarse = np.where(np.isinf(depth), 9.0, depth)[::2, ::2]
    io.write_depth("coarse.pfm", coarse)
    arguments = ["render", "a.exr", "coarse.pfm", "-o", "o.exr", *LENS_OPTIONS]
    assert "of another size must be refined (--refine-depth)" in fails(capsys, 2, *arguments)
    assert run([*arguments, "--refine-depth", "--focus-at", "30,20"]) == 0
    assert f"o.exr: {WIDTH} x {HEIGHT}, depth 1.5 to 9 m, focus 1.5 m" in capsys.readouterr().err
    lens = dofsim.Lens(aperture_radius=0.03, fov=40.0, focus_distance=1.5)
    expected = dofsim.render(color, coarse, lens, refine=True)
    np.testing.assert_allclose(io.read_color("o.exr").pixels, expected, atol=1e-5)


def test_one_range_of_depth_for_all_pictures(scene, capsys):
    _, depth = scene
    disparity = (1.0 / depth).astype(np.float32)
    io.write_depth("d.pfm", disparity)
    arguments = ["render", "a.png", "d.pfm", "-o", "o.npy", "--depth-kind", "relative"]
    arguments += ["--strength-px", "6", "--focus", "0.5"]
    assert run([*arguments, "--depth-range", "0,2"]) == 0
    assert "blur radius" in capsys.readouterr().err
    lens = dofsim.Lens.from_disparity(strength_px=6.0, focus=0.5)
    light = io.read_color("a.png").to_linear()
    expected = dofsim.render(light, disparity, lens, depth_kind="relative", depth_range=(0.0, 2.0))
    np.testing.assert_array_equal(np.load("o.npy"), expected)
    assert "--depth-range" in fails(capsys, 2, *arguments, "--depth-range", "0")
    assert "--depth-range" in fails(capsys, 2, *arguments, "--depth-range", "1,1")
