"""Which devices there are, how they are named and chosen, and what is known of a render on one."""

import os
import re
import subprocess
import sys
from pathlib import Path

import dofsim
import numpy as np
import pytest
from both_devices import AGREEMENT, CASES, LENS_AGREEMENT, LENS_PSNR, assert_agree, render, surfaces
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
        "sprites": "sprites/gather",
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
        assert device.visible
        assert device.memory_bytes is None or device.memory_bytes >= device.max_binding_bytes
        assert re.fullmatch(r"([0-9a-f]{4,8}:[0-9a-f]{2}:[0-9a-f]{2}\.[0-7])?", device.pci_bus_id)


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


def lines_of_devices(*words, **environment):
    """Run `dofsim devices` in a process of its own."""
    child = subprocess.run(
        [sys.executable, "-m", "dofsim", "devices", *words],
        capture_output=True,
        text=True,
        env=os.environ | {"DOFSIM_DEVICE": ""} | environment,
    )
    return child.returncode, child.stdout


linux_only = pytest.mark.skipif(sys.platform != "linux", reason="drivers are found the Linux way")


@linux_only
def test_what_is_missing_is_said_by_the_command_and_by_the_error(tmp_path):
    if any(device.kind != "software" for device in dofsim.devices()):
        pytest.skip("there is a GPU")
    # A loader that is no library: the system's own one is not looked for any more.
    (tmp_path / "libvulkan.so.1").write_bytes(b"")
    status, out = lines_of_devices(LD_LIBRARY_PATH=str(tmp_path), VK_DRIVER_FILES="/nowhere/driver.json")
    assert status == 0
    # Lines fit a terminal.
    out = " ".join(out.split())
    assert re.search(r" Vulkan's loader cannot be loaded \(.*libvulkan.so.1.*: install libvulkan1", out)
    assert 'VK_DRIVER_FILES names no driver that exists: "/nowhere/driver.json"' in out
    assert "--device auto is the CPU: no discrete GPU is to be had." in out
    code = "import dofsim, numpy as np; dofsim.Scene(np.ones((4, 4, 3)), np.ones((4, 4)), device='gpu')"
    child = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env=os.environ | {"DOFSIM_DEVICE": "", "VK_DRIVER_FILES": "/nowhere/driver.json"},
    )
    error = child.stderr.splitlines()[-1]
    assert 'device="gpu": no GPU was found' in error
    assert 'VK_DRIVER_FILES names no driver that exists: "/nowhere/driver.json"' in error
    assert "Vulkan's loader" not in error


def test_the_command_says_what_auto_is():
    _, out = lines_of_devices(DOFSIM_DEVICE="cpu")
    expected = "the CPU: the environment variable DOFSIM_DEVICE is 'cpu'"
    assert out.splitlines()[-1] == f"--device auto is {expected}."
    _, out = lines_of_devices()
    discrete = [device.id for device in dofsim.devices() if device.kind == "discrete"]
    expected = f"{discrete[0]}: a discrete GPU" if discrete else "the CPU: no discrete GPU is to be had"
    assert out.splitlines()[-1] == f"--device auto is {expected}."


def test_what_cuda_hides_cannot_always_be_known():
    if any(device.kind != "software" for device in dofsim.devices()):
        pytest.skip("there is a GPU")
    _, out = lines_of_devices(CUDA_VISIBLE_DEVICES="MIG-1")
    sentence = "CUDA_VISIBLE_DEVICES=MIG-1 is not heeded: parts of a GPU cannot be had through Vulkan."
    assert sentence in " ".join(out.split())
    _, out = lines_of_devices(CUDA_VISIBLE_DEVICES="")
    assert "CUDA_VISIBLE_DEVICES" not in out


def test_every_method_is_checked_on_every_adapter(gpu):
    status, out = lines_of_devices("--check")
    assert status == 0
    for method in CASES:
        found = re.findall(rf"^ +{method} +agrees with the CPU: largest difference (\S+) of", out, re.M)
        assert len(found) == len(dofsim.devices())
        assert all(float(difference) <= 2e-3 for difference in found)


def test_a_device_that_differs_is_found_out(gpu, capsys, monkeypatch):
    from dofsim import _device_check

    assert _device_check.AGREEMENT == AGREEMENT
    assert (_device_check.LENS_AGREEMENT, _device_check.LENS_PSNR) == (LENS_AGREEMENT, LENS_PSNR)
    rendered = _device_check.rendered

    def wrong(method, device):
        picture = rendered(method, device)
        if method == "taps" and device != "cpu":
            picture[3, 5, 1] += 0.05
        if method == "levels" and device != "cpu":
            raise dofsim.DeviceError("the device was lost")
        return picture

    monkeypatch.setattr(_device_check, "rendered", wrong)
    assert run(["devices", "--check"]) == 1
    out = capsys.readouterr().out
    assert re.search(r"^ +taps +DISAGREES with the CPU: largest difference 6.\de-03 .* 2e-04 all", out, re.M)
    assert re.search(r"^ +levels +fails: the device was lost", out, re.M)
    assert re.search(r"^ +lens +agrees", out, re.M)


def test_the_benchmark_writes_its_table(gpu, tmp_path):
    script = Path(__file__).parent / "bench/gpu.py"
    words = ["--runs", "1", "--size", "small", "--radius", "4", "--device", gpu, "-o", tmp_path / "table.md"]
    subprocess.run([sys.executable, script, *map(str, words)], check=True, capture_output=True)
    table = (tmp_path / "table.md").read_text()
    for method in CASES:
        row = next(line for line in table.splitlines() if line.startswith(f"| {method} |"))
        assert all(float(value) > 0.0 for value in row.split("|")[4:-1])
