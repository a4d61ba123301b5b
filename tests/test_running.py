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
        [sys.executable, "-c", SCENE + textwrap.dedent(code)],
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
    ticks, stop = [], threading.Event()

    def tick():
        while not stop.wait(0.005):
            ticks.append(time.perf_counter())

    thread = threading.Thread(target=tick)
    thread.start()
    began = time.perf_counter()
    render(color, depth, views=1024, threads=1)
    ended = time.perf_counter()
    stop.set()
    thread.join()
    during = [t for t in ticks if began < t < ended]
    assert ended - began > 0.2, "too short a render to tell"
    # A tick takes 5 ms; a tenth of them leaves room for a busy machine, and a held lock lets none through.
    assert len(during) > (ended - began) / 0.005 / 10


def test_the_interpreter_is_free_while_a_render_waits_for_another():
    color, depth = scene(400, 600)
    first, second = (
        threading.Thread(target=render, args=(color, depth), kwargs={"views": views}) for views in (8192, 16)
    )
    began = time.perf_counter()
    first.start()
    # The first is among its views by now, and its workers are busy until they are done with all of them.
    time.sleep(0.5)
    second.start()
    ticks = [time.perf_counter()]
    while first.is_alive():
        time.sleep(0.005)
        ticks.append(time.perf_counter())
    second.join()
    assert ticks[-1] - began > 1.0, "too short a render to tell"
    # Whoever waits for workers with the interpreter in hand keeps it until they are free.
    assert max(np.diff(ticks)) < 0.5 * (ticks[-1] - ticks[0])


@pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")
# In the middle of the preparation, and in the middle of the views.
@pytest.mark.parametrize("after_s", [0.3, 3.0])
def test_interrupt_stops_a_render_within_a_second(after_s):
    child = start("""
        import signal
        signal.signal(signal.SIGINT, signal.default_int_handler)
        color, depth = scene(1080, 1920)
        print("started", flush=True)
        try:
            render(color, depth, views=16384)
        except KeyboardInterrupt:
            print("interrupted", flush=True)
        else:
            print("finished", flush=True)
    """)
    try:
        assert child.stdout.readline().strip() == "started"
        time.sleep(after_s)
        assert child.poll() is None
        sent = time.perf_counter()
        child.send_signal(signal.SIGINT)
        assert child.stdout.readline().strip() == "interrupted"
        assert time.perf_counter() - sent < 1.0
        assert child.wait(timeout=10) == 0
    finally:
        stop(child)
        child.communicate()


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
        out, err = child.communicate(timeout=10)
    finally:
        stop(child)
    assert out.strip() == "0", err
