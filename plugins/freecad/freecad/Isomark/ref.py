# SPDX-License-Identifier: MIT OR Apache-2.0
"""An object where it is in the document: inside its containers and links."""

import FreeCAD
import Part

from .wording import Trouble, translate


class Ref:
    """An object inside its containers and links, if it has any.

    An object that no link shows is followed when it is moved into a container, or out of it.
    """

    def __init__(self, top, path=""):
        self.document = top.Document.Name
        self.top = top.Name
        #: The names of the objects from `top` to the object, each followed by a dot.
        self.path = path
        item = _within(top, path)
        #: The name of the object; empty if a link shows it.
        self._own = item.Name if item is not None and _place_of(item) == (top, path) else ""

    @classmethod
    def of(cls, item):
        """An object inside its outermost container."""
        parents = item.Parents
        if parents:
            top, path = parents[0]
            return cls(top, path)
        return cls(item)

    def outermost(self):
        """The outermost container or link, or the object itself. Raises `Trouble` if it was removed."""
        document = FreeCAD.listDocuments().get(self.document)
        known = document.getObject(self._own or self.top) if document else None
        if known is None:
            raise _removed()
        top, path = _place_of(known)
        self.top, self.path = top.Name, path if self._own else path + self.path
        return top

    @property
    def item(self):
        """The object itself."""
        top = self.outermost()
        found = _within(top, self.path)
        if found is None:
            raise _removed()
        return found

    @property
    def linked(self):
        """The object that a link shows, or the object itself."""
        item = self.item
        return item.getLinkedObject() or item

    @property
    def label(self):
        return self.item.Label

    def shape(self):
        """Its shape in the coordinates of the document."""
        top = self.outermost()
        return Part.getShape(top, self.path, needSubElement=False)

    def matrix(self):
        """From the coordinates of `linked` to those of the document, with the scales of all links."""
        item = self.item
        # FreeCAD's own matrix has no scale of the last link, and its placement has a wrong rotation below a scaled one.
        above = self.outermost().getSubObject(self.path, retType=4).multiply(item.Placement.toMatrix().inverse())
        return item.getLinkedObject(True, above, True)[1]

    def inside(self, item):
        """An object in this container."""
        top = self.outermost()
        return Ref(top, self.path + item.Name + ".")

    def above(self):
        """The containers of the object, from the innermost on."""
        top = self.outermost()
        names = self.path.rstrip(".").split(".") if self.path else []
        for count in range(len(names) - 1, -1, -1):
            yield Ref(top, "".join(name + "." for name in names[:count]))

    def documents(self):
        """The names of the documents that contain the object and what it is made of."""
        top = self.outermost()
        return {item.Document.Name for item in [top] + top.OutListRecursive}

    def names(self):
        """The names of the objects on the way, as text that a document can keep."""
        return self.top + "." + self.path

    def __eq__(self, other):
        return isinstance(other, Ref) and (self.document, self.top, self.path) == (
            other.document,
            other.top,
            other.path,
        )


def _within(top, path):
    """The object at the path; `None` if there is none."""
    return top.getSubObject(path, retType=1) if path else top


def _place_of(item):
    """The outermost container of an object, and the path from it to the object."""
    path = ""
    container = item.getParentGeoFeatureGroup()
    while container is not None:
        path = item.Name + "." + path
        item, container = container, container.getParentGeoFeatureGroup()
    return item, path


def _removed():
    return Trouble(
        translate("Isomark", "An object that was chosen was removed, or its document was closed."),
        translate("Isomark", "Select the part and the drawing, and click Use selection."),
    )
