# SPDX-License-Identifier: GPL-3.0-or-later
"""The DXF writer: polylines in millimetres, R2000, with only the structure that strict readers require."""

from collections import namedtuple

# A polyline: the name of its layer, whether it is closed, and its points in mm (pairs).
Path = namedtuple("Path", "layer closed points")

_BLOCK_RECORDS, _LAYERS, _STYLES, _LINE_TYPES, _VIEWS, _UCS, _VIEWPORTS, _APPLICATIONS, _DIMENSIONS = range(1, 10)
_ROOT, _GROUPS, _LAYOUTS, _STYLE, _MODEL, _PAPER, _MODEL_LAYOUT, _PAPER_LAYOUT = 12, 13, 14, 17, 32, 33, 34, 35
_FIRST_FREE = 0x100


def layer_name(name):
    """A name without the characters that DXF forbids in names of layers."""
    name = "".join("_" if letter in '<>/\\":;?*|=,`' or ord(letter) < 32 else letter for letter in name).strip()
    return name or "0"


def write(paths):
    """The drawing as bytes. The same paths always give the same bytes; a path without points is skipped."""
    paths = [Path(layer_name(path.layer), path.closed, path.points) for path in paths if len(path.points)]
    layers = ["0"] + sorted({path.layer for path in paths} - {"0"})
    out = _Writer()
    out.section("HEADER", lambda: _header(out, paths, len(layers)))
    out.section("TABLES", lambda: _tables(out, layers))
    out.section("BLOCKS", lambda: _blocks(out))
    out.section("ENTITIES", lambda: _entities(out, paths))
    out.section("OBJECTS", lambda: _objects(out))
    out.put(0, "EOF")
    return "".join(out.text).encode("ascii")


class _Writer:
    def __init__(self):
        self.text = []
        self.next_handle = _FIRST_FREE

    def put(self, *groups):
        for code, value in zip(groups[::2], groups[1::2]):
            self.text.append(f"{code:>3}\r\n{value}\r\n")

    def section(self, name, content):
        self.put(0, "SECTION", 2, name)
        content()
        self.put(0, "ENDSEC")

    def new_handle(self, owner, code=5):
        self.put(code, f"{self.next_handle:X}", 330, f"{owner:X}")
        self.next_handle += 1

    def table(self, name, handle, entries, content=lambda: None):
        self.put(0, "TABLE", 2, name, 5, f"{handle:X}", 330, 0, 100, "AcDbSymbolTable", 70, entries)
        if name == "DIMSTYLE":
            self.put(100, "AcDbDimStyleTable")
        content()
        self.put(0, "ENDTAB")

    def entry(self, kind, record, table, name):
        self.put(0, kind)
        self.new_handle(table, 105 if kind == "DIMSTYLE" else 5)
        self.put(100, "AcDbSymbolTableRecord", 100, record, 2, _escaped(name), 70, 0)


def _header(out, paths, layers):
    across = [x for path in paths for x, _ in path.points] or [0.0]
    up = [y for path in paths for _, y in path.points] or [0.0]
    out.put(9, "$ACADVER", 1, "AC1015", 9, "$DWGCODEPAGE", 3, "ANSI_1252")
    out.put(9, "$EXTMIN", 10, _number(min(across)), 20, _number(min(up)), 30, "0.0")
    out.put(9, "$EXTMAX", 10, _number(max(across)), 20, _number(max(up)), 30, "0.0")
    out.put(9, "$INSUNITS", 70, 4, 9, "$MEASUREMENT", 70, 1)
    # Above every handle: one per entity and layer, and a few dozen for the fixed parts.
    out.put(9, "$HANDSEED", 5, f"{_FIRST_FREE + len(paths) + layers + 0x100:X}")


def _tables(out, layers):
    out.table("VPORT", _VIEWPORTS, 0)

    def line_types():
        for name in ("ByBlock", "ByLayer", "Continuous"):
            out.entry("LTYPE", "AcDbLinetypeTableRecord", _LINE_TYPES, name)
            out.put(3, "", 72, 65, 73, 0, 40, "0.0")

    def layer_entries():
        for name in layers:
            out.entry("LAYER", "AcDbLayerTableRecord", _LAYERS, name)
            out.put(62, 7, 6, "Continuous")

    def styles():
        out.put(0, "STYLE", 5, f"{_STYLE:X}", 330, f"{_STYLES:X}")
        out.put(100, "AcDbSymbolTableRecord", 100, "AcDbTextStyleTableRecord", 2, "Standard", 70, 0)
        out.put(40, "0.0", 41, "1.0", 50, "0.0", 71, 0, 42, "2.5", 3, "txt", 4, "")

    def dimension_styles():
        out.entry("DIMSTYLE", "AcDbDimStyleTableRecord", _DIMENSIONS, "Standard")
        out.put(340, f"{_STYLE:X}")

    def block_records():
        records = (("*Model_Space", _MODEL, _MODEL_LAYOUT), ("*Paper_Space", _PAPER, _PAPER_LAYOUT))
        for name, handle, layout in records:
            out.put(0, "BLOCK_RECORD", 5, f"{handle:X}", 330, f"{_BLOCK_RECORDS:X}")
            out.put(100, "AcDbSymbolTableRecord", 100, "AcDbBlockTableRecord", 2, name, 340, f"{layout:X}")

    out.table("LTYPE", _LINE_TYPES, 3, line_types)
    out.table("LAYER", _LAYERS, len(layers), layer_entries)
    out.table("STYLE", _STYLES, 1, styles)
    out.table("VIEW", _VIEWS, 0)
    out.table("UCS", _UCS, 0)
    application = ("APPID", "AcDbRegAppTableRecord", _APPLICATIONS, "ACAD")
    out.table("APPID", _APPLICATIONS, 1, lambda: out.entry(*application))
    out.table("DIMSTYLE", _DIMENSIONS, 1, dimension_styles)
    out.table("BLOCK_RECORD", _BLOCK_RECORDS, 2, block_records)


def _blocks(out):
    for name, record in (("*Model_Space", _MODEL), ("*Paper_Space", _PAPER)):
        out.put(0, "BLOCK")
        out.new_handle(record)
        out.put(100, "AcDbEntity", 8, "0", 100, "AcDbBlockBegin", 2, name, 70, 0)
        out.put(10, "0.0", 20, "0.0", 30, "0.0", 3, name, 1, "", 0, "ENDBLK")
        out.new_handle(record)
        out.put(100, "AcDbEntity", 8, "0", 100, "AcDbBlockEnd")


def _entities(out, paths):
    for path in paths:
        dot = len(path.points) == 1
        out.put(0, "POINT" if dot else "LWPOLYLINE")
        out.new_handle(_MODEL)
        out.put(100, "AcDbEntity", 8, _escaped(path.layer), 100, "AcDbPoint" if dot else "AcDbPolyline")
        if not dot:
            out.put(90, len(path.points), 70, int(path.closed))
        for x, y in path.points:
            out.put(10, _number(x), 20, _number(y))
        if dot:
            out.put(30, "0.0")


def _objects(out):
    def dictionary(handle, owner, entries):
        out.put(0, "DICTIONARY", 5, f"{handle:X}", 330, f"{owner:X}", 100, "AcDbDictionary", 281, 1)
        for name, entry in entries:
            out.put(3, name, 350, f"{entry:X}")

    dictionary(_ROOT, 0, (("ACAD_GROUP", _GROUPS), ("ACAD_LAYOUT", _LAYOUTS)))
    dictionary(_GROUPS, _ROOT, ())
    dictionary(_LAYOUTS, _ROOT, (("Layout1", _PAPER_LAYOUT), ("Model", _MODEL_LAYOUT)))
    layouts = (("Model", _MODEL_LAYOUT, _MODEL, 0), ("Layout1", _PAPER_LAYOUT, _PAPER, 1))
    for name, handle, record, tab in layouts:
        out.put(0, "LAYOUT", 5, f"{handle:X}", 330, f"{_LAYOUTS:X}", 100, "AcDbPlotSettings")
        # 1024: the tab is the model.
        out.put(1, "", 2, "none_device", 4, "", 6, "", 70, 0 if tab else 1024)
        out.put(100, "AcDbLayout", 1, name, 70, 1, 71, tab, 330, f"{record:X}")


def _number(value):
    text = f"{value:.6f}".rstrip("0")
    text += "0" if text.endswith(".") else ""
    return "0.0" if text == "-0.0" else text


def _escaped(text):
    """Text in ASCII, with other letters as `\\U+XXXX`; `_` replaces letters that need more than four digits."""
    def letter(character):
        if " " <= character <= "~":
            return character
        return f"\\U+{ord(character):04X}" if 0xA0 <= ord(character) <= 0xFFFF else "_"
    return "".join(map(letter, text))
