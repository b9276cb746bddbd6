"""Runs in a Blender with a window: installs the zip, makes a can with a text, and reports what happens. Started by window.py.

Writes `state.json` into the folder, and takes the path of isomark from `program.txt` there.
"""

import importlib
import json
import math
import os
import sys

import bpy
from mathutils import Euler, Matrix

FOLDER, STATION = sys.argv[sys.argv.index("--") + 1:]
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
host = importlib.import_module("host")
MODULE = host.install(FOLDER)


def make_scene():
    """A can, a frame on its front, and a drawing on the frame; all are selected."""
    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item)
    scene = bpy.context.scene
    scene.unit_settings.scale_length, scene.unit_settings.length_unit = 0.001, "MILLIMETERS"
    bpy.ops.mesh.primitive_cylinder_add(vertices=128, radius=33, depth=110)
    can = bpy.context.object
    can.name = "Can"
    material = bpy.data.materials.new("aluminium")
    material.diffuse_color = (0.75, 0.77, 0.8, 1)
    can.data.materials.append(material)
    frame = bpy.data.objects.new("Front", None)
    frame.empty_display_type, frame.empty_display_size = "ARROWS", 25
    frame.matrix_world = Matrix(((1, 0, 0, 0), (0, 0, -1, -33), (0, 1, 0, 8), (0, 0, 0, 1)))
    scene.collection.objects.link(frame)
    bpy.ops.object.text_add()
    text = bpy.context.object
    text.name, text.data.body, text.data.size, text.data.align_x = "Title", "Größe L", 11, "CENTER"
    text.matrix_world = frame.matrix_world @ Matrix.Translation((0, 4, 0))
    bpy.ops.curve.primitive_bezier_circle_add(radius=11)
    ring = bpy.context.object
    ring.name, ring.matrix_world = "Ring", frame.matrix_world @ Matrix.Translation((0, -14, 0))
    for item in (can, frame, text, ring):
        item.select_set(True)
    bpy.ops.ed.undo_push(message="scene")


def look():
    """Points the view at the can."""
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "VIEW_3D":
            view = area.spaces.active
            view.clip_end, view.overlay.grid_scale = 10000, 10
            overlay = view.overlay
            overlay.show_cursor = overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = False
            view.shading.background_type, view.shading.background_color = "VIEWPORT", (0.35, 0.36, 0.38)
            view.region_3d.view_distance = 135
            view.region_3d.view_location = (14, 0, -2)
            view.region_3d.view_rotation = Euler((math.radians(72), 0, math.radians(-10))).to_quaternion()


def taken(name):
    """Whether window.py asks for something; it asks once."""
    path = os.path.join(FOLDER, name)
    if not os.path.exists(path):
        return False
    os.remove(path)
    return True


def report():
    """Writes the state, and takes the path of isomark."""
    session = importlib.import_module(f"{MODULE}.session")
    path = os.path.join(FOLDER, "program.txt")
    if os.path.exists(path):
        with open(path, encoding="utf-8") as file:
            bpy.context.preferences.addons[MODULE].preferences.program = file.read()
        os.remove(path)
    if taken("grow.txt"):
        bpy.data.objects["Ring"].scale *= 1.2
    if taken("hide.txt"):
        # For the picture: the flat drawing would cover the mark.
        for name in ("Title", "Ring", "Front"):
            bpy.data.objects[name].hide_set(True)
    settings, courier = bpy.context.scene.isomark, session.courier
    state = {
        "part": settings.part and settings.part.name,
        "drawings": [entry.item.name for entry in settings.drawings],
        "outcome": json.loads(settings.outcome or "{}"),
        "marks": [item.name for item in bpy.data.objects if item.name.startswith("isomark")],
        "running": session.run is not None,
        "version": session.version,
        "live": bpy.context.window_manager.isomark_live,
        "answer": courier and courier.answer.kind,
    }
    with open(os.path.join(FOLDER, "state.part"), "w", encoding="utf-8") as file:
        json.dump(state, file)
    os.replace(file.name, os.path.join(FOLDER, "state.json"))
    return 0.2


def begin():
    """Called when the window is there."""
    look()
    bpy.app.timers.register(report)


bpy.context.preferences.addons[MODULE].preferences.station = STATION
bpy.context.preferences.view.show_splash = False
make_scene()
bpy.app.timers.register(begin, first_interval=2.0)
