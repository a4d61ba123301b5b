"""The picture through a lens as a smooth function of shifts, in float64, which PyTorch differentiates.

A surface in front, with its coverage, and one behind are functions of the place: bilinear between pixels. A
ray through one lens point meets each of them where place plus shift is the pixel from which it starts.
"""

import math
from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Plane = NDArray[np.float64]


def disc_points(count: int) -> Tensor:
    """Give points that fill the unit disc evenly, shape (count, 2)."""
    number = torch.arange(count, dtype=torch.float64)
    angle = math.pi * (3.0 - math.sqrt(5.0)) * number
    return ((number + 0.5) / count).sqrt()[:, None] * torch.stack((angle.cos(), angle.sin()), dim=1)


def sampled(planes: Tensor, place: Tensor) -> Tensor:
    """Give planes, shape (C, H, W), at places (H, W, 2) in columns and rows; mirrored at the border."""
    size = torch.tensor(planes.shape[:0:-1], dtype=torch.float64)
    grid = 2.0 * (place + 0.5) / size - 1.0
    found = torch.nn.functional.grid_sample(
        planes[None], grid[None], padding_mode="reflection", align_corners=False
    )
    return found[0]


def met(shift: Tensor, point: Tensor, steps: int = 8) -> Tensor:
    """Give the place where each pixel's ray through a lens point meets a surface of these shifts."""
    height, width = shift.shape
    y, x = torch.meshgrid(*(torch.arange(n, dtype=torch.float64) for n in (height, width)), indexing="ij")
    pixel = torch.stack((x, y), dim=2)
    place = pixel
    for _ in range(steps):
        place = pixel + point * sampled(shift[None], place)[0][..., None]
    return place


def picture(near: Tensor, far: Tensor, near_shift: Tensor, far_shift: Tensor, points: Tensor) -> Tensor:
    """Give the picture of a surface before another, the mean over lens points.

    `near` is (C + 1, H, W): its last plane is its coverage, by which the others are multiplied.
    """
    total = torch.zeros_like(far)
    for point in points:
        front = sampled(near, met(near_shift, point))
        total = total + front[:-1] + (1.0 - front[-1]) * sampled(far, met(far_shift, point))
    return total / len(points)


def quadrature(rings: int = 10, spokes: int = 36) -> list[tuple[float, float, float]]:
    """Give points of the unit disc with their weights: Gauss's in the square of the radius."""
    places, weights = np.polynomial.legendre.leggauss(rings)
    angles = 2.0 * np.pi * (np.arange(spokes) + 0.5) / spokes
    return [
        (radius * math.cos(angle), radius * math.sin(angle), 0.5 * weight / spokes)
        for radius, weight in zip(np.sqrt(0.5 + 0.5 * places), weights, strict=True)
        for angle in angles
    ]


def of_surface(
    texture: Callable[[Plane, Plane], Plane],
    shift: Callable[[Plane, Plane], Plane],
    pixels: tuple[Plane, Plane],
    steps: int = 8,
) -> Plane:
    """Give what a lens sees at some pixels of one surface: texture and shift are functions of the place."""
    x, y = pixels
    total = np.zeros_like(x)
    for across, down, weight in quadrature():
        at_x, at_y = x, y
        for _ in range(steps):
            t = shift(at_x, at_y)
            at_x, at_y = x + across * t, y + down * t
        total += weight * texture(at_x, at_y)
    return total
