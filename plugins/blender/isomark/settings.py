# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of the add-on and of each scene."""

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, PointerProperty, StringProperty

from . import drawing, live, mark, part, session, wrap


def _is_part(_, item):
    return item.type in part.TYPES and not mark.is_ours(item)


def _is_drawing(_, item):
    return item.type in drawing.TYPES and not mark.is_ours(item)


def _is_frame(_, item):
    return drawing.is_frame(item)


def _show_again(_, context):
    session.show_again(context)


def _is_live(_):
    return live.is_on(bpy.context.scene)


def _switch_live(_, on):
    live.switch(bpy.context.scene, on)


class IsomarkDrawing(bpy.types.PropertyGroup):
    item: PointerProperty(name="Drawing", type=bpy.types.Object, poll=_is_drawing)


class IsomarkScene(bpy.types.PropertyGroup):
    part: PointerProperty(name="Part", type=bpy.types.Object, poll=_is_part,
                          description="The object that the laser marks")
    drawings: CollectionProperty(name="Drawing", type=IsomarkDrawing)
    frame: PointerProperty(name="Frame", type=bpy.types.Object, poll=_is_frame,
                           description="An empty on the part: its Z points to the laser, its X is the direction of the "
                                       "text. Without one, the laser looks down")
    sku: StringProperty(name="SKU", description="Name of the product; empty: the name of the part")
    name: StringProperty(name="Name", description="Name of the drawing; empty: the name of its first object")
    coloured: BoolProperty(name="Colour by Stretch", default=True, update=_show_again,
                           description="Orange lines are too long on the part, blue lines too short")
    show_ink: BoolProperty(name="Ink", default=False, update=_show_again, description="Fills the marked areas")
    show_uncorrected: BoolProperty(name="Uncorrected", default=False, update=_show_again,
                                   description="Shows where the drawing would be without the correction")
    show_view: BoolProperty(name="Laser's View", default=False, update=_show_again,
                            description="Outlines what the laser can reach")
    width_mm: FloatProperty(name="Line Width", default=0.6, min=0.0, soft_max=2.0, max=20.0, precision=2,
                            update=_show_again, description="Width of the shown lines, mm. The laser has its own")
    outcome: StringProperty(options={"HIDDEN"})


class IsomarkPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    program: StringProperty(name="Program", subtype="FILE_PATH",
                            description="Path of isomark; empty: the variable ISOMARK, PATH and the usual folders")
    station: StringProperty(name="Station", subtype="FILE_PATH",
                            description="The station's settings file, station.toml: its field, its limits, its folders")
    hot_folder: StringProperty(name="Hot Folder", subtype="DIR_PATH",
                               description="Where parts and drawings are sent; empty: that of the station's settings")

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        row = layout.row()
        row.prop(self, "program")
        row.operator("isomark.test", text="Test")
        if session.version_trouble:
            trouble = session.version_trouble
            wrap.label(layout, context, f"{trouble.what} {trouble.remedy}", "ERROR")
        elif session.version:
            wrap.label(layout, context, session.version, "CHECKMARK")
        layout.prop(self, "station")
        layout.prop(self, "hot_folder")


CLASSES = (IsomarkDrawing, IsomarkScene, IsomarkPreferences)


def register():
    for one in CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Scene.isomark = PointerProperty(type=IsomarkScene)
    bpy.types.WindowManager.isomark_live = BoolProperty(
        name="Live", get=_is_live, set=_switch_live,
        description="Corrects again whenever the part, the drawing or the frame of this scene changes")


def unregister():
    del bpy.types.WindowManager.isomark_live
    del bpy.types.Scene.isomark
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)
