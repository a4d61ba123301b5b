"""How runs of `dofsim batch` end, by themselves, by a signal or by a death, and how the next one goes on."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from data_set import (
    LENS_OPTIONS,
    batch,
)
from interrupts import HANG_S

# A shell has its background jobs ignore Ctrl-C, and what they start inherits that.
START = """
import signal
from dofsim.cli import main

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    main()
"""


def start(*arguments):
    command = [sys.executable, "-c", START, "batch", *arguments]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def wait_for(condition):
    deadline = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def records():
    return len(list(Path("out").glob("*.json")))


@pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")
@pytest.mark.parametrize("workers", ["1", "2"])
def test_ctrl_c_ends_cleanly_and_the_next_run_resumes(data, capsys, workers):
    # Views enough that 50 frames take much longer than a look at what is there.
    arguments = ["rgb", "depth", *LENS_OPTIONS, "--set", "views=2048", "--workers", workers]
    child = start(*arguments, "-o", "out")
    wait_for(lambda: records() >= 2)
    # As a terminal does: to all of its processes.
    os.killpg(child.pid, signal.SIGINT)
    _, err = child.communicate(timeout=HANG_S)
    assert child.returncode == 1
    assert err.splitlines()[-1] == "dofsim: interrupted"
    assert "Traceback" not in err
    done = records()
    assert 2 <= done < 47
    assert not list(Path("out").glob(".*"))
    assert batch(*arguments, "-o", "out") == 1
    assert f"{47 - done} written, {done} there already, 3 failed" in capsys.readouterr().err


# Python runs this as it starts, long before it can know what it was started for.
INTERRUPTED = """
import os
import signal
import sys

if "--multiprocessing-fork" in sys.orig_argv:
    os.kill(os.getpid(), signal.SIGINT)
"""

POOL = """
import os
import signal
from dofsim.batch.workers import process_pool

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with process_pool(1) as pool:
        assert pool.submit(os.getppid).result() == os.getpid()
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == set()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")
def test_ctrl_c_does_not_meet_a_worker_that_starts(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(INTERRUPTED)
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    result = subprocess.run(
        [sys.executable, "-c", POOL],
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG_S,
    )
    assert result.stderr == ""
    assert result.returncode == 0


# A frame whose picture is to end whoever reads it, as one does that takes more memory than there is, while
# another file is being written.
DEADLY = """
import os
from pathlib import Path
from dofsim import io
from dofsim.cli import main

def read_rgbd(color, *arguments, **words):
    if color.name == "0001.exr":
        Path(f"out/.0002.exr.{os.getpid()}-9.part").touch()
        os._exit(1)
    return read(color, *arguments, **words)

read, io.read_rgbd = io.read_rgbd, read_rgbd
if __name__ == "__main__":
    main()
"""


def run_deadly(*arguments):
    Path("deadly.py").write_text(DEADLY)
    command = [sys.executable, "deadly.py", "batch", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANG_S)


def test_a_frame_that_kills_its_worker_is_one_failure(few):
    arguments = ["rgb", "depth", *LENS_OPTIONS, "-o", "out", "--workers", "2"]
    for skipped in (0, 3):
        result = run_deadly(*arguments)
        assert result.returncode == 1
        assert f"{3 - skipped} written, {skipped} there already, 1 failed" in result.stderr
        (failure,) = map(json.loads, Path("out/failures.jsonl").read_text().splitlines())
        assert failure["color"] == str(Path("rgb/0001.exr"))
        assert failure["error"].startswith("the process that computed it was killed")
        assert not list(Path("out").glob(".*"))
    assert batch(*arguments) == 0


def test_a_frame_that_kills_the_run_is_computed_apart_the_next_time(few):
    arguments = ["rgb", "depth", *LENS_OPTIONS, "-o", "out"]
    assert run_deadly(*arguments).returncode == 1
    assert not Path("out/failures.jsonl").exists()
    result = run_deadly(*arguments)
    assert ", 1 failed" in result.stderr
    assert len(list(Path("out").glob("*.exr"))) == 3
    assert not list(Path("out").glob(".*"))


def test_one_run_at_a_time_writes_into_a_folder(data, capsys):
    arguments = ["rgb", "depth", *LENS_OPTIONS, "-o", "out", "--set", "views=2048"]
    child = start(*arguments)
    wait_for(lambda: records() >= 2)
    assert batch(*arguments) == 2
    message = f"out: another dofsim batch is writing there (process {child.pid})"
    assert message in capsys.readouterr().err
    assert child.poll() is None
    child.terminate()
    child.communicate(timeout=HANG_S)


@pytest.mark.skipif(os.name != "posix", reason="locks a file the POSIX way")
def test_what_a_living_process_writes_is_not_removed(few):
    import fcntl

    Path("out").mkdir()
    mine = Path("out/.0001.exr.123-4.part")
    with mine.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert batch("rgb", "depth", *LENS_OPTIONS, "-o", "out") == 0
    assert mine.exists()


@pytest.mark.skipif(os.name != "posix", reason="what is unfinished is removed there")
def test_what_a_dead_process_wrote_is_removed_whoever_has_its_number(few):
    # The number is soon another process's, and a dead process keeps it until its parent has asked after it.
    Path("out").mkdir()
    left = Path(f"out/.0001.exr.{os.getpid()}-4.part")
    left.touch()
    assert batch("rgb", "depth", *LENS_OPTIONS, "-o", "out") == 0
    assert not left.exists()


@pytest.mark.skipif(os.name != "posix", reason="signals are sent the POSIX way")
def test_workers_end_with_a_killed_run_and_its_unfinished_files_go(data, capsys):
    arguments = ["rgb", "depth", *LENS_OPTIONS, "--workers", "2"]
    child = start(*arguments, "-o", "out")
    wait_for(lambda: records() >= 2)
    child.kill()
    # The workers hold the other ends of these pipes.
    child.communicate(timeout=HANG_S)
    left = Path("out/.0040.exr.123-4.part")
    left.touch()
    other = Path("out/.0099.exr.123-4.part")
    other.touch()
    done = records()
    assert batch(*arguments, "-o", "out") == 1
    assert f"{47 - done} written, {done} there already" in capsys.readouterr().err
    assert not left.exists()
    assert other.exists()
