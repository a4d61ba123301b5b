"""What can go wrong around a GPU, seen from outside: drivers, processes, threads and signals."""

import contextlib
import os
import signal
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import dofsim
import numpy as np
import pytest
from interrupts import HANG_S, INTERRUPTS, assert_prompt

SCENE = """
import dofsim
import numpy as np

def scene(height=200, width=300, **options):
    rng = np.random.default_rng(9)
    color = rng.random((height, width, 3), dtype=np.float32)
    depth = np.kron(rng.uniform(-1.0, 1.0, (height // 20, width // 20)), np.ones((20, 20)))
    return dofsim.Scene(color, depth, depth_kind="disparity", **options)

lens = dofsim.Lens.from_disparity(strength_px=6.0, focus=0.0)
"""
names = {}
exec(SCENE, names)
scene, lens = names["scene"], names["lens"]


def start(code, device, **environment):
    code = f"{SCENE}{INTERRUPTS}device = {device!r}\n{textwrap.dedent(code)}"
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | environment,
    )


def said(code, device=None, **environment):
    """Run code in another process, which may not take for ever, and return the text that it prints."""
    child = start(code, device, **environment)
    try:
        out, err = child.communicate(timeout=HANG_S)
    finally:
        stop(child)
    assert child.returncode == 0, err
    return out


def output(code, device=None, **environment):
    """Return the words that it prints."""
    return said(code, device, **environment).split()


def stop(child):
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)


@pytest.mark.skipif(sys.platform != "linux", reason="drivers are chosen the Linux way")
def test_without_a_driver_the_cpu_is_left():
    printed = output(
        """
        print(len(dofsim.devices()))
        try:
            scene(device="gpu")
        except dofsim.DeviceError as error:
            print("no GPU was found" in str(error) and "driver" in str(error))
        print(scene().render(lens, method="taps").shape[0])
        """,
        VK_DRIVER_FILES="/nonexistent",
        DOFSIM_DEVICE="",
    )
    assert printed == ["0", "True", "200"]


@pytest.mark.skipif(sys.platform != "linux", reason="drivers are chosen the Linux way")
def test_a_driver_without_its_hardware_lists_nothing():
    drivers = Path("/usr/share/vulkan/icd.d").glob("*.json")
    others = [path for path in drivers if not path.name.startswith(("lvp", "nvidia"))]
    if not others or any(device.kind != "software" for device in dofsim.devices()):
        pytest.skip("there is no driver whose hardware is missing")
    assert output("print(len(dofsim.devices()))", VK_DRIVER_FILES=str(others[0])) == ["0"]


@pytest.mark.skipif(sys.platform != "linux", reason="reads the process's own map")
def test_drivers_are_loaded_when_they_are_asked_for():
    loaded = "print('libvulkan' in open('/proc/self/maps').read())"
    assert output(loaded) == ["False"]
    assert output(f"dofsim.devices()\n{loaded}") == ["True"] or not dofsim.devices()


def test_a_frame_beyond_the_binding_limit_is_rendered_all_the_same(gpu):
    most = min(device.max_binding_bytes for device in dofsim.devices())
    side = int(np.ceil(np.sqrt(most / 16))) + 1
    if side > 6000:
        pytest.skip("the device holds more than this test should make")
    color = np.random.default_rng(3).random((side, side, 4), dtype=np.float32)
    depth = np.broadcast_to(np.linspace(1.0, 4.0, side, dtype=np.float32)[:, None], (side, side))
    large = dofsim.Scene(color, depth, device=gpu, alpha="none")
    wide = dofsim.Lens(aperture_radius=0.1, focus_distance=2.0, fov=40.0)
    # The fewest look-ups, for a software rasteriser has to make them all.
    options = {"method": "taps", "variant": "four"}
    expected = dofsim.render(color, depth, wide, device="cpu", alpha="none", **options)
    np.testing.assert_allclose(large.render(wide, **options), expected, atol=2e-4)


@pytest.mark.parametrize("method", ["taps", "lens"])
def test_two_threads_share_a_device_and_a_scene(gpu, method):
    shared, own = scene(80, 120, device=gpu), scene(60, 80, device=gpu)
    expected = [one.render(lens, method=method) for one in (shared, own)]
    results = [[], [], []]

    def work(i, one):
        for _ in range(3):
            results[i].append(one.render(lens, method=method))

    threads = [threading.Thread(target=work, args=(i, one)) for i, one in enumerate((shared, shared, own))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for got, want in zip(results, [expected[0], *expected], strict=True):
        assert len(got) == 3
        for picture in got:
            np.testing.assert_array_equal(picture, want)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_child_has_a_device_of_its_own(gpu):
    printed = output(
        """
        import os
        one = scene(80, 120, device=device)
        want = one.render(lens)
        pid = os.fork()
        if pid == 0:
            same = np.array_equal(one.render(lens), want)
            del one
            os._exit(0 if same else 3)
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
        print(np.array_equal(one.render(lens), want))
        """,
        gpu,
    )
    assert printed == ["0", "True"]


def test_the_interpreter_may_end_during_a_render(gpu):
    printed = output(
        """
        import threading
        import time
        one = scene(400, 600, device=device)
        one.render(lens, method="taps")
        threading.Thread(target=lambda: one.render(lens, views=4096), daemon=True).start()
        began = time.monotonic()
        while time.process_time() < 2.0 and time.monotonic() - began < 1.0:
            time.sleep(0.01)
        print("over", flush=True)
        """,
        gpu,
    )
    assert printed == ["over"]


@pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")
def test_interrupt_stops_the_wait_for_a_device(gpu):
    out = said(
        """
        one = scene(600, 800, device=device)
        one.render(lens, method="taps")
        # A GPU that is no software takes no processor time: the wall clock says when.
        print(interrupted(lambda: one.render(lens, views=8192), 2.0, wall_s=3.0), flush=True)
        os._exit(0)
        """,
        gpu,
    )
    if out.strip() == "finished":
        pytest.skip("the device was done before it could be interrupted")
    assert_prompt(out, 1.0)
