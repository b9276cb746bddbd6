# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows what isomark draws on the part as objects of the scene: curves named `isomark`, and a mesh for areas."""

import bpy
import numpy as np

NAME = "isomark"
# The objects that are shown, with the field of glb.OnPart that each contains.
PARTS = ((NAME, "mark"), (f"{NAME} ink", "ink"), (f"{NAME} uncorrected", "drawn"), (f"{NAME} view", "view"))
# Marks an object as made by the add-on, with the field that it shows.
_TAG = "isomark_shows"
# Steps of each colour channel; every colour becomes a material.
_STEPS = 6
# The steps are equal for the eye; the colours of glTF and of materials are linear.
_GAMMA = 2.2
# A tube around more points than this would slow the window down.
_MOST_TUBE_POINTS = 60000
_PLAIN = {"mark": (0.0, 0.0, 0.0, 1.0), "ink": (0.02, 0.02, 0.02, 1.0), "drawn": (0.45, 0.45, 0.45, 1.0),
          "view": (0.1, 0.3, 0.9, 1.0)}


def find(scene, field):
    """The object that shows the field in this scene, or None."""
    return next((item for item in scene.objects if item.get(_TAG) == field), None)


def is_ours(item):
    """Whether the add-on made the object."""
    return _TAG in item


def clear(scene):
    """Removes the mark from the scene. Returns whether there was one."""
    items = [item for item in scene.objects if is_ours(item)]
    for item in items:
        data = item.data
        bpy.data.objects.remove(item)
        if data.users == 0:
            (bpy.data.curves if isinstance(data, bpy.types.Curve) else bpy.data.meshes).remove(data)
    return bool(items)


def show(scene, on_part, settings):
    """Shows the mark; objects that are there from before get the new content."""
    to_scene = 1 / scene.unit_settings.scale_length
    wanted = {"mark": True, "ink": settings.show_ink, "drawn": settings.show_uncorrected, "view": settings.show_view}
    for name, field in PARTS:
        shapes = getattr(on_part, field) if wanted[field] else []
        item = find(scene, field)
        if not shapes and item is None:
            continue
        item = item or _new(scene, name, field)
        if field == "ink":
            _fill_mesh(item.data, shapes, to_scene)
        else:
            width = settings.width_mm / 2000 * to_scene
            _fill_curve(item.data, shapes, to_scene, field, settings.coloured and field in ("mark", "drawn"), width)


def _new(scene, name, field):
    if field == "ink":
        data = bpy.data.meshes.new(name)
        data.materials.append(_material(_PLAIN[field], "ink"))
    else:
        data = bpy.data.curves.new(name, "CURVE")
        data.dimensions = "3D"
        data.resolution_u = 1
        data.bevel_resolution = 0
    item = bpy.data.objects.new(name, data)
    item[_TAG] = field
    item.show_in_front = True
    item.hide_select = True
    scene.collection.objects.link(item)
    return item


def _material(color, label):
    """The material of a colour, made once."""
    name = f"{NAME} {label}"
    material = bpy.data.materials.get(name)
    if material is None:
        material = bpy.data.materials.new(name)
        material.diffuse_color = color
        material.roughness = 1.0
    return material


def _fill_curve(data, shapes, to_scene, field, coloured, width):
    data.splines.clear()
    data.materials.clear()
    slots = {}

    def slot(color):
        """The number of the material for a colour, given in steps; None is the plain one."""
        if color not in slots:
            if color is None:
                material = _material(_PLAIN[field], field)
            else:
                shade = tuple((step / _STEPS) ** _GAMMA for step in color)
                material = _material((*shade, 1.0), "-".join(map(str, color)))
            data.materials.append(material)
            slots[color] = len(slots)
        return slots[color]

    count = 0
    for shape in shapes:
        points = np.ones((len(shape.points), 4), np.float32)
        points[:, :3] = shape.points * to_scene
        for begin, end, color in _runs(shape.colors if coloured else None, len(points)):
            spline = data.splines.new("POLY")
            spline.points.add(end - begin - 1)
            spline.points.foreach_set("co", points[begin:end].reshape(-1))
            spline.material_index = slot(color)
            count += end - begin
    data.bevel_depth = width if count <= _MOST_TUBE_POINTS else 0.0


def _runs(colors, count):
    """Runs of points whose lines have the same colour: first point, end, colour in steps."""
    if colors is None:
        return [(0, count, None)]
    shades = np.clip((colors[:-1] + colors[1:]) / 2, 0, 1) ** (1 / _GAMMA)
    steps = np.rint(shades * _STEPS).astype(int)
    breaks = np.flatnonzero((steps[1:] != steps[:-1]).any(axis=1)) + 1
    begins = np.append(0, breaks)
    ends = np.append(breaks, count - 1)
    return [(begin, end + 1, tuple(steps[begin].tolist())) for begin, end in zip(begins, ends)]


def _fill_mesh(mesh, shapes, to_scene):
    mesh.clear_geometry()
    if not shapes:
        return
    starts = np.cumsum([0, *(len(shape.points) for shape in shapes)])
    points = np.vstack([shape.points for shape in shapes]) * to_scene
    triangles = np.vstack([shape.triangles + start for shape, start in zip(shapes, starts)])
    mesh.from_pydata(points.tolist(), [], triangles.tolist())
    mesh.update()
