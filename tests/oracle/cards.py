"""Scenes of textured cards, by casting rays: pinholes anywhere, and the thin lens as the mean of many.

A camera at the origin looks along +z, x to the right and y down, as OpenCV has it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def stripes(x: Vector, y: Vector, towards: Vector) -> Vector:
    """Give a smooth texture with detail of several pixels."""
    return np.stack(
        [0.5 + 0.3 * np.sin(9 * x + 2 * y), 0.5 + 0.3 * np.cos(7 * y), 0.4 + 0.2 * np.sin(5 * x - 6 * y)],
        axis=-1,
    )


@dataclass(frozen=True)
class Card:
    """A rectangle of half sizes around a centre, upright or turned about the vertical by a slope dz/dx."""

    centre: tuple[float, float, float]
    half: tuple[float, float]
    color: Callable[[Vector, Vector, Vector], Vector] = stripes
    slope: float = 0.0

    def hit(self, origin: Vector, towards: Vector) -> tuple[Vector, Vector]:
        """Give how far along each ray the card is (infinite where it is missed), and its colours there."""
        # The plane z - cz = slope (x - cx).
        cx, cy, cz = self.centre
        above = towards[..., 2] - self.slope * towards[..., 0]
        t = (cz - origin[2] - self.slope * (cx - origin[0])) / above
        at = origin + t[..., None] * towards
        x, y = at[..., 0] - cx, at[..., 1] - cy
        inside = (np.abs(x) <= self.half[0]) & (np.abs(y) <= self.half[1]) & (t > 0.0)
        return np.where(inside, t, np.inf), self.color(x, y, towards)


@dataclass(frozen=True)
class Cards:
    """Cards, and the camera that sees them."""

    cards: list[Card]
    width: int = 96
    height: int = 72
    focal_px: float = 100.0
    samples: int = 4

    @property
    def intrinsics(self) -> Vector:
        """Give the camera's matrix."""
        centre = 0.5 * (self.width - 1), 0.5 * (self.height - 1)
        return np.array([[self.focal_px, 0, centre[0]], [0, self.focal_px, centre[1]], [0, 0, 1]])

    def rays(self, dx: float = 0.0, dy: float = 0.0) -> Vector:
        """Give the direction of each pixel's ray, of length 1 along z."""
        y, x = np.mgrid[: self.height, : self.width].astype(float)
        x, y = x + dx - 0.5 * (self.width - 1), y + dy - 0.5 * (self.height - 1)
        return np.stack([x / self.focal_px, y / self.focal_px, np.ones_like(x)], axis=-1)

    def cast(self, origin: Vector, towards: Vector) -> tuple[Vector, Vector]:
        """Give the colour that each ray sees, and how far along it."""
        nearest, color = np.full(towards.shape[:-1], np.inf), np.zeros((*towards.shape[:-1], 3))
        for card in self.cards:
            t, own = card.hit(origin, towards)
            color = np.where((t < nearest)[..., None], own, color)
            nearest = np.minimum(nearest, t)
        return color, nearest

    def offsets(self) -> list[tuple[float, float]]:
        """Give the places in a pixel that its colour is the mean of."""
        steps = (np.arange(self.samples) + 0.5) / self.samples - 0.5
        return [(dx, dy) for dx in steps for dy in steps]

    def pinhole(self, pose: Vector) -> tuple[Vector, Vector]:
        """Give colours averaged over pixels, and depth at their centres, from a camera-to-world pose."""
        turn, origin = pose[:3, :3], pose[:3, 3]
        color = np.mean([self.cast(origin, self.rays(*at) @ turn.T)[0] for at in self.offsets()], axis=0)
        return color, self.cast(origin, self.rays() @ turn.T)[1]

    def thin_lens(self, radius: float, focus: float, points: int = 256) -> Vector:
        """Give the picture through a lens at the origin, the mean over points of its aperture."""
        turns = np.arange(points) * (3.0 - 5.0**0.5) * np.pi
        lengths = radius * np.sqrt((np.arange(points) + 0.5) / points)
        total = np.zeros((self.height, self.width, 3))
        for i, (turn, length) in enumerate(zip(turns, lengths, strict=True)):
            origin = np.array([length * np.cos(turn), length * np.sin(turn), 0.0])
            total += self.cast(origin, focus * self.rays(*self.offsets()[i * 7 % self.samples**2]) - origin)[
                0
            ]
        return total / points


def pose(right: float = 0.0, down: float = 0.0, forward: float = 0.0, turn: float = 0.0) -> Vector:
    """Give a pose so many metres away, turned about the vertical by some degrees."""
    cos, sin = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    out = np.eye(4)
    out[:3, :3] = [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]
    out[:3, 3] = right, down, forward
    return out


def rim(count: int, radius: float) -> Vector:
    """Give poses on a circle around the origin."""
    turns = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return np.stack([pose(radius * np.cos(turn), radius * np.sin(turn)) for turn in turns])
