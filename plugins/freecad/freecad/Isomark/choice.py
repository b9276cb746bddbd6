# SPDX-License-Identifier: MIT OR Apache-2.0
"""What the user chose: the part, its faces, the drawing, and the marking frame that follows from them."""

import os

import FreeCAD
import Part

from . import outline
from .frame import Frame, dot, scaled, subtract
from .wording import Trouble, translate

PICTURES = (".png", ".bmp")


class Ref:
    """An object where it is in the document: inside its containers and links, if it has any."""

    def __init__(self, top, path=""):
        self.document = top.Document.Name
        self.top = top.Name
        #: The names of the objects from `top` to the object, each followed by a dot.
        self.path = path

    @classmethod
    def of(cls, item):
        """An object inside its outermost container."""
        parents = item.Parents
        if parents:
            top, path = parents[0]
            return cls(top, path)
        return cls(item)

    def _top(self):
        document = FreeCAD.listDocuments().get(self.document)
        top = document.getObject(self.top) if document else None
        if top is None:
            raise _removed()
        return top

    @property
    def item(self):
        """The object itself."""
        top = self._top()
        found = top.getSubObject(self.path, retType=1) if self.path else top
        if found is None:
            raise _removed()
        return found

    @property
    def label(self):
        return self.item.Label

    def shape(self):
        """Its shape in the coordinates of the document."""
        return Part.getShape(self._top(), self.path, needSubElement=False)

    def placement(self):
        """Its placement in the document."""
        top = self._top()
        return top.getSubObject(self.path, retType=3) if self.path else top.Placement

    def inside(self, item):
        """An object in this container."""
        return Ref(self._top(), self.path + item.Name + ".")

    def names(self):
        """The names of the objects on the way, as text that a document can keep."""
        return self.top + "." + self.path

    def __eq__(self, other):
        return isinstance(other, Ref) and (self.document, self.top, self.path) == (
            other.document,
            other.top,
            other.path,
        )


def _removed():
    return Trouble(
        translate("Isomark", "An object that was chosen was removed."),
        translate("Isomark", "Select the part and the drawing, and click Use selection."),
    )


class Choice:
    """The part with its chosen faces, and the drawing: objects or a file."""

    def __init__(self):
        self.part = None
        #: Indices of the chosen faces, from 0.
        self.faces = []
        #: Where a face was clicked, in the document.
        self.picked = None
        #: The objects of the drawing.
        self.drawing = []
        #: The file of the drawing; empty if it is made of objects.
        self.file = ""
        #: Labels of further parts that are selected.
        self.more_parts = []
        #: What is selected and is neither a part nor a drawing.
        self.unusable = []

    def check(self):
        """Raises `Trouble` when something is missing, or when it is not clear what is meant."""
        is_incomplete = self.part is None or not (self.drawing or self.file)
        for ref in self.unusable:
            trouble = _not_usable(ref, is_incomplete)
            if trouble:
                raise trouble
        if self.more_parts:
            raise Trouble(
                translate(
                    "Isomark",
                    "Several parts are selected: {names}.",
                    names=", ".join([self.part.label] + self.more_parts),
                ),
                translate("Isomark", "Select only the part that is marked, and with Ctrl the drawing."),
            )
        if self.part is None and not self.drawing and not self.file:
            raise Trouble(
                translate("Isomark", "Nothing is selected."),
                translate(
                    "Isomark",
                    "Select a face of the part and, with Ctrl, a sketch, a Draft object or a ShapeString. Then click "
                    "Use selection.",
                ),
            )
        if self.part is None:
            raise Trouble(
                translate("Isomark", "No part is selected."),
                translate("Isomark", "Click a face of the part, with Ctrl also the drawing. Then click Use selection."),
            )
        if not self.drawing and not self.file:
            raise Trouble(
                translate("Isomark", "No drawing is selected."),
                translate(
                    "Isomark",
                    "Select a sketch, a Draft object or a ShapeString and click Use selection, or choose a DXF file or "
                    "a picture with File.",
                ),
            )
        if self.file and not os.path.isfile(self.file):
            raise Trouble(
                translate("Isomark", "The drawing {file} does not exist.", file=self.file),
                translate("Isomark", "Choose the drawing again with File."),
            )

    def is_picture(self):
        return self.file.lower().endswith(PICTURES)

    def frame(self, other_side=False):
        """The marking frame. Raises `Trouble`."""
        self.check()
        frame = self._frame_at_face() if self.file else self._frame_of_drawing()
        return frame.other_side() if other_side else frame

    def suggests_other_side(self):
        """Whether the clicked place looks away from the laser of the drawing's own frame."""
        if self.file or not self.faces or self.picked is None:
            return False
        frame = self._frame_of_drawing()
        _, normal = self._spot(self.picked)
        return dot(normal, frame.z) < -0.1

    def _frame_of_drawing(self):
        # A single point has no plane, and a straight line has many.
        shapes = [(ref, ref.shape()) for ref in self.drawing]
        lined = [(ref, shape) for ref, shape in shapes if outline.has_lines(shape) and shape.Edges]
        if not lined:
            raise _no_lines(self.drawing[0])
        straight = None
        for ref, shape in lined:
            if ref.item.isDerivedFrom("Part::Part2DObject"):
                frame = frame_of_placement(ref.placement())
                depths = [frame.local(tuple(vertex.Point))[2] for vertex in shape.Vertexes]
                if not depths or max(depths) - min(depths) <= outline.FLAT:
                    return frame
            along = outline.direction_of(shape)
            if along is None:
                _, axis = outline.plane_of(shape)
                return self._frame_away(shape, tuple(axis))
            straight = straight or (shape, along)
        shape, along = straight
        away = subtract(tuple(shape.BoundBox.Center), self._middle())
        across = subtract(away, scaled(along, dot(away, along)))
        if dot(across, across) < 1e-6:
            raise Trouble(
                translate("Isomark", "The drawing is a straight line through the middle of the part: it has no plane."),
                translate("Isomark", "Draw the line in a sketch."),
            )
        return self._frame_away(shape, across)

    def _frame_away(self, shape, normal):
        """The frame in the middle of the shape whose z is the normal or its opposite, away from the part."""
        center = tuple(shape.BoundBox.Center)
        away = subtract(center, self._middle())
        return Frame.on_surface(center, normal if dot(away, normal) >= 0.0 else scaled(normal, -1.0))

    def _middle(self):
        return tuple(self.part.shape().BoundBox.Center)

    def _frame_at_face(self):
        point, normal = self._spot(self.picked)
        return Frame.on_surface(point, normal)

    def _spot(self, picked):
        """A point of the chosen face and the normal there; the middle of the face without a point."""
        shape = self.part.shape()
        if not self.faces or self.faces[0] >= len(shape.Faces):
            raise Trouble(
                translate("Isomark", "No face is selected for the drawing's place."),
                translate("Isomark", "Click the place on the part, and click Use selection."),
            )
        face = shape.Faces[self.faces[0]]
        u0, u1, v0, v1 = face.ParameterRange
        u, v = (u0 + u1) / 2.0, (v0 + v1) / 2.0
        if picked is not None:
            u, v = face.Surface.parameter(FreeCAD.Vector(*picked))
        return tuple(face.valueAt(u, v)), tuple(face.normalAt(u, v))

    def paths(self, frame):
        """The lines of the drawing's objects in the frame. Raises `Trouble`."""
        found = []
        for ref in self.drawing:
            shape = ref.shape()
            if not outline.has_lines(shape):
                raise _no_lines(ref)
            found += outline.paths_of(shape, ref.label, frame)
        if not found:
            raise _no_lines(self.drawing[0])
        return found


def frame_of_placement(placement):
    """The frame of a sketch or another flat object: its own origin and axes."""
    turn = placement.Rotation
    z, x = turn.multVec(FreeCAD.Vector(0, 0, 1)), turn.multVec(FreeCAD.Vector(1, 0, 0))
    return Frame(tuple(placement.Base), tuple(z), tuple(x))


def _no_lines(ref):
    return Trouble(
        translate("Isomark", "The drawing {name} has no lines.", name=ref.label),
        translate(
            "Isomark",
            "Choose a sketch, a Draft object or a ShapeString with lines that are not construction lines.",
        ),
    )


def of_selection(selection):
    """What is selected: entries with `Object`, `SubElementNames` and `PickedPoints`, from the outermost container on."""
    choice = Choice()
    for entry in selection:
        names = list(entry.SubElementNames) or [""]
        points = list(getattr(entry, "PickedPoints", []))
        for number, name in enumerate(names):
            path, _, element = name.rpartition(".")
            ref = Ref(entry.Object, path + "." if path else "")
            _add(choice, ref, element, points[number] if number < len(points) else None)
    if choice.part is None and choice.drawing:
        choice.part = _only_part(choice.drawing[0])
    return choice


def _add(choice, ref, element, point):
    item = ref.item
    if is_drawing(ref):
        if ref not in choice.drawing:
            choice.drawing.append(ref)
        return
    part = _owner(ref)
    if not _has_faces(part):
        choice.unusable.append(part)
        return
    if choice.part not in (None, part):
        if part.label not in choice.more_parts:
            choice.more_parts.append(part.label)
        return
    choice.part = part
    is_shown = item == part.item or getattr(_linked(part.item), "Tip", None) == item
    if element.startswith("Face") and is_shown:
        number = int(element[4:]) - 1
        if number not in choice.faces:
            choice.faces.append(number)
        if choice.picked is None and point is not None:
            choice.picked = tuple(point)


def _owner(ref):
    """The body of a feature, or the object itself."""
    above = next(_above(ref), None)
    return above if above is not None and _is_body(above.item) else ref


def _linked(item):
    """The object that a link shows, or the object itself."""
    return item.getLinkedObject() or item


def _is_body(item):
    return _linked(item).isDerivedFrom("PartDesign::Body")


#: The properties of texts and dimensions of Draft, and of annotations.
_OF_TEXTS = ("Text", "CustomText", "LabelText", "Dimline")


def _not_usable(ref, is_incomplete):
    """Why a selected object is neither a part nor a drawing; `None` if nothing was probably meant by it."""
    item = _linked(ref.item)
    if item.isDerivedFrom("Mesh::Feature"):
        return Trouble(
            translate("Isomark", "{name} is a mesh, which has no faces that can be marked.", name=ref.label),
            translate(
                "Isomark",
                "Make a shape of it with Part > Create shape from mesh, or drop its file into the station's hot folder.",
            ),
        )
    if any(hasattr(item, name) for name in _OF_TEXTS):
        return Trouble(
            translate("Isomark", "{name} is a text or a dimension, which has no outlines.", name=ref.label),
            translate("Isomark", "Draw it as a ShapeString of Draft, and select that."),
        )
    if not is_incomplete:
        return None
    return Trouble(
        translate("Isomark", "{name} is neither a part nor a drawing.", name=ref.label),
        translate("Isomark", "Select a face of the part and, with Ctrl, a sketch, a Draft object or a ShapeString."),
    )


def _has_faces(ref):
    shape = ref.shape()
    if ref.item.isDerivedFrom("Part::Datum"):
        return False
    return isinstance(shape, Part.Shape) and not shape.isNull() and bool(shape.Faces)


def is_drawing(ref):
    """Whether the object is a drawing rather than a part: flat and without a volume."""
    item = ref.item
    if item.isDerivedFrom("Part::Part2DObject"):
        return True
    shape = ref.shape()
    if not isinstance(shape, Part.Shape) or shape.isNull() or shape.Solids or item.isDerivedFrom("Part::Datum"):
        return False
    if not shape.Edges:
        return bool(shape.Vertexes)
    if any(not isinstance(face.Surface, Part.Plane) for face in shape.Faces):
        return False
    return not shape.Shells and shape.findPlane(outline.FLAT) is not None


def _only_part(drawing):
    """The part of a drawing that was selected alone: its body, else the only solid of its container or of the document."""
    for body in (ref for ref in _bodies_above(drawing) if _has_faces(ref)):
        return body
    # In the drawing's own containers first: other instances of them may show the same part elsewhere.
    for container in _above(drawing):
        inside = getattr(_linked(container.item), "Group", [])
        solids = [ref for ref in (container.inside(item) for item in inside) if _is_solid(ref)]
        if solids:
            return solids[0] if len(solids) == 1 else None
    item = drawing.item
    solids = [ref for ref in (Ref.of(other) for other in item.Document.Objects if other != item) if _is_solid(ref)]
    return solids[0] if len(solids) == 1 else None


def _is_solid(ref):
    """Whether the object is shown and is a solid of its own, rather than a feature of a body."""
    item = ref.item
    if not item.isDerivedFrom("Part::Feature") or item.isDerivedFrom("PartDesign::Feature") or not _is_shown(item):
        return False
    shape = ref.shape()
    return isinstance(shape, Part.Shape) and not shape.isNull() and bool(shape.Solids)


def _above(ref):
    """The containers of an object, from the innermost on."""
    names = ref.path.rstrip(".").split(".") if ref.path else []
    for count in range(len(names) - 1, -1, -1):
        yield Ref(ref._top(), "".join(name + "." for name in names[:count]))


def _bodies_above(ref):
    return (above for above in _above(ref) if _is_body(above.item))


def _is_shown(item):
    view = getattr(item, "ViewObject", None)
    return view is None or view.Visibility


def is_under(points, frame, box):
    """Whether any of the part's points, or what they span, is under the drawing's box (left, bottom, right, top)."""
    left = bottom = float("inf")
    right = top = float("-inf")
    for point in points:
        x, y, _ = frame.local(point)
        left, right = min(left, x), max(right, x)
        bottom, top = min(bottom, y), max(top, y)
    return left <= box[2] and box[0] <= right and bottom <= box[3] and box[1] <= top
