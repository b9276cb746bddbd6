"""Writes one drawing for each kind of entity with ezdxf into a folder: `samples.py FOLDER`."""

import math
import sys
from pathlib import Path

import ezdxf
from ezdxf.enums import TextEntityAlignment as Align
from ezdxf.math import Vec2

FOLDER = Path(sys.argv[1])


def drawing(name, version="R2010"):
    doc = ezdxf.new(version, units=4)
    doc.styles.add("SANS", font="DejaVuSans-subset.ttf")
    return doc, doc.modelspace(), FOLDER / f"{name}.dxf"


doc, msp, file = drawing("text")
for index, align in enumerate(
    [Align.LEFT, Align.CENTER, Align.RIGHT, Align.MIDDLE, Align.BOTTOM_LEFT, Align.MIDDLE_CENTER, Align.TOP_RIGHT]
):
    attributes = {"style": "SANS", "layer": align.name, "width": 1 - 0.05 * index, "oblique": 3 * index}
    text = msp.add_text(f"Hegy {index}", height=3, rotation=10 * index, dxfattribs=attributes)
    text.set_placement((20 * index, 0), align=align)
for align, points in [(Align.FIT, [(0, 20), (30, 25)]), (Align.ALIGNED, [(0, 30), (30, 25)])]:
    msp.add_text("Stretched", height=3, dxfattribs={"style": "SANS", "layer": align.name}).set_placement(*points, align)
for index, layer in [(2, "BACKWARD"), (4, "UPSIDE_DOWN")]:
    attributes = {"style": "SANS", "layer": layer, "text_generation_flag": index}
    msp.add_text("Mirror", height=3, dxfattribs=attributes).set_placement((0, 40 + 5 * index))
attributes = {"style": "SANS", "layer": "CODES", "extrusion": (0, 0, -1)}
msp.add_text("Größe %%c12 %%p0,1 90%%d", height=3, dxfattribs=attributes).set_placement((0, 90))
block = doc.blocks.new("PLATE")
block.add_lwpolyline([(0, 0), (40, 0), (40, 10), (0, 10)], close=True)
block.add_attdef("LOT", (2, 2), height=3, dxfattribs={"style": "SANS"})
insert = msp.add_blockref("PLATE", (0, 110), dxfattribs={"layer": "PLATE"})
insert.add_attrib("LOT", "LOT 4711", (2, 112), dxfattribs={"style": "SANS", "height": 3, "layer": "ATTRIB"})
hidden = insert.add_attrib("NOTE", "not shown", (2, 112), dxfattribs={"style": "SANS", "height": 3, "layer": "ATTRIB"})
hidden.is_invisible = True
doc.saveas(file)

doc, msp, file = drawing("mtext")
for layer, text, attributes in [
    ("LINES", "First line\\PSecond one", {"insert": (50, 40), "attachment_point": 1}),
    ("WRAPPED", "The quick brown fox jumps over the lazy dog", {"attachment_point": 5, "width": 30, "rotation": 20}),
    ("RIGHT", "right {\\C1;red} end\\Pbottom", {"attachment_point": 9, "line_spacing_factor": 1.5, "insert": (90, 0)}),
    ("CENTER", "one\\Ptwenty two\\P\\Pfour", {"attachment_point": 2, "insert": (90, 60), "text_direction": (0, 1, 0)}),
    ("WIDE", "{\\W1.5;wide} {\\Q15;slanted} {\\H1;small} %%c", {"attachment_point": 7, "insert": (0, 60)}),
]:
    msp.add_mtext(text, dxfattribs={"style": "SANS", "layer": layer, "char_height": 2, **attributes})
doc.saveas(file)

doc, msp, file = drawing("hatch-patterns")
for index, (pattern, scale, angle) in enumerate([("ANSI31", 0.5, 0), ("ANSI37", 0.5, 20), ("DASH", 0.5, 0), ("BRICK", 0.2, 0)]):
    hatch = msp.add_hatch(dxfattribs={"layer": pattern})
    hatch.set_pattern_fill(pattern, scale=scale, angle=angle)
    # Shifted so that no line runs through a corner of the boundary, where readers may differ.
    for line in hatch.pattern.lines:
        line.base_point += Vec2(0.13, 0.27)
    x = 30 * index
    hatch.paths.add_polyline_path([(x, 0), (x + 20, 0, 0.5), (x + 20, 15), (x, 15)], is_closed=True)
    edges = hatch.paths.add_edge_path(flags=16)
    edges.add_ellipse((x + 8, 7), major_axis=(4, 1), ratio=0.5)
doc.saveas(file)

doc, msp, file = drawing("curves")
msp.add_line((0, 0), (10, 5), dxfattribs={"layer": "LINE"})
msp.add_arc((20, 0), 5, 30, 200, dxfattribs={"layer": "ARC"})
msp.add_arc((20, 20), 5, 300, 45, dxfattribs={"layer": "ARC_MIRRORED", "extrusion": (0, 0, -1)})
msp.add_circle((40, 0), 5, dxfattribs={"layer": "CIRCLE"})
msp.add_ellipse((60, 0), (8, 2), 0.4, 0.5, 4, dxfattribs={"layer": "ELLIPSE"})
msp.add_ellipse((60, 20), (8, 2), 0.4, dxfattribs={"layer": "ELLIPSE_FULL"})
msp.add_point((5, 5), dxfattribs={"layer": "POINT"})
msp.add_solid([(70, 0), (80, 0), (70, 10), (80, 8)], dxfattribs={"layer": "SOLID"})
msp.add_trace([(90, 0), (95, 0), (90, 10), (95, 8)], dxfattribs={"layer": "TRACE"})
bulges = [(0, 30, 0.5), (10, 30, -1), (20, 30, 0), (20, 40, 2)]
msp.add_lwpolyline(bulges, format="xyb", close=True, dxfattribs={"layer": "LWPOLYLINE"})
msp.add_lwpolyline(bulges, format="xyb", dxfattribs={"layer": "LWPOLYLINE_MIRRORED", "extrusion": (0, 0, -1)})
msp.add_polyline2d([(x, y - 80, b) for x, y, b in bulges], format="xyb", dxfattribs={"layer": "POLYLINE"})
msp.add_polyline3d([(0, 60, 0), (10, 65, 0), (20, 55, 0)], dxfattribs={"layer": "POLYLINE_3D"})
control = [(0, 70), (5, 80), (10, 65), (15, 85), (20, 70), (28, 78)]
msp.add_open_spline(control, degree=3, dxfattribs={"layer": "SPLINE"})
msp.add_open_spline([(x + 40, y) for x, y in control], degree=5, dxfattribs={"layer": "SPLINE_5"})
msp.add_rational_spline([(x, y + 30) for x, y in control], weights=[1, 2, 0.5, 1, 3, 1], dxfattribs={"layer": "SPLINE_RATIONAL"})
msp.add_rational_spline([(x + 40, y + 30) for x, y in control[:4]], weights=[1, 2, 0.5, 1], degree=2, dxfattribs={"layer": "SPLINE_2"})
doc.saveas(file)

doc, msp, file = drawing("curves-r12", "R12")
msp.add_line((0, 0), (10, 5), dxfattribs={"layer": "LINE"})
msp.add_polyline2d(bulges, format="xyb", close=True, dxfattribs={"layer": "POLYLINE"})
msp.add_polyline3d([(0, 60, 0), (10, 65, 0), (20, 55, 0)], close=True, dxfattribs={"layer": "POLYLINE_3D"})
msp.add_arc((20, 0), 5, 30, 200, dxfattribs={"layer": "ARC"})
msp.add_text("R12", height=3, dxfattribs={"style": "SANS", "layer": "TEXT"}).set_placement((40, 0))
doc.saveas(file)

doc, msp, file = drawing("blocks", "R2018")
star = doc.blocks.new("STAR", base_point=(1, 1))
star.add_lwpolyline([(r * math.cos(i * math.pi / 5), r * math.sin(i * math.pi / 5)) for i in range(10) for r in [4 - 2 * (i % 2)]], close=True)
star.add_circle((0, 0), 1)
nested = doc.blocks.new("PAIR")
nested.add_blockref("STAR", (0, 0))
nested.add_blockref("STAR", (10, 0), dxfattribs={"xscale": -1, "yscale": 1.5, "rotation": 30})
msp.add_blockref("STAR", (0, 0), dxfattribs={"layer": "PLAIN"})
msp.add_blockref("PAIR", (20, 0), dxfattribs={"layer": "NESTED", "rotation": 40})
msp.add_blockref("STAR", (0, 30), dxfattribs={"layer": "ARRAY", "column_count": 4, "row_count": 2, "column_spacing": 12, "row_spacing": 11})
msp.add_blockref("STAR", (90, 0), dxfattribs={"layer": "MIRRORED", "extrusion": (0, 0, -1), "rotation": 25})
doc.saveas(file)

for version in ["R2013", "R2018"]:
    doc, msp, file = drawing(f"attributes-{version}".lower(), version)
    doc.blocks.new("EMPTY")
    for index, (align, points) in enumerate(
        [
            (Align.LEFT, [(0, 0)]),
            (Align.CENTER, [(50, 0)]),
            (Align.TOP_RIGHT, [(100, 0)]),
            (Align.FIT, [(0, 20), (30, 25)]),
            (Align.ALIGNED, [(0, 30), (30, 25)]),
        ]
    ):
        insert = msp.add_blockref("EMPTY", (0, 0))
        attributes = {"style": "SANS", "height": 3, "layer": align.name}
        insert.add_attrib("LOT", "Stretched", dxfattribs=attributes).set_placement(*points, align=align)
    insert = msp.add_blockref("EMPTY", (0, 0))
    attributes = {"style": "SANS", "height": 3, "layer": "BACKWARD", "text_generation_flag": 2}
    insert.add_attrib("LOT", "Lot 4711", (50, 50), dxfattribs=attributes)
    grid = {"column_count": 3, "row_count": 2, "column_spacing": 30, "row_spacing": 12, "rotation": 25}
    insert = msp.add_blockref("EMPTY", (0, 60), dxfattribs=grid)
    insert.add_attrib("LOT", "Lot 47", (0, 60), dxfattribs={"style": "SANS", "height": 3, "layer": "GRID"})
    if version == "R2018":
        insert = msp.add_blockref("EMPTY", (0, 0))
        lines = insert.add_attrib("LOT", "", dxfattribs={"layer": "LINES"})
        attributes = {"style": "SANS", "char_height": 3, "insert": (-50, 40), "rotation": 20, "layer": "LINES"}
        lines.embed_mtext(msp.add_mtext("First line\\PSecond one\\PThird", dxfattribs=attributes))
    doc.saveas(file)

doc, msp, file = drawing("hatch-edges")


def hatch(layer, **attributes):
    return msp.add_hatch(dxfattribs={"layer": layer, **attributes})


for layer, extrusion in [("EDGES", (0, 0, 1)), ("EDGES_MIRRORED", (0, 0, -1))]:
    path = hatch(layer, extrusion=extrusion).paths.add_edge_path()
    path.add_line((0, 0), (10, 0))
    path.add_arc((10, 5), 5, 270, 90, ccw=True)
    path.add_line((10, 10), (0, 10))
    path.add_ellipse((0, 5), (0, 5), 0.4, 0, 180, ccw=True)
path = hatch("CLOCKWISE").paths.add_edge_path()
path.add_line((0, 20), (10, 20))
path.add_arc((10, 25), 5, 270, 90, ccw=True)
path.add_line((10, 30), (0, 30))
path.add_arc((0, 25), 5, 90, 270, ccw=False)
island = hatch("ELLIPSES")
island.paths.add_edge_path().add_ellipse((0, 50), (6, 2), 0.5, 0, 360)
island.paths.add_edge_path().add_ellipse((0, 50), (3, 1), 0.5, 0, 360, ccw=False)
for index, ccw in enumerate([True, False]):
    path = hatch(f"ELLIPTIC_{ccw}".upper()).paths.add_edge_path()
    path.add_ellipse((30 + 20 * index, 50), (6, 2), 0.5, 30, 200, ccw=ccw)
    path.add_line(path.edges[0].end_point, path.edges[0].start_point)
path = hatch("RATIONAL").paths.add_edge_path()
control = [(0, 80), (5, 90), (10, 70), (15, 80)]
path.add_spline(control_points=control, degree=3, knot_values=[0] * 4 + [1] * 4, weights=[1, 2, 0.5, 1])
path.add_line((15, 80), (0, 80))
polygon = msp.add_mpolygon(dxfattribs={"layer": "MPOLYGON"}, fill_color=2)
polygon.paths.add_polyline_path([(0, 120), (10, 120, 0.5), (10, 130), (0, 130)], is_closed=True)
polygon.paths.add_polyline_path([(3, 123), (6, 123), (6, 126)], is_closed=True)
doc.saveas(file)

for name, version, form in [("blocks", "R2010", "asc"), ("blocks-r12", "R12", "asc"), ("blocks-binary", "R2000", "bin")]:
    doc, msp, file = drawing(name, version)
    for layer, color in [("NEST", 3), ("OWN", 5)]:
        doc.layers.add(layer, color=color)
    doc.layers.add("ICE", color=1).freeze()
    block = doc.blocks.new("CURVES", base_point=(2, 1))
    block.add_arc((0, 0), 5, 300, 45)
    block.add_circle((9, 3), 2)
    outline = [(0, 0, 0.5), (3, 0, -1), (5, 5, 0)]
    if version == "R12":
        block.add_polyline2d(outline, format="xyb", close=True)
    else:
        block.add_lwpolyline(outline, format="xyb", close=True)
        block.add_ellipse((0, 20), (8, 2), 0.4, 0.5, 4)
        block.add_ellipse((1, 31), (3, 0), 0.5, 1, 2, dxfattribs={"extrusion": (0, 0, -1)})
    for index, (layer, attributes) in enumerate(
        [
            ("MIRRORED", {"xscale": -1, "rotation": 30}),
            ("STRETCHED", {"xscale": 2, "yscale": -0.5, "rotation": 77}),
            ("FROM_BELOW", {"xscale": 1.5, "yscale": 0.7, "rotation": 20, "extrusion": (0, 0, -1)}),
            (
                "ROWS",
                {"xscale": -1.2, "yscale": 0.8, "rotation": 15}
                | {"column_count": 3, "row_count": 2, "column_spacing": 20, "row_spacing": -15},
            ),
        ]
    ):
        msp.add_blockref("CURVES", (20 * index, 40 * index), dxfattribs={"layer": layer, **attributes})
    colors = doc.blocks.new("COLORS", base_point=(1, 1))
    for index, attributes in enumerate([{"color": 0}, {"color": 256}, {"layer": "OWN", "color": 0}, {"layer": "OWN"}, {"color": 4}]):
        colors.add_line((0, index), (5 + index, index), dxfattribs=attributes)
    nested = doc.blocks.new("NESTED")
    nested.add_blockref("COLORS", (0, 0), dxfattribs={"color": 0})
    nested.add_blockref("COLORS", (0, 10), dxfattribs={"layer": "OWN"})
    for index, attributes in enumerate([{}, {"color": 2}, {"layer": "NEST"}, {"layer": "NEST", "color": 6}]):
        msp.add_blockref("NESTED", (100 + 15 * index, 0), dxfattribs=attributes)
        plate = msp.add_blockref("COLORS", (100 + 15 * index, 50), dxfattribs=attributes)
        plate.add_attrib("LOT", "47", (100 + 15 * index, 60), dxfattribs={"style": "SANS", "height": 3, "color": 0})
    msp.add_blockref("COLORS", (0, -50), dxfattribs={"layer": "ICE"}).add_attrib("LOT", "frozen", (0, -40))
    doc.layouts.new("Sheet") if version != "R12" else None
    if version != "R12":
        doc.layouts.get("Sheet").add_line((0, 0), (99, 99))
        doc.layouts.get("Layout1").add_line((0, 0), (99, 99))
    doc.saveas(file, fmt=form)

doc, msp, file = drawing("dimensions")
for layer, dimension in [
    ("LINEAR", msp.add_linear_dim(base=(0, 150), p1=(0, 140), p2=(30, 140), dxfattribs={"layer": "LINEAR"})),
    ("RADIUS", msp.add_radius_dim(center=(60, 140), radius=10, angle=45, dxfattribs={"layer": "RADIUS"})),
]:
    dimension.render()
    for text in dimension.dimension.get_geometry_block().query("TEXT MTEXT"):
        text.dxf.style = "SANS"
doc.saveas(file)
