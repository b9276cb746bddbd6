# SPDX-License-Identifier: MIT OR Apache-2.0
"""Writes drawings as DXF R2000 in mm: polylines with arcs, and points."""

import math


class Path:
    """A polyline: corners (x, y, bulge), where the bulge is that of the arc to the next corner (0: straight).

    A path of one corner is a point.
    """

    def __init__(self, layer, corners, closed=False):
        self.layer = layer
        self.corners = corners
        self.closed = closed


def bulge_of(angle):
    """The bulge of an arc that turns by `angle` radians, counter-clockwise positive."""
    return math.tan(angle / 4.0)


def extents(paths):
    """Left, bottom, right and top of all paths, or `None` without any."""
    xs, ys = [], []
    for path in paths:
        count = len(path.corners)
        for number, (x, y, bulge) in enumerate(path.corners):
            xs.append(x)
            ys.append(y)
            if bulge and (number + 1 < count or path.closed):
                there = path.corners[(number + 1) % count]
                for ax, ay in _extremes((x, y), there[:2], bulge):
                    xs.append(ax)
                    ys.append(ay)
    return (min(xs), min(ys), max(xs), max(ys)) if xs else None


def _extremes(start, end, bulge):
    """The points of an arc that are farthest left, right, up and down, without its ends."""
    chord = (end[0] - start[0], end[1] - start[1])
    length = math.hypot(*chord)
    if length == 0.0:
        return
    # From the middle of the chord to the centre, to the left of the chord.
    away = (1.0 - bulge * bulge) / (4.0 * bulge)
    center = (
        (start[0] + end[0]) / 2.0 - chord[1] * away,
        (start[1] + end[1]) / 2.0 + chord[0] * away,
    )
    radius = length * (1.0 + bulge * bulge) / (4.0 * abs(bulge))
    first = math.atan2(start[1] - center[1], start[0] - center[0])
    turn = 4.0 * math.atan(bulge)
    for quarter in range(4):
        angle = quarter * math.pi / 2.0
        passed = (angle - first) % (2.0 * math.pi) if turn > 0.0 else (first - angle) % (2.0 * math.pi)
        if passed < abs(turn):
            yield (center[0] + radius * math.cos(angle), center[1] + radius * math.sin(angle))


def layer_name(text):
    """A layer name without the characters that DXF forbids, at most 60 letters."""
    name = "".join("_" if c in '<>/\\":;?*|=,`' or ord(c) < 32 else c for c in text)
    return name[:60].strip() or "MARK"


def _escaped(text):
    """Text in ASCII, with other letters as `\\U+XXXX`; `_` replaces letters that need more than four digits."""
    def letter(c):
        if " " <= c <= "~":
            return c
        return "\\U+%04X" % ord(c) if 0xA0 <= ord(c) <= 0xFFFF else "_"

    return "".join(letter(c) for c in text)


_LINE_TYPES, _LAYERS, _STYLES, _APPLICATIONS, _DIMENSIONS, _RECORDS = 0x5, 0x2, 0x3, 0x9, 0xA, 0x1
_VIEWPORTS, _VIEWS, _COORDINATES = 0x8, 0x6, 0x7
_ROOT, _GROUPS, _LAYOUTS, _STANDARD = 0xC, 0xD, 0xE, 0x11
_MODEL, _PAPER, _MODEL_LAYOUT, _PAPER_LAYOUT = 0x20, 0x21, 0x22, 0x23
_FIRST_FREE = 0x100


class _File:
    def __init__(self):
        self.lines = []
        self.next = _FIRST_FREE

    def put(self, *groups):
        for code, value in groups:
            self.lines.append("%3d" % code)
            self.lines.append(str(value))

    def handle(self, owner):
        self.put((5, "%X" % self.next), (330, "%X" % owner))
        self.next += 1

    def table(self, name, handle, count):
        self.put((0, "TABLE"), (2, name), (5, "%X" % handle), (330, 0), (100, "AcDbSymbolTable"), (70, count))

    def entry(self, kind, name_of_class, table, name):
        self.put((0, kind))
        self.handle(table)
        self.put((100, "AcDbSymbolTableRecord"), (100, name_of_class), (2, _escaped(name)), (70, 0))

    def end_table(self):
        self.put((0, "ENDTAB"))


def _number(value):
    # Nanometres: finer than any laser, and the arcs of small letters stay closed.
    text = ("%.6f" % value).rstrip("0")
    text = text + "0" if text.endswith(".") else text
    return "0.0" if text == "-0.0" else text


def write(paths, comment="isomark for FreeCAD"):
    """The DXF file of the paths."""
    file = _File()
    file.put((999, comment))
    layers = sorted({layer_name(path.layer) for path in paths} - {"0"})
    box = extents(paths) or (0.0, 0.0, 0.0, 0.0)
    body = _File()
    body.next = _FIRST_FREE + 0x100 + len(layers)
    for path in paths:
        _entity(body, path)
    file.put((0, "SECTION"), (2, "HEADER"))
    file.put((9, "$ACADVER"), (1, "AC1015"), (9, "$DWGCODEPAGE"), (3, "ANSI_1252"))
    file.put((9, "$EXTMIN"), (10, _number(box[0])), (20, _number(box[1])), (30, "0.0"))
    file.put((9, "$EXTMAX"), (10, _number(box[2])), (20, _number(box[3])), (30, "0.0"))
    file.put((9, "$INSUNITS"), (70, 4), (9, "$MEASUREMENT"), (70, 1), (9, "$HANDSEED"), (5, "%X" % body.next))
    file.put((0, "ENDSEC"))
    _tables(file, layers)
    _blocks(file)
    file.put((0, "SECTION"), (2, "ENTITIES"))
    file.lines += body.lines
    file.put((0, "ENDSEC"))
    _objects(file)
    file.put((0, "EOF"))
    return ("\r\n".join(file.lines) + "\r\n").encode("ascii", "replace")


def _tables(file, layers):
    file.put((0, "SECTION"), (2, "TABLES"))
    file.table("VPORT", _VIEWPORTS, 0)
    file.end_table()
    file.table("LTYPE", _LINE_TYPES, 3)
    for name in ("ByBlock", "ByLayer", "Continuous"):
        file.entry("LTYPE", "AcDbLinetypeTableRecord", _LINE_TYPES, name)
        file.put((3, ""), (72, 65), (73, 0), (40, "0.0"))
    file.end_table()
    file.table("LAYER", _LAYERS, len(layers) + 1)
    for name in ["0"] + layers:
        file.entry("LAYER", "AcDbLayerTableRecord", _LAYERS, name)
        file.put((62, 7), (6, "Continuous"))
    file.end_table()
    file.table("STYLE", _STYLES, 1)
    file.put((0, "STYLE"), (5, "%X" % _STANDARD), (330, "%X" % _STYLES))
    file.put((100, "AcDbSymbolTableRecord"), (100, "AcDbTextStyleTableRecord"), (2, "Standard"), (70, 0))
    file.put((40, "0.0"), (41, "1.0"), (50, "0.0"), (71, 0), (42, "2.5"), (3, "txt"), (4, ""))
    file.end_table()
    file.table("VIEW", _VIEWS, 0)
    file.end_table()
    file.table("UCS", _COORDINATES, 0)
    file.end_table()
    file.table("APPID", _APPLICATIONS, 1)
    file.entry("APPID", "AcDbRegAppTableRecord", _APPLICATIONS, "ACAD")
    file.end_table()
    file.table("DIMSTYLE", _DIMENSIONS, 1)
    file.put((100, "AcDbDimStyleTable"), (0, "DIMSTYLE"), (105, "%X" % file.next), (330, "%X" % _DIMENSIONS))
    file.next += 1
    file.put((100, "AcDbSymbolTableRecord"), (100, "AcDbDimStyleTableRecord"), (2, "Standard"), (70, 0))
    file.put((340, "%X" % _STANDARD))
    file.end_table()
    file.table("BLOCK_RECORD", _RECORDS, 2)
    for name, handle, layout in (("*Model_Space", _MODEL, _MODEL_LAYOUT), ("*Paper_Space", _PAPER, _PAPER_LAYOUT)):
        file.put((0, "BLOCK_RECORD"), (5, "%X" % handle), (330, "%X" % _RECORDS), (100, "AcDbSymbolTableRecord"))
        file.put((100, "AcDbBlockTableRecord"), (2, name), (340, "%X" % layout))
    file.end_table()
    file.put((0, "ENDSEC"))


def _blocks(file):
    file.put((0, "SECTION"), (2, "BLOCKS"))
    for name, record in (("*Model_Space", _MODEL), ("*Paper_Space", _PAPER)):
        file.put((0, "BLOCK"))
        file.handle(record)
        file.put((100, "AcDbEntity"), (8, "0"), (100, "AcDbBlockBegin"), (2, name), (70, 0))
        file.put((10, "0.0"), (20, "0.0"), (30, "0.0"), (3, name), (1, ""))
        file.put((0, "ENDBLK"))
        file.handle(record)
        file.put((100, "AcDbEntity"), (8, "0"), (100, "AcDbBlockEnd"))
    file.put((0, "ENDSEC"))


def _entity(file, path):
    is_point = len(path.corners) == 1
    file.put((0, "POINT" if is_point else "LWPOLYLINE"))
    file.handle(_MODEL)
    file.put((100, "AcDbEntity"), (8, _escaped(layer_name(path.layer))))
    if is_point:
        x, y, _ = path.corners[0]
        file.put((100, "AcDbPoint"), (10, _number(x)), (20, _number(y)), (30, "0.0"))
        return
    file.put((100, "AcDbPolyline"), (90, len(path.corners)), (70, 1 if path.closed else 0))
    for x, y, bulge in path.corners:
        file.put((10, _number(x)), (20, _number(y)))
        if bulge:
            file.put((42, "%.12g" % bulge))


def _objects(file):
    def dictionary(handle, owner, entries):
        file.put((0, "DICTIONARY"), (5, "%X" % handle), (330, "%X" % owner), (100, "AcDbDictionary"), (281, 1))
        for name, there in entries:
            file.put((3, name), (350, "%X" % there))

    file.put((0, "SECTION"), (2, "OBJECTS"))
    dictionary(_ROOT, 0, [("ACAD_GROUP", _GROUPS), ("ACAD_LAYOUT", _LAYOUTS)])
    dictionary(_GROUPS, _ROOT, [])
    dictionary(_LAYOUTS, _ROOT, [("Layout1", _PAPER_LAYOUT), ("Model", _MODEL_LAYOUT)])
    for name, handle, record, tab in (("Model", _MODEL_LAYOUT, _MODEL, 0), ("Layout1", _PAPER_LAYOUT, _PAPER, 1)):
        file.put((0, "LAYOUT"), (5, "%X" % handle), (330, "%X" % _LAYOUTS), (100, "AcDbPlotSettings"))
        file.put((1, ""), (2, "none_device"), (4, ""), (6, ""), (70, 1024 if tab == 0 else 0))
        file.put((100, "AcDbLayout"), (1, name), (70, 1), (71, tab), (330, "%X" % record))
    file.put((0, "ENDSEC"))
