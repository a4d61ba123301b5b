"""Write the camera of every frame for dofsim: blender FILE.blend --background --python blender_cameras.py."""

import json
from pathlib import Path

import bpy

scene = bpy.context.scene
share = scene.render.resolution_percentage / 100
width, height = int(scene.render.resolution_x * share), int(scene.render.resolution_y * share)
cameras = []
for frame in range(scene.frame_start, scene.frame_end + 1, scene.frame_step):
    scene.frame_set(frame)
    eye, camera = scene.camera, scene.camera.data
    vertical = camera.sensor_fit == "VERTICAL"
    side = {"VERTICAL": height, "HORIZONTAL": width}.get(camera.sensor_fit, max(width, height))
    focal = side * camera.lens / (camera.sensor_height if vertical else camera.sensor_width)
    middle = 0.5 * (width - 1) - side * camera.shift_x, 0.5 * (height - 1) + side * camera.shift_y
    place, turn, _ = eye.matrix_world.decompose()
    rows = turn.to_matrix()
    pose = [[*rows[i], place[i]] for i in range(3)] + [[0, 0, 0, 1]]
    intrinsics = [[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]]
    cameras.append({"name": f"{frame:04}", "pose": [list(row) for row in pose], "intrinsics": intrinsics})
words = {"axes": "opengl", "width": width, "height": height, "cameras": cameras}
Path("cameras.json").write_text(json.dumps(words, indent=1))
