"""The hexagonal blur, written down plainly: two passes of line blurs, light in front apart from the rest."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# A look-up: columns, rows, its share of the step, and where along the line the step begins and ends.
Tap = tuple[int, int, float, float, float]


def line(angle_deg: float, length: float, reach_px: float) -> list[Tap]:
    """Look-ups that spread light towards `angle_deg` (counter-clockwise on screen) over `length` radii."""
    angle = np.radians(angle_deg)
    step = np.array([-np.cos(angle), np.sin(angle)])
    major = int(abs(step[1]) > abs(step[0]))
    step /= abs(step[major])
    # The radius whose line is as long as one step.
    radius = np.hypot(*step) / length
    taps = []

    def add(k: int, across: float, share: float, start: float, end: float) -> None:
        d = (round(k * step[0]), int(across)) if major == 0 else (int(across), round(k * step[1]))
        taps.append((*d, share, start * radius, end * radius))

    for k in range(int(reach_px / radius + 0.5) + 1):
        start, end = max(k - 0.5, 0.0), k + 0.5
        if abs(step[1 - major]) < 1e-3:
            add(k, 0, 1.0, start, end)
        elif k == 0:
            add(k, 0, 1.0, 0.0, 0.25)
            add(k, -1, 0.5, 0.25, 0.5)
            add(k, 1, 0.5, 0.25, 0.5)
        else:
            # Bilinear half a pixel to either side.
            for place in (k * step[1 - major] - 0.5, k * step[1 - major] + 0.5):
                fraction = place - np.floor(place)
                add(k, np.floor(place), 0.5 * (1.0 - fraction), start, end)
                add(k, np.floor(place) + 1, 0.5 * fraction, start, end)
    return taps


def part(tap: Tap, radius: Array) -> Array:
    """Share of its light that a circle of confusion sends to a step of its line."""
    _, _, share, start, end = tap
    reached = np.clip(radius - start, 0.0, end - start)
    return share * np.divide(reached, radius, out=np.zeros_like(radius), where=radius > 0.0)


def render(
    color: NDArray[np.floating],
    coc_px: NDArray[np.floating],
    *,
    blades: int = 6,
    rotation: float = 90.0,
    max_coc_px: float = 64.0,
) -> Array:
    """Blur an (H, W, C) picture by signed CoC radii; beyond the border lies its mirror image."""
    coc = np.clip(coc_px.astype(np.float64), -max_coc_px, max_coc_px)
    reach = np.abs(coc).max()
    margin = 2 * int(np.ceil(reach)) + 4
    coc = np.pad(coc, margin, mode="symmetric")
    color = np.pad(color.astype(np.float64), [(margin, margin)] * 2 + [(0, 0)], mode="symmetric")

    def at(plane: Array, tap: Tap) -> Array:
        # What is rolled in from the other side stays in the margin.
        return np.roll(plane, (-tap[1], -tap[0]), axis=(0, 1))

    def near_line(light: Array, radius: Array, taps: list[Tap]) -> tuple[Array, Array]:
        total, carried = np.zeros_like(light), np.zeros_like(radius)
        for tap in taps:
            weight = part(tap, at(radius, tap))
            total += weight[..., None] * at(light, tap)
            carried = np.maximum(carried, np.where(weight > 0.0, at(radius, tap), 0.0))
        return total, carried

    def rest_line(light: Array, taps: list[Tap]) -> Array:
        total, weights = np.zeros_like(light), np.zeros_like(coc)
        for tap in taps:
            theirs = np.where(at(coc, tap) < 2.0 * coc, part(tap, np.maximum(at(coc, tap), 0.0)), 0.0)
            weight = np.where(coc < 0.0, part(tap, -coc), theirs)
            total += weight[..., None] * at(light, tap)
            weights += weight
        seen = weights[..., None] > 0.0
        return np.where(seen, np.divide(total, weights[..., None], where=seen, out=total), light)

    if blades == 6:
        a, b, c = (line(rotation + turn, 1.0, reach) for turn in (0.0, 120.0, 240.0))
        targets, parallelograms = [([a], [b]), ([b], [c])], 3
    else:
        a, b, c, d = (line(rotation + turn, np.sqrt(0.5), reach) for turn in (45.0, 135.0, 225.0, 315.0))
        targets, parallelograms = [([a, c], [b, d])], 4

    # Light with coverage as its last channel.
    in_front = (coc < 0.0)[..., None]
    light = np.concatenate([color, np.ones_like(in_front)], axis=-1)
    radius = np.where(coc < 0.0, -coc, 0.0)
    near, near_radius, rest = np.zeros_like(light), np.zeros_like(coc), np.zeros_like(light)
    near_out, rest_out = np.zeros_like(light), np.zeros_like(light)
    for gathered, spread in targets:
        for taps in gathered:
            added, carried = near_line(np.where(in_front, light, 0.0), radius, taps)
            near, near_radius = near + added, np.maximum(near_radius, carried)
            rest = rest + rest_line(np.where(in_front, 0.0, light), taps)
        for taps in spread:
            near_out += near_line(near, near_radius, taps)[0] / parallelograms
            rest_out += rest_line(rest, taps) / parallelograms

    silhouette = (near_out + rest_out) / (near_out + rest_out)[..., -1:]
    behind = light + np.clip(coc, 0.0, 1.0)[..., None] * (rest_out - light)
    coverage = near_out[..., -1:]
    over = near_out / np.maximum(coverage, 1.0) + (1.0 - np.minimum(coverage, 1.0)) * behind
    out = np.where(in_front, silhouette, over)
    return out[margin:-margin, margin:-margin, :-1]
