"""A made scene and all that a compositor gets with it, through one lens.

Run `make passes`, or this file with the folder to write into: `passes.png`, the plate. The scene is three
balls on a chequered floor, traced here. Each pixel is the mean of 16 rays; depth is that of its middle.
"""

import argparse
import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dofsim
import numpy as np
from dofsim import _dofsim, _panel
from dofsim._compare import shown
from numpy.typing import NDArray

Plane = NDArray[np.floating[Any]]

WIDTH, HEIGHT, FOV_DEG = 480, 320, 40.0
# Rays along each side of a pixel.
RAYS = 4
# Centre, radius and albedo of the balls, in metres: x to the right, y up, z away from the camera.
Ball = tuple[tuple[float, float, float], float, tuple[float, float, float]]
BALLS: tuple[Ball, ...] = (
    ((-0.55, -0.15, 1.7), 0.35, (0.9, 0.35, 0.1)),
    ((0.15, -0.1, 2.6), 0.4, (0.15, 0.5, 0.9)),
    ((1.3, 0.1, 4.6), 0.6, (0.3, 0.8, 0.25)),
)
FLOOR_Y, WALL_Z = -0.5, 9.0
# What a pixel shows, as a number: these, and then the balls.
FLOOR, WALL, FIRST_BALL = range(3)
BLUE = FIRST_BALL + 1
KEY, FILL = np.array([0.5, 0.7, -0.5]), np.array([-0.7, 0.2, -0.7])
LENS = dofsim.Lens(aperture_radius=0.06, focus_distance=2.3, fov=FOV_DEG)


@dataclass
class Traced:
    """Passes of the scene through a pinhole. The coverage is that of each thing."""

    key: Plane
    fill: Plane
    # The light of balls alone.
    of_balls: Plane
    normal: Plane
    coverage: Plane
    depth: Plane

    @property
    def color(self) -> Plane:
        """The beauty."""
        return self.key + self.fill


def hit(
    rays: NDArray[np.float64], balls: tuple[Ball, ...]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Find what rays from the origin with z = 1 meet: its z, its number and its normal."""
    z = np.minimum(FLOOR_Y / np.minimum(rays[..., 1], -1e-9), WALL_Z)
    number = np.where(z < WALL_Z, FLOOR, WALL)
    normal = np.where((z < WALL_Z)[..., None], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0])
    for i, (centre, radius, _) in enumerate(balls):
        a, b = np.sum(rays**2, axis=-1), rays @ np.array(centre)
        root = b**2 - a * (np.dot(centre, centre) - radius**2)
        nearer = (b - np.sqrt(np.maximum(root, 0.0))) / a
        found = (root > 0.0) & (nearer < z)
        z, number = np.where(found, nearer, z), np.where(found, FIRST_BALL + i, number)
        normal = np.where(found[..., None], (nearer[..., None] * rays - centre) / radius, normal)
    return z, number, normal


def through_pixels(rays: int) -> NDArray[np.float64]:
    """Give as many rays along each side of every pixel."""
    x, y = ((np.arange(n * rays) + 0.5) / rays - 0.5 * n for n in (WIDTH, HEIGHT))
    across, down = np.meshgrid(x, y)
    per_px = 2.0 * np.tan(0.5 * np.radians(FOV_DEG)) / WIDTH
    return np.stack([per_px * across, -per_px * down, np.ones_like(across)], axis=-1)


def trace(balls: tuple[Ball, ...]) -> Traced:
    """Trace the scene with these balls."""
    rays = through_pixels(RAYS)
    z, number, normal = hit(rays, balls)
    place = z[..., None] * rays
    squares = np.floor(2.5 * place).astype(int) @ np.array([1, 0, 1]) % 2
    tiles = np.floor(1.5 * place).astype(int) @ np.array([1, 1, 0]) % 2
    albedo = np.where((number == FLOOR)[..., None], (0.15 + 0.6 * squares)[..., None], 0.0)
    wall = (0.25 + 0.3 * tiles)[..., None] * [1.0, 0.85, 0.7]
    albedo = np.where((number == WALL)[..., None], wall, albedo)
    for i, (_, _, paint) in enumerate(balls):
        albedo = np.where((number == FIRST_BALL + i)[..., None], paint, albedo)

    def mean(fine: NDArray[np.float64]) -> Plane:
        blocks = fine.reshape(HEIGHT, RAYS, WIDTH, RAYS, -1)
        return blocks.mean(axis=(1, 3)).astype(np.float32)

    def lit(light: NDArray[np.float64], tint: list[float]) -> NDArray[np.float64]:
        cosine = np.maximum(normal @ (light / np.linalg.norm(light)), 0.0)
        return albedo * cosine[..., None] * tint

    own = np.stack([number == i for i in range(FIRST_BALL + len(balls))], axis=-1)
    depth = hit(through_pixels(1), balls)[0].astype(np.float32)
    key, fill = lit(KEY, [0.9, 0.8, 0.65]), lit(FILL, [0.25, 0.3, 0.4])
    of_balls = (key + fill) * (number >= FIRST_BALL)[..., None]
    return Traced(*map(mean, (key, fill, of_balls, normal, own.astype(float))), depth)


def ids_of(coverage: Plane, ranks: int = 3) -> Plane:
    """Rank what each pixel shows by its coverage, as Cryptomatte does. An id is a number and one half."""
    order = np.argsort(-coverage, axis=-1, kind="stable")[..., :ranks]
    pairs = np.stack([order + 0.5, np.take_along_axis(coverage, order, axis=-1)], axis=-1)
    return pairs.reshape(*coverage.shape[:2], 2 * ranks).astype(np.float32)


def tinted(ids: Plane) -> Plane:
    """Give each id a colour, weighted by its coverage."""
    tints = np.random.default_rng(3).random((FIRST_BALL + len(BALLS), 3))
    return sum(ids[..., r + 1, None] * tints[ids[..., r].astype(int)] for r in range(0, ids.shape[-1], 2))


def layered(layers: list[tuple[Plane, Plane, Plane]]) -> Plane:
    """Render layers, near to far: the colour, the alpha and the depth of each."""
    colors = [
        np.concatenate([alpha[..., None] * color, alpha[..., None]], axis=-1) for color, alpha, _ in layers
    ]
    depths = [depth for _, _, depth in layers]
    return dofsim.render(np.stack(colors).astype(np.float32), np.stack(depths).astype(np.float32), LENS)[
        ..., :3
    ]


def fog(near: Plane, far: Plane, density_per_m: float, slabs: int) -> list[tuple[Plane, Plane, Plane]]:
    """Cut the air between two depths into slabs. Each stops by its thickness, and stands in its middle."""
    edges = near + (far - near) * np.linspace(0.0, 1.0, slabs + 1)[:, None, None]
    alpha = 1.0 - np.exp(-density_per_m * np.diff(edges, axis=0))
    tint = np.broadcast_to([0.75, 0.8, 0.9], (*near.shape, 3))
    middles = (0.5 * (near + far) for near, far in itertools.pairwise(edges))
    return [(tint, a, z) for a, z in zip(alpha, middles, strict=True)]


def in_fog() -> list[tuple[Plane, Plane, Plane]]:
    """Give every ball and the empty room as layers, and the fog in between: what a deep render has."""
    room = trace(())
    layers = [(room.color, np.ones_like(room.depth), room.depth)]
    for i in reversed(range(len(BALLS))):
        ball = trace(BALLS[i : i + 1])
        alpha = ball.coverage[..., FIRST_BALL]
        # Of a pixel at the rim, the middle may lie beside the ball.
        depth = np.where(ball.depth < room.depth, ball.depth, BALLS[i][0][2])
        behind = layers[0][2]
        depth = np.where(alpha > 0.0, np.minimum(depth, behind), behind)
        color = ball.of_balls / np.maximum(alpha, 1e-6)[..., None]
        layers = [(color, alpha, depth), *fog(depth, behind, 0.12, 5), *layers]
    return [*fog(np.ones_like(room.depth), layers[0][2], 0.12, 8), *layers]


def codes(values: Plane) -> NDArray[np.uint8]:
    """Show values from 0 to 1 as they are."""
    grey = np.rint(255.0 * np.clip(values, 0.0, 1.0)).astype(np.uint8)
    return np.broadcast_to(grey, (*grey.shape[:2], 3))


def plates(scene: Traced) -> dict[str, NDArray[np.uint8]]:
    """Render every pass, by what it is called on the plate."""
    color, depth, coverage = scene.color, scene.depth, scene.coverage
    passes = np.concatenate([scene.key, scene.normal, coverage[..., BLUE, None], depth[..., None]], axis=-1)
    kinds = ["light"] * 3 + ["normal"] * 3 + ["matte", "data"]
    through = dofsim.render(passes, depth, LENS, guide=color, kinds=kinds)
    ids = dofsim.render_ids(ids_of(coverage), depth, LENS, guide=color)
    blue = coverage[..., BLUE]
    # The ball by itself, as a renderer gives it: traced without the others, premultiplied.
    ball = trace(BALLS[1:2])
    alone = np.concatenate([ball.of_balls, ball.coverage[..., FIRST_BALL, None]], axis=-1)
    past_blue = dofsim.render(color, depth, LENS, holdout=(blue, depth))[..., :3]
    past_others = dofsim.render(alone, depth, LENS, holdout=(1.0 - blue, depth))[..., :3]
    glass = np.broadcast_to([0.05, 0.25, 0.2], color.shape)
    pane = (glass, np.full_like(depth, 0.35), np.full_like(depth, 1.2))
    return {
        "The pinhole picture": shown(color),
        "Through the lens": shown(dofsim.render(color, depth, LENS)),
        "The key light alone": shown(through[..., :3]),
        "Normals": codes(0.5 + 0.5 * through[..., 3:6]),
        "Depth, the mean of what is seen": codes(through[..., 7:] / WALL_Z),
        "Ids, by rank": codes(tinted(ids)),
        "A matte of the blue ball": codes(through[..., 6:7]),
        "What is beside the blue ball, held out by it": shown(past_blue),
        "The blue ball, held out by the rest": shown(past_others),
        "Both of them, added": shown(past_blue + past_others),
        "Fog, in 23 layers": shown(layered(in_fog())),
        "A pane in front, out of focus": shown(layered([pane, (color, np.ones_like(depth), depth)])),
    }


def main() -> None:
    """Draw the plate."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("folder", type=Path, help="where to write; made if it is not there")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    tiles = [_panel.Tile(title, picture) for title, picture in plates(trace(BALLS)).items()]
    _dofsim.write_bytes(folder / "passes.png", _panel.draw(tiles, columns=3))
    print(folder / "passes.png")


if __name__ == "__main__":
    main()
