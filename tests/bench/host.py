"""What a device leaves to the host: processor time for a new frame, and the bytes that go there and back.

Run this file on Linux. A software rasteriser does as a device, because the time of its threads is left out:
they are those that come up when it is opened. Shaders are compiled before. With `--steps`, `perf` samples the
threads of the host, and samples are counted by the module of dofsim in which they are. What is waited for is
in `gpu::submissions`, and depends on how slow the device is.
"""

import argparse
import collections
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import dofsim
from dofsim._dofsim import device_traffic
from pictures import lens_of, planes

MEBIBYTE = 2**20
SAMPLES_PER_S = 1000
# Few views: their number hardly changes what the host does, and a software rasteriser takes long for each.
OPTIONS = {"views": 16}


def threads():
    """List the threads of this process."""
    return {task.name for task in Path("/proc/self/task").iterdir()}


def threads_of(device, color, depth):
    """Open a device, compile its shaders, and list its threads."""
    small = color[:256, :256], depth[:256, :256]
    lens = lens_of(16, depth)
    dofsim.render(*small, lens, device="cpu")
    before = threads()
    for radius in (16, 2, 0.01):
        dofsim.render(*small, lens_of(radius, depth), device=device, **OPTIONS)
    return threads() - before


def host_ms(of_device):
    """Give the processor time of this process so far, without these threads."""
    files = [Path(f"/proc/self/task/{thread}/schedstat") for thread in of_device]
    spent = sum(1e-6 * int(file.read_text().split()[0]) for file in files if file.exists())
    return 1e3 * time.process_time() - spent


def measured(scene, lens, of_device):
    """Render a scene; give the host's time for it, and what it takes to the device and back."""
    before, began = device_traffic(), host_ms(of_device)
    scene.render(lens, **OPTIONS)
    spent = host_ms(of_device) - began
    return spent, {name: count - before[name] for name, count in device_traffic().items()}


def totals(arguments, color, depth, lens):
    """Print the time and the traffic of a new frame, and of a prepared scene at another focus."""
    of_device = threads_of(arguments.device, color, depth)
    nearer = lens.replace(focus_distance=0.98 * lens.focus_distance)
    new, prepared = [], []
    for _ in range(arguments.runs):
        scene = dofsim.Scene(color, depth, device=arguments.device)
        new.append(measured(scene, lens, of_device))
        prepared.append(measured(scene, nearer, of_device))
    for name, found in (("a new frame", new), ("another focus", prepared)):
        went = found[0][1]
        up, down = went["uploaded_bytes"], went["downloaded_bytes"]
        print(f"{name}: {statistics.median(ms for ms, _ in found):.0f} ms of the host's processors;")
        print(f"  {up / MEBIBYTE:.1f} MiB to the device, {up / depth.size:.1f} bytes a pixel;")
        print(f"  {down / MEBIBYTE:.1f} MiB back, readbacks: {went['readbacks']};")
        print(f"  submissions: {went['submissions']}")


def frames(arguments, color, depth, lens):
    """Render new frames, for `perf`; print the threads of the device and when the frames began."""
    print(*threads_of(arguments.device, color, depth))
    print(time.monotonic(), flush=True)
    for _ in range(arguments.runs):
        dofsim.Scene(color, depth, device=arguments.device).render(lens, **OPTIONS)


def step_of(stack):
    """Name the module of dofsim in which a sample is, or what it is in beside."""
    inside = [found[1] for symbol in stack if (found := re.search(r"_dofsim::((?:[a-z_0-9]+::)+)", symbol))]
    step = inside[0].removesuffix("::") if inside else "outside of dofsim"
    return f"{step}, pages of memory" if any("page" in symbol for symbol in stack[:4]) else step


def steps(arguments):
    """Print the processor time of a new frame by modules."""
    with tempfile.TemporaryDirectory() as folder:
        data = str(Path(folder) / "perf.data")
        again = [sys.executable, __file__, "--frames", "--device", arguments.device]
        again += ["--runs", str(arguments.runs), "--radius", str(arguments.radius)]
        record = ["perf", "record", "-k", "mono", "-e", "cpu-clock", "-F", str(SAMPLES_PER_S)]
        record += ["--call-graph", "dwarf,16384", "-o", data, *again]
        told = subprocess.run(record, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()
        of_device, began = set(told[0].split()), float(told[1])
        script = ["perf", "script", "-i", data, "-F", "tid,time,ip,sym", "--no-inline"]
        samples = subprocess.run(script, check=True, stdout=subprocess.PIPE, text=True).stdout.split("\n\n")
    counts = collections.Counter()
    for sample in samples:
        head, *stack = [line.strip() for line in sample.splitlines() if line.strip()] or [""]
        if head and head.split()[0] not in of_device and float(head.split()[1].rstrip(":")) > began:
            counts[step_of(stack)] += 1
    for step, count in counts.most_common():
        milliseconds = count * 1e3 / SAMPLES_PER_S / arguments.runs
        if milliseconds >= 1.0:
            print(f"{step:<60} {milliseconds:6.0f} ms")


def main() -> None:
    """Measure a frame of 1920 x 1080 pixels."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--device", default="gpu:0", help="as `dofsim devices` lists it")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--radius", type=float, default=16, help="the largest radius of the blur in pixels")
    parser.add_argument("--steps", action="store_true", help="by modules, with perf")
    parser.add_argument("--frames", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.steps:
        steps(arguments)
        return
    color, depth = planes()
    (frames if arguments.frames else totals)(arguments, color, depth, lens_of(arguments.radius, depth))


if __name__ == "__main__":
    main()
