"""`import dofsim` is quick, and takes nothing optional with it."""

import importlib
import shutil
import subprocess
import sys

import pytest

# In milliseconds of processor time, beyond NumPy's own; the best of some, as other work shares the caches.
MOST_MS, TRIES = 50.0, 7


def run(code):
    return subprocess.check_output([sys.executable, "-c", code], text=True).strip()


def test_import_is_quick():
    code = (
        "import numpy, time; start = time.process_time(); import dofsim; print(time.process_time() - start)"
    )
    took = [1e3 * float(run(code)) for _ in range(TRIES)]
    assert min(took) < MOST_MS, took


def test_nothing_optional_is_imported():
    optional = ("matplotlib", "anywidget", "IPython", "mitsuba", "torch", "skimage", "scipy", "typer")
    code = f"import sys, dofsim; print([name for name in {optional} if name in sys.modules])"
    assert run(code) == "[]"


OFFLINE = """
import os, socket, sys

def refused(*_, **__):
    raise AssertionError("a connection")

for name in ("connect", "connect_ex", "bind", "sendto"):
    # The class in C cannot be changed, and the one in Python that everybody makes sockets of can.
    setattr(socket.socket, name, refused)
socket.create_connection = socket.getaddrinfo = refused

import numpy as np
import dofsim
from dofsim import batch, cli, io, metrics, presets

os.chdir(sys.argv[1])
color, depth = np.ones((20, 30, 3), np.float32), np.full((20, 30), 2.0)
io.write_image("a.exr", color, depth=depth)
dofsim.devices()
lens = ["--aperture-radius", "0.1", "--focus-distance", "1", "--fov", "40"]
assert cli.run(["render", "a.exr", "-o", "b.png", *lens]) == 0
assert cli.run(["batch", "a.exr", "-o", "out", *lens]) == 0
"""


def test_nothing_is_asked_of_the_network(tmp_path):
    subprocess.run(
        [sys.executable, "-W", "ignore", "-c", OFFLINE, str(tmp_path)], check=True, stdout=subprocess.DEVNULL
    )


@pytest.mark.skipif(shutil.which("strace") is None, reason="needs strace")
def test_no_part_opens_a_socket_to_elsewhere(tmp_path):
    """What is compiled does not go through Python's sockets."""
    trace = tmp_path / "trace"
    command = ["strace", "-f", "-qq", "-e", "trace=connect,sendto,bind", "-o", str(trace), sys.executable]
    run = subprocess.run(
        [*command, "-W", "ignore", "-c", OFFLINE, str(tmp_path)], capture_output=True, text=True, check=False
    )
    if not trace.exists() or "ptrace" in run.stderr:
        pytest.skip("processes may not be traced here")
    assert run.returncode == 0, run.stderr
    # A display is looked for through a file of this machine.
    assert "AF_INET" not in trace.read_text()


@pytest.mark.parametrize("name", ["io", "batch", "metrics", "photo", "presets", "cameras"])
def test_a_module_lists_its_public_names_alone(name):
    module = importlib.import_module(f"dofsim.{name}")
    assert [one for one in dir(module) if not one.startswith("__")] == sorted(module.__all__)
