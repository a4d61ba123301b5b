"""What a further channel with a guide costs, in parts of the first three, and in memory.

The picture is that of `pictures.py`, with edges everywhere. Time is that of the processors, so that what else
a machine does counts little. Numbers of channels are measured in turn, and the least of each is taken.
"""

import argparse
import re
import subprocess
import sys
import time
from pathlib import Path

import dofsim
import numpy as np
from pictures import HEIGHT, WIDTH, lens_of, planes

RADII_PX = (4, 16, 64)
COUNTS = (3, 4, 7, 23)
MEMORY_RADIUS_PX = 16


def channels(count: int):
    """Make channels that have nothing to do with the picture."""
    return np.random.default_rng(1).random((HEIGHT, WIDTH, count), dtype=np.float32)


def seconds(*given, **words) -> float:
    """Give the time of the processors that a render takes."""
    start = time.process_time()
    dofsim.render(*given, device="cpu", **words)
    return time.process_time() - start


def peak_bytes(count: int, kind: str) -> int:
    """Give the largest memory of a process that renders so many channels."""
    command = [sys.executable, __file__, "--memory-of", str(count), "--kind", kind]
    return int(subprocess.run(command, capture_output=True, check=True, text=True).stdout)


def main() -> None:
    """Measure every radius."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--kind", default="light")
    parser.add_argument("--memory-of", type=int, help="render so many channels, and print the memory taken")
    arguments = parser.parse_args()
    color, depth = planes()
    words = {"guide": color, "kinds": arguments.kind, "threads": arguments.threads}
    if arguments.memory_of:
        seconds(channels(arguments.memory_of), depth, lens_of(MEMORY_RADIUS_PX), **words)
        # What the system counts for a process goes on from that of its parent; this does not.
        status = Path("/proc/self/status").read_text()
        print(1024 * int(re.findall(r"VmHWM:\s+(\d+)", status)[0]))
        return
    for radius in RADII_PX:
        lens = lens_of(radius)
        plain, times = np.inf, dict.fromkeys(COUNTS, np.inf)
        for _ in range(arguments.runs):
            plain = min(plain, seconds(color, depth, lens, threads=arguments.threads))
            for count in COUNTS:
                times[count] = min(times[count], seconds(channels(count), depth, lens, **words))
        shares = [(times[count] - times[3]) / (count - 3) / times[3] for count in COUNTS[1:]]
        print(
            f"{radius:>4} px: the picture {plain:.2f} s, three channels {times[3]:.2f} s, "
            f"23 {times[23]:.2f} s; each further one of {', '.join(map(str, COUNTS[1:]))}: "
            f"{', '.join(f'{100 * share:.1f} %' for share in shares)}"
        )
    few, many = (peak_bytes(count, arguments.kind) for count in (3, 23))
    print(f"memory of a further channel: {(many - few) / 20 / (WIDTH * HEIGHT):.0f} bytes a pixel")


if __name__ == "__main__":
    main()
