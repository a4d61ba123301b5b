"""Many renders at once, in processes of every kind, interrupted anywhere, and for long."""

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import dofsim
import numpy as np
import pytest
from interrupts import HANG_S, INTERRUPTS, assert_prompt

METHODS = ["lens", "poisson", "gaussian", "hexagonal", "levels", "taps", "sprites"]
# `make soak` asks for 2000.
RENDERS = int(os.environ.get("DOFSIM_RENDERS", "200"))
linux = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
posix = pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")


def some_scene(rng, **options):
    height, width = rng.integers(1, 70, 2)
    color = rng.random((height, width, int(rng.choice([1, 3, 4]))), dtype=np.float32)
    color[..., :3] *= color[..., 3:] if color.shape[-1] == 4 else 1.0
    depth = rng.choice([1.0, 1.5, 2.0, 5.0, np.inf], (height, width)).astype(np.float32)
    return dofsim.Scene(color, depth, **options)


def some_words(rng, threads=(None, 1, 2, 3)):
    """Draw a lens and options that all methods take."""
    lens = dofsim.Lens(
        aperture_radius=float(rng.uniform(0.0, 0.2)),
        focus_distance=float(rng.uniform(0.8, 6.0)),
        fov=float(rng.uniform(30.0, 80.0)),
    )
    return lens, {"method": str(rng.choice(METHODS)), "threads": rng.choice(np.array(threads, object))}


def in_threads(work, count=8):
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, range(count)))


@pytest.mark.parametrize("which", ["one scene", "many scenes"])
def test_eight_threads_get_what_one_gets(which):
    rng = np.random.default_rng(4)
    each = max(20, RENDERS // 10)
    scenes = [some_scene(rng) for _ in range(1 if which == "one scene" else 40)]
    jobs = [(scenes[rng.integers(len(scenes))], *some_words(rng)) for _ in range(8 * each)]
    expected = [scene.render(lens, **words) for scene, lens, words in jobs]

    def work(thread):
        return [scene.render(lens, **words) for scene, lens, words in jobs[thread * each :][:each]]

    for i, got in enumerate(picture for pictures in in_threads(work) for picture in pictures):
        np.testing.assert_array_equal(got, expected[i])


def workers():
    """Count the threads of this process that renders are computed by."""
    count = 0
    for task in Path("/proc/self/task").iterdir():
        # A thread may end between the listing and the reading.
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            count += (task / "comm").read_text().startswith("dofsim-")
    return count


def workers_are_shared():
    """Run in a process of its own, where no other test has left workers."""
    processors = len(os.sched_getaffinity(0))
    color, depth = np.ones((8, 8), np.float32), np.full((8, 8), 2.0)
    lens = dofsim.Lens(aperture_radius=0.1, focus_distance=1.0, fov=40.0)
    for threads in range(1, 33):
        dofsim.render(color, depth, lens, threads=threads)
    # One set renders, one reads, and the last call has left its own. Those told to stop take a moment.
    most = 2 * processors + 32
    deadline = time.monotonic() + HANG_S
    while workers() > most:
        assert time.monotonic() < deadline, workers()
        time.sleep(0.01)
    # On a busy machine some of them have no name yet, so how many there are is no bound for later.
    dofsim.render(color, depth, lens, threads=1)
    in_threads(lambda _: [dofsim.render(color, depth, lens) for _ in range(50)])
    assert workers() <= most + 1


@linux
def test_workers_are_shared_unless_a_call_asks_for_its_own():
    folder = str(Path(__file__).parent)
    code = f"import sys; sys.path.insert(0, {folder!r}); import test_load; test_load.workers_are_shared()"
    with ended(child(code)) as process:
        _, error = process.communicate(timeout=2 * HANG_S)
        assert process.returncode == 0, error


@linux
def test_calls_of_one_thread_each_run_side_by_side():
    color = np.random.default_rng(1).random((300, 400, 3), dtype=np.float32)
    depth = np.random.default_rng(2).uniform(1.0, 5.0, (300, 400))
    lens = dofsim.Lens(aperture_radius=0.05, focus_distance=2.0, fov=40.0)
    busy = set()

    def work(_):
        # Until the watcher, which may have to wait for a processor itself, has seen them.
        for _ in range(100):
            dofsim.render(color, depth, lens, threads=1, views=64)
            if len(busy) >= 3:
                break

    def watch():
        while not done.wait(0.005):
            for task in Path("/proc/self/task").iterdir():
                with contextlib.suppress(FileNotFoundError, ProcessLookupError):
                    name, _, rest = (task / "stat").read_text().partition(")")
                    if "(dofsim-0" in name and rest.split()[0] == "R":
                        busy.add(task.name)

    done = threading.Event()
    watcher = threading.Thread(target=watch)
    watcher.start()
    in_threads(work, 3)
    done.set()
    watcher.join()
    assert len(busy) >= 3


def child_render(seed):
    rng = np.random.default_rng(seed)
    scene = some_scene(rng)
    lens, words = some_words(rng)
    return scene.render(lens, **words)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("start", multiprocessing.get_all_start_methods())
def test_processes_of_every_kind_render_the_same(start):
    expected = [child_render(seed) for seed in range(12)]
    with multiprocessing.get_context(start).Pool(2) as pool:
        for got, want in zip(pool.map(child_render, range(12)), expected, strict=True):
            np.testing.assert_array_equal(got, want)


def child(code):
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", textwrap.dedent(code)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@contextlib.contextmanager
def ended(process):
    """Leave no process behind."""
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


NOISE = (
    """
import dofsim, os, sys
import numpy as np
from dofsim import io

rng = np.random.default_rng(9)
color = rng.random((1080, 1920, 3), dtype=np.float32)
depth = np.kron(rng.uniform(1.0, 8.0, (54, 96)), np.ones((20, 20))).astype(np.float32)
lens = dofsim.Lens(aperture_radius=1.0, focus_distance=2.0, fov=50.0)
"""
    + INTERRUPTS
)

# Work of seconds, each in another loop of the core, and what it works on.
SMALL = "color, depth = color[:360, :640].copy(), depth[:360, :640].copy()"
PHASES = {
    "preparation": (
        "color, depth = np.tile(color, (2, 2, 1)), np.tile(depth, (2, 2))",
        "dofsim.Scene(color, depth).render(lens.replace(aperture_radius=0.6))",
    ),
    "views": (SMALL, "dofsim.render(color, depth, lens, views=16384)"),
    "barrel": (SMALL, "dofsim.render(color, depth, lens.replace(cat_eye=0.7), views=16384)"),
    "disc": (
        "color, depth = np.tile(color, (2, 2, 1)), np.tile(depth, (2, 2)) * 0 + 4",
        "dofsim.render(color, depth, lens.replace(aperture_radius=0.5), resolution='full', "
        "aperture=dofsim.Aperture(apodization=0.5))",
    ),
    "kernels": (
        "color = np.where(rng.random((64, 512, 1)) < 0.02, np.float32(1e4), color[:64, :512])\n"
        "depth = np.tile(1 / np.linspace(1 / 3, 1 / 6, 512, dtype=np.float32), (64, 1))",
        "dofsim.render(color, depth, lens, aperture=dofsim.Aperture(apodization=0.5))",
    ),
    "hexagonal": ("", "dofsim.render(color, depth, lens, method='hexagonal', max_coc_px=256.0)"),
    "sprites": ("", "dofsim.render(color, depth, lens, method='sprites', max_coc_px=256.0)"),
    "stack": (
        SMALL,
        "dofsim.Scene(color, depth).focal_stack("
        "lens, np.linspace(1.0, 8.0, 400), method='poisson', taps=128)",
    ),
}


@posix
@pytest.mark.parametrize("phase", list(PHASES))
def test_ctrl_c_stops_every_phase(phase):
    data, work = PHASES[phase]
    code = f"""
{data}
print(interrupted(lambda: {work}, 1.0), flush=True)
# What is left of the process still works.
print(dofsim.render(color[:16, :40].copy(), depth[:16, :40].copy(), lens).shape, flush=True)
"""
    with ended(child(NOISE + code)) as process:
        out, err = process.communicate(timeout=HANG_S)
        assert process.returncode == 0, err
    stopped, after = out.splitlines()
    assert_prompt(stopped, 1.5)
    assert after == "(16, 40, 3)"


@posix
def test_ctrl_c_while_files_are_written_leaves_whole_ones_or_none(tmp_path):
    code = f"""
os.chdir({str(tmp_path)!r})

def work():
    while True:
        for name in ("a.png", "a.exr", "a.npz"):
            io.write_image(name, color[::2, ::2])
            io.read_color(name)

print(interrupted(work, 0.8).split()[0], *sorted(os.listdir()), flush=True)
for name in os.listdir():
    assert io.read_color(name).pixels.shape == (540, 960, 3)
"""
    with ended(child(NOISE + code)) as process:
        out, err = process.communicate(timeout=HANG_S)
        assert process.returncode == 0, err
    stopped, *names = out.split()
    assert stopped == "interrupted"
    assert set(names) <= {"a.png", "a.exr", "a.npz"}


def test_the_interpreter_may_end_during_renders():
    code = """
for _ in range(3):
    threading.Thread(target=lambda: dofsim.render(color, depth, lens, views=16384), daemon=True).start()
while time.process_time() < 1.5:
    time.sleep(0.01)
print("over", flush=True)
"""
    with ended(child(NOISE + code)) as process:
        out, err = process.communicate(timeout=HANG_S)
        assert process.returncode == 0, err
        assert out == "over\n"


@linux
def test_only_the_main_thread_comes_back_to_the_interpreter_before_its_render_is_over():
    # CPython before 3.13 crashes if a daemon thread does so while the interpreter ends. A thread
    # that only waits for its workers is not woken.
    code = """
def wakings(thread):
    with open(f"/proc/self/task/{thread.native_id}/status") as file:
        return [int(line.split()[1]) for line in file if line.startswith("voluntary_ctxt_switches")]

def render():
    dofsim.render(color, depth, lens, views=16384)

thread = threading.Thread(target=render, daemon=True)
thread.start()
while time.process_time() < 1.5:
    time.sleep(0.01)
before = wakings(thread)
time.sleep(0.5)
print(thread.is_alive(), wakings(thread) == before, flush=True)
"""
    with ended(child(NOISE + code)) as process:
        out, err = process.communicate(timeout=HANG_S)
        assert process.returncode == 0, err
        assert out == "True True\n"


SOAK = """
import gc, os, sys
import numpy as np
sys.path.insert(0, {tests!r})
from test_load import some_scene, some_words

def resources():
    gc.collect()
    with open("/proc/self/statm") as file:
        resident = int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20
    return resident, len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task"))

rng = np.random.default_rng(6)
scene = None
for i in range({first} + {renders}):
    if i == {first}:
        print(*resources(), flush=True)
    if i % 3 == 0:
        scene = some_scene(rng, device={device!r})
    lens, words = some_words(rng)
    scene.render(lens, **words)
print(*resources(), flush=True)
"""


def soak(device):
    """Count MiB of memory, files and threads when all that is kept is there, and after many more renders."""
    # Shaders of all methods are translated by then, and memory of all sizes is left to the next render.
    first = max(300, RENDERS // 2)
    code = SOAK.format(tests=str(Path(__file__).parent), first=first, renders=RENDERS, device=device)
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return [tuple(map(float, line.split())) for line in run.stdout.splitlines()]


@linux
@pytest.mark.parametrize("device", ["cpu", "gpu"])
def test_nothing_is_left_of_many_renders(device, request):
    name = "cpu" if device == "cpu" else request.getfixturevalue("gpu")
    (resident, files, threads), (resident_after, files_after, threads_after) = soak(name)
    print(f"{device}: {RENDERS} renders, {resident:.0f} MiB, then {resident_after:.0f} MiB")
    assert resident_after - resident < 16
    assert files_after <= files
    # Threads that were told to stop may not all have done so at either time.
    assert threads_after <= threads + 4
