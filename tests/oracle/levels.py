"""The chain of filter levels, written down plainly, and the look-up table of the paper's equation 1."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def circle_of_confusion(
    camera_distance: NDArray[np.floating], focus_distance: float, focal_length: float, f_stop: float
) -> Array:
    """Diameter on the film by equation 1, all lengths in one unit."""
    return np.abs(
        (focus_distance / camera_distance - 1.0)
        * focal_length**2
        / (f_stop * (focus_distance - focal_length))
    )


def level(diameter: NDArray[np.floating], c0: float) -> Array:
    """Where a diameter lies between the first target (0, at c0 or less) and the last (1, at 2 c0 or more)."""
    return np.clip(diameter / c0 - 1.0, 0.0, 1.0)


def targets(color: NDArray[np.floating], c0_px: float) -> tuple[Array, Array]:
    """Give the third and the fifth filter step of an (H, W, C) picture."""
    height, width, _ = color.shape
    scale = 2 ** int(np.log2(max(c0_px / 2.7, 1.0)))
    beyond = [(0, -height % scale), (0, -width % scale), (0, 0)]
    padded = np.pad(color.astype(np.float64), beyond, mode="symmetric")
    picture = padded.reshape(padded.shape[0] // scale, scale, -1, scale, color.shape[2]).mean(axis=(1, 3))
    resampled = 0.25 * scale**2 if scale > 1 else 0.0
    side = 0.25 * (0.25 * c0_px**2 - resampled) / 5 / scale**2
    steps = []
    for _ in range(5):
        # Twice along each axis.
        for axis in (0, 0, 1, 1):
            p = np.pad(picture, [(int(a == axis), int(a == axis)) for a in range(3)], mode="symmetric")
            n = picture.shape[axis]
            before, middle, after = (np.take(p, np.arange(n) + i, axis) for i in range(3))
            picture = (1.0 - 2.0 * side) * middle + side * (before + after)
        steps.append(picture)
    return enlarge(steps[2], scale)[:height, :width], enlarge(steps[4], scale)[:height, :width]


def enlarge(picture: Array, scale: int) -> Array:
    """Interpolate linearly between the centres of pixels that are `scale` times larger."""
    for axis in (0, 1):
        n = picture.shape[axis]
        place = np.clip((np.arange(n * scale) + 0.5) / scale - 0.5, 0.0, n - 1.0)
        low = np.minimum(place.astype(int), n - 1)
        fraction = (place - low).reshape([-1 if a == axis else 1 for a in range(3)])
        a, b = (np.take(picture, i, axis) for i in (low, np.minimum(low + 1, n - 1)))
        picture = a + fraction * (b - a)
    return picture


def render(color: NDArray[np.floating], coc_px: NDArray[np.floating], *, c0_px: float | None = None) -> Array:
    """Interpolate an (H, W, C) picture between its filter levels by CoC radii."""
    c0 = c0_px or max(float(np.abs(coc_px).max()), 0.5)
    third, fifth = targets(color, c0)
    x = level(2.0 * np.abs(coc_px), c0)[..., None]
    lower = color + 2.0 * x * (third - color)
    upper = third + (2.0 * x - 1.0) * (fifth - third)
    return np.where(x > 0.5, upper, lower)
