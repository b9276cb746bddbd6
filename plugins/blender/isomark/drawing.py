# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads curves, texts and grease pencil of a scene as flat paths in the marking frame, in mm."""

from collections import namedtuple

import numpy as np
from mathutils import Matrix

from . import curves, dxf
from .trouble import InputTrouble

# Types of objects that are read as drawings. Blender 4.3 renamed grease pencil.
TYPES = ("CURVE", "FONT", "GPENCIL", "GREASEPENCIL")

# The marking frame: origin and axes (columns) in the units of the scene.
Frame = namedtuple("Frame", "origin axes")

# What was read: paths for the DXF, and sentences about what was not.
Drawing = namedtuple("Drawing", "paths notices")

# Deviation from the frame's plane that needs no notice, mm.
_FLAT = 0.01
_CATMULL_ROM, _POLY, _BEZIER, _NURBS = range(4)
# Modifiers that Blender applies to control points if "Apply on Spline" is on; a hook always moves control points.
_ON_CONTROL_POINTS = {"CAST", "CURVE", "LATTICE", "SHRINKWRAP", "SIMPLE_DEFORM", "WARP", "WAVE"}
# What Blender writes where an instance has no further number.
_NO_NUMBER = 2 ** 31 - 1


def millimetres(scene):
    """The length of one unit of the scene, mm."""
    return scene.unit_settings.scale_length * 1000


def is_frame(item):
    """Whether an object can be a marking frame: an empty that shows no collection."""
    return item.type == "EMPTY" and not shows_collection(item)


def shows_collection(item):
    """Whether an object is an instance of a collection."""
    return item.type == "EMPTY" and item.instance_type == "COLLECTION" and item.instance_collection is not None


def frame_of(empty, context):
    """The marking frame of an empty; without one, that of the world: the laser looks down.

    Raises InputTrouble if the empty is hidden, or its axes have no length or are mirrored.
    """
    if empty is None:
        return Frame(np.zeros(3), np.eye(3))
    refuse_hidden(empty, context)
    matrix = np.array(empty.evaluated_get(context.evaluated_depsgraph_get()).matrix_world, float)
    axes = matrix[:3, :3]
    if abs(np.linalg.det(axes)) < 1e-12 * max(1e-12, np.abs(axes).max() ** 3):
        raise InputTrouble(f"The frame {empty.name} has the scale 0.", "Clear its scale with Alt+S.")
    if np.linalg.det(axes) < 0:
        raise InputTrouble(f"The frame {empty.name} is mirrored: its scale is negative.", "Clear its scale with Alt+S.")
    z = axes[:, 2] / np.linalg.norm(axes[:, 2])
    x = axes[:, 0] - z * (z @ axes[:, 0])
    x /= np.linalg.norm(x)
    return Frame(matrix[:3, 3], np.column_stack([x, np.cross(z, x), z]))


def quaternion(frame):
    """The rotation of the frame as (w, x, y, z)."""
    return tuple(Matrix(frame.axes.tolist()).to_quaternion())


def instances(evaluated, depsgraph):
    """What the view shows of other geometry at an object: instances of geometry nodes, of vertices or faces, of particles.

    Each is valid only until the next one.
    """
    for instance in depsgraph.object_instances:
        if instance.is_instance and instance.parent == evaluated:
            # Blender lists the mesh of a text, a surface and a metaball itself, too: with a single number.
            is_itself = instance.object.original == evaluated.original and instance.persistent_id[1] == _NO_NUMBER
            if not is_itself:
                yield instance


def refuse_hidden(item, context):
    """Raises InputTrouble for an object that Blender does not keep up to date, because it is not shown."""
    if item.name not in context.view_layer.objects:
        raise InputTrouble(f"The object {item.name} is not in this scene or view layer.",
                           "Choose another object, or link it to the scene.")
    if not item.visible_get(view_layer=context.view_layer):
        raise InputTrouble(f"The object {item.name} is hidden, and Blender does not keep hidden objects up to date.",
                           "Show it with its eye in the Outliner.")


def read(objects, frame, context):
    """The drawing that the objects show, with one layer for each object.

    Raises InputTrouble if there is no object, one is of another kind, or none contains a line.
    """
    if not objects:
        raise InputTrouble("There is no drawing yet.",
                           "Select curves, texts or grease pencil in the view and press Use Selected.")
    for item in objects:
        if item.type not in TYPES:
            raise InputTrouble(f"The object {item.name} is a {item.type.lower()}, which is not a drawing.",
                               "Convert it with Object > Convert > Curve, or remove it from the list.")
        refuse_hidden(item, context)
        if item.type in ("CURVE", "FONT") and item.data.is_editmode:
            item.update_from_editmode()
            # The view already evaluated the edit, but with the splines of the edit before.
            item.data.update_tag()
    depsgraph = context.evaluated_depsgraph_get()
    scale = millimetres(context.scene)
    paths, notices = [], []
    for item in objects:
        evaluated = item.evaluated_get(depsgraph)
        place = _Place(frame, np.array(evaluated.matrix_world, float), scale)
        if item.type in ("CURVE", "FONT"):
            found = _of_curve(item, evaluated, depsgraph, place, notices)
        elif item.type == "GPENCIL":
            found = _of_old_pencil(item, place, notices)
        else:
            found = _of_pencil(item, place, notices)
        layer = dxf.layer_name(item.name)
        count = len(paths)
        for points, closed in found:
            if not np.isfinite(points).all():
                raise InputTrouble(f"The object {item.name} has points at infinity.", "Remove the broken spline.")
            flat = _without_repeats(points[:, :2], closed)
            paths.append(dxf.Path(layer, closed and len(flat) > 2, flat.tolist()))
        if count == len(paths):
            notices.append(f"{item.name} contains no line.")
        if any(instances(evaluated, depsgraph)):
            notices.append(f"{item.name}: its instances are not marked. Realize them in the geometry nodes.")
        if place.off > _FLAT:
            notices.append(f"{item.name} is up to {place.off:.2f} mm off the plane of the frame; its view along the "
                           "frame's Z is marked.")
    if not paths:
        raise InputTrouble("The drawing contains no line.", "Draw a curve, or type a text.")
    return Drawing(paths, notices)


class _Place:
    """Converts points of an object to the marking frame, and keeps their largest distance from its plane."""

    def __init__(self, frame, matrix, scale):
        self._frame, self._matrix, self._scale = frame, matrix, scale
        self.off = 0.0

    def __call__(self, points, matrix=None):
        matrix = self._matrix if matrix is None else self._matrix @ matrix
        world = np.asarray(points, float).reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
        flat = (world - self._frame.origin) @ self._frame.axes * self._scale
        if len(flat):
            self.off = max(self.off, float(np.abs(flat[:, 2]).max()))
        return flat


def _without_repeats(points, closed):
    """The points without those that repeat the one before, which would be pieces without a length."""
    step = np.abs(np.diff(points, axis=0)).max(axis=1) if len(points) > 1 else np.zeros(0)
    points = points[np.append(True, step > 1e-6)]
    if closed and len(points) > 1 and np.abs(points[0] - points[-1]).max() <= 1e-6:
        points = points[:-1]
    return points


def _coordinates(collection, attribute, width=3):
    values = np.empty(len(collection) * width, np.float32)
    collection.foreach_get(attribute, values)
    return values.reshape(-1, width).astype(float)


def _of_curve(item, evaluated, depsgraph, place, notices):
    """Paths of a curve or of the outlines of a text."""
    data = item.data
    # With the mode Object, Blender uses neither the depth nor the extrusion; with the others, no bevel object.
    has_body = data.bevel_object if data.bevel_mode == "OBJECT" else data.bevel_depth or data.extrude
    if has_body:
        notices.append(f"{item.name}: bevel and extrusion are ignored, the line itself is marked.")
    if beyond := _beyond_splines(item):
        names = ", ".join(beyond)
        lines = [] if has_body else _shown_lines(evaluated)
        if lines:
            notices.append(f"{item.name}: its lines are marked as the view shows them after {names}, with the steps of its "
                           "Resolution Preview. Raise that for finer curves.")
            yield from ((place(points), closed) for points, closed in lines)
            return
        remedy = "Remove its bevel and extrusion" if has_body else "Convert it with Object > Convert > Curve"
        notices.append(f"{item.name}: {names} is not applied, so the mark differs from the view. {remedy}.")
    if data.offset:
        notices.append(f"{item.name}: its offset is ignored.")
    flat = evaluated.to_curve(depsgraph, apply_modifiers=item.type == "CURVE")
    try:
        for number, spline in enumerate(flat.splines, 1):
            points, closed = _of_spline(spline, place)
            if points is None:
                notices.append(f"{item.name}: spline {number} has weights of 0 or less and is not marked.")
            elif len(points):
                yield points, closed
    finally:
        evaluated.to_curve_clear()


def _beyond_splines(item):
    """The names of the modifiers that the view shows and that the splines of the evaluated object do not have."""
    shown = [modifier for modifier in item.modifiers
             if modifier.show_viewport and (modifier.show_in_editmode or not item.data.is_editmode)]
    return [modifier.name for modifier in shown
            if item.type == "FONT" or modifier.type != "HOOK"
            and not (modifier.type in _ON_CONTROL_POINTS and modifier.use_apply_on_spline)]


def _shown_lines(evaluated):
    """The lines that the view shows: points and whether they are closed. A filled curve shows the border of its faces."""
    mesh = evaluated.to_mesh()
    if mesh is None:
        return []
    try:
        points = _coordinates(mesh.vertices, "co")
        ends, sides = np.empty(len(mesh.edges) * 2, np.int32), np.empty(len(mesh.loops), np.int32)
        mesh.edges.foreach_get("vertices", ends)
        mesh.loops.foreach_get("edge_index", sides)
    finally:
        evaluated.to_mesh_clear()
    border = np.bincount(sides, minlength=len(ends) // 2) < 2
    return [(points[chain], closed) for chain, closed in curves.chains(ends.reshape(-1, 2)[border].tolist())]


def _of_spline(spline, place):
    closed = spline.use_cyclic_u
    if spline.type == "BEZIER":
        points = spline.bezier_points
        names = ("co", "handle_left", "handle_right")
        knots, lefts, rights = (place(_coordinates(points, name))[:, :2] for name in names)
        return curves.bezier(knots, lefts, rights, closed), closed
    values = _coordinates(spline.points, "co", 4)
    control = place(values[:, :3])
    if spline.type == "POLY":
        return control, closed
    weights = values[:, 3]
    if not (weights > 0).all():
        return None, closed
    points = curves.nurbs(control[:, :2], weights, spline.order_u, closed, spline.use_endpoint_u, spline.use_bezier_u)
    return points, closed


def _of_old_pencil(item, place, notices):
    """Paths of grease pencil until Blender 4.2."""
    _note_modifiers(item, getattr(item, "grease_pencil_modifiers", ()), notices)
    for layer in item.data.layers:
        if layer.hide or layer.active_frame is None:
            continue
        _note_parent(item, layer, notices)
        matrix = np.array(layer.matrix_layer, float)
        for stroke in layer.active_frame.strokes:
            if len(stroke.points) and (kind := _pencil_kind(item, stroke.material_index)):
                closed = stroke.use_cyclic or kind == "fill"
                yield place(_coordinates(stroke.points, "co"), matrix), closed


def _of_pencil(item, place, notices):
    """Paths of grease pencil from Blender 4.3 on."""
    _note_modifiers(item, item.modifiers, notices)
    for layer in item.data.layers:
        frame = None if layer.hide else layer.current_frame()
        if frame is None or frame.drawing is None:
            continue
        _note_parent(item, layer, notices)
        matrix = np.array(layer.matrix_local, float)
        curved = 0
        for stroke in frame.drawing.strokes:
            kind = _pencil_kind(item, stroke.material_index)
            if not kind or not len(stroke.points):
                continue
            points = place([point.position for point in stroke.points], matrix)
            curved += getattr(stroke, "curve_type", _POLY) != _POLY
            yield points, stroke.cyclic or kind == "fill"
        if curved:
            notices.append(f"{item.name}: {curved} strokes of layer {layer.name} are curves, of which only the control "
                           "points are joined. Convert them to poly strokes (Edit Mode: Stroke > Convert Type).")


def _pencil_kind(item, index):
    """What the material of a stroke shows: "stroke", "fill", or nothing."""
    materials = item.data.materials
    material = materials[index] if 0 <= index < len(materials) else None
    style = material.grease_pencil if material else None
    if style is None:
        return "stroke"
    if style.hide:
        return None
    return "fill" if style.show_fill else "stroke" if style.show_stroke else None


def _note_modifiers(item, modifiers, notices):
    shown = [modifier.name for modifier in modifiers if modifier.show_viewport]
    if shown:
        notices.append(f"{item.name}: modifiers are ignored ({', '.join(shown)}). Apply them to mark what they show.")


def _note_parent(item, layer, notices):
    if layer.parent is not None:
        notices.append(f"{item.name}: the parent {layer.parent.name} of a layer is ignored. Clear it to mark what you see.")
