# SPDX-License-Identifier: MIT OR Apache-2.0
"""Keeps the mark in the document as plain objects, which open without this workbench."""

import FreeCAD
import Part

from .wording import translate

#: The property that names what a mark was made from.
SOURCE = "IsomarkSource"
#: Colours that a kept mark distinguishes, for each channel.
_STEPS = 16


def keep(document, mark, title, source, facts):
    """Adds the mark to the document, or replaces the mark with the same `source`. One step of Undo.

    `facts` are pairs of a property's name and its text.
    """
    document.openTransaction(translate("Isomark", "Mark on part"))
    try:
        for old in [item for item in document.Objects if getattr(item, SOURCE, None) == source]:
            for child in list(getattr(old, "Group", [])):
                document.removeObject(child.Name)
            document.removeObject(old.Name)
        group = document.addObject("App::DocumentObjectGroup", "Mark")
        group.Label = title
        for name, text in [(SOURCE, source)] + list(facts):
            group.addProperty("App::PropertyString", name, "isomark")
            setattr(group, name, text)
            group.setEditorMode(name, 1)
        group.addObject(_lines(document, mark.strips.get("mark", [])))
        meshes = mark.meshes.get("mark-ink", [])
        if meshes:
            group.addObject(_ink(document, meshes))
    except Exception:
        document.abortTransaction()
        raise
    document.commitTransaction()
    return group


def is_mark(item):
    """Whether the object belongs to a kept mark."""
    return hasattr(item, SOURCE) or any(hasattr(other, SOURCE) for other in item.InList)


def _lines(document, strips):
    edges, colours = [], []
    for strip in strips:
        for points, colour in _runs(strip):
            edges.append(_polyline(points))
            colours.append(colour)
    lines = document.addObject("Part::Feature", "MarkLines")
    lines.Label = translate("Isomark", "Marked lines")
    lines.Shape = Part.makeCompound(edges)
    view = getattr(lines, "ViewObject", None)
    if view is not None and edges:
        view.LineWidth = 3.0
        view.PointSize = 1.0
        view.LineColorArray = [colour + (0.0,) for colour in colours]
    return lines


def _runs(strip):
    """Pieces of a strip with one colour each."""
    run, shown = [strip.points[0]], None
    for number in range(1, len(strip.points)):
        point = strip.points[number]
        colour = tuple(round(c * _STEPS) / _STEPS for c in strip.colours[number])
        if shown not in (None, colour):
            yield run, shown
            run = [run[-1]]
        shown = colour
        if _differ(run[-1], point):
            run.append(point)
    yield run, shown


def _differ(a, b):
    return max(abs(a[axis] - b[axis]) for axis in range(3)) > 1e-6


def _polyline(points):
    """One edge for many points: a document with an edge for each piece of a mark would be slow."""
    if len(points) < 2:
        return Part.Vertex(*points[0])
    vectors = [FreeCAD.Vector(*point) for point in points]
    if len(vectors) == 2:
        return Part.makeLine(*vectors)
    curve = Part.BSplineCurve()
    knots = [float(number) for number in range(len(vectors))]
    multiplicities = [2] + [1] * (len(vectors) - 2) + [2]
    curve.buildFromPolesMultsKnots(vectors, multiplicities, knots, False, 1)
    return curve.toShape()


def _ink(document, meshes):
    import Mesh

    facets = []
    for part in meshes:
        facets += [[part.points[corner] for corner in triangle] for triangle in part.triangles]
    ink = document.addObject("Mesh::Feature", "MarkInk")
    ink.Label = translate("Isomark", "Marked areas")
    ink.Mesh = Mesh.Mesh(facets)
    view = getattr(ink, "ViewObject", None)
    if view is not None:
        view.ShapeColor = (0.1, 0.1, 0.1)
        view.Lighting = "Two side"
    return ink
