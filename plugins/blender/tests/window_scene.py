"""Runs in a Blender with a window: installs the zip and makes a can with a text, all selected. Started by window.py."""

import os
import sys

import bpy
from mathutils import Matrix

folder, isomark, station = sys.argv[sys.argv.index("--") + 1:]
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import host  # noqa: E402  the tests are not a package

module = host.install(folder)
preferences = bpy.context.preferences.addons[module].preferences
preferences.program, preferences.station = isomark, station
bpy.context.preferences.view.show_splash = False
for item in list(bpy.data.objects):
    bpy.data.objects.remove(item)
scene = bpy.context.scene
scene.unit_settings.scale_length, scene.unit_settings.length_unit = 0.001, "MILLIMETERS"

bpy.ops.mesh.primitive_cylinder_add(vertices=128, radius=33, depth=110)
can = bpy.context.object
can.name = "Can"
material = bpy.data.materials.new("aluminium")
material.diffuse_color = (0.55, 0.58, 0.62, 1)
can.data.materials.append(material)
frame = bpy.data.objects.new("Front", None)
frame.empty_display_type, frame.empty_display_size = "ARROWS", 25
frame.matrix_world = Matrix(((1, 0, 0, 0), (0, 0, -1, -33), (0, 1, 0, 8), (0, 0, 0, 1)))
scene.collection.objects.link(frame)
bpy.ops.object.text_add()
text = bpy.context.object
text.name, text.data.body, text.data.size, text.data.align_x = "Title", "Größe L", 12, "CENTER"
text.matrix_world = frame.matrix_world @ Matrix.Translation((0, 4, 0))
bpy.ops.curve.primitive_bezier_circle_add(radius=9)
ring = bpy.context.object
ring.name, ring.matrix_world = "Ring", frame.matrix_world @ Matrix.Translation((0, -14, 0))
for item in (can, frame, text, ring):
    item.select_set(True)


def look():
    """Points the view at the can, when the window is there."""
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "VIEW_3D":
            view = area.spaces.active
            view.clip_end, view.overlay.grid_scale = 10000, 10
            view.region_3d.view_distance = 260
            view.region_3d.view_location = (12, 0, 0)
            view.region_3d.view_rotation = (0.85, 0.48, 0.09, 0.17)
    open(os.path.join(folder, "ready"), "w").close()


bpy.app.timers.register(look, first_interval=1.0)
