# SPDX-License-Identifier: MIT OR Apache-2.0
"""What the user chose once: the program and the station."""

import FreeCAD

_GROUP = "User parameter:BaseApp/Preferences/Mod/Isomark"


def program():
    return FreeCAD.ParamGet(_GROUP).GetString("Program", "")


def set_program(path):
    FreeCAD.ParamGet(_GROUP).SetString("Program", path)


def station():
    return FreeCAD.ParamGet(_GROUP).GetString("Station", "")


def set_station(path):
    FreeCAD.ParamGet(_GROUP).SetString("Station", path)
