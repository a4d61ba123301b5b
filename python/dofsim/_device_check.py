"""Whether an adapter computes what the CPU computes: ``dofsim devices --check``."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._dofsim import Device, DeviceError, Lens, methods_available, render

# How far devices may be apart, as a share of the picture's range. Both compute in float32, but only the CPU
# has the optics in float64, and a GPU may fuse products into sums and divide less exactly.
AGREEMENT = 2e-4
# The flagship adds up hundreds of views, and a ray that just grazes a cell may meet it on one device alone.
LENS_AGREEMENT = 2e-3
LENS_PSNR = 60.0

# Wider than two tiles and higher than one, and no multiple of a workgroup: borders are checked, too.
_WIDTH, _HEIGHT = 151, 70


class Verdict(NamedTuple):
    """What became of one method on one adapter."""

    method: str
    agrees: bool
    text: str


def check(device: Device) -> Iterator[Verdict]:
    """Render a small frame by every method on an adapter and on the CPU, and compare the two."""
    for method in methods_available():
        expected = rendered(method, "cpu")
        try:
            found = rendered(method, device.id)
        except (DeviceError, MemoryError) as error:
            yield Verdict(method, False, f"fails: {error}")
        else:
            yield _compared(method, found, expected)


def rendered(method: str, device: str) -> NDArray[np.float32]:
    """Render the frame: surfaces before, in and behind the focus with edges and a slope, and lamps."""
    y, x = np.mgrid[:_HEIGHT, :_WIDTH]
    disparity = np.full((_HEIGHT, _WIDTH), -1.0, np.float32)
    disparity[40:, 90:] = 0.0
    disparity[20:50, 30:80] = np.linspace(0.3, 1.0, 50, dtype=np.float32)
    # A texture in which every pixel differs, without a generator whose numbers change.
    texture = np.modf(np.sin(12.9898 * x + 78.233 * y) * 43758.5453)[0] % 1.0
    color = np.stack([texture, texture[::-1], texture[:, ::-1]], axis=-1).astype(np.float32)
    color[::13, ::17] = 8.0
    lens = Lens.from_disparity(strength_px=6.0, focus=0.0)
    return render(color, disparity, lens, depth_kind="disparity", method=method, device=device)  # type: ignore[call-overload,no-any-return]


def _compared(method: str, found: NDArray[np.float32], expected: NDArray[np.float32]) -> Verdict:
    allowed = LENS_AGREEMENT if method == "lens" else AGREEMENT
    if not np.isfinite(found).all():
        return Verdict(method, False, "DISAGREES with the CPU: some pixels are not finite")
    apart = np.abs(found.astype(np.float64) - expected) / float(np.ptp(expected))
    text = f"largest difference {apart.max():.1e} of the picture's range, {allowed:.0e} allowed"
    agrees = bool(apart.max() <= allowed)
    if method == "lens" and apart.any():
        psnr = -10.0 * float(np.log10(np.mean(apart**2)))
        agrees = agrees and psnr >= LENS_PSNR
        text += f"; PSNR {psnr:.0f} dB, {LENS_PSNR:.0f} wanted"
    return Verdict(method, agrees, f"{'agrees' if agrees else 'DISAGREES'} with the CPU: {text}")
