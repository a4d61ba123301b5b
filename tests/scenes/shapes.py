"""Short spellings of the Mitsuba dictionaries that the scenes are written in.

Every scene is seen from the origin along +z with +y up, so that a point's z is its depth. Mitsuba's
image then runs towards -x; `X_RIGHT` turns a position to the right of the picture into world x.
"""

import tempfile
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from .textures import Picture

X_RIGHT = -1.0

Shape = dict[str, Any]


def bitmap(picture: Picture, repeat: tuple[float, float] = (1.0, 1.0)) -> Shape:
    """Make a texture of linear values, repeated over the surface's parameters."""
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(picture, np.float32)),
        "raw": True,
        "wrap_mode": "repeat",
        "to_uv": mi.ScalarTransform4f().scale([repeat[0], repeat[1], 1.0]),
    }


def glow(radiance: Shape | Picture | tuple[float, float, float]) -> Shape:
    """Make a surface shine by itself: what it shows is its texture, with no shading noise."""
    if isinstance(radiance, tuple):
        value: Shape = {"type": "rgb", "value": list(radiance)}
    elif isinstance(radiance, np.ndarray):
        value = bitmap(radiance)
    else:
        value = radiance
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    return {"bsdf": black, "emitter": {"type": "area", "radiance": value}}


def paint(reflectance: Shape | Picture | tuple[float, float, float]) -> Shape:
    """Make a surface matt."""
    if isinstance(reflectance, tuple):
        value: Shape = {"type": "rgb", "value": list(reflectance)}
    elif isinstance(reflectance, np.ndarray):
        value = bitmap(reflectance)
    else:
        value = reflectance
    return {"bsdf": {"type": "diffuse", "reflectance": value}}


def sphere(right: float, up: float, z: float, radius: float, look: Shape, turn: float = 0.0) -> Shape:
    """Make a ball with its poles above and below, turned about the vertical by `turn` degrees."""
    place = mi.ScalarTransform4f().translate([X_RIGHT * right, up, z])
    spin = mi.ScalarTransform4f().rotate([0, 1, 0], turn).rotate([1, 0, 0], -70.0).scale(radius)
    return {"type": "sphere", "to_world": place @ spin, **look}


def wall(z: float, half_width: float, half_height: float, look: Shape) -> Shape:
    """Make a rectangle across the view that faces the camera."""
    place = mi.ScalarTransform4f().translate([0, 0, z]).rotate([0, 1, 0], 180.0)
    return {"type": "rectangle", "to_world": place.scale([half_width, half_height, 1.0]), **look}


def floor(y: float, half_width: float, z_near: float, z_far: float, look: Shape) -> Shape:
    """Make a level rectangle that faces up (or down, when it lies above the camera)."""
    place = mi.ScalarTransform4f().translate([0, y, 0.5 * (z_near + z_far)])
    place = place.rotate([1, 0, 0], -90.0 if y < 0 else 90.0)
    return {"type": "rectangle", "to_world": place.scale([half_width, 0.5 * (z_far - z_near), 1.0]), **look}


def side(right: float, half_height: float, z_near: float, z_far: float, look: Shape) -> Shape:
    """Make an upright rectangle along the view that faces the axis."""
    place = mi.ScalarTransform4f().translate([X_RIGHT * right, 0, 0.5 * (z_near + z_far)])
    place = place.rotate([0, 1, 0], 90.0 if right > 0 else -90.0)
    return {"type": "rectangle", "to_world": place.scale([0.5 * (z_far - z_near), half_height, 1.0]), **look}


def box(
    right: float, up: float, z: float, half: tuple[float, float, float], look: Shape, turn: float = 0.0
) -> Shape:
    """Make a box of half sizes `half`, turned about the vertical by `turn` degrees."""
    place = mi.ScalarTransform4f().translate([X_RIGHT * right, up, z]).rotate([0, 1, 0], turn)
    return {"type": "cube", "to_world": place.scale(list(half)), **look}


def rod(
    start: tuple[float, float, float], end: tuple[float, float, float], radius: float, look: Shape
) -> Shape:
    """Make a round bar between two points given as (right, up, z)."""
    p0 = [X_RIGHT * start[0], start[1], start[2]]
    p1 = [X_RIGHT * end[0], end[1], end[2]]
    return {"type": "cylinder", "p0": p0, "p1": p1, "radius": radius, **look}


def tubes(paths: list[np.ndarray], radius: float, look: Shape, sides: int = 6) -> Shape:
    """Make one mesh of tubes along paths of (right, up, z) points, texture running lengthwise.

    Hundreds of thin rods render much faster as one mesh than as shapes of their own.
    """
    positions, texcoords, faces = [], [], []
    angles = 2.0 * np.pi * np.arange(sides) / sides
    for path in paths:
        points = path * [X_RIGHT, 1.0, 1.0]
        forward = np.gradient(points, axis=0)
        forward /= np.linalg.norm(forward, axis=1, keepdims=True)
        first = np.cross(forward, [0.0, 0.0, 1.0])
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second = np.cross(forward, first)
        ring = np.cos(angles)[:, None] * first[:, None] + np.sin(angles)[:, None] * second[:, None]
        start = sum(len(p) for p in positions)
        positions.append((points[:, None] + radius * ring).reshape(-1, 3))
        along = np.repeat(np.linspace(0.0, 1.0, len(path)), sides)
        texcoords.append(np.stack([np.tile(np.arange(sides) / sides, len(path)), along], axis=-1))
        corner, around = np.mgrid[0 : len(path) - 1, 0:sides]
        a, b = start + corner * sides + around, start + corner * sides + (around + 1) % sides
        c, d = a + sides, b + sides
        faces.append(np.stack([a, b, d, a, d, c], axis=-1).reshape(-1, 3))
    return mesh(np.concatenate(positions), np.concatenate(texcoords), np.concatenate(faces), look)


def turned(profile: np.ndarray, place: "mi.ScalarTransform4f", look: Shape, sides: int = 64) -> Shape:
    """Make one smooth mesh by turning a profile of (radius, height) points about the vertical."""
    angles = 2.0 * np.pi * np.arange(sides + 1) / sides
    rows = len(profile)
    radius, height = profile[:, :1], np.broadcast_to(profile[:, 1:], (rows, sides + 1))
    positions = np.stack([radius * np.cos(angles), height, radius * np.sin(angles)], axis=-1)
    across, along = np.meshgrid(angles / (2.0 * np.pi), np.linspace(0.0, 1.0, rows))
    corner, around = np.mgrid[0 : rows - 1, 0:sides]
    a = corner * (sides + 1) + around
    c = a + sides + 1
    faces = np.stack([a, c, c + 1, a, c + 1, a + 1], axis=-1)
    texcoords = np.stack([across, along], axis=-1)
    return mesh(positions, texcoords, faces, {"to_world": place, **look}, smooth=True)


def mesh(
    positions: np.ndarray, texcoords: np.ndarray, faces: np.ndarray, look: Shape, smooth: bool = False
) -> Shape:
    """Load arrays of (..., 3) positions, (..., 2) texture coordinates and (..., 3) corners as one shape."""
    built = mi.Mesh("mesh", positions.size // 3, faces.size // 3, has_vertex_texcoords=True)
    data = mi.traverse(built)
    data["vertex_positions"] = positions.astype(np.float32).ravel()
    data["vertex_texcoords"] = texcoords.astype(np.float32).ravel()
    data["faces"] = faces.astype(np.uint32).ravel()
    data.update()
    # Looks attach to shapes that Mitsuba loads, so the mesh makes a detour over a file.
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "mesh.ply")
        built.write_ply(path)
        return mi.load_dict({"type": "ply", "filename": path, "face_normals": not smooth, **look})
