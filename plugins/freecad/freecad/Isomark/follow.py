# SPDX-License-Identifier: MIT OR Apache-2.0
"""Notices what changes while the panel is open: documents, and the file of the drawing."""

import FreeCADGui
from PySide import QtCore

from . import mark
from .child import Background
from .station import stamp

#: The properties that change what is seen of an object without a recompute.
_SEEN = ("Shape", "Placement", "LinkPlacement", "LinkedObject", "LinkTransform", "Scale", "ScaleVector", "Group")


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
    """Calls `changed` when the file of the drawing is another one than before."""

    def __init__(self, changed):
        self._changed = changed
        self._path = ""
        self._seen = None
        self._work = None

    def close(self):
        if self._work is not None:
            self._work.forget()
            self._work = None

    def begin(self, path):
        """Follows a file, from what it is now; an empty path follows none."""
        self.close()
        self._path = path
        self._seen = stamp(path) if path else None

    def look(self):
        """Looks at the file, soon."""
        # A share may answer slowly: never in the window's thread, and never two at a time.
        if self._path and self._work is None:
            path = self._path
            self._work = Background(lambda: stamp(path), self._found)

    def _found(self, found, _error):
        self._work = None
        if found != self._seen:
            self._seen = found
            self._changed()
