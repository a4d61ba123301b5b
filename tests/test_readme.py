"""What the README shows works as it stands there."""

import re
import shlex
import shutil
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from dofsim import io
from dofsim.cli import run

README = Path(__file__).parents[1].joinpath("README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README, re.DOTALL)
PYTHON = [code for language, code in BLOCKS if language == "python"]
COMMANDS = [line for language, code in BLOCKS if language == "console" for line in code.splitlines()]
DOFSIM = [line.removeprefix("$ dofsim ") for line in COMMANDS if line.startswith("$ dofsim ")]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Go to a folder with the files that the README speaks of."""
    monkeypatch.chdir(tmp_path)
    with resources.as_file(resources.files("dofsim") / "data") as data:
        for name, copy in (
            ("demo.exr", "picture.exr"),
            ("demo_lens.toml", "lens.toml"),
            ("demo_reference.exr", "reference.exr"),
        ):
            shutil.copy(data / name, copy)
        color, depth = io.read_rgbd(data / "demo.exr")
    io.write_image("photo.png", color)
    io.write_image("render.exr", color)
    np.save("depth.npy", np.where(np.isinf(depth), 100.0, depth))
    for name in ("color", "depth"):
        Path(name).mkdir()
    for index in range(2):
        shutil.copy("render.exr", f"color/{index:04}_rgb.exr")
        shutil.copy("depth.npy", f"depth/{index:04}.npy")
    Path("frames.csv").write_text("color,depth,focus_distance\nrender.exr,depth.npy,0.5\n")
    return tmp_path


def test_the_readme_has_examples():
    assert PYTHON
    assert len(DOFSIM) >= 4


@pytest.mark.parametrize("code", PYTHON)
def test_python_example(code, folder):
    assert len(code.strip().splitlines()) <= 12
    exec(compile(code, "README.md", "exec"), {})
    assert any(path.name == "picture.png" for path in folder.iterdir())


@pytest.mark.parametrize("command", DOFSIM)
def test_command(command, folder, capsys):
    assert run(shlex.split(command)) == 0
    assert "dofsim: " not in capsys.readouterr().err
