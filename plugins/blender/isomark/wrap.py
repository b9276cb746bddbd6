# SPDX-License-Identifier: GPL-3.0-or-later
"""Long sentences in narrow panels: Blender's labels do not wrap."""

import textwrap

_LETTER_PX = 6.9
_MARGIN_PX = 62


def label(layout, context, text, icon="NONE"):
    """A label of several lines; the icon is in front of the first."""
    scale = context.preferences.system.ui_scale
    letters = int((context.region.width / scale - _MARGIN_PX) / _LETTER_PX)
    column = layout.column(align=True)
    column.scale_y = 0.8
    for line in textwrap.wrap(text, max(20, letters)) or [""]:
        column.label(text=line, icon=icon)
        icon = "NONE" if icon == "NONE" else "BLANK1"
