"""Batches that are killed at any moment, and batches side by side: every file is whole, and none is lost."""

import contextlib
import itertools
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from frames import write_frames
from interrupts import HANG_S

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="workers are found and killed the Linux way")

KILLS = int(os.environ.get("DOFSIM_KILLS", "3"))
PAIRS = int(os.environ.get("DOFSIM_PAIRS", "1"))
COUNT = 16
# Views enough that a frame takes much longer than a look at what is there.
LENS = ["--aperture-radius", "0.3", "--focus-distance", "3", "--fov", "40"]
OPTIONS = [*LENS, "--set", "views=2048", "--outputs", "picture,coc,mask"]


@pytest.fixture
def expected(tmp_path, monkeypatch):
    """Go to a folder with a data set; give the files of a batch that nobody disturbs."""
    monkeypatch.chdir(tmp_path)
    write_frames(COUNT, seed=10)
    run = start("calm")
    run.communicate(timeout=HANG_S)
    assert run.returncode == 0
    files = contents("calm")
    assert len(files) == 4 * COUNT + 1
    return files


def start(folder, workers=2):
    command = [sys.executable, "-c", "from dofsim.cli import main; main()", "batch"]
    return subprocess.Popen(
        [*command, "rgb", "depth", "-o", folder, *OPTIONS, "--workers", str(workers)],
        stdout=subprocess.DEVNULL,
        text=True,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def contents(folder):
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def kill_run(run, chosen):
    os.kill(run.pid, signal.SIGKILL)


def kill_all(run, chosen):
    os.killpg(run.pid, signal.SIGKILL)


def kill_worker(run, chosen):
    children = Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()
    workers = [one for one in children if b"spawn_main" in Path(f"/proc/{one}/cmdline").read_bytes()]
    os.kill(int(chosen.choice(workers)), signal.SIGKILL)


def test_a_batch_that_is_killed_again_and_again_is_whole_in_the_end(expected):
    chosen = random.Random(4)
    ways = itertools.cycle([kill_run, kill_worker, kill_all])
    kills = completed = 0
    while kills < KILLS or not completed:
        run, before = start("out"), records()
        while records() <= before and run.poll() is None:
            time.sleep(0.005)
        # About as long as a frame takes, so that all that is done for one is met.
        time.sleep(chosen.uniform(0, 0.1))
        # It may have just ended.
        with contextlib.suppress(FileNotFoundError, ProcessLookupError, IndexError):
            if kills < KILLS and run.poll() is None:
                next(ways)(run, chosen)
                kills += 1
        # Its workers hold the other end of this pipe, and end with it.
        run.communicate(timeout=HANG_S)
        assert run.returncode in (0, -signal.SIGKILL)
        # What is there under its own name is whole, at any time.
        there = {name: data for name, data in contents("out").items() if not name.startswith(".")}
        assert there.items() <= expected.items()
        if run.returncode == 0:
            assert contents("out") == expected
            completed += 1
            shutil.rmtree("out")
    print(f"{kills} kills, {completed} batches came to their end")


def records():
    return len(list(Path("out").glob("*.json")))


def test_two_batches_at_once_write_what_one_does(expected):
    refused = 0
    for number in range(PAIRS):
        folder = f"out{number}"
        runs = [start(folder, 1), start(folder, 2)]
        said = "".join(run.communicate(timeout=HANG_S)[1] for run in runs)
        # Whoever comes second is told so, unless the first one has ended.
        statuses = sorted(run.returncode for run in runs)
        assert statuses in ([0, 0], [0, 2])
        refused += 2 in statuses
        # No frame is made twice.
        assert sum(map(int, re.findall(r"(\d+) written", said))) == COUNT
        assert contents(folder) == expected
    print(f"{PAIRS} pairs, of which {refused} times one was refused")
