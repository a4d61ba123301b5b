"""How much of the time of a batch is rendering, and whether its memory stays flat.

Frames of 640 x 480 with depth, OpenEXR in and out, through `dofsim.batch.map_frames`; and the same frames
rendered in memory, one after another. Run this file with dofsim installed; Linux only.
"""

import argparse
import tempfile
import time
from pathlib import Path

import dofsim
import numpy as np
from dofsim import io
from dofsim.batch import Frame, map_frames

HEIGHT, WIDTH = 480, 640
LENS = {"aperture_radius": 0.05, "focus_distance": 4.0, "fov": 40.0}
# Different pictures; the files are so many more.
DIFFERENT = 10


def resident_mb() -> float:
    """Read the memory that this process has now."""
    fields = Path("/proc/self/status").read_text().split("VmRSS:")[1].split()
    return int(fields[0]) / 1e3


def picture(index: int) -> tuple[np.ndarray, np.ndarray]:
    """Make a textured wall with a few tilted cards in front of it."""
    rng = np.random.default_rng(index)
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    color = 0.5 + 0.5 * np.sin(
        x[..., None] * rng.uniform(0.05, 0.6, 3) + y[..., None] * rng.uniform(0.05, 0.6, 3)
    )
    depth = np.full((HEIGHT, WIDTH), 9.0, np.float32)
    for z in np.linspace(7.0, 2.0, 8):
        left, top = rng.uniform(0, WIDTH), rng.uniform(0, HEIGHT)
        card = (np.abs(x - left) < rng.uniform(30, 120)) & (np.abs(y - top) < rng.uniform(30, 120))
        depth[card] = (z + 0.002 * (x - left))[card]
        color[card] = color[card] * rng.uniform(0.2, 1.0, 3)
    return color.astype(np.float32), depth


def main() -> None:
    """Print the rates and the memory."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--frames", type=int, default=500)
    arguments = parser.parse_args()
    pictures = [picture(index) for index in range(DIFFERENT)]
    lens = dofsim.Lens(**LENS)
    radius = max(float(np.abs(dofsim.coc(depth, lens)).max()) for _, depth in pictures)
    print(f"{arguments.frames} frames of {WIDTH} x {HEIGHT}, largest radius {radius:.1f} px")

    def in_memory() -> float:
        start = time.perf_counter()
        for color, depth in pictures:
            dofsim.render(color, depth, lens)
        return (time.perf_counter() - start) / DIFFERENT

    in_memory()
    with tempfile.TemporaryDirectory() as folder:
        frames = []
        for index, (color, depth) in enumerate(pictures):
            io.write_image(Path(folder, f"{index}.exr"), color, depth=depth)
        for index in range(arguments.frames):
            source, output = Path(folder, f"{index % DIFFERENT}.exr"), Path(folder, "out", f"{index:05}.exr")
            frames.append(Frame(color=source, output=output, lens=LENS))
        # Rendering alone is measured before, after and in between, so that a busy machine is busy for both.
        alone = [in_memory()]
        seconds, memory = 0.0, {}
        start = time.perf_counter()
        for done, result in enumerate(map_frames(frames), 1):
            assert result.status == "written", result.error
            if done in (50, arguments.frames):
                memory[done] = resident_mb()
            if done % 100 == 0:
                seconds += time.perf_counter() - start
                alone.append(in_memory())
                start = time.perf_counter()
        seconds += time.perf_counter() - start
    render = arguments.frames * float(np.mean(alone))
    print(f"rendering alone {arguments.frames / render:6.2f} frames/s")
    print(
        f"batch           {arguments.frames / seconds:6.2f} frames/s, {100 * render / seconds:.0f} % of that"
    )
    print(", ".join(f"{mb:.0f} MB after frame {done}" for done, mb in memory.items()))


if __name__ == "__main__":
    main()
