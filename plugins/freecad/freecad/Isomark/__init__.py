# SPDX-License-Identifier: MIT OR Apache-2.0
"""isomark in FreeCAD: shows a drawing on a curved part with true lengths, and sends both to a marking station."""

__version__ = "0.1.0"
