"""Frames on a Dask cluster: the same bits, whatever happens to its workers."""

import os
import signal
import threading
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from dofsim.batch import Frame, map_frames, pair_files
from dofsim.batch.unfinished import remove_unfinished
from dofsim.batch.workers import dask_cluster
from dofsim.cli import run
from frames import write_frames

distributed = pytest.importorskip("distributed")

COUNT = 24
LENS = {"aperture_radius": 0.3, "focus_distance": 3.0, "fov": 40.0}
LENS_OPTIONS = ("--aperture-radius", "0.3", "--focus-distance", "3", "--fov", "40")


@pytest.fixture
def data(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_frames(COUNT, seed=9)
    return tmp_path


def frames(folder, **options):
    pairs = pair_files("rgb", "depth").pairs.items()
    return [
        Frame(color=c, depth=d, output=f"{folder}/{n}.exr", lens=LENS, options=options) for n, (c, d) in pairs
    ]


def contents(folder):
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def batch(*arguments):
    return run(["batch", *(str(argument) for argument in arguments)])


def test_a_local_cluster_gives_the_same_bits(data, capsys):
    assert batch("rgb", "depth", "-o", "here", *LENS_OPTIONS) == 0
    assert batch("rgb", "depth", "-o", "there", *LENS_OPTIONS, "--dask", "local", "--workers", 2) == 0
    assert f"{COUNT} written" in capsys.readouterr().err
    assert contents("here") == contents("there")


def test_a_scheduler_elsewhere_works_on_absolute_paths(data, capsys):
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, host="127.0.0.1", dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, "--dask", address) == 0
        assert str(data / "rgb") in Path("out/0000.exr.json").read_text()
        assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, "--dask", address) == 0
        assert f"{COUNT} there already" in capsys.readouterr().err
        assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, "--dask", address, "--workers", 2) == 2
    assert "--workers is for this machine" in capsys.readouterr().err


def test_a_scheduler_that_is_not_there(data, capsys, monkeypatch):
    monkeypatch.setattr("dofsim.batch.workers._TIMEOUT_S", 0.5)
    assert batch("rgb", "depth", "-o", "out", *LENS_OPTIONS, "--dask", "tcp://127.0.0.1:9") == 1
    assert "127.0.0.1:9" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="kills the POSIX way")
# The cluster speaks of the worker it has lost.
@pytest.mark.filterwarnings("ignore")
def test_a_worker_that_is_killed_costs_nothing(data):
    expected = [result.status for result in map_frames(frames("whole", views=2048))]
    with dask_cluster("local", 2) as cluster:
        victim = cluster.executor.submit(os.getpid).result()

        def kill():
            while not list(Path("killed").glob("*.json")):
                time.sleep(0.01)
            os.kill(victim, signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        work = [replace(f, options={"views": 2048, "threads": 1}) for f in frames("killed")]
        # Frames that the dead worker had written are there when they are tried again.
        results = [result.status for result in map_frames(work, executor=cluster.executor, in_flight=4)]
        killer.join()
        assert cluster.executor.submit(os.getpid).result() != victim
    assert [status.replace("skipped", "written") for status in results] == expected
    # Death may come in the middle of a file, and here it has in any case.
    Path(f"killed/.0000.exr.{victim}-99.part").touch()
    remove_unfinished(work)
    assert contents("whole") == contents("killed")


def test_a_gpu_of_a_worker_is_taken_by_one_frame_at_a_time(data):
    with (
        distributed.LocalCluster(
            n_workers=1,
            threads_per_worker=4,
            host="127.0.0.1",
            dashboard_address=None,
            resources={"GPU": 1},
        ) as cluster,
        dask_cluster(cluster.scheduler_address, 1) as found,
    ):
        assert found.slots == 1
        spans = [found.executor.submit(span) for _ in range(3)]
        times = sorted(future.result() for future in spans)
    assert all(end <= start for (_, end), (start, _) in pairwise(times))


def span():
    start = time.monotonic()
    time.sleep(0.1)
    return start, time.monotonic()
