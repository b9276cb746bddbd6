"""Measures drawings with ezdxf: length, area and extents of the visible entities, by layer and colour.

Usage: `original.py FONTS DRAWING.dxf...`. Curves become chords within 1e-5 units; letters use the font in the folder
FONTS, so that the same outlines are compared. Prints a JSON object for each drawing, null for one that ezdxf rejects.
"""

import json
import math
import sys

import ezdxf
from ezdxf import path
from ezdxf.addons import MTextExplode, text2path
from ezdxf.fonts import fonts
from ezdxf.render import hatching

CHORD = 1e-5
CURVES = ("LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE", "SOLID", "TRACE", "HELIX")


class Drawing:
    def __init__(self, file):
        self.doc = ezdxf.readfile(file)
        self.measured = {}
        self.scratch = self.doc.blocks.new_anonymous_block()
        for entity, layer, color in self.parts(self.doc.modelspace(), None, 7):
            self.draw(entity, f"{layer} {color}")

    def layer_of(self, name):
        return self.doc.layers.get(name) if name in self.doc.layers else None

    def color_of(self, entity, layer, by_block):
        """`#rrggbb` or the index; entities by layer have the colour of the layer."""
        if entity.dxf.hasattr("true_color"):
            return f"#{entity.dxf.true_color:06x}"
        if entity.dxf.color == 0:
            return by_block
        if entity.dxf.color != 256:
            return entity.dxf.color
        entry = self.layer_of(layer)
        if entry is None:
            return 7
        return f"#{entry.dxf.true_color:06x}" if entry.dxf.hasattr("true_color") else entry.color

    def parts(self, entities, outer, by_block):
        """Everything that is drawn, with its layer and colour; blocks are expanded."""
        for entity in entities:
            kind = entity.dxftype()
            layer = outer if outer is not None and entity.dxf.layer == "0" else entity.dxf.layer
            entry = self.layer_of(layer)
            # Layer names are not case-sensitive.
            layer = entry.dxf.name if entry else layer
            color = self.color_of(entity, layer, by_block)
            if entity.dxf.invisible or (entry and entry.is_frozen()):
                continue
            if kind == "INSERT":
                for insert in entity.multi_insert() if entity.mcount > 1 else [entity]:
                    yield from self.parts(insert.virtual_entities(), layer, color)
                    yield from self.parts((a for a in insert.attribs if not a.is_invisible), layer, color)
                continue
            if kind == "DIMENSION":
                yield from self.parts(entity.virtual_entities(), layer, color)
                continue
            if entry and (entry.is_off() or not entry.dxf.plot or entry.dxf.name.upper() == "DEFPOINTS"):
                continue
            if kind == "ATTRIB" and entity.has_embedded_mtext_entity:
                entity, kind = entity.virtual_mtext_entity(), "MTEXT"
                entity.doc = self.doc
            if kind == "MTEXT":
                before = len(self.scratch)
                with MTextExplode(self.scratch) as explode:
                    explode.explode(entity, destroy=False)
                for text in list(self.scratch)[before:]:
                    yield text, layer, self.color_of(text, layer, color)
                continue
            yield entity, layer, color

    def draw(self, entity, key):
        kind = entity.dxftype()
        if kind in ("TEXT", "ATTRIB"):
            for outline in text2path.make_paths_from_entity(entity):
                for contour in outline.sub_paths():
                    self.add_path(key, contour, True)
        elif kind in ("HATCH", "MPOLYGON") and not entity.dxf.solid_fill:
            for start, end in hatching.hatch_entity(entity, jiggle_origin=False):
                self.add(key, [(start.x, start.y), (end.x, end.y)], False)
        elif kind in ("HATCH", "MPOLYGON"):
            for outline in path.from_hatch(entity):
                for contour in outline.sub_paths():
                    self.add_path(key, contour, True)
        elif kind == "POINT":
            self.add(key, [(entity.dxf.location.x, entity.dxf.location.y)], False)
        elif kind in CURVES:
            self.add_path(key, path.make_path(entity))

    def add_path(self, key, outline, closed=False):
        points = [(v.x, v.y) for v in outline.flattening(CHORD, 16)]
        if len(points) > 1:
            self.add(key, points, closed or math.dist(points[0], points[-1]) < 1e-9)

    def add(self, key, points, closed):
        if closed:
            points = points + points[:1]
        entry = self.measured.setdefault(key, {"length": 0.0, "area": 0.0, "box": [math.inf, math.inf, -math.inf, -math.inf]})
        pairs = list(zip(points, points[1:]))
        entry["length"] += sum(math.dist(a, b) for a, b in pairs)
        if closed:
            entry["area"] += abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in pairs) / 2)
        for x, y in points:
            box = entry["box"]
            entry["box"] = [min(box[0], x), min(box[1], y), max(box[2], x), max(box[3], y)]


if __name__ == "__main__":
    fonts.font_manager.clear()
    fonts.font_manager.build([sys.argv[1]])
    for file in sys.argv[2:]:
        try:
            print(json.dumps(Drawing(file).measured))
        except ezdxf.DXFError:
            print("null")
