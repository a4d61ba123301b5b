"""A render as a guest in somebody's process: locks, signals, threads and forks."""

import contextlib
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time

import dofsim
import numpy as np
import pytest
from interrupts import HANG_S, INTERRUPTS, assert_prompt

# Edges everywhere, so that every tile is swept through all the views: many seconds of work.
SCENE = """
import dofsim
import numpy as np

def scene(height, width):
    rng = np.random.default_rng(9)
    color = rng.random((height, width, 3), dtype=np.float32)
    depth = np.kron(rng.uniform(-1.0, 1.0, (height // 20, width // 20)), np.ones((20, 20))).astype(np.float32)
    return color, depth

def render(color, depth, **options):
    lens = dofsim.Lens.from_disparity(strength_px=10.0, focus=0.0)
    return dofsim.render(color, depth, lens, depth_kind="disparity", **options)
"""
names = {}
exec(SCENE, names)
scene, render = names["scene"], names["render"]


def start(code):
    return subprocess.Popen(
        [sys.executable, "-c", SCENE + INTERRUPTS + textwrap.dedent(code)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def stop(child):
    """End the child with whatever it forked."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)


def test_the_interpreter_is_free_while_a_render_runs():
    color, depth = scene(400, 600)
    running, stop, ticks = threading.Event(), threading.Event(), []

    def tick():
        while not stop.wait(0.002):
            if running.is_set():
                ticks.append(None)

    thread = threading.Thread(target=tick)
    thread.start()
    # A render that is too short to tell is followed by a longer one. A lock that is held lets a tick through
    # before a render and one after it, however long the render is.
    for views in (512, 2048, 8192):
        ticks.clear()
        running.set()
        render(color, depth, views=views, threads=1)
        running.clear()
        if len(ticks) >= 20:
            break
    stop.set()
    thread.join()
    assert len(ticks) >= 20


def test_the_interpreter_is_free_while_a_render_waits_for_another():
    color, depth = scene(240, 360)
    first, second = (
        threading.Thread(target=render, args=(color, depth), kwargs={"views": views}) for views in (8192, 16)
    )
    # All times are of the processor, which other processes have no part in.
    began = time.process_time()
    first.start()
    # The first is among its views by then, and its workers are busy until they are done with all of them.
    while time.process_time() - began < 0.3:
        time.sleep(0.005)
    ticks = [time.process_time()]
    second.start()
    ticks.append(time.process_time())
    while first.is_alive():
        time.sleep(0.005)
        ticks.append(time.process_time())
    second.join()
    # Whoever waits for workers with the interpreter in hand keeps it until they are free.
    assert max(np.diff(ticks)) < 0.5 * (ticks[-1] - ticks[0])
    assert len(ticks) > 20, "too short a render to tell"


@pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")
# In the middle of the preparation, and in the middle of the views.
@pytest.mark.parametrize("after_s", [0.2, 1.5])
def test_interrupt_stops_a_render_within_a_second(after_s):
    child = start(f"""
        color, depth = scene(540, 960)
        print(interrupted(lambda: render(color, depth, views=16384), {after_s}))
    """)
    try:
        out, err = child.communicate(timeout=HANG_S)
    finally:
        stop(child)
    assert child.returncode == 0, err
    assert_prompt(out, 1.0)


def test_two_threads_render_at_once():
    scenes = [scene(200, 300), tuple(a[::-1] for a in scene(200, 300))]
    expected = [render(*s) for s in scenes]
    results = [[], []]

    def work(i):
        for _ in range(4):
            results[i].append(render(*scenes[i]))

    threads = [threading.Thread(target=work, args=(i,)) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for got, want in zip(results, expected, strict=True):
        assert len(got) == 4
        for out in got:
            np.testing.assert_array_equal(out, want)


def test_one_scene_serves_two_threads():
    color, depth = scene(200, 300)
    shared = dofsim.Scene(color, depth, depth_kind="disparity")
    lenses = [dofsim.Lens.from_disparity(strength_px=s, focus=0.0) for s in (3.0, 9.0)]
    expected = [shared.render(one) for one in lenses]
    results = [None, None]

    def work(i):
        for _ in range(4):
            results[i] = shared.render(lenses[i])

    threads = [threading.Thread(target=work, args=(i,)) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for out, want in zip(results, expected, strict=True):
        np.testing.assert_array_equal(out, want)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_child_renders():
    child = start("""
        import os
        import warnings
        warnings.simplefilter("ignore")
        color, depth = scene(100, 160)
        want = render(color, depth)
        pid = os.fork()
        if pid == 0:
            os._exit(0 if np.array_equal(render(color, depth), want) else 3)
        _, status = os.waitpid(pid, 0)
        print(os.waitstatus_to_exitcode(status))
    """)
    try:
        # A child that waits for its parent's threads would wait for ever.
        out, err = child.communicate(timeout=HANG_S)
    finally:
        stop(child)
    assert out.strip() == "0", err
