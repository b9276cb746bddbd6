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

FONT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "fonts", "DejaVuSans-subset.ttf")
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

    def __init__(self, item, *names):
        self.Object, self.SubElementNames, self.PickedPoints = item, names, []


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
    of = choice.of_selection
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
    chosen_there = choice.of_selection([Entry(link, sketch.Name + ".")])
    assert chosen_there.part.item == link, chosen_there.part.names()
    check(can, link.Placement, chosen_there, "link", drawn)
    with_face = choice.of_selection([Entry(link, "Cylinder.Face1", sketch.Name + ".")])
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
        found = choice.of_selection([Entry(top, "Inner.%s." % sketch.Name)])
        assert found.part is not None and found.part.names() == "%s.Inner.%s." % (top.Name, item.Name)
        check(can, top.Placement * inner.Placement, found, "alone", drawn)


def a_straight_line_gets_its_plane_from_the_part():
    document = FreeCAD.newDocument()
    can = Can(30.0, 100.0)
    item = feature(document, can, FreeCAD.Placement(Vector(0, 0, -50), FreeCAD.Rotation()))
    for corners in ([(-4, -3), (8, 6)], [(0, -9), (0, 9)], [(-4, -3), (0, 0), (8, 6)]):
        line = Draft.make_wire([Vector(x, -34, z) for x, z in corners])
        document.recompute()
        choices = chosen(item, [line])
        frame = choices.frame()
        assert max(abs(a - b) for a, b in zip(frame.z, (0, -1, 0))) < 1e-9, frame.z
        _, _, report, mark = corrected(choices, "line")
        points = [point for strip in mark.strips["mark"] for point in strip.points]
        assert all(point[1] < -25.0 for point in points)
        assert abs(report["quality"]["after"]["length_mm"] - line.Shape.Length) < 0.01
    through = Draft.make_wire([Vector(0, 0, -60), Vector(0, 0, 60)])
    document.recompute()
    assert "no plane" in refusal(chosen(item, [through]))


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
        a_straight_line_gets_its_plane_from_the_part,
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
