# SPDX-License-Identifier: MIT OR Apache-2.0
"""The lines of sketches, Draft objects, ShapeStrings and other flat shapes, in the coordinates of a marking frame."""

import math

import Part

from .chain import chained
from .dxf import Path, bulge_of
from .frame import dot, scaled, subtract, unit
from .wording import Trouble, translate

#: How far a polyline may be from a curve that is no line or arc, mm.
DEFLECTION = 0.001
#: How far a drawing may leave its plane, mm.
FLAT = 0.01
#: The shortest edge that is drawn, mm.
SHORTEST = 1e-6


def paths_of(shape, layer, frame):
    """The paths of a shape: the contours of its faces, its other edges, and its single points.

    Raises `Trouble` when the shape is not flat in the frame's plane or a plane parallel to it.
    """
    heights = []
    groups, in_faces = [], _Shapes()
    for face in shape.Faces:
        for wire in face.Wires:
            groups.append(wire.Edges)
            for edge in wire.Edges:
                in_faces.add(edge)
    groups.append([edge for edge in shape.Edges if edge not in in_faces])
    paths = []
    for edges in groups:
        pieces = [piece for piece in (_piece(edge, frame, heights) for edge in edges) if piece]
        paths += [Path(layer, corners, closed) for corners, closed in chained(pieces)]
    ends = _Shapes()
    for edge in shape.Edges:
        for vertex in edge.Vertexes:
            ends.add(vertex)
    for vertex in shape.Vertexes:
        if vertex not in ends:
            x, y, height = frame.local(tuple(vertex.Point))
            heights.append(height)
            paths.append(Path(layer, [(x, y, 0.0)]))
    if heights and max(heights) - min(heights) > FLAT:
        raise _not_flat(shape, layer, max(heights) - min(heights))
    return paths


def _not_flat(shape, name, depth):
    if shape.findPlane(FLAT) is None:
        what = translate(
            "Isomark", "The drawing {name} is not flat: its lines differ by {depth:.2f} mm in depth.", name=name, depth=depth
        )
        return Trouble(what, translate("Isomark", "Choose a drawing that is in one plane, such as a sketch."))
    return Trouble(
        translate("Isomark", "The drawing {name} is in another plane than the first one that is selected.", name=name),
        translate("Isomark", "Select drawings in the same plane or in parallel planes, and mark the others on their own."),
    )


class _Shapes:
    """A set of shapes. Different shapes may have the same hash, so that it alone would lose lines."""

    def __init__(self):
        self._with_hash = {}

    def add(self, shape):
        if shape not in self:
            self._with_hash.setdefault(shape.hashCode(), []).append(shape)

    def __contains__(self, shape):
        return any(shape.isSame(other) for other in self._with_hash.get(shape.hashCode(), ()))


def _piece(edge, frame, heights):
    """The corners of an edge, from its start to its end; `None` for an edge without a length."""
    if edge.Length < SHORTEST or getattr(edge, "Degenerated", False):
        return None

    def local(point):
        x, y, height = frame.local((point.x, point.y, point.z))
        heights.append(height)
        return (x, y)

    first, last = edge.FirstParameter, edge.LastParameter
    kind = edge.Curve.TypeId
    if kind in ("Part::GeomLine", "Part::GeomLineSegment"):
        start, end = local(edge.valueAt(first)), local(edge.valueAt(last))
        return [start + (0.0,), end + (0.0,)]
    if kind == "Part::GeomCircle":
        arc = _arc(edge, first, last, frame, local)
        if arc:
            return arc
    points = edge.discretize(Deflection=DEFLECTION)
    if len(points) < 2:
        points = edge.discretize(Number=64)
    return [local(point) + (0.0,) for point in points]


def _arc(edge, first, last, frame, local):
    """The corners of an arc in a plane parallel to the frame's; each is at most a third of a circle."""
    axis = edge.Curve.Axis
    along = axis.x * frame.z[0] + axis.y * frame.z[1] + axis.z * frame.z[2]
    if abs(abs(along) - 1.0) > 1e-12:
        return None
    turn = (last - first) * math.copysign(1.0, along)
    count = max(1, math.ceil(abs(turn) / (2.0 * math.pi / 3.0) - 1e-9))
    step = (last - first) / count
    bulge = bulge_of(turn / count)
    corners = [local(edge.valueAt(first + number * step)) + (bulge,) for number in range(count)]
    return corners + [local(edge.valueAt(last)) + (0.0,)]


def direction_of(shape):
    """The direction of a shape whose lines are all on one straight line; `None` for others."""
    straight = ("Part::GeomLine", "Part::GeomLineSegment")
    if any(edge.Length >= SHORTEST and edge.Curve.TypeId not in straight for edge in shape.Edges):
        return None
    points = [tuple(vertex.Point) for vertex in shape.Vertexes]
    if not points:
        # An infinite line.
        return None
    farthest = max(points, key=lambda point: math.dist(point, points[0]))
    if math.dist(farthest, points[0]) < SHORTEST:
        return None
    along = unit(subtract(farthest, points[0]))
    for point in points:
        away = subtract(point, points[0])
        across = subtract(away, scaled(along, dot(away, along)))
        if dot(across, across) > FLAT**2:
            return None
    return along


def plane_of(shape):
    """A point, the normal and the x direction of the plane of a shape that has no placement in its plane.

    Raises `Trouble` when the shape is not flat.
    """
    plane = shape.findPlane(FLAT) if shape.Edges else None
    if plane is None:
        raise Trouble(
            translate("Isomark", "The drawing is not flat."),
            translate("Isomark", "Choose a drawing that is in one plane, such as a sketch."),
        )
    return plane.Position, plane.Axis


def has_lines(shape):
    """Whether anything of the shape can be drawn."""
    return isinstance(shape, Part.Shape) and not shape.isNull() and bool(shape.Edges or shape.Vertexes)
