# SPDX-License-Identifier: MIT OR Apache-2.0
"""Notices what changes while the panel is open: documents, and the file of the drawing."""

import FreeCADGui
from PySide import QtCore

from . import mark
from .child import Background
from .station import stamp

#: The properties that change what is seen of an object without a recompute.
_SEEN = ("Shape", "Placement", "LinkPlacement", "LinkedObject", "LinkTransform", "Scale", "ScaleVector", "Group")
#: The same of the elements of a link array.
_SEEN += ("PlacementList", "ScaleList", "ElementCount", "VisibilityList", "ShowElement")


class Documents:
    """An observer of FreeCAD's documents: corrects again after a change, and closes the panel with its document."""

    def __init__(self, panel):
        self.panel = panel
        self.quiet = False

    def _changed(self, document):
        if not self.quiet and document.Name in self.panel.documents:
            self.panel.changed()

    def slotRecomputedDocument(self, document):
        self._changed(document)

    def slotUndoDocument(self, document):
        self._changed(document)

    def slotRedoDocument(self, document):
        self._changed(document)

    def slotChangedObject(self, item, name):
        if name in _SEEN and not mark.is_mark(item):
            self._changed(item.Document)

    def slotDeletedObject(self, item):
        if not mark.is_mark(item):
            self._changed(item.Document)

    def slotFinishSaveDocument(self, document, _file):
        if document.Name == self.panel.document:
            self.panel.document_saved()

    def slotDeletedDocument(self, document):
        if document.Name == self.panel.document:
            self.panel.close()
            # FreeCAD is still removing the document.
            QtCore.QTimer.singleShot(0, FreeCADGui.Control.closeDialog)
        else:
            self._changed(document)


class File:
    """Calls `changed` when the file of the drawing is another one than the one that was read."""

    def __init__(self, changed):
        self._changed = changed
        self._path = ""
        self._seen = None
        self._work = None

    def close(self):
        self._path = ""
        if self._work is not None:
            self._work.forget()

    def begin(self, path, seen=None):
        """Follows a file whose `stamp` was `seen` before it was read; an empty path follows none."""
        self._path, self._seen = path, seen

    def look(self):
        """Looks at the file, soon."""
        # A share may answer slowly: never in the window's thread, and never two at a time.
        if self._path and self._work is None:
            path, seen = self._path, self._seen
            self._work = Background(lambda: stamp(path), lambda found, _error: self._found(path, seen, found))

    def _found(self, path, seen, found):
        self._work = None
        # Of a file that was read again since, this may be older than what was read.
        if (path, seen) == (self._path, self._seen) and found != seen:
            self._seen = found
            self._changed()
