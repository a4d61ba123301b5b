"""What the README and the documentation show works as it stands there."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib import resources
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import typer
from dofsim import Camera, cli, io
from dofsim.cameras import write_cameras
from dofsim.cli import run
from phones import with_dynamic_depth

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
TEXTS = {page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8") for page in PAGES}
BLOCKS = [
    (name, language.strip("{}"), code)
    for name, text in TEXTS.items()
    for language, code in re.findall(r"^```(\{?[\w-]+\}?)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
]
CONSOLE = [(name, code) for name, language, code in BLOCKS if language == "console"]
PYTHON = [(name, code) for name, language, code in BLOCKS if language == "python"]
# What a machine alone cannot run.
ELSEWHERE = ("tcp://", "dask_jobqueue", "submitit")

# Pages that name options of other programs, too.
OTHERS = ("docs/guide/container.md", "docs/performance.md", "CONTRIBUTING.md")


def identity(value):
    return value if value.endswith(".md") else value.strip().splitlines()[-1][:60]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Go to a folder with the files that the pages speak of."""
    monkeypatch.chdir(tmp_path)
    with resources.as_file(resources.files("dofsim") / "data") as data:
        for name, copy in (
            ("demo.exr", "picture.exr"),
            ("demo_lens.toml", "lens.toml"),
            ("demo_reference.exr", "reference.exr"),
        ):
            shutil.copy(data / name, copy)
        color, depth = io.read_rgbd(data / "demo.exr")
    image = pytest.importorskip("PIL.Image")
    io.write_image("photo.png", color)
    image.fromarray(io.read_color("photo.png").pixels).save("photo.jpg")
    shutil.copy("photo.jpg", "portrait.jpg")
    nearness = np.rint(255 * depth.min() / depth).astype(np.uint8)
    image.fromarray(nearness).save("depth.png")
    with_dynamic_depth(Path("portrait.jpg"), 255 - nearness)
    np.save("disparity.npy", np.float32(37.0) + 12.0 / depth)
    np.save("depth.npy", np.where(np.isinf(depth), 100.0, depth))
    names = {f"ViewLayer.Combined.{name}": color[..., index] for index, name in enumerate("RGB")}
    blender = {**names, "ViewLayer.Depth.Z": np.where(np.isinf(depth), 1e10, depth)}
    io.write_exr("render.exr", blender)
    words = {"lens": 50.0, "fstop": 1.8, "focus_distance": 0.6, "sensor_width": 36.0, "aperture_blades": 7}
    Path("camera.json").write_text(json.dumps(words))
    small, near = color[::4, ::4], np.where(np.isinf(depth), 100.0, depth)[::4, ::4]
    io.write_image("character.exr", small, depth=near)
    half = np.arange(small.shape[1])[:, None] < small.shape[1] // 2
    io.write_image(
        "set.exr", half * np.ones((*small.shape[:2], 4), np.float32), depth=0.4 * np.ones_like(near)
    )
    for index in range(2):
        shutil.copy("set.exr", f"roto.{index:04}.exr")
    for name in ("color", "depth", "shots"):
        Path(name).mkdir()
    for index in range(2):
        io.write_image(f"color/{index:04}_rgb.exr", small)
        np.save(f"depth/{index:04}.npy", near)
        io.write_image(f"shots/shot.beauty.{index:04}.exr", small)
        io.write_depth(f"shots/shot.depth.{index:04}.exr", near)
        names = dict(zip("RGBZ", [*np.moveaxis(small, -1, 0), near], strict=True))
        io.write_exr(
            f"shot.{index:04}.exr", {name: np.ascontiguousarray(plane) for name, plane in names.items()}
        )
    height, width = near.shape
    camera = Camera(np.eye(4), [[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], (width, height))
    beside = camera.moved(right=0.01)
    write_cameras("cameras.json", [replace(camera, name="shot.0000"), replace(beside, name="shot.0001")])
    Path("frames.csv").write_text("color,depth,focus_distance\ncolor/0000_rgb.exr,depth/0000.npy,0.5\n")
    return tmp_path


def commands(code):
    return [line.removeprefix("$ ") for line in code.splitlines() if line.startswith("$ ")]


@pytest.mark.parametrize(
    ("name", "code"), [(name, code) for name, code in CONSOLE if "$ dofsim " in code], ids=identity
)
def test_the_commands_of_a_block_work_one_after_another(name, code, folder, capsys):
    if "dofsim photo " in code:
        pytest.importorskip("defusedxml")
    for command in commands(code):
        if command.startswith("dofsim ") and not any(word in command for word in ELSEWHERE):
            if "--install-completion" in command:
                continue
            assert run(shlex.split(command)[1:]) == 0, (command, capsys.readouterr().err)
            assert "dofsim: " not in capsys.readouterr().err


def test_other_commands_are_of_files_that_are_there():
    makefile = (ROOT / "Makefile").read_text()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    extras = set(project["project"]["optional-dependencies"])
    for name, code in CONSOLE:
        for command in commands(code):
            words = [word for word in shlex.split(command) if "=" not in word or word.startswith("-")]
            if words[0] == "make":
                assert re.search(rf"^{words[1]}:", makefile, re.MULTILINE), (name, command)
            for word in words:
                if found := re.fullmatch(r"\.\[(.*)\]", word):
                    assert set(found[1].split(",")) <= extras, (name, command)
                if re.fullmatch(r"(tests|docs|packaging)/\S+", word):
                    assert (ROOT / word).is_file(), (name, command)
                assert not word.startswith("dofsim["), (name, "is not published")


def options():
    """Give all options of all commands."""
    group = typer.main.get_command(cli.app)
    found = {option for parameter in group.params for option in parameter.opts}
    for command in group.commands.values():
        for parameter in command.params:
            found.update(parameter.opts, parameter.secondary_opts)
    return found | {"--help", "-h"}


def test_every_option_that_is_named_is_one():
    known = options()
    for name, text in TEXTS.items():
        prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
        for span in re.findall(r"`([^`\n]+)`", prose):
            words = span.split()
            if words[0].startswith("-") or words[0] == "dofsim":
                for word in words:
                    if word.startswith("--") and name not in OTHERS:
                        assert word.split("=")[0].strip(",") in known, (name, span)


def test_every_option_that_messages_name_is_one():
    known = options()
    for path in (ROOT / "python" / "dofsim").rglob("*.py"):
        for line in path.read_text(encoding="utf-8").splitlines():
            for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*[a-z]", line):
                # An underline of numpydoc has no letters; "--random-" is completed where it stands.
                assert option in known or option == "--random", (path.name, option)


@pytest.mark.parametrize(("name", "code"), PYTHON, ids=identity)
def test_python_that_is_shown_runs(name, code, folder):
    compiled = compile(code, name, "exec")
    if any(word in code for word in ELSEWHERE):
        return
    names = {}
    if "dofsim.torch" in code:
        torch = pytest.importorskip("torch")
        pytest.importorskip("torchvision")
        names["sharp_data"] = [torch.rand(3, 8, 8)]
    if "import jax" in code:
        pytest.importorskip("jax")
    if "from optiland" in code:
        pytest.importorskip("optiland")
    exec(compiled, names)


def test_the_readme_is_short_and_writes_a_picture(folder):
    lines = TEXTS["README.md"].splitlines()
    assert len(lines) < 100
    assert max(map(len, lines)) < 140
    (code,) = [code for name, code in PYTHON if name == "README.md"]
    exec(compile(code, "README.md", "exec"), {})
    assert Path("picture.png").is_file()


def test_cells_can_be_copied():
    """No cell is hidden from the page, and none needs what is not shown."""
    for name, text in TEXTS.items():
        assert not re.search(r":tags: .*remove-(cell|input)", text), name


def cells(text):
    return "\n".join(
        re.findall(r"^```\{code-cell\}\n(?::[^\n]*\n)*\n?(.*?)^```", text, re.DOTALL | re.MULTILINE)
    )


@pytest.mark.parametrize("name", [name for name, text in TEXTS.items() if "{code-cell}" in text])
def test_the_cells_of_a_page_run_one_after_another(name, folder):
    for package in ("matplotlib", "anywidget", "mitsuba", "skimage", "flip_evaluator"):
        if package in TEXTS[name] + "matplotlib skimage flip_evaluator" and find_spec(package) is None:
            pytest.skip(f"the pages need {package}")
    if "FocusPicker" in TEXTS[name]:
        pytest.importorskip("anywidget")
    code = "import matplotlib\nmatplotlib.use('Agg')\n" + cells(TEXTS[name])
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
