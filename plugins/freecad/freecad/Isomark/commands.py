# SPDX-License-Identifier: MIT OR Apache-2.0
"""The commands of the workbench."""

import os

import FreeCAD
import FreeCADGui

from .wording import translate

NAMES = ["Isomark_Mark"]


class _Mark:
    """Opens the task panel for the selected part and drawing."""

    def GetResources(self):
        icons = os.path.join(os.path.dirname(__file__), "resources", "icons")
        return {
            "Pixmap": os.path.join(icons, "Isomark.svg"),
            "MenuText": translate("Isomark", "Mark on part"),
            "ToolTip": translate(
                "Isomark",
                "Select a face of a part and, with Ctrl, a sketch, Draft object or ShapeString. Shows the drawing on the "
                "part with true lengths, and sends it to a laser station.",
            ),
        }

    def IsActive(self):
        return FreeCAD.ActiveDocument is not None and FreeCADGui.Control.activeDialog() in (False, None)

    def Activated(self):
        from .panel import open_panel

        open_panel()


def register():
    FreeCADGui.addCommand("Isomark_Mark", _Mark())
