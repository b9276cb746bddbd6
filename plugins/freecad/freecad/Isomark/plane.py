# SPDX-License-Identifier: MIT OR Apache-2.0
"""The plane of a drawing: its own, that of the sketch that it shows, or one that follows from the part."""

import FreeCAD
import Part

from . import outline
from .frame import Frame, add, cross, dot, scaled, subtract
from .wording import Trouble, translate

#: How much of a face's normal is across a straight line in front of it, at least: the line is inclined by up to 45°.
SMALLEST_ACROSS = 0.7
#: How far corners of the same drawing may be apart, mm, and how many of them are compared.
SAME, COMPARED = 1e-4, 20


def own_frames(ref, shape):
    """The frames of the flat objects that a drawing is or shows, with these objects; empty without a plane of its own."""
    matrix, linked = ref.matrix(), ref.linked
    if _has_plane(linked):
        frame = frame_of_matrix(matrix)
        depths = [frame.local(tuple(vertex.Point))[2] for vertex in shape.Vertexes]
        return [(frame, linked)] if not depths or max(depths) - min(depths) <= outline.FLAT else []
    found = []
    for source in _made_of(linked):
        if _has_plane(source):
            placed = _placed(source, shape, matrix)
            if placed is not None:
                found.append((frame_of_matrix(placed), source))
    return found


def _made_of(item):
    """The objects that an object is made of, each once, in the order of its links."""
    # `OutListRecursive` sorts by addresses in memory, so that another session would give another order.
    seen, waiting = {item}, item.OutList[::-1]
    while waiting:
        found = waiting.pop()
        if found not in seen:
            seen.add(found)
            yield found
            waiting += found.OutList[::-1]


def _has_plane(item):
    """Whether the object is flat and has a plane of its own: a straight line of Draft has many."""
    if not item.isDerivedFrom("Part::Part2DObject") or not item.Shape.Edges:
        return False
    return item.isDerivedFrom("Sketcher::SketchObject") or outline.direction_of(item.Shape) is None


def _placed(source, shape, matrix):
    """From the coordinates of a flat object to the document, where a shape shows it; `None` if it does not show it.

    `matrix` is that of the object with the shape.
    """
    # By their ranges, which are the same for the same edge: comparing each with each takes seconds for a large array.
    with_range = {}
    for edge in shape.Edges:
        with_range.setdefault((edge.FirstParameter, edge.LastParameter), []).append(edge)
    # A binder may show only some of the edges.
    for line in source.Shape.Edges:
        for edge in with_range.get((line.FirstParameter, line.LastParameter), ()):
            # Links, binders and compounds place the same edge; arrays copy it, and so do faces of binders.
            if edge.isPartner(line):
                moved = edge.Placement.multiply(line.Placement.inverse())
                return moved.multiply(source.Placement).toMatrix()
    shown = [vertex.Point for vertex in shape.Vertexes]
    drawn = [matrix.multVec(vertex.Point) for vertex in source.Shape.Vertexes]
    # An array shows more than the drawing, and a binder of some closed lines less.
    if shown and (_are_among(drawn[:COMPARED], shown) or _are_among(shown[:COMPARED], drawn)):
        return matrix.multiply(source.Placement.toMatrix())
    return None


def _are_among(points, others):
    return all(any((other - point).Length <= SAME for other in others) for point in points)


def frame_of_matrix(matrix):
    """The frame of a sketch or another flat object: its own origin and axes."""
    origin, x, y, z = (matrix.multVec(FreeCAD.Vector(*axis)) for axis in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)))
    x, y, z = (tuple(axis - origin) for axis in (x, y, z))
    # A scale that differs between the axes moves z away from the normal, and a negative one turns the normal round.
    normal = cross(x, y)
    return Frame(tuple(origin), normal if dot(normal, z) > 0.0 else scaled(normal, -1.0), x)


def frame_away(part, shape, normal):
    """The frame in the middle of a flat shape whose z is the normal or its opposite, away from the part."""
    center = tuple(shape.BoundBox.Center)
    away = subtract(center, tuple(part.BoundBox.Center))
    return Frame.on_surface(center, normal if dot(away, normal) >= 0.0 else scaled(normal, -1.0))


def frame_of_lines(part, chosen, shapes):
    """The frame of straight lines: in their common plane, or on the side of the part where a single one is.

    `chosen` is the face of the part that the user chose, or `None`. Raises `Trouble`.
    """
    together = Part.Compound(shapes)
    along = outline.direction_of(together)
    plane = together.findPlane(outline.FLAT) if along is None else None
    if plane is not None:
        return frame_away(part, together, tuple(plane.Axis))
    # Lines in no common plane are refused when they are drawn.
    shape, along = (together, along) if along is not None else (shapes[0], outline.direction_of(shapes[0]))
    center = tuple(shape.BoundBox.Center)
    is_flat = chosen is not None and isinstance(chosen.Surface, Part.Plane)
    away = _across(subtract(center, tuple(part.BoundBox.Center)), along)
    if not is_flat and dot(away, away) < 1e-6:
        raise Trouble(
            translate("Isomark", "The drawing is a straight line through the middle of the part: it has no plane."),
            translate("Isomark", "Draw the line in a sketch."),
        )
    for faces in [chosen, part] if chosen is not None else [part]:
        across = _across(_outward(faces, center), along)
        if dot(across, across) >= SMALLEST_ACROSS**2:
            return Frame.on_surface(center, across)
    raise Trouble(
        translate("Isomark", "The drawing is a straight line that points into the part: it has no plane."),
        translate("Isomark", "Draw the line in a sketch, or click the face in front of which the line is."),
    )


def _across(vector, along):
    """The part of a vector that is perpendicular to a direction."""
    return subtract(vector, scaled(along, dot(vector, along)))


def _outward(shape, point):
    """The normal of the faces of a shape where they are nearest to a point; at an edge, the sum of their normals."""
    # Faces only: inside a solid, every distance to it is zero.
    surface = Part.Compound(shape.Faces)
    _, pairs, supports = surface.distToShape(Part.Vertex(*point))
    kind, number = supports[0][:2]
    faces = [surface.Faces[number]] if kind == "Face" else []
    if kind in ("Edge", "Vertex"):
        support = surface.Edges[number] if kind == "Edge" else surface.Vertexes[number]
        faces = surface.ancestorsOfType(support, Part.Face)
    total = (0.0, 0.0, 0.0)
    for face in faces:
        total = add(total, tuple(face.normalAt(*face.Surface.parameter(pairs[0][0]))))
    return total


def middle_of(face):
    """The parameters of the middle of a face, on the face."""
    u0, u1, v0, v1 = face.ParameterRange
    u, v = (u0 + u1) / 2.0, (v0 + v1) / 2.0
    if face.isPartOfDomain(u, v):
        return u, v
    # In a hole, or beside an edge that is not straight.
    _, pairs, _ = face.distToShape(Part.Vertex(face.CenterOfMass))
    return face.Surface.parameter(pairs[0][0])
