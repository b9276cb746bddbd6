# SPDX-License-Identifier: GPL-3.0-or-later
"""isomark in Blender: shows a mark on a curved part with true lengths, and sends it to the laser's hot folder."""

from . import operators, panel, settings

# For Blender 3.4 to 4.1; newer versions read blender_manifest.toml.
bl_info = {
    "name": "isomark",
    "author": "The isomark project",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "3D View > Sidebar > isomark",
    "description": "See marks with true lengths on curved parts, and send them to the laser",
    "category": "Import-Export",
}


def register():
    settings.register()
    operators.register()
    panel.register()


def unregister():
    panel.unregister()
    operators.unregister()
    settings.unregister()
