"""Makes the Blender samples of this folder: blender -b --factory-startup -P make_blender.py (Blender 3.4)."""

import math

import bpy


def export(name):
    bpy.ops.export_scene.gltf(filepath=f"{name}.glb", export_format="GLB", export_apply=True)


def box(bevel_segments, auto_smooth_deg=None, weighted=False):
    """A box of 50 x 50 x 30 mm on z = 0 with bevels of 5 mm, shaded smooth."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(size=1)
    part = bpy.context.object
    part.scale, part.location = (0.05, 0.05, 0.03), (0, 0, 0.015)
    bpy.ops.object.transform_apply(location=True, scale=True)
    if bevel_segments:
        bevel = part.modifiers.new("bevel", "BEVEL")
        bevel.width, bevel.segments = 0.005, bevel_segments
        bpy.ops.object.modifier_apply(modifier="bevel")
    bpy.ops.object.shade_smooth()
    if auto_smooth_deg is not None:
        part.data.use_auto_smooth = True
        part.data.auto_smooth_angle = math.radians(auto_smooth_deg)
    if weighted:
        part.data.use_auto_smooth = True
        part.data.auto_smooth_angle = math.pi
        part.modifiers.new("weighted", "WEIGHTED_NORMAL")


box(0)
export("bl34-box")
box(2, auto_smooth_deg=30)
export("bl34-bevel-2-auto-smooth")
box(3)
export("bl34-bevel-3")
box(8, weighted=True)
export("bl34-bevel-8-weighted")
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_cylinder_add()
bpy.ops.object.shade_smooth()
export("bl34-cylinder")
