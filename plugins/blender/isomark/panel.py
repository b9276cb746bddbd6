# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel in the sidebar of the 3D view."""

import json

import bpy

from . import mark, session, station, wrap

_ICONS = {"FONT": "OUTLINER_OB_FONT", "CURVE": "OUTLINER_OB_CURVE"}
_ANSWERS = {station.SENDING: "SORTTIME", station.SENT: "CHECKMARK", station.WAITING: "SORTTIME",
            station.DELIVERED: "CHECKMARK", station.REJECTED: "CANCEL", station.FAILED: "ERROR",
            station.ASKING: "QUESTION", station.LEFT: "ERROR"}


class IsomarkPanel(bpy.types.Panel):
    bl_idname = "VIEW3D_PT_isomark"
    bl_label = "isomark"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "isomark"

    def draw(self, context):
        settings = context.scene.isomark
        self._inputs(settings)
        self._mark(context, settings)
        self._send(context, settings)

    def _inputs(self, settings):
        layout = self.layout
        layout.operator("isomark.use_selected", icon="RESTRICT_SELECT_OFF")
        column = layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.prop(settings, "part")
        row = column.row(align=True)
        row.prop(settings, "frame", icon="EMPTY_ARROWS")
        row.operator("isomark.add_frame", text="", icon="ADD")
        box = column.box()
        if not settings.drawings:
            box.label(text="No drawing yet", icon="CURVE_DATA")
        for index, entry in enumerate(settings.drawings):
            row = box.row()
            if entry.item is None:
                row.label(text="(removed)", icon="ERROR")
            else:
                row.label(text=entry.item.name, icon=_ICONS.get(entry.item.type, "GREASEPENCIL"))
            row.operator("isomark.remove_drawing", text="", icon="X", emboss=False).index = index
        if settings.drawings and settings.frame:
            box.operator("isomark.lay_on_frame", icon="ORIENTATION_LOCAL")
        column.prop(settings, "sku")
        column.prop(settings, "name")

    def _mark(self, context, settings):
        layout = self.layout.box()
        row = layout.row(align=True)
        if session.run is None:
            row.operator("isomark.show", icon="HIDE_OFF")
        else:
            row.operator("isomark.cancel", text="Cancel (ESC)", icon="CANCEL")
        row.prop(context.window_manager, "isomark_live", toggle=True, text="", icon="FILE_REFRESH")
        if settings.outcome:
            self._outcome(layout, context, json.loads(settings.outcome))
        if mark.find(context.scene, "mark") is None:
            return
        column = layout.column(align=True)
        for name in ("coloured", "show_ink", "show_uncorrected", "show_view"):
            column.prop(settings, name)
        row = layout.row(align=True)
        row.prop(settings, "width_mm")
        row.operator("isomark.clear", text="", icon="TRASH")

    def _outcome(self, layout, context, outcome):
        if "what" in outcome:
            wrap.label(layout, context, outcome["what"], "ERROR")
            wrap.label(layout, context, outcome["remedy"], "BLANK1")
            return
        column = layout.column(align=True)
        stretch = (_percent(outcome["stretch_before"]), _percent(outcome["stretch_after"]))
        for text in (f"{outcome['length_mm']:.1f} mm of lines",
                     f"Error: {_change(outcome['before_mm'], outcome['after_mm'], '{:.3f}', 'mm')}",
                     f"Stretch: {_change(*stretch, '{:+.2f}', '%')}",
                     f"Incidence: at most {outcome['incidence_deg']:.1f}°"):
            column.label(text=text)
        for warning in outcome["warnings"]:
            wrap.label(layout, context, warning[:1].upper() + warning[1:], "ERROR")

    def _send(self, context, settings):
        layout = self.layout.box()
        sku, name = session.names(settings)
        if sku and name:
            layout.label(text=f"{sku}@{name}.dxf", icon="FILE")
        row = layout.row(align=True)
        row.operator("isomark.send", icon="EXPORT")
        row.operator("preferences.addon_show", text="", icon="PREFERENCES").module = __package__
        if session.send_trouble:
            wrap.label(layout, context, session.send_trouble.what, "ERROR")
            wrap.label(layout, context, session.send_trouble.remedy, "BLANK1")
        elif session.courier:
            answer = session.courier.answer
            wrap.label(layout, context, answer.what, _ANSWERS[answer.kind])
            if answer.report:
                error = answer.report["quality"]["after"]["length_error_mm"]
                wrap.label(layout, context, f"Length error on the part: {error:.3f} mm.", "BLANK1")
            if answer.remedy:
                wrap.label(layout, context, answer.remedy, "ERROR" if answer.kind == station.DELIVERED else "BLANK1")


def _percent(share):
    return None if share is None else share * 100


def _change(before, after, form, unit):
    text = f"{form.format(after)} {unit}"
    return text if before is None else f"{form.format(before)} → {text}"


def register():
    bpy.utils.register_class(IsomarkPanel)


def unregister():
    bpy.utils.unregister_class(IsomarkPanel)
