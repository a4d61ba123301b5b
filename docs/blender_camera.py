"""Write a scene's camera for dofsim: blender FILE.blend --background --python blender_camera.py."""

import json
from pathlib import Path

import bpy

eye = bpy.context.scene.camera
camera, focus = eye.data, eye.data.dof
words = {name: getattr(camera, name) for name in ("lens", "sensor_width", "sensor_height", "sensor_fit")}
words |= {name: getattr(camera, name) for name in ("shift_x", "shift_y")}
words |= {name: getattr(focus, name) for name in dir(focus) if name.startswith("aperture_")}
words["focus_distance"] = focus.focus_distance
if focus.focus_object:
    words["focus_distance"] = -(eye.matrix_world.inverted() @ focus.focus_object.matrix_world.translation).z
Path("camera.json").write_text(json.dumps(words, indent=1))
