"""The `dofsim` command itself: its words, its options, its help, and how it ends."""

import dataclasses
import os
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import dofsim
import numpy as np
import pytest
import typer
from command_lines import HEIGHT, LENS_OPTIONS, WIDTH, fails
from dofsim import _command_options, cli, io
from dofsim.cli import run


def test_version_is_printed_without_numpy():
    script = "import sys; from dofsim.cli import run; run(['--version']); print('numpy' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["dofsim", dofsim.__version__, "False"]


def test_the_script_ends_with_the_status(tmp_path):
    command = [sys.executable, "-c", "from dofsim.cli import main; main()", "render", "no.exr", "-o", "o.exr"]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr == "dofsim: no.exr: No such file or directory\n"


def test_help_lists_the_commands(capsys):
    assert run(["--help"]) == 0
    help_text = capsys.readouterr().out
    assert all(command in help_text for command in ("render", "batch", "coc", "compare", "demo"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rendre"], "No such command"),
        (["render", "a.exr"], "Missing option"),
        (["render", "a.exr", "-o", "o.exr", "--fov", "wide"], "--fov"),
        (["render", "a.exr", "-o", "o.exr", "--sideways"], "--sideways"),
    ],
)
def test_usage_errors(scene, capsys, arguments, message):
    assert message in fails(capsys, 2, *arguments)


@pytest.mark.parametrize(
    ("command", "groups"),
    [
        ("render", ["LensOptions", "ApertureOptions", "DepthOptions", "RenderOptions"]),
        ("batch", ["LensOptions", "ApertureOptions", "DepthOptions", "RenderOptions"]),
        ("coc", ["LensOptions", "DepthOptions"]),
    ],
)
def test_a_command_has_each_option_of_its_groups_once(command, groups):
    found = [parameter.name for parameter in typer.main.get_command(cli.app).commands[command].params]
    assert len(found) == len(set(found))
    for group in groups:
        own = [field.name for field in dataclasses.fields(getattr(_command_options, group))]
        first = found.index(own[0])
        assert found[first : first + len(own)] == own


def plain(*arguments):
    """Run the command in a process of its own, on a terminal of 80 columns."""
    environment = {**os.environ, "COLUMNS": "80"}
    command = [sys.executable, "-m", "dofsim", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


COMMANDS = ("render", "coc", "batch", "photo", "compare", "devices", "help", "demo")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_fits_a_terminal_and_shows_all_of_itself(command):
    shown = [plain(command, "--help"), plain(command, "-h"), plain("help", command)]
    assert {(one.returncode, one.stdout) for one in shown} == {(0, shown[0].stdout)}
    text = shown[0].stdout
    assert max(map(len, text.splitlines())) <= 80
    # A command without a lens has none to print.
    assert ("Print also the lens" in text) == (command in ("render", "coc", "batch", "photo"))
    # No type of a flag, no markup.
    assert "<" not in text
    assert "bool" not in text
    assert ("[aperture]" in text) == (command in ("render", "coc", "batch"))
    # Lines are as full as their next word allows.
    for paragraph in text.split("\n\n")[1:2]:
        lines = [line.strip() for line in paragraph.splitlines()]
        for line, following in pairwise(lines):
            assert len(line) + 1 + len(following.split()[0]) > 74


def test_without_a_word_the_commands_are_listed():
    shown = plain()
    assert shown.returncode == 2
    assert all(f"\n  {command} " in shown.stderr for command in COMMANDS)
    assert plain("help").stdout == plain("--help").stdout == shown.stderr


def test_completion_can_be_had():
    # It is for the shell from which it is asked: there may be none above the tests.
    asked = f"{shlex.quote(sys.executable)} -m dofsim --show-completion; true"
    shown = subprocess.run(["bash", "-c", asked], capture_output=True, text=True, check=False)
    assert "_dofsim_completion" in shown.stdout
    environment = {
        **os.environ,
        "_DOFSIM_COMPLETE": "complete_bash",
        "COMP_WORDS": "dofsim ren",
        "COMP_CWORD": "1",
    }
    command = [sys.executable, "-m", "dofsim"]
    completed = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert "render" in completed.stdout


def test_errors_speak_of_options(scene, capsys):
    io.write_image("nan.exr", np.ones((4, 5, 3)), depth=np.full((4, 5), np.nan))
    message = fails(capsys, 2, "render", "nan.exr", "-o", "o.exr", *LENS_OPTIONS)
    assert "pass --invalid far" in message
    words = ["--depth-kind", "relative"]
    message = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, *words)
    assert "--depth-kind relative" in message
    assert "--strength-percent" in message
    assert "from_disparity" not in message
    message = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--supersample", "7")
    assert "--supersample 7 must divide" in message
    message = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--near", "1")
    assert '--near and --far are for --depth-kind "zbuffer"' in message
    both = ["--strength-px", "3", "--strength-percent", "3", "--focus", "0"]
    message = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", *words, *both)
    assert "--strength-px excludes --strength-percent" in message
    message = fails(capsys, 1, "render", "a.exr", "-o", "o.exr", *LENS_OPTIONS, "--device", "gpu:99")
    assert message.startswith("dofsim: --device: there is no")
    Path("lens.toml").write_text("colour = 3\n")
    message = fails(capsys, 2, "render", "a.exr", "-o", "o.exr", "--lens", "lens.toml")
    assert 'lens.toml: a lens has no "colour"; it has aperture_radius' in message
    io.write_depth("small.pfm", np.ones((5, 4)))
    message = fails(capsys, 2, "render", "a.png", "small.pfm", "-o", "o.exr", *LENS_OPTIONS)
    assert f"the picture is {WIDTH} x {HEIGHT}, its depth 4 x 5" in message


def test_devices_are_listed_without_the_noise_of_drivers():
    code = (
        "import os, dofsim; from dofsim import cli; "
        "dofsim.devices = lambda: os.write(2, b'MESA: error\\n') and []; cli.run(['devices'{}])"
    )
    for more, noise in (("", ""), (", '-v'", "MESA: error\n")):
        command = [sys.executable, "-c", code.format(more)]
        shown = subprocess.run(command, capture_output=True, text=True, check=True)
        assert shown.stderr == noise
        assert "There is no GPU" in shown.stdout


def test_devices_fit_a_terminal(monkeypatch, capsys):
    class Adapter:
        id, name, kind, backend = "gpu:0", "llvmpipe (LLVM 15.0.6, 256 bits)", "software", "vulkan"
        driver, max_binding_bytes = "llvmpipe Mesa 22.3.6 (LLVM 15.0.6)", 2**27
        pci_bus_id, memory_bytes, visible = "0000:00:1f.0", 2**34, True
        measures_time = True

    monkeypatch.setattr(dofsim, "devices", lambda: [Adapter])
    assert run(["devices"]) == 0
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 80
    assert "used only if it is named (--device gpu:0)" in shown
    assert "buffers of up to 128 MiB; larger frames are rendered in bands" in shown
