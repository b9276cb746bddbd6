# SPDX-License-Identifier: MIT OR Apache-2.0
"""What the user chose: the part, its faces, the drawing, and the marking frame that follows from them."""

import FreeCAD
import Part

from . import outline, plane
from .frame import Frame, dot
from .ref import Ref
from .wording import Trouble, translate

PICTURES = (".png", ".bmp")


class Choice:
    """The part with its chosen faces, and the drawing: objects or a file."""

    def __init__(self):
        self.part = None
        #: Indices of the chosen faces, from 0.
        self.faces = []
        #: Where a face was clicked, in the part's own coordinates.
        self._clicked = None
        #: The objects of the drawing.
        self.drawing = []
        #: The file of the drawing; empty if it is made of objects.
        self.file = ""
        #: Labels of further parts that are selected.
        self.more_parts = []
        #: What is selected and is neither a part nor a drawing.
        self.unusable = []
        #: What is selected in other documents: labels of objects and of their documents.
        self.elsewhere = []
        #: What the last frame is based on if the drawing does not state it: a sentence and a remedy, or `None`.
        self.assumed = None

    @property
    def picked(self):
        """Where a face was clicked, in the document; it moves with the part. `None` if a face was not clicked."""
        if self._clicked is None:
            return None
        return tuple(self.part.matrix().multVec(self._clicked))

    @picked.setter
    def picked(self, point):
        self._clicked = None if point is None else self.part.matrix().inverse().multVec(FreeCAD.Vector(*point))

    def take_part(self, other):
        """Takes the part, its faces and the clicked place from another choice."""
        self.part, self.faces, self._clicked = other.part, other.faces, other._clicked

    def is_incomplete(self):
        """Whether the part or the drawing is missing."""
        return self.part is None or not (self.drawing or self.file)

    def documents(self):
        """The names of the documents that the part and the drawing come from."""
        return set().union(*(ref.documents() for ref in [self.part] + self.drawing))

    def check(self):
        """Raises `Trouble` when something is missing, or when it is not clear what is meant."""
        is_incomplete = self.is_incomplete()
        for ref in self.unusable:
            trouble = _not_usable(ref, is_incomplete)
            if trouble:
                raise trouble
        if is_incomplete and self.elsewhere:
            raise in_other_document(*self.elsewhere[0])
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

    def is_picture(self):
        return self.file.lower().endswith(PICTURES)

    def frame(self, other_side=False):
        """The marking frame. Raises `Trouble`."""
        self.check()
        self.assumed = None
        frame = self._frame_at_face() if self.file else self._frame_of_drawing()
        return frame.other_side() if other_side else frame

    def suggests_other_side(self):
        """Whether the clicked place looks away from the laser of the drawing's own frame."""
        if self.file or not self.faces or self.picked is None:
            return False
        frame = self._frame_of_drawing()
        _, normal = self._spot()
        return dot(normal, frame.z) < -0.1

    def _frame_of_drawing(self):
        # A single point has no plane, and a straight line has many.
        shapes = [(ref, ref.shape()) for ref in self.drawing]
        lined = [(ref, shape) for ref, shape in shapes if outline.has_lines(shape) and shape.Edges]
        if not lined:
            raise _no_lines(self.drawing[0])
        for ref, shape in lined:
            found = plane.own_frames(ref, shape)
            if found:
                frame, source = found[0]
                if any(not frame.is_same(other) for other, _ in found):
                    self.assumed = _first_of_several(ref, source)
                return frame
            if outline.direction_of(shape) is None:
                self.assumed = _no_x(ref)
                _, axis = outline.plane_of(shape)
                return plane.frame_away(self.part.shape(), shape, tuple(axis))
        self.assumed = _no_x(lined[0][0])
        face = self._face() if self.faces else None
        return plane.frame_of_lines(self.part.shape(), face, [shape for _, shape in lined])

    def _frame_at_face(self):
        return Frame.on_surface(*self._spot())

    def _face(self):
        """The first of the chosen faces."""
        faces = self.part.shape().Faces
        if not self.faces or self.faces[0] >= len(faces):
            raise Trouble(
                translate("Isomark", "No face is selected for the drawing's place."),
                translate("Isomark", "Click the place on the part, and click Use selection."),
            )
        return faces[self.faces[0]]

    def _spot(self):
        """The clicked point of the chosen face and the normal there; the middle of the face without a point."""
        face, picked = self._face(), self.picked
        u, v = plane.middle_of(face) if picked is None else face.Surface.parameter(FreeCAD.Vector(*picked))
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


def _no_x(ref):
    """What is assumed for a drawing without a plane of its own."""
    return (
        translate(
            "Isomark",
            "The drawing {name} has no plane with an x of its own. It is marked from its side of the part, with its x "
            "horizontal.",
            name=ref.label,
        ),
        translate("Isomark", "Draw it in a sketch to choose the side of the laser and the x of the marking field."),
    )


def _first_of_several(ref, source):
    """What is assumed for a drawing that is made of several sketches."""
    return (
        translate(
            "Isomark",
            "The drawing {name} shows several sketches. Origin and x of the marking field are those of {first}.",
            name=ref.label,
            first=source.Label,
        ),
        translate("Isomark", "Select the sketches themselves, first the one whose origin and x are used."),
    )


def in_other_document(name, document):
    """The trouble with an object that is selected in another document."""
    return Trouble(
        translate("Isomark", "{name} is in another document, {document}.", name=name, document=document),
        translate(
            "Isomark",
            "Make a link to it in this document (Std_LinkMake) and select the link, or close this panel and run Mark on "
            "part in that document.",
        ),
    )


def _no_lines(ref):
    return Trouble(
        translate("Isomark", "The drawing {name} has no lines.", name=ref.label),
        translate(
            "Isomark",
            "Choose a sketch, a Draft object or a ShapeString with lines that are not construction lines.",
        ),
    )


#: What FreeCAD gives as the clicked point of an element that was selected without a click.
_NOT_CLICKED = (0.0, 0.0, 0.0)


def of_selection(selection, document):
    """What is selected in a document: entries with `Object`, `SubElementNames` and `PickedPoints`, from the outermost
    container on.
    """
    choice = Choice()
    for entry in selection:
        if entry.Object.Document.Name != document:
            choice.elsewhere.append((entry.Object.Label, entry.Object.Document.Label))
            continue
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
    is_shown = item == part.item or getattr(part.linked, "Tip", None) == item
    if element.startswith("Face") and is_shown:
        number = int(element[4:]) - 1
        if number not in choice.faces:
            choice.faces.append(number)
        if choice.picked is None and point is not None and tuple(point) != _NOT_CLICKED:
            choice.picked = tuple(point)


def _owner(ref):
    """The body of a feature, or the object itself."""
    above = next(ref.above(), None)
    return above if above is not None and _is_body(above) else ref


def _is_body(ref):
    return ref.linked.isDerivedFrom("PartDesign::Body")


#: The properties of texts and dimensions of Draft, and of annotations.
_OF_TEXTS = ("Text", "CustomText", "LabelText", "Dimline")


def _not_usable(ref, is_incomplete):
    """Why a selected object is neither a part nor a drawing; `None` if nothing was probably meant by it."""
    item = ref.linked
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
    if _is_datum(ref.item):
        return False
    return isinstance(shape, Part.Shape) and not shape.isNull() and bool(shape.Faces)


def _is_datum(item):
    # The axes and planes of an origin have shapes in FreeCAD 1.
    return any(item.isDerivedFrom(kind) for kind in ("Part::Datum", "App::OriginFeature", "App::DatumElement"))


def is_drawing(ref):
    """Whether the object is a drawing rather than a part: flat and without a volume."""
    item = ref.item
    if item.isDerivedFrom("Part::Part2DObject"):
        return True
    shape = ref.shape()
    if not isinstance(shape, Part.Shape) or shape.isNull() or shape.Solids or _is_datum(item):
        return False
    if not shape.Edges:
        return bool(shape.Vertexes)
    if any(not isinstance(face.Surface, Part.Plane) for face in shape.Faces):
        return False
    if shape.Shells:
        return False
    return shape.findPlane(outline.FLAT) is not None or outline.direction_of(shape) is not None


def _only_part(drawing):
    """The part of a drawing that was selected alone: its body, else the only solid of its container or of the document."""
    for body in (ref for ref in _bodies_above(drawing) if _has_faces(ref)):
        return body
    # In the drawing's own containers first: other instances of them may show the same part elsewhere.
    for container in drawing.above():
        inside = getattr(container.linked, "Group", [])
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


def _bodies_above(ref):
    return (above for above in ref.above() if _is_body(above))


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
