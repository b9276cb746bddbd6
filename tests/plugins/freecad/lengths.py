"""Sketches and texts drawn by script come out with the lengths that were drawn, on any plane and in any container.

Run by freecadcmd. The drawn lengths are those of the CAD kernel or were chosen here; the lengths on the part are measured on
the formula of the surface.
"""

import json
import math
import os
import struct
import sys
import tempfile
import zipfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness

harness.use_plugin()

import Draft
import FreeCAD
import Part
from freecad.Isomark import choice, dxf, glb, job, part
from freecad.Isomark import mark as kept_in
from freecad.Isomark.dxf import Path
from surfaces import Can, Cone, Mouse, Vector, any_rotation, length_on, lifted, polylines

FONT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "..", "fonts", "DejaVuSans-subset.ttf")
#: The length error that a drawing may have, mm.
LIMIT = 0.1


def corrected(chosen, name, more=(), options=None, other_side=False, bounding=()):
    """Runs the program for a choice: the frame, the corrected DXF, the report and the mark on the part."""
    frame = chosen.frame(other_side)
    tessellated = part.at_once(part.tessellate(chosen.part.shape(), bounding))
    made = job.files(chosen, tessellated, frame)
    folder = job.Folder()
    try:
        run = job.Run(folder, made, name, "drawing", options or {"anchor": "origin"})
        report, mark = run.result(*harness.isomark(*run.arguments, *more))
        with open(run.out, "rb") as file:
            return frame, file.read(), report, mark
    finally:
        folder.close()


def check(surface, placement, chosen, name, drawn, more=(), has_origin=True):
    """Compares the lengths on the surface with the drawn ones, and the place with that of the drawing's origin."""
    frame, data, report, mark = corrected(chosen, name, more)
    marked = polylines(data)
    lengths = sorted(length_on(surface, placement, frame, *path) for path in marked if len(path[0]) > 1)
    assert len(lengths) == len(drawn), "%d paths instead of %d" % (len(lengths), len(drawn))
    error = sum(abs(a - b) for a, b in zip(lengths, sorted(drawn)))
    assert error < LIMIT, "%s: the lengths differ by %.4f mm" % (name, error)
    assert report["quality"]["after"]["length_error_mm"] < LIMIT
    turn = placement.inverse()
    farthest = max(
        abs(surface.outside(turn.multVec(Vector(*point)))) for strip in mark.strips["mark"] for point in strip.points
    )
    assert farthest < 0.05, "%s: the mark is drawn %.4f mm off the surface" % (name, farthest)
    # What was drawn about the origin is marked where the normal of the drawing meets the part.
    smallest = min((path[0] for path in marked), key=lambda corners: math.dist(corners[0], corners[len(corners) // 2]))
    if has_origin:
        middle = [(min(axis) + max(axis)) / 2 for axis in zip(*smallest)]
        x, y, _ = frame.local(lifted(surface, placement, frame, *middle))
        assert abs(x) < 0.02 and abs(y) < 0.02, "%s: the origin is marked at %.4f, %.4f" % (name, x, y)
    harness.say("   %s: length error %.4f mm on %.1f mm, %.4f mm off the surface" % (name, error, sum(drawn), farthest))


def draw(sketch):
    """Lines, arcs, circles, an ellipse and a spline; returns the drawn lengths of the paths."""
    line, arc = Part.LineSegment, Part.Arc
    sketch.addGeometry(Part.Circle(Vector(0, 0, 0), Vector(0, 0, 1), 0.5))
    sketch.addGeometry(line(Vector(-15, 2, 0), Vector(15, 2, 0)))
    # A slot: two lines and two half circles, one contour.
    sketch.addGeometry(line(Vector(-10, 5, 0), Vector(10, 5, 0)))
    sketch.addGeometry(arc(Vector(10, 5, 0), Vector(12, 7, 0), Vector(10, 9, 0)))
    sketch.addGeometry(line(Vector(10, 9, 0), Vector(-10, 9, 0)))
    sketch.addGeometry(arc(Vector(-10, 9, 0), Vector(-12, 7, 0), Vector(-10, 5, 0)))
    circle = Part.Circle(Vector(-8, -6, 0), Vector(0, 0, 1), 5.0)
    sketch.addGeometry(circle)
    ellipse = Part.Ellipse(Vector(14, -6, 0), Vector(8, -3, 0), Vector(8, -6, 0))
    sketch.addGeometry(ellipse)
    spline = Part.BSplineCurve()
    spline.interpolate([Vector(-14, -12, 0), Vector(-5, -14, 0), Vector(4, -11, 0), Vector(13, -13, 0)])
    sketch.addGeometry(spline)
    construction = sketch.addGeometry(line(Vector(-40, -40, 0), Vector(40, 40, 0)))
    sketch.toggleConstruction(construction)
    slot = 2 * 20.0 + 2 * math.pi * 2.0
    return [2 * math.pi * 0.5, 30.0, slot, 2 * math.pi * 5.0, ellipse.length(), spline.length()]


def sketch_on(document, container, placement):
    sketch = document.addObject("Sketcher::SketchObject", "Sketch")
    if container is not None:
        container.addObject(sketch)
    sketch.Placement = placement
    drawn = draw(sketch)
    document.recompute()
    return sketch, drawn


def feature(document, surface, placement):
    item = document.addObject("Part::Feature", "Shape")
    item.Shape = surface.shape()
    item.Placement = placement
    document.recompute()
    return item


def chosen(part_item, drawings):
    result = choice.Choice()
    result.part = choice.Ref.of(part_item)
    result.drawing = [choice.Ref.of(item) for item in drawings]
    return result


def a_sketch_in_front_of_an_upright_can():
    document = FreeCAD.newDocument()
    can = Can(36.5, 120.0)
    item = feature(document, can, FreeCAD.Placement())
    upright = FreeCAD.Rotation(Vector(0, 0, 1), 25) * FreeCAD.Rotation(Vector(1, 0, 0), 90)
    sketch, drawn = sketch_on(document, None, FreeCAD.Placement(Vector(17, -36, 60), upright))
    check(can, FreeCAD.Placement(), chosen(item, [sketch]), "upright", drawn)


def a_sketch_in_a_body_that_is_turned_and_moved():
    document = FreeCAD.newDocument()
    can = Can(30.0, 100.0)
    body = document.addObject("PartDesign::Body", "Body")
    cylinder = document.addObject("PartDesign::AdditiveCylinder", "Cylinder")
    body.addObject(cylinder)
    cylinder.Radius, cylinder.Height = can.radius, can.height
    # On the XZ plane through the axis: the mark is on the surface in front of it.
    sketch, drawn = sketch_on(
        document, body, FreeCAD.Placement(Vector(0, 0, 50), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    )
    body.Placement = FreeCAD.Placement(Vector(40, -25, 12), any_rotation(3))
    document.recompute()
    check(can, body.Placement, chosen(body, [sketch]), "body", drawn)


def a_sketch_and_a_body_in_a_container():
    document = FreeCAD.newDocument()
    can = Can(40.0, 90.0)
    container = document.addObject("App::Part", "Assembly")
    item = feature(document, can, FreeCAD.Placement(Vector(5, 6, 7), FreeCAD.Rotation(Vector(0, 1, 0), 90)))
    container.addObject(item)
    sketch, drawn = sketch_on(
        document, container, FreeCAD.Placement(Vector(50, 6, 60), FreeCAD.Rotation(Vector(0, 0, 1), 90))
    )
    container.Placement = FreeCAD.Placement(Vector(-10, 20, 30), any_rotation(5))
    document.recompute()
    check(can, container.Placement * item.Placement, chosen(item, [sketch]), "container", drawn)


def a_sketch_on_a_cone():
    document = FreeCAD.newDocument()
    cone = Cone(30.0, 42.0, 120.0)
    item = feature(document, cone, FreeCAD.Placement(Vector(3, 2, 1), any_rotation(8)))
    front = FreeCAD.Placement(Vector(0, -40, 60), FreeCAD.Rotation(Vector(1, 0, 0), 95))
    sketch, drawn = sketch_on(document, None, item.Placement * front)
    check(cone, item.Placement, chosen(item, [sketch]), "cone", drawn)


def text_on_a_mouse():
    document = FreeCAD.newDocument()
    mouse = Mouse()
    item = feature(document, mouse, FreeCAD.Placement())
    text = Draft.make_shapestring("isomark", FONT, 7.0)
    # Above the back, and tilted a little.
    text.Placement = FreeCAD.Placement(Vector(-15, 5, 45), FreeCAD.Rotation(Vector(1, 0, 0), 6))
    document.recompute()
    drawn = [wire.Length for face in text.Shape.Faces for wire in face.Wires]
    assert len(drawn) == 10, "i, s, o, m, a, r, k have ten contours"
    # The corners of the corrected polylines are on the curves, so polylines are shorter than curves, most of all in small
    # letters: with the usual tolerance of 0.01 mm by 0.14 mm here.
    check(mouse, FreeCAD.Placement(), chosen(item, [text]), "text", drawn, ["--tolerance", "0.001"], False)


def draft_objects_on_a_mouse():
    document = FreeCAD.newDocument()
    mouse = Mouse()
    item = feature(document, mouse, FreeCAD.Placement(Vector(0, 0, 0), any_rotation(13)))
    above = item.Placement * FreeCAD.Placement(Vector(0, 5, 50), FreeCAD.Rotation(Vector(0, 0, 1), 30))
    rectangle = Draft.make_rectangle(24.0, 10.0, face=True)
    rectangle.Placement = above * FreeCAD.Placement(Vector(-12, -5, 0), FreeCAD.Rotation())
    circle = Draft.make_circle(4.0)
    circle.Placement = above
    # At the origin of the frame, which is that of the first object.
    point = Draft.make_point(*rectangle.Placement.Base)
    wire = Draft.make_wire([above.multVec(Vector(x, y, 0)) for x, y in ((-10, 9), (-3, 14), (8, 9))], face=False)
    document.recompute()
    drawn = [68.0, 2 * math.pi * 4.0, (49 + 25) ** 0.5 + (121 + 25) ** 0.5]
    check(mouse, item.Placement, chosen(item, [rectangle, circle, wire, point]), "draft", drawn)


def a_drawing_seen_from_its_back_is_marked_at_its_place():
    document = FreeCAD.newDocument()
    can = Can(30.0, 100.0)
    item = feature(document, can, FreeCAD.Placement())
    # The normal of this sketch points into the can, at its back: the laser is behind the sketch.
    inwards = FreeCAD.Placement(Vector(0, 40, 50), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    sketch = document.addObject("Sketcher::SketchObject", "Sketch")
    sketch.addGeometry(Part.LineSegment(Vector(4, -5, 0), Vector(12, 3, 0)))
    sketch.Placement = inwards
    document.recompute()
    choices = chosen(item, [sketch])
    choices.faces = [0]
    choices.picked = (0.0, 30.0, 50.0)
    assert choices.suggests_other_side(), "the clicked face looks away from the sketch's own laser"
    choices.faces, choices.picked = [], None
    _, _, report, mark = corrected(choices, "behind", other_side=True)
    assert report["quality"]["after"]["length_error_mm"] < 0.01
    points = [point for strip in mark.strips["mark"] for point in strip.points]
    assert all(point[1] > 20.0 for point in points), "the mark is not at the back"
    start = min(points, key=lambda point: point[2])
    end = max(points, key=lambda point: point[2])
    # The line is straight on the unrolled can, and its middle keeps its place up to the unrolling of the drawing.
    assert abs(start[2] - 45.0) < 0.05 and abs(end[2] - 53.0) < 0.05, (start, end)
    around = [30.0 * math.asin(point[0] / 30.0) for point in (start, end)]
    assert abs(around[0] - 4.0) < 0.05 and abs(around[1] - 12.0) < 0.05, around


def files_are_placed_at_the_clicked_point():
    document = FreeCAD.newDocument()
    can = Can(30.0, 100.0)
    item = feature(document, can, FreeCAD.Placement(Vector(7, 8, 9), FreeCAD.Rotation(Vector(0, 0, 1), 40)))
    choices = chosen(item, [])
    choices.faces = [next(n for n, face in enumerate(item.Shape.Faces) if isinstance(face.Surface, Part.Cylinder))]
    angle = math.radians(200.0)
    clicked = (7 + 30 * math.cos(angle), 8 + 30 * math.sin(angle), 9 + 62.0)
    choices.picked = clicked
    with tempfile.TemporaryDirectory() as folder:
        for name, data, options in (
            (
                "cross.dxf",
                dxf.write([Path("0", [(100, 50, 0), (110, 50, 0)]), Path("0", [(105, 45, 0), (105, 55, 0)])]),
                {},
            ),
            ("logo.bmp", bitmap(), {"width_mm": 12.0}),
        ):
            choices.file = os.path.join(folder, name)
            with open(choices.file, "wb") as file:
                file.write(data)
            _, _, report, mark = corrected(choices, "file", options=dict(options, anchor="center"))
            points = [point for strip in mark.strips["mark"] for point in strip.points]
            middle = [sum(point[axis] for point in points) / len(points) for axis in range(3)]
            assert math.dist(middle, clicked) < 2.0, (name, middle, clicked)
            heights = [point[2] for point in points]
            assert abs((max(heights) + min(heights)) / 2 - 71.0) < 0.1, name
            assert report["quality"]["after"]["length_error_mm"] < LIMIT


def bitmap():
    """A black square in a white picture of 24 x 24 pixels, 24 bits each."""
    size = 24
    rows = b"".join(
        b"".join(b"\0\0\0" if 6 <= x < 18 and 6 <= y < 18 else b"\xff\xff\xff" for x in range(size))
        for y in range(size)
    )
    head = struct.pack("<2sIHHI", b"BM", 54 + len(rows), 0, 0, 54)
    return head + struct.pack("<IiiHHIIiiII", 40, size, size, 1, 24, 0, len(rows), 2835, 2835, 0, 0) + rows


def ink_beyond_the_selected_faces_is_refused():
    document = FreeCAD.newDocument()
    item = feature(document, Can(30.0, 100.0), FreeCAD.Placement())
    sketch, _ = sketch_on(document, None, FreeCAD.Placement(Vector(0, -30, 50), FreeCAD.Rotation(Vector(1, 0, 0), 90)))
    faces = item.Shape.Faces
    side = next(number for number, face in enumerate(faces) if isinstance(face.Surface, Part.Cylinder))
    corrected(chosen(item, [sketch]), "inside", bounding=(side,))
    try:
        corrected(chosen(item, [sketch]), "outside", bounding=((side + 1) % len(faces),))
    except job.Trouble as trouble:
        assert "Only on the selected faces" in trouble.remedy, trouble
        assert "outside the selected faces" in trouble.what and "`mark`" not in trouble.what, trouble
        return
    raise AssertionError("ink beyond the selected faces was accepted")


def the_mark_is_kept_as_plain_objects():
    document = FreeCAD.newDocument()
    document.UndoMode = 1
    can = Can(36.5, 120.0)
    item = feature(document, can, FreeCAD.Placement())
    sketch, drawn = sketch_on(
        document, None, FreeCAD.Placement(Vector(0, -36, 60), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    )
    _, _, _, mark = corrected(chosen(item, [sketch]), "kept")
    kept_in.keep(document, mark, "Mark", "Shape Sketch", [("Product", "kept")])
    lines = document.getObject("MarkLines")
    assert abs(lines.Shape.Length - sum(drawn)) < 0.5, lines.Shape.Length
    assert {entry.TypeId for entry in document.getObject("Mark").Group} <= {"Part::Feature", "Mesh::Feature"}
    # Again: it replaces the first one, and Undo brings that back in one step.
    kept_in.keep(document, mark, "Mark again", "Shape Sketch", [("Product", "kept")])
    assert len([entry for entry in document.Objects if kept_in.is_mark(entry)]) == 2 + ("mark-ink" in mark.meshes)
    document.undo()
    assert document.getObject("Mark").Label == "Mark"
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "kept.FCStd")
        document.saveAs(path)
        # No class of the workbench is in the file, so that it opens without the workbench.
        with zipfile.ZipFile(path) as archive:
            text = archive.read("Document.xml").decode("utf-8")
        assert "freecad.Isomark" not in text and "Proxy" not in text.replace("ShapeString", "")


def the_files_are_valid_for_others():
    document = FreeCAD.newDocument()
    item = feature(document, Can(30.0, 100.0), FreeCAD.Placement())
    sketch, _ = sketch_on(document, None, FreeCAD.Placement(Vector(0, -30, 50), FreeCAD.Rotation(Vector(1, 0, 0), 90)))
    choices = chosen(item, [sketch])
    frame = choices.frame()
    data = dxf.write(choices.paths(frame))
    folder = os.environ.get("ISOMARK_FILES")
    if folder:
        tessellated = part.at_once(part.tessellate(choices.part.shape(), (0,)))
        for name, content in (("drawing.dxf", data), ("part.glb", tessellated.glb(frame))):
            with open(os.path.join(folder, name), "wb") as file:
                file.write(content)
    left, bottom, right, top = dxf.extents(choices.paths(frame))
    box = sketch.Shape.optimalBoundingBox(False)
    assert abs(left - box.XMin) < 1e-3 and abs(right - box.XMax) < 1e-3
    assert abs(bottom - (box.ZMin - 50.0)) < 1e-3 and abs(top - (box.ZMax - 50.0)) < 1e-3
    assert data.isascii()


def drawings_with_other_letters_keep_their_own_layers():
    """As isomark reads them: each drawing may have its own pen."""
    labels = ["Größe 1/2", "Надпись", "文字", "日本", "plain", "0"]
    paths = [Path(label, [(0, n, 0), (5, n, 0)]) for n, label in enumerate(labels)]
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "layers.dxf")
        with open(path, "wb") as file:
            file.write(dxf.write(paths))
        code, output, errors = harness.isomark("inspect", path, "--json")
        assert code == 0, errors
        layers = json.loads(output.decode("utf-8"))["layers"]
    expected = {label.replace("/", "_"): 1 for label in labels}
    assert {name: layer["paths"] for name, layer in layers.items()} == expected, layers


def the_part_is_written_as_glb_with_outward_normals():
    shape = (
        Part.makeBox(10, 20, 30)
        .cut(Part.makeCylinder(3, 30, Vector(5, 10, 0)))
        .fuse(Part.makeSphere(6, Vector(5, 10, 33)))
    )
    tessellated = part.at_once(part.tessellate(shape))
    primitive = tessellated.others
    inside = 0
    for n in range(0, len(primitive.positions), 3):
        at = glb.to_document([primitive.positions[n + axis] * 1000.0 for axis in range(3)])
        normal = glb.to_document(primitive.normals[n : n + 3])
        if shape.isInside(Vector(*(a + 0.05 * b for a, b in zip(at, normal))), 1e-3, False):
            inside += 1
    # Only vertices in concave edges may have the part in front of them.
    assert inside < 0.2 * primitive.vertices(), "%d of %d normals point inwards" % (inside, primitive.vertices())


def a_drawing_beside_the_part_is_refused_with_a_remedy():
    document = FreeCAD.newDocument()
    item = feature(document, Can(20.0, 50.0), FreeCAD.Placement())
    sketch, _ = sketch_on(
        document, None, FreeCAD.Placement(Vector(300, -20, 25), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    )
    try:
        corrected(chosen(item, [sketch]), "beside")
    except job.Trouble as trouble:
        assert "No face of the part" in trouble.what and trouble.remedy
        return
    raise AssertionError("a drawing beside the part was accepted")


class Entry:
    """What FreeCAD's selection gives for an object in the 3-D view or in the tree."""

    def __init__(self, item, *names, points=()):
        self.Object, self.SubElementNames, self.PickedPoints = item, names, list(points)


def of(entries):
    """The choice that a selection gives."""
    return choice.of_selection(entries, entries[0].Object.Document.Name)


def refusal(chosen):
    """The trouble that a choice ends with."""
    try:
        chosen.check()
        chosen.frame()
    except choice.Trouble as trouble:
        assert trouble.remedy
        return trouble.what
    raise AssertionError("the choice was accepted")


def what_cannot_be_used_is_named():
    document = FreeCAD.newDocument()
    front = FreeCAD.Placement(Vector(0, -20, 25), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    can, other = (feature(document, Can(20.0, 50.0), FreeCAD.Placement(Vector(x, 0, 0), FreeCAD.Rotation())) for x in (0, 90))
    sketch, _ = sketch_on(document, None, front)
    text = Draft.make_text(["isomark"], placement=front)
    dimension = Draft.make_dimension(Vector(0, -20, 25), Vector(9, -20, 25), Vector(4, -20, 30))
    scan = document.addObject("Mesh::Feature", "Scan")
    plane = document.addObject("PartDesign::Plane", "Plane")
    group = document.addObject("App::DocumentObjectGroup", "Group")
    document.recompute()
    for drawing in (text, dimension):
        assert "text or a dimension" in refusal(of([Entry(can, "Face1"), Entry(drawing)]))
        assert "text or a dimension" in refusal(of([Entry(drawing)]))
        assert "text or a dimension" in refusal(of([Entry(can), Entry(sketch), Entry(drawing)]))
    assert "mesh" in refusal(of([Entry(scan), Entry(sketch)]))
    for many in ([can, other, sketch], [other, sketch, can]):
        found = refusal(of([Entry(item) for item in many]))
        assert "Several parts" in found and can.Label in found and other.Label in found, found
    assert "neither a part nor a drawing" in refusal(of([Entry(group), Entry(can)]))
    assert "neither a part nor a drawing" in refusal(of([Entry(plane), Entry(sketch)]))
    # It has no ends, and so no vertices.
    endless = document.addObject("Part::Feature", "Endless")
    endless.Shape = Part.Line(Vector(0, -20, 25), Vector(9, -20, 25)).toShape()
    assert endless.Shape.Edges and not endless.Shape.Vertexes
    for entries in ([Entry(endless)], [Entry(can, "Face1"), Entry(endless)]):
        assert "neither a part nor a drawing" in refusal(of(entries))
    # Beside a part and a drawing, these are ignored.
    usable = of([Entry(can), Entry(sketch), Entry(plane), Entry(group), Entry(can, "Face2")])
    usable.check()
    assert (usable.part.label, [ref.label for ref in usable.drawing]) == (can.Label, [sketch.Label])


def a_sketch_in_a_linked_body_is_on_the_link():
    document = FreeCAD.newDocument()
    can = Can(30.0, 100.0)
    body = document.addObject("PartDesign::Body", "Body")
    cylinder = document.addObject("PartDesign::AdditiveCylinder", "Cylinder")
    body.addObject(cylinder)
    cylinder.Radius, cylinder.Height = can.radius, can.height
    front = FreeCAD.Placement(Vector(0, -30, 50), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    sketch, drawn = sketch_on(document, body, front)
    link = document.addObject("App::Link", "Link")
    link.LinkedObject = body
    link.Placement = FreeCAD.Placement(Vector(40, -25, 12), any_rotation(4))
    document.recompute()
    chosen_there = of([Entry(link, sketch.Name + ".")])
    assert chosen_there.part.item == link, chosen_there.part.names()
    check(can, link.Placement, chosen_there, "link", drawn)
    with_face = of([Entry(link, "Cylinder.Face1", sketch.Name + ".")])
    assert (with_face.part.item, with_face.faces) == (link, [0])


def a_sketch_alone_gets_the_part_of_its_own_container():
    """Also where a link shows the container once more, and where another solid is elsewhere."""
    document = FreeCAD.newDocument()
    can = Can(30.0, 100.0)
    outer, inner = (document.addObject("App::Part", name) for name in ("Outer", "Inner"))
    outer.addObject(inner)
    item = feature(document, can, FreeCAD.Placement())
    inner.addObject(item)
    front = FreeCAD.Placement(Vector(0, -30, 50), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    sketch, drawn = sketch_on(document, inner, front)
    feature(document, Can(5.0, 5.0), FreeCAD.Placement(Vector(500, 0, 0), FreeCAD.Rotation()))
    inner.Placement = FreeCAD.Placement(Vector(20, 0, 0), FreeCAD.Rotation(Vector(1, 0, 0), 20))
    outer.Placement = FreeCAD.Placement(Vector(0, 100, 0), FreeCAD.Rotation(Vector(0, 0, 1), 30))
    link = document.addObject("App::Link", "Link")
    link.LinkedObject = outer
    link.Placement = FreeCAD.Placement(Vector(-40, 30, 10), any_rotation(6))
    document.recompute()
    for top in (outer, link):
        found = of([Entry(top, "Inner.%s." % sketch.Name)])
        assert found.part is not None and found.part.names() == "%s.Inner.%s." % (top.Name, item.Name)
        check(can, top.Placement * inner.Placement, found, "alone", drawn)


def corner_sketch(document, container, placement):
    """A sketch of two lines from its origin: 5 mm along its x, 7 mm along its y."""
    sketch = document.addObject("Sketcher::SketchObject", "Corner")
    if container is not None:
        container.addObject(sketch)
    for end in ((5, 0, 0), (0, 7, 0)):
        sketch.addGeometry(Part.LineSegment(Vector(0, 0, 0), Vector(*end)))
    sketch.Placement = placement
    document.recompute()
    return sketch


def assert_frame_of_corner(frame, shape, name):
    """Compares a frame with the first corner of a shape, which FreeCAD placed."""
    along_x, along_y = sorted(shape.Edges[:2], key=lambda edge: edge.Length)
    origin = next(
        one.Point for one in along_x.Vertexes for other in along_y.Vertexes if (one.Point - other.Point).Length < 1e-6
    )
    x, y = (max((v.Point - origin for v in edge.Vertexes), key=lambda away: away.Length) for edge in (along_x, along_y))
    z = x.cross(y)
    for found, expected in ((frame.x, x), (frame.z, z)):
        assert (Vector(*found) - expected.normalize()).Length < 1e-6, (name, found, expected)
    assert (Vector(*frame.origin) - origin).Length < 1e-6, (name, frame.origin, origin)


def a_scaled_link_does_not_turn_the_frame():
    document = FreeCAD.newDocument()
    body = document.addObject("PartDesign::Body", "Body")
    cylinder = document.addObject("PartDesign::AdditiveCylinder", "Cylinder")
    body.addObject(cylinder)
    cylinder.Radius, cylinder.Height = 30.0, 100.0
    front = FreeCAD.Placement(Vector(3, -30, 50), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    sketch = corner_sketch(document, body, front)
    for scale in (1.0, 1.02, 2.0):
        link = document.addObject("App::Link", "Link")
        link.LinkedObject, link.Scale = body, scale
        link.Placement = FreeCAD.Placement(Vector(40, -25, 12), any_rotation(21))
        document.recompute()
        found = of([Entry(link, "Cylinder.Face1", sketch.Name + ".")])
        shape = Part.getShape(link, sketch.Name + ".", needSubElement=False)
        assert abs(shape.Length - 12.0 * scale) < 1e-6
        assert_frame_of_corner(found.frame(), shape, scale)
        assert found.assumed is None
    # The mark is as long as the link shows the drawing.
    _, data, _, _ = corrected(found, "scaled")
    assert abs(Part.makePolygon([Vector(*point, 0) for point in polylines(data)[0][0]]).Length - 24.0) < 0.2


def what_shows_a_sketch_has_its_plane_and_its_x():
    document = FreeCAD.newDocument()
    plate = document.addObject("Part::Box", "Plate")
    plate.Length, plate.Width, plate.Height = 100, 60, 10
    turned = FreeCAD.Placement(Vector(40, 20, 3), FreeCAD.Rotation(Vector(0, 0, 1), 30))
    # Below the middle of the plate: the side of the laser follows from the sketch alone.
    sketch = corner_sketch(document, None, turned)
    elsewhere = FreeCAD.Placement(Vector(50, 30, 2), FreeCAD.Rotation(Vector(0, 0, 1), -70))
    container = document.addObject("App::Part", "Container")
    container.Placement = FreeCAD.Placement(Vector(1, 2, 3), any_rotation(2))
    showing = []
    for settings in ({}, {"LinkTransform": True}, {"Scale": 1.5}, {"Scale": 1.5, "LinkTransform": True}):
        link = document.addObject("App::Link", "Link")
        link.LinkedObject, link.Placement = sketch, elsewhere
        for name, value in settings.items():
            setattr(link, name, value)
        showing.append(link)
    binder = document.addObject("PartDesign::SubShapeBinder", "Binder")
    binder.Support = [(sketch, "")]
    inside = document.addObject("PartDesign::SubShapeBinder", "Binder")
    container.addObject(inside)
    inside.Support = [(sketch, "")]
    older = document.addObject("PartDesign::ShapeBinder", "Binder")
    older.Support = [(sketch, "")]
    compound = document.addObject("Part::Compound", "Compound")
    compound.Links, compound.Placement = [sketch], elsewhere
    array = Draft.make_ortho_array(sketch, Vector(20, 0, 0), Vector(0, 20, 0), Vector(), 2, 1, 1, use_link=False)
    document.recompute()
    linked_compound = document.addObject("App::Link", "Link")
    linked_compound.LinkedObject, linked_compound.Placement = compound, elsewhere
    showing += [binder, older, compound, array, linked_compound, Draft.make_clone(sketch)]
    document.recompute()
    for item, shape in [(item, Part.getShape(item, "", needSubElement=False)) for item in showing] + [(inside, None)]:
        choices = chosen(plate, [item])
        shape = shape or Part.getShape(container, inside.Name + ".", needSubElement=False)
        assert choice.is_drawing(choices.drawing[0]), item.Name
        assert_frame_of_corner(choices.frame(), shape, item.Name)
        assert choices.assumed is None, item.Name
    # What a sketch does not decide is stated.
    mirrored = document.addObject("Part::Mirroring", "Mirrored")
    mirrored.Source, mirrored.Normal = sketch, Vector(1, 0, 0)
    copy = document.addObject("Part::Feature", "Copy")
    copy.Shape = sketch.Shape
    two = document.addObject("Part::Compound", "Two")
    two.Links = [sketch, corner_sketch(document, None, elsewhere)]
    document.recompute()
    for item, words in ((mirrored, "no plane with an x"), (copy, "no plane with an x"), (two, "several sketches")):
        choices = chosen(plate, [item])
        choices.frame()
        what, remedy = choices.assumed
        assert words in what and item.Label in what and "sketch" in remedy, choices.assumed


def of_several_sketches_the_first_link_decides():
    document = FreeCAD.newDocument()
    plate = document.addObject("Part::Box", "Plate")
    plate.Length, plate.Width, plate.Height = 100, 60, 10
    turn = FreeCAD.Rotation(Vector(0, 0, 1), 30)
    sketches = [corner_sketch(document, None, FreeCAD.Placement(Vector(10 * n, 20, 12), turn)) for n in range(4)]
    for order in ((0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1), (1, 3, 0, 2)):
        links = [sketches[number] for number in order]
        flat, inner, outer = (document.addObject("Part::Compound", "Several") for _ in range(3))
        # The same in containers, one of which shows a sketch once more.
        flat.Links, inner.Links, outer.Links = links, links[:2], [inner, links[0]] + links[2:]
        document.recompute()
        for item in (flat, outer):
            choices = chosen(plate, [item])
            assert_frame_of_corner(choices.frame(), links[0].Shape, (item.Name, order))
            assert links[0].Label in choices.assumed[0], (order, choices.assumed)


def a_binder_of_some_edges_has_the_plane_of_its_sketch():
    document = FreeCAD.newDocument()
    plate = document.addObject("Part::Box", "Plate")
    plate.Length, plate.Width, plate.Height = 100, 60, 10
    sketch, _ = sketch_on(document, None, FreeCAD.Placement(Vector(50, 30, 12), FreeCAD.Rotation(Vector(0, 0, 1), 30)))
    corner = corner_sketch(document, None, FreeCAD.Placement(Vector(40, 20, 13), FreeCAD.Rotation(Vector(0, 0, 1), 70)))
    # Of closed lines, such as the circles 1 and 7, a binder makes faces, with copies of the edges.
    for source, edges in (
        (sketch, (1,)),
        (sketch, (2,)),
        (sketch, (7,)),
        (sketch, (9, 8)),
        (sketch, (3, 4, 5, 6)),
        (corner, (1,)),
        (corner, (2,)),
    ):
        binder = document.addObject("PartDesign::SubShapeBinder", "Binder")
        binder.Support = [(source, tuple("Edge%d" % number for number in edges))]
        document.recompute()
        choices = chosen(plate, [binder])
        assert choices.frame().is_same(chosen(plate, [source]).frame()), (source.Name, edges)
        assert choices.assumed is None, (source.Name, edges)


def a_link_array_whose_elements_change_is_followed():
    from freecad.Isomark import follow

    document = FreeCAD.newDocument()
    sketch = corner_sketch(document, None, FreeCAD.Placement())
    array = document.addObject("App::Link", "Array")
    array.LinkedObject, array.ShowElement, array.ElementCount = sketch, False, 2
    document.recompute()

    class Following:
        documents = {document.Name}
        count = 0

        def changed(self):
            self.count += 1

    panel = Following()
    observer = follow.Documents(panel)
    FreeCAD.addDocumentObserver(observer)
    try:
        for name, change in (
            ("Label", lambda: setattr(array, "Label", "Other")),
            ("PlacementList", lambda: setattr(array, "PlacementList", [FreeCAD.Placement(), sketch.Placement])),
            ("ScaleList", lambda: setattr(array, "ScaleList", [Vector(1, 1, 1), Vector(2, 2, 2)])),
            ("VisibilityList", lambda: array.setElementVisible("0", False)),
            ("ElementCount", lambda: setattr(array, "ElementCount", 3)),
            ("ShowElement", lambda: setattr(array, "ShowElement", True)),
        ):
            before = panel.count
            change()
            assert (panel.count > before) == (name != "Label"), name
    finally:
        FreeCAD.removeDocumentObserver(observer)


def a_straight_line_gets_its_plane_from_the_part():
    document = FreeCAD.newDocument()
    can = Can(30.0, 100.0)
    item = feature(document, can, FreeCAD.Placement(Vector(0, 0, -50), FreeCAD.Rotation()))
    for corners in ([(-4, -3), (8, 6)], [(0, -9), (0, 9)], [(-4, -3), (0, 0), (8, 6)], [(-8, 20), (8, 20)]):
        line = Draft.make_wire([Vector(x, -34, z) for x, z in corners])
        document.recompute()
        choices = chosen(item, [line])
        frame = choices.frame()
        along = (Vector(*frame.z).dot(line.Shape.Vertexes[-1].Point - line.Shape.Vertexes[0].Point)) / line.Shape.Length
        # The laser looks along the normal of the can under the middle of the line, across the line.
        middle = line.Shape.BoundBox.Center
        normal = Vector(middle.x, middle.y, 0).normalize()
        assert abs(along) < 1e-9 and normal.dot(Vector(*frame.z)) > 0.998, frame.z
        assert "no plane" in choices.assumed[0]
        _, _, report, mark = corrected(choices, "line")
        points = [point for strip in mark.strips["mark"] for point in strip.points]
        assert all(point[1] < -25.0 for point in points)
        assert abs(report["quality"]["after"]["length_mm"] - line.Shape.Length) < 0.01
    through = Draft.make_wire([Vector(0, 0, -60), Vector(0, 0, 60)])
    document.recompute()
    assert "no plane" in refusal(chosen(item, [through]))
    into = Draft.make_wire([Vector(0, -34, 10), Vector(0, -54, 10)])
    document.recompute()
    assert "points into the part" in refusal(chosen(item, [into]))
    # Lines together have the plane that they span, whatever their order.
    upright, level = (Draft.make_wire([Vector(x, -34, z), Vector(-x, -34, -z)]) for x, z in ((0, 10), (8, 0)))
    document.recompute()
    for lines in ([upright, level], [level, upright]):
        choices = chosen(item, lines)
        frame = choices.frame()
        assert max(abs(a - b) for a, b in zip(frame.z, (0, -1, 0))) < 1e-9, frame.z
        assert len(choices.paths(frame)) == 2


def a_straight_line_in_front_of_a_clicked_face_is_marked_on_it():
    document = FreeCAD.newDocument()
    plate = document.addObject("Part::Box", "Plate")
    plate.Length, plate.Width, plate.Height = 100, 60, 10
    bottle = document.addObject("Part::Feature", "Bottle")
    bottle.Shape = Part.makeCylinder(40, 20).fuse(Part.makeCylinder(30, 100))
    sloped = [Draft.make_wire([Vector(5, y, 2), Vector(15, y, 8)]) for y in (0, -10)]
    level = Draft.make_wire([Vector(-8, -34, 60), Vector(8, -34, 60)])
    edge_like = document.addObject("Part::Feature", "Line")
    edge_like.Shape = Part.makeLine(Vector(-8, -34, 60), Vector(8, -34, 60))
    document.recompute()
    front = next(n for n, face in enumerate(plate.Shape.Faces) if abs(face.CenterOfMass.y) < 1e-6)
    side = next(n for n, face in enumerate(plate.Shape.Faces) if abs(face.CenterOfMass.x) < 1e-6)
    neck = next(n for n, face in enumerate(bottle.Shape.Faces) if abs(getattr(face.Surface, "Radius", 0) - 30) < 1e-6)
    for item, face, line, clicked in (
        (plate, front, sloped[0], (90, 0, 5)),
        (plate, front, sloped[1], (90, 0, 5)),
        # A face that the line points into is not the one that is meant.
        (plate, side, sloped[1], (0, 30, 5)),
        (bottle, neck, level, (30, 0, 90)),
        (bottle, neck, edge_like, (30, 0, 90)),
    ):
        found = of([Entry(item, "Face%d" % (face + 1), points=[Vector(*clicked)]), Entry(line)])
        frame, _, _, mark = corrected(found, "clicked")
        assert max(abs(a - b) for a, b in zip(frame.z, (0, -1, 0))) < 1e-9, (line.Name, frame.z)
        points = [point for strip in mark.strips["mark"] for point in strip.points]
        box = line.Shape.BoundBox
        for axis, low, high in ((0, box.XMin, box.XMax), (2, box.ZMin, box.ZMax)):
            numbers = [point[axis] for point in points]
            assert abs(min(numbers) - low) < 0.2 and abs(max(numbers) - high) < 0.2, (line.Name, axis, numbers)


def a_face_that_was_not_clicked_has_its_mark_in_the_middle():
    document = FreeCAD.newDocument()
    plate = document.addObject("Part::Box", "Plate")
    plate.Length, plate.Width, plate.Height = 100, 60, 5
    ring = document.addObject("Part::Feature", "Ring")
    ring.Shape = Part.makeBox(100, 60, 5).cut(Part.makeCylinder(10, 5, Vector(50, 30, 0)))
    document.recompute()
    # What FreeCAD gives for a face that was selected in a box or by a script.
    found = of([Entry(plate, "Face6", points=[Vector(0, 0, 0)])])
    found.file = __file__
    assert (Vector(*found.frame().origin) - plate.Shape.Faces[5].CenterOfMass).Length < 1e-6
    clicked = of([Entry(plate, "Face6", points=[Vector(10, 20, 5)])])
    clicked.file = __file__
    assert (Vector(*clicked.frame().origin) - Vector(10, 20, 5)).Length < 1e-6
    top = next(n for n, face in enumerate(ring.Shape.Faces) if face.CenterOfMass.z > 5 - 1e-6)
    found = of([Entry(ring, "Face%d" % (top + 1), points=[Vector(0, 0, 0)])])
    found.file = __file__
    assert ring.Shape.Faces[top].distToShape(Part.Vertex(*found.frame().origin))[0] < 1e-6


def a_part_that_is_moved_into_a_container_is_followed():
    document = FreeCAD.newDocument()
    can = feature(document, Can(30.0, 100.0), FreeCAD.Placement())
    sketch = corner_sketch(document, None, FreeCAD.Placement(Vector(0, -30, 50), FreeCAD.Rotation(Vector(1, 0, 0), 90)))
    container, outer = (document.addObject("App::Part", name) for name in ("Container", "Outer"))
    container.Placement = FreeCAD.Placement(Vector(15, 0, 0), FreeCAD.Rotation())
    outer.Placement = FreeCAD.Placement(Vector(0, 7, 0), FreeCAD.Rotation(Vector(0, 0, 1), 90))
    document.recompute()
    side = next(n for n, face in enumerate(can.Shape.Faces) if isinstance(face.Surface, Part.Cylinder))
    found = of([Entry(can, "Face%d" % (side + 1), points=[Vector(0, -30, 50)]), Entry(sketch)])
    steps = (
        (lambda: container.addObject(can), container, can.Name + "."),
        (lambda: outer.addObject(container), outer, "%s.%s." % (container.Name, can.Name)),
        (lambda: container.removeObject(can), can, ""),
    )
    for change, top, path in steps:
        change()
        document.recompute()
        # As FreeCAD shows it.
        shape = Part.getShape(top, path, needSubElement=False)
        assert (found.part.shape().BoundBox.Center - shape.BoundBox.Center).Length < 1e-6
        assert found.part.names() == "%s.%s" % (top.Name, path)
        # The clicked point is where it was on the part.
        assert shape.Faces[side].distToShape(Part.Vertex(*found.picked))[0] < 1e-6
        assert abs(found.picked[2] - 50.0) < 1e-6
    # A part in a container that is removed with it.
    container.addObject(can)
    found = of([Entry(outer, "%s.%s.Face1" % (container.Name, can.Name)), Entry(sketch)])
    document.removeObject(can.Name)
    try:
        found.part.shape()
    except choice.Trouble as trouble:
        assert "was removed" in trouble.what and trouble.remedy
        return
    raise AssertionError("a part that was removed has a shape")


def what_is_selected_in_another_document_is_named():
    here, there = FreeCAD.newDocument(), FreeCAD.newDocument()
    can = feature(here, Can(30.0, 100.0), FreeCAD.Placement())
    front = FreeCAD.Placement(Vector(0, -30, 50), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    own, foreign = corner_sketch(here, None, front), corner_sketch(there, None, front)
    foreign.Label = "Foreign"
    for entries in ([Entry(can, "Face1"), Entry(foreign)], [Entry(foreign), Entry(can)]):
        found = choice.of_selection(entries, here.Name)
        what = refusal(found)
        assert "Foreign" in what and "another document" in what and there.Label in what, what
    # Beside a part and a drawing of this document, it is ignored.
    choice.of_selection([Entry(can, "Face1"), Entry(own), Entry(foreign)], here.Name).check()


def drawings_in_different_planes_are_named():
    document = FreeCAD.newDocument()
    item = feature(document, Can(30.0, 100.0), FreeCAD.Placement())
    upright = FreeCAD.Rotation(Vector(1, 0, 0), 90)
    one, other, parallel = (
        sketch_on(document, None, FreeCAD.Placement(Vector(0, -31, z), turn))[0]
        for z, turn in ((50, upright), (102, FreeCAD.Rotation()), (52, upright))
    )
    choices = chosen(item, [one, parallel])
    assert len(choices.paths(choices.frame())) == 12
    choices = chosen(item, [one, other])
    try:
        choices.paths(choices.frame())
    except choice.Trouble as trouble:
        assert other.Label in trouble.what and "another plane" in trouble.what and "parallel" in trouble.remedy, trouble
        return
    raise AssertionError("drawings in two planes were accepted")


def edges_with_the_same_hash_are_all_drawn():
    """FreeCAD's hashes of two shapes may be the same by chance."""
    from freecad.Isomark import outline

    class Alike:
        def __init__(self, shape):
            self.shape = shape

        def hashCode(self):
            return 7

        def isSame(self, other):
            return self.shape.isSame(other.shape)

    one, other = (Alike(Part.makeLine(Vector(0, 0, 0), Vector(1, y, 0))) for y in (0, 1))
    there = outline._Shapes()
    there.add(one)
    assert one in there and other not in there
    there.add(other)
    assert other in there


def lines_that_are_not_flat_are_refused():
    document = FreeCAD.newDocument()
    item = feature(document, Can(20.0, 50.0), FreeCAD.Placement())
    bent = document.addObject("Part::Feature", "Bent")
    bent.Shape = Part.makePolygon([Vector(-5, -25, 20), Vector(5, -25, 20), Vector(5, -27, 30), Vector(0, -21, 31)])
    try:
        corrected(chosen(item, [bent]), "bent")
    except job.Trouble as trouble:
        assert "not flat" in trouble.what and trouble.remedy
        return
    raise AssertionError("a bent drawing was accepted")


harness.run(
    [
        the_part_is_written_as_glb_with_outward_normals,
        the_files_are_valid_for_others,
        drawings_with_other_letters_keep_their_own_layers,
        files_are_placed_at_the_clicked_point,
        ink_beyond_the_selected_faces_is_refused,
        a_drawing_seen_from_its_back_is_marked_at_its_place,
        the_mark_is_kept_as_plain_objects,
        a_drawing_beside_the_part_is_refused_with_a_remedy,
        lines_that_are_not_flat_are_refused,
        what_cannot_be_used_is_named,
        a_sketch_in_a_linked_body_is_on_the_link,
        a_sketch_alone_gets_the_part_of_its_own_container,
        a_scaled_link_does_not_turn_the_frame,
        what_shows_a_sketch_has_its_plane_and_its_x,
        of_several_sketches_the_first_link_decides,
        a_binder_of_some_edges_has_the_plane_of_its_sketch,
        a_link_array_whose_elements_change_is_followed,
        a_straight_line_gets_its_plane_from_the_part,
        a_straight_line_in_front_of_a_clicked_face_is_marked_on_it,
        a_face_that_was_not_clicked_has_its_mark_in_the_middle,
        a_part_that_is_moved_into_a_container_is_followed,
        what_is_selected_in_another_document_is_named,
        edges_with_the_same_hash_are_all_drawn,
        drawings_in_different_planes_are_named,
        a_sketch_in_front_of_an_upright_can,
        a_sketch_in_a_body_that_is_turned_and_moved,
        a_sketch_and_a_body_in_a_container,
        a_sketch_on_a_cone,
        text_on_a_mouse,
        draft_objects_on_a_mouse,
    ]
)
