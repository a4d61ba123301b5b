"""Which devices there are, how they are named and chosen, and what is known of a render on one."""

import re
import subprocess
import sys
from pathlib import Path

import dofsim
import numpy as np
import pytest
from both_devices import CASES, assert_agree, render, surfaces
from dofsim.cli import run


@pytest.mark.parametrize("method", CASES)
def test_passes_are_timed(gpu, method):
    color, disparity = surfaces()
    scene = dofsim.Scene(color, disparity, depth_kind="disparity", device=gpu)
    lens = dofsim.Lens.from_disparity(strength_px=6.0, focus=0.0)
    passes = dict(scene.profile(lens, method=method))
    several = {
        "lens": "lens/sweep",
        "gaussian": "gaussian/blur_x",
        "levels": "levels/filter",
        "hexagonal": "hexagonal/shade",
        "sprites": "sprites/draw",
    }
    assert passes[several.get(method, method)] > 0.0
    assert all(milliseconds >= 0.0 for milliseconds in passes.values())


def test_the_cpu_has_no_passes():
    color, disparity = surfaces()
    scene = dofsim.Scene(color, disparity, depth_kind="disparity", device="cpu")
    with pytest.raises(dofsim.DeviceError, match="profile: there are no times to show"):
        scene.profile(dofsim.Lens.from_disparity(strength_px=6.0, focus=0.0))


def test_devices_are_described(gpu):
    for number, device in enumerate(dofsim.devices()):
        assert device.id == f"gpu:{number}"
        assert device.kind in {"discrete", "integrated", "virtual", "software", "other"}
        assert device.backend in {"vulkan", "metal", "dx12"}
        assert device.max_buffer_bytes >= device.max_binding_bytes >= 1 << 27
        assert device.name in repr(device)


def test_devices_go_by_number_and_by_name(gpu):
    scene = surfaces()
    expected = render(*scene, "gpu:0", method="taps")
    name = dofsim.devices()[0].name
    np.testing.assert_array_equal(render(*scene, name, method="taps"), expected)
    np.testing.assert_array_equal(render(*scene, name.upper(), method="taps"), expected)


@pytest.mark.parametrize("device", ["tpu", "gpu:x", "gpu:-1", ""])
def test_what_is_no_device_is_named(device):
    with pytest.raises(ValueError, match=f"device must be .*got {re.escape(repr(device))}".replace("'", '"')):
        render(*surfaces(), device)


def test_a_number_that_is_no_adapter_is_named():
    with pytest.raises(dofsim.DeviceError, match='there is no "gpu:99"; there is'):
        render(*surfaces(), "gpu:99")


def test_a_software_rasteriser_is_not_chosen_by_itself(monkeypatch):
    monkeypatch.delenv("DOFSIM_DEVICE", raising=False)
    scene = surfaces()
    if all(device.kind == "software" for device in dofsim.devices()):
        with pytest.raises(dofsim.DeviceError, match='device="gpu": no GPU was found'):
            render(*scene, "gpu", method="taps")
        np.testing.assert_array_equal(
            render(*scene, "auto", method="taps"), render(*scene, "cpu", method="taps")
        )
    else:
        assert_agree(render(*scene, "gpu", method="taps"), render(*scene, "cpu", method="taps"), "taps")


def test_the_environment_chooses(gpu, monkeypatch):
    scene = surfaces()
    monkeypatch.setenv("DOFSIM_DEVICE", "gpu:0")
    expected = render(*scene, "gpu:0", method="taps")
    np.testing.assert_array_equal(render(*scene, "gpu", method="taps"), expected)
    np.testing.assert_array_equal(render(*scene, "auto", method="taps"), expected)
    monkeypatch.setenv("DOFSIM_DEVICE", "gpu:99")
    with pytest.raises(dofsim.DeviceError, match='environment variable DOFSIM_DEVICE: there is no "gpu:99"'):
        render(*scene, "auto", method="taps")
    monkeypatch.setenv("DOFSIM_DEVICE", "cpu")
    with pytest.raises(dofsim.DeviceError, match='the environment variable DOFSIM_DEVICE is "cpu"'):
        render(*scene, "gpu", method="taps")
    np.testing.assert_array_equal(render(*scene, "auto", method="taps"), render(*scene, "cpu", method="taps"))


def test_the_command_lists_devices(gpu, capsys):
    assert run(["devices"]) == 0
    out = capsys.readouterr().out
    for device in dofsim.devices():
        assert f"{device.id}  {device.name}" in out


def test_the_benchmark_writes_its_table(gpu, tmp_path):
    script = Path(__file__).parent / "bench/gpu.py"
    words = ["--runs", "1", "--size", "small", "--radius", "4", "--device", gpu, "-o", tmp_path / "table.md"]
    subprocess.run([sys.executable, script, *map(str, words)], check=True, capture_output=True)
    table = (tmp_path / "table.md").read_text()
    for method in CASES:
        row = next(line for line in table.splitlines() if line.startswith(f"| {method} |"))
        assert all(float(value) > 0.0 for value in row.split("|")[4:-1])
