# SPDX-License-Identifier: MIT OR Apache-2.0
"""The part as triangles whose normals are those of the true surface."""

import math
from itertools import product

import Part

from . import glb
from .frame import cross, dot, subtract, unit
from .wording import Trouble, translate

#: How far a triangle may be from the surface, mm, and how far neighbouring normals may differ, radians.
DEFLECTION = 0.02
ANGLE = 0.1
#: Vertices between two pauses of the tessellation.
PAUSE = 2000


class Tessellated:
    """The triangles of a part: all faces, and those that bound the mark."""

    def __init__(self):
        self.others = glb.Primitive()
        self.bounding = glb.Primitive()

    def points(self):
        """All vertices in the document, mm."""
        for primitive in (self.others, self.bounding):
            p = primitive.positions
            for n in range(0, len(p), 3):
                yield (p[n] * 1000.0, -p[n + 2] * 1000.0, p[n + 1] * 1000.0)

    def glb(self, frame):
        """The file of the part with its marking frame."""
        primitives = [(self.others, False), (self.bounding, True)]
        # Not the product's name: that of a product `mark` would mean that ink may be on all faces only.
        return glb.write_part(primitives, "part", frame, "isomark workbench for FreeCAD")


def tessellate(shape, bounding=()):
    """Yields now and then, so that a window stays live, and returns the `Tessellated` part at last.

    `bounding` holds the indices of the faces that bound the mark, from 0. Raises `Trouble` for a shape without faces.
    """
    if shape.isNull() or not shape.Faces:
        raise Trouble(
            translate("Isomark", "The part has no faces."),
            translate("Isomark", "Choose a solid or a surface, or a face of one."),
        )
    _mesh(shape)
    yield
    result = Tessellated()
    done = 0
    for number, face in enumerate(shape.Faces):
        primitive = result.bounding if number in bounding else result.others
        before = primitive.vertices()
        for _ in _face(face, primitive):
            yield
        done += primitive.vertices() - before
        if done > PAUSE:
            done = 0
            yield
    if not (result.others.indices or result.bounding.indices):
        raise Trouble(
            translate("Isomark", "FreeCAD cannot make triangles of the part."),
            translate("Isomark", "Check the part with Part > Check geometry, and repair it."),
        )
    return result


def at_once(steps):
    """The result of a generator such as `tessellate`, without pauses."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def _mesh(shape):
    """Makes the triangles of all faces at once, so that neighbouring faces share the points of their edges."""
    try:
        import MeshPart

        MeshPart.meshFromShape(Shape=shape, LinearDeflection=DEFLECTION, AngularDeflection=ANGLE, Relative=False)
    except Exception:  # the mesh module is optional, and raises its own kinds of errors
        shape.tessellate(DEFLECTION)


def _face(face, primitive):
    # Coarser than the triangles that are already there, so that these are returned.
    points, triangles = face.tessellate(1e3)
    if not triangles:
        return
    first = primitive.vertices()
    normal_at = _normals(face)
    parameters = None
    if normal_at is None:
        parameters = yield from _parameters(face, points)
    flat = None
    for number, point in enumerate(points):
        normal = normal_at(point) if normal_at else _normal(face, parameters[number])
        if normal is None:
            flat = flat or _facet_normals(points, triangles)
            normal = flat[number]
        primitive.add_vertex((point.x, point.y, point.z), normal)
        if number % PAUSE == PAUSE - 1:
            yield
    for triangle in triangles:
        primitive.indices.extend(first + corner for corner in triangle)


def _normals(face):
    """A function from a point of a plane or cylinder to the outward normal; `None` for other surfaces."""
    surface = face.Surface
    if isinstance(surface, Part.Plane):
        u0, u1, v0, v1 = face.ParameterRange
        normal = tuple(face.normalAt((u0 + u1) / 2.0, (v0 + v1) / 2.0))
        return lambda _point: normal
    if isinstance(surface, Part.Cylinder):
        center, axis = tuple(surface.Center), tuple(surface.Axis)
        u0, u1, v0, v1 = face.ParameterRange
        u, v = (u0 + u1) / 2.0, (v0 + v1) / 2.0

        def away(point):
            d = subtract((point[0], point[1], point[2]), center)
            along = dot(d, axis)
            return unit((d[0] - along * axis[0], d[1] - along * axis[1], d[2] - along * axis[2]))

        sign = 1.0 if dot(away(tuple(face.valueAt(u, v))), tuple(face.normalAt(u, v))) > 0.0 else -1.0
        return lambda point: tuple(sign * c for c in away(tuple(point)))

    return None


#: Points that are at most this far apart are the same, mm.
SAME = 1e-3


def _parameters(face, points):
    """The parameters of the points of a face's triangles.

    FreeCAD gives both in different orders, and merges points. Projecting the points would take 10 ms for each.
    """
    found = [None] * len(points)
    cells = {}
    for number, point in enumerate(points):
        cells.setdefault(_cell(point), []).append(number)
    places = []
    for uv in face.getUVNodes():
        place = face.valueAt(*uv)
        places.append((place, uv))
        own = _cell(place)
        around = product(*((axis, axis - 1, axis + 1) for axis in own)) if own not in cells else (own,)
        for number in (number for cell in around for number in cells.get(cell, ())):
            if found[number] is None and (points[number] - place).Length <= SAME:
                found[number] = uv
        if len(places) % PAUSE == 0:
            yield
    # Where an edge is farther from its face than that, the nearest point of the face is used.
    for number, point in enumerate(points):
        if found[number] is None and places:
            found[number] = min(places, key=lambda entry: (entry[0] - point).Length)[1]
    return found


def _cell(point):
    return (round(point.x / SAME), round(point.y / SAME), round(point.z / SAME))


def _normal(face, uv):
    """The outward normal at the parameters; `None` where there is none."""
    try:
        normal = tuple(face.normalAt(*uv))
        return unit(normal) if math.isfinite(sum(normal)) and dot(normal, normal) > 0.25 else None
    except Exception:  # singular points, such as the tip of a cone, raise errors of OpenCASCADE
        return None


def _facet_normals(points, triangles):
    sums = [[0.0, 0.0, 0.0] for _ in points]
    corners = [tuple(point) for point in points]
    for a, b, c in triangles:
        normal = cross(subtract(corners[b], corners[a]), subtract(corners[c], corners[a]))
        for corner in (a, b, c):
            for axis in range(3):
                sums[corner][axis] += normal[axis]
    return [unit(total) if dot(total, total) > 0.0 else (0.0, 0.0, 1.0) for total in sums]
