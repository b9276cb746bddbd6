# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads an object of the scene as a part: its mesh with all modifiers and instances, in the axes of the world, in metres."""

from collections import namedtuple

import bmesh
import numpy as np
from mathutils.bvhtree import BVHTree

from . import drawing, glb
from .trouble import InputTrouble

# Types of objects that have a surface.
TYPES = ("MESH", "SURFACE", "META")

# What was read: the GLB file, the number of triangles, and sentences about how it was read.
Part = namedtuple("Part", "glb triangles notices")

# A longer part is assumed to be drawn in mm in a scene in metres; isomark would assume so, too.
_LONGEST_M = 5.0


def read(item, frame, context):
    """The part as a GLB file with the marking frame; `frame` is a drawing.Frame, or None for none.

    Raises InputTrouble if there is no object, it has no faces, or its size is not that of a part.
    """
    if item is None:
        raise InputTrouble("There is no part yet.", "Select the part in the view and press Use Selected, or choose it under Part.")
    if item.type not in TYPES:
        raise InputTrouble(f"The object {item.name} is a {item.type.lower()}, which has no faces.", "Choose a mesh as the part.")
    drawing.refuse_hidden(item, context)
    metres = context.scene.unit_settings.scale_length
    pieces = [piece for shown, mesh, matrix in _meshes(item, context)
              for piece in _pieces(shown, mesh, np.array(matrix, float), metres)]
    triangles = sum(len(piece.triangles) for piece in pieces)
    if not triangles:
        raise InputTrouble(f"The part {item.name} has no faces.", "Choose an object with faces as the part.")
    points = np.vstack([piece.points for piece in pieces])
    if not np.isfinite(points).all():
        raise InputTrouble(f"The part {item.name} has points at infinity.", "Remove the broken vertices.")
    size = np.ptp(points, axis=0)
    if np.linalg.norm(size) > _LONGEST_M:
        raise InputTrouble(f"The part {item.name} is {size.max():.3g} m long, because a unit of the scene is {metres:g} m.",
                           "If it is drawn in mm, set Scene Properties > Units > Unit Scale to 0.001.")
    node = None if frame is None else (tuple(frame.origin * metres), drawing.quaternion(frame))
    name = "part" if item.name == "isomark" else item.name
    return Part(glb.write_part(name, pieces, node), triangles, _notices(item))


def nearest(item, point, context):
    """The point of the part that is nearest to a point of the world, with the normal there; None without faces."""
    found = None
    for _, mesh, matrix in _meshes(item, context):
        faces = bmesh.new()
        try:
            faces.from_mesh(mesh)
            faces.transform(matrix)
            faces.normal_update()
            place, normal, _, distance = BVHTree.FromBMesh(faces).find_nearest(point)
        finally:
            faces.free()
        if place is not None and (found is None or distance < found[2]):
            # A mirrored object shows the back of its triangles.
            found = place, -normal if matrix.determinant() < 0 else normal, distance
    return found and found[:2]


def _meshes(item, context):
    """What the view shows of an object and its instances: evaluated objects with their meshes and matrices."""
    if item.mode == "EDIT" and item.type == "MESH":
        item.update_from_editmode()
    depsgraph = context.evaluated_depsgraph_get()
    evaluated = item.evaluated_get(depsgraph)
    yield from _mesh(evaluated, evaluated.matrix_world)
    for instance in drawing.instances(evaluated, depsgraph):
        yield from _mesh(instance.object, instance.matrix_world)


def _mesh(evaluated, matrix):
    mesh = evaluated.to_mesh() if evaluated.type in (*TYPES, "CURVE", "FONT") else None
    if mesh is not None:
        try:
            yield evaluated, mesh, matrix
        finally:
            evaluated.to_mesh_clear()


def _pieces(evaluated, mesh, matrix, metres):
    """One piece for each material, with the faces turned right side out if the object is mirrored."""
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    if not count:
        return []
    corners = np.empty(count * 3, np.int32)
    mesh.loop_triangles.foreach_get("loops", corners)
    materials = np.empty(count, np.int32)
    mesh.loop_triangles.foreach_get("material_index", materials)
    vertex_of = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", vertex_of)
    points = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", points)
    normals = np.empty(len(mesh.loops) * 3, np.float32)
    if hasattr(mesh, "corner_normals"):
        mesh.corner_normals.foreach_get("vector", normals)
    else:
        mesh.calc_normals_split()
        mesh.loops.foreach_get("normal", normals)

    turn = matrix[:3, :3]
    points = (points.reshape(-1, 3) @ turn.T + matrix[:3, 3]) * metres
    determinant = np.linalg.det(turn)
    if abs(determinant) > 1e-30:
        # Normals keep their right angle to the surface, also under a scale that differs between the axes.
        normals = normals.reshape(-1, 3) @ np.linalg.inv(turn)
    else:
        normals = normals.reshape(-1, 3)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    # A face without an area has no normal, and glTF needs one.
    normals = np.where(length > 0, normals / np.where(length > 0, length, 1), (0.0, 0.0, 1.0))
    corners = corners.reshape(-1, 3)
    if determinant < 0:
        corners = corners[:, ::-1]

    # Those of the evaluated object: geometry nodes give materials, too.
    names = [slot.material.name if slot.material else None for slot in evaluated.material_slots] or [None]
    pieces = []
    for index in np.unique(materials):
        used, order = _distinct(corners[materials == index].reshape(-1), vertex_of, normals)
        name = names[min(int(index), len(names) - 1)]
        pieces.append(glb.Piece(name, points[vertex_of[used]], normals[used], order.reshape(-1, 3)))
    return pieces


def _distinct(corners, vertex_of, normals):
    """Corners without repeats, where a repeat has the same vertex and the same normal to a thousandth; and for each corner
    its number among them."""
    steps = np.rint((normals[corners] + 1) * 511).astype(np.int64)
    key = ((vertex_of[corners].astype(np.int64) * 1024 + steps[:, 0]) * 1024 + steps[:, 1]) * 1024 + steps[:, 2]
    _, first, order = np.unique(key, return_index=True, return_inverse=True)
    return corners[first], order


def _notices(item):
    notices = []
    for modifier in item.modifiers:
        if modifier.type == "SUBSURF" and modifier.show_viewport and modifier.levels < modifier.render_levels:
            notices.append(f"{item.name} is read as the view shows it: {modifier.name} has {modifier.levels} levels in the "
                           f"view and {modifier.render_levels} in renders. Set both to the level of the real part.")
        elif modifier.type == "SUBSURF" and not modifier.show_viewport:
            notices.append(f"{item.name}: {modifier.name} is switched off in the view and is not applied.")
    return notices
