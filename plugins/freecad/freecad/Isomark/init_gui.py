# SPDX-License-Identifier: MIT OR Apache-2.0
"""Registers the workbench with FreeCAD's window."""

import os

import FreeCADGui

from .wording import translate

FOLDER = os.path.dirname(__file__)
ICONS = os.path.join(FOLDER, "resources", "icons")

FreeCADGui.addLanguagePath(os.path.join(FOLDER, "resources", "translations"))
FreeCADGui.updateLocale()


class IsomarkWorkbench(FreeCADGui.Workbench):
    """Drawings on curved parts with true lengths."""

    MenuText = translate("Isomark", "isomark")
    ToolTip = translate(
        "Isomark", "Shows a drawing on a curved part with true lengths, and sends it to a laser station"
    )
    Icon = os.path.join(ICONS, "Isomark.svg")

    def Initialize(self):
        from . import commands

        commands.register()
        self.appendToolbar(translate("Isomark", "isomark"), commands.NAMES)
        self.appendMenu(translate("Isomark", "isomark"), commands.NAMES)

    def GetClassName(self):
        return "Gui::PythonWorkbench"


FreeCADGui.addWorkbench(IsomarkWorkbench())
