# SPDX-License-Identifier: MIT OR Apache-2.0
"""glTF 2.0 binary files: writes the part with its marking frame, reads isomark's file with the mark on the part.

In the document: mm, +Z up. In glTF: metres, +Y up.
"""

import array
import json
import math
import struct
import sys

_GLB, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_FLOAT, _UINT = 5126, 5125
_ARRAY, _ELEMENTS = 34962, 34963
_LINES, _LINE_LOOP, _LINE_STRIP, _TRIANGLES = 1, 2, 3, 4

#: The name of the node that carries the marking frame.
FRAME_NODE = "isomark"
#: The name of the material of faces that bound the mark.
MARK_MATERIAL = "mark"


def to_gltf(v):
    """A vector of the document, turned to +Y up."""
    return (v[0], v[2], -v[1])


def to_document(v):
    """A vector of glTF, turned to +Z up."""
    return (v[0], -v[2], v[1])


class Primitive:
    """Triangles with normals: flat lists of coordinates in mm, of normals, and of indices."""

    def __init__(self):
        self.positions = array.array("f")
        self.normals = array.array("f")
        self.indices = array.array("I")

    def add_vertex(self, position, normal):
        x, y, z = to_gltf(position)
        self.positions.extend((x / 1000.0, y / 1000.0, z / 1000.0))
        self.normals.extend(to_gltf(normal))

    def vertices(self):
        return len(self.positions) // 3


def quaternion(frame):
    """The rotation of the frame's node: x, y, z, w.

    The node's axes are turned like those of the part, so a node without a rotation is the frame of the document.
    """
    columns = (to_gltf(frame.x), to_gltf(frame.z), tuple(-c for c in to_gltf(frame.y)))
    m = [[columns[j][i] for j in range(3)] for i in range(3)]
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace > 0.0:
        s = math.sqrt(trace + 1.0) * 2.0
        q = ((m[2][1] - m[1][2]) / s, (m[0][2] - m[2][0]) / s, (m[1][0] - m[0][1]) / s, s / 4.0)
    else:
        i = max(range(3), key=lambda k: m[k][k])
        j, k = (i + 1) % 3, (i + 2) % 3
        s = math.sqrt(1.0 + m[i][i] - m[j][j] - m[k][k]) * 2.0
        v = [0.0, 0.0, 0.0]
        v[i], v[j], v[k] = s / 4.0, (m[j][i] + m[i][j]) / s, (m[k][i] + m[i][k]) / s
        q = (v[0], v[1], v[2], (m[k][j] - m[j][k]) / s)
    length = math.sqrt(sum(c * c for c in q))
    return [c / length for c in q]


def write_part(primitives, name, frame, generator):
    """The file of a part: `primitives` are pairs of a `Primitive` and whether its faces bound the mark."""
    body = bytearray()
    views, accessors, drawn = [], [], []

    def accessor(values, component, kind, count, target, limits=None):
        if sys.byteorder == "big":
            values = array.array(values.typecode, values)
            values.byteswap()
        views.append(
            {"buffer": 0, "byteOffset": len(body), "byteLength": len(values) * values.itemsize, "target": target}
        )
        body.extend(values.tobytes())
        entry = {"bufferView": len(views) - 1, "componentType": component, "count": count, "type": kind}
        if limits:
            entry["min"], entry["max"] = limits
        accessors.append(entry)
        return len(accessors) - 1

    for primitive, bounds_mark in primitives:
        count = primitive.vertices()
        if not primitive.indices:
            continue
        axes = [primitive.positions[axis::3] for axis in range(3)]
        limits = ([min(axis) for axis in axes], [max(axis) for axis in axes])
        entry = {
            "attributes": {
                "POSITION": accessor(primitive.positions, _FLOAT, "VEC3", count, _ARRAY, limits),
                "NORMAL": accessor(primitive.normals, _FLOAT, "VEC3", count, _ARRAY),
            },
            "indices": accessor(primitive.indices, _UINT, "SCALAR", len(primitive.indices), _ELEMENTS),
            "mode": _TRIANGLES,
        }
        if bounds_mark:
            entry["material"] = 0
        drawn.append(entry)
    document = {
        "asset": {"version": "2.0", "generator": generator},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [
            {"name": name, "mesh": 0},
            {
                "name": FRAME_NODE,
                "translation": [c / 1000.0 for c in to_gltf(frame.origin)],
                "rotation": quaternion(frame),
            },
        ],
        "meshes": [{"name": name, "primitives": drawn}],
        "buffers": [{"byteLength": len(body)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    if any("material" in entry for entry in drawn):
        document["materials"] = [{"name": MARK_MATERIAL}]
    text = json.dumps(document, separators=(",", ":")).encode("utf-8")
    text += b" " * (-len(text) % 4)
    body += b"\0" * (-len(body) % 4)
    total = 12 + 8 + len(text) + 8 + len(body)
    parts = [struct.pack("<III", _GLB, 2, total), struct.pack("<II", len(text), _JSON), text]
    parts += [struct.pack("<II", len(body), _BIN), bytes(body)]
    return b"".join(parts)


class Strip:
    """A polyline on the part: points in mm in the document, and a colour (red, green, blue; 0 to 1) for each."""

    def __init__(self, points, colours):
        self.points = points
        self.colours = colours


class Mesh:
    """Triangles on the part: points in mm in the document, and indices."""

    def __init__(self, points, triangles):
        self.points = points
        self.triangles = triangles


class MarkOnPart:
    """What isomark draws on the part: for each node its strips and meshes."""

    def __init__(self, strips, meshes, extras):
        self.strips = strips
        self.meshes = meshes
        self.extras = extras


class NotReadable(Exception):
    """The file is not a glTF binary that this reader supports."""


def read_mark(data):
    """Reads isomark's file with the mark on the part.

    Raises `NotReadable` when the file is cut short or not of this form.
    """
    try:
        return _read_mark(data)
    except (struct.error, ValueError, KeyError, IndexError, TypeError, AttributeError) as error:
        raise NotReadable(str(error)) from error


def _read_mark(data):
    magic, version, total = struct.unpack_from("<III", data, 0)
    if magic != _GLB or version != 2 or total > len(data):
        raise NotReadable("no glTF binary, or cut short")
    size, kind = struct.unpack_from("<II", data, 12)
    if kind != _JSON:
        raise NotReadable("no JSON chunk")
    root = json.loads(data[20 : 20 + size].decode("utf-8"))
    start = 20 + size
    body = b""
    if start + 8 <= total:
        size, kind = struct.unpack_from("<II", data, start)
        if kind == _BIN:
            body = data[start + 8 : start + 8 + size]
    reader = _Reader(root, body)
    strips, meshes, extras = {}, {}, {}
    for node in root.get("nodes", []):
        name = node.get("name", "")
        extras.update(node.get("extras", {}).get("isomark", {}))
        if "mesh" not in node:
            continue
        for primitive in root["meshes"][node["mesh"]]["primitives"]:
            mode = primitive.get("mode", _TRIANGLES)
            if mode == _TRIANGLES:
                meshes.setdefault(name, []).append(reader.mesh(primitive))
            elif mode in (_LINES, _LINE_LOOP, _LINE_STRIP):
                strips.setdefault(name, []).extend(reader.strips(primitive, mode))
    return MarkOnPart(strips, meshes, extras)


class _Reader:
    def __init__(self, root, body):
        self.root = root
        self.body = body
        self.points_of = {}

    def numbers(self, index):
        """An accessor's numbers, and how many each element has."""
        accessor = self.root["accessors"][index]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        code, size, scale = {
            5121: ("B", 1, 255.0),
            5123: ("H", 2, 65535.0),
            5125: ("I", 4, 1.0),
            5126: ("f", 4, 1.0),
        }[accessor["componentType"]]
        view = self.root["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride = view.get("byteStride") or width * size
        count = accessor["count"]
        if count and start + (count - 1) * stride + width * size > len(self.body):
            raise NotReadable("an accessor reaches beyond the file")
        if stride == width * size:
            numbers = struct.unpack_from("<%d%s" % (count * width, code), self.body, start)
        else:
            numbers = []
            for number in range(count):
                numbers += struct.unpack_from("<%d%s" % (width, code), self.body, start + number * stride)
        if accessor.get("normalized"):
            numbers = [value / scale for value in numbers]
        return numbers, width

    def points(self, index):
        """Positions in mm in the document; many primitives may share them."""
        if index not in self.points_of:
            numbers, width = self.numbers(index)
            metres = zip(*(numbers[axis::width] for axis in range(3)))
            self.points_of[index] = [(x * 1000.0, -z * 1000.0, y * 1000.0) for x, y, z in metres]
        return self.points_of[index]

    def indices(self, primitive, count):
        if "indices" in primitive:
            return self.numbers(primitive["indices"])[0]
        return range(count)

    def mesh(self, primitive):
        points = self.points(primitive["attributes"]["POSITION"])
        order = list(self.indices(primitive, len(points)))
        return Mesh(points, [tuple(order[n : n + 3]) for n in range(0, len(order) - 2, 3)])

    def strips(self, primitive, mode):
        attributes = primitive["attributes"]
        points = self.points(attributes["POSITION"])
        colours = [(0.0, 0.0, 0.0)] * len(points)
        if "COLOR_0" in attributes:
            numbers, width = self.numbers(attributes["COLOR_0"])
            linear = zip(*(numbers[axis::width] for axis in range(3)))
            colours = [tuple(_display(channel) for channel in colour) for colour in linear]
        order = list(self.indices(primitive, len(points)))
        if mode == _LINE_LOOP and order:
            order.append(order[0])
        runs = [order[n : n + 2] for n in range(0, len(order) - 1, 2)] if mode == _LINES else [order]
        return [Strip([points[i] for i in run], [colours[i] for i in run]) for run in runs if len(run) > 1]


def _display(linear):
    """A colour channel of glTF, which is linear, as a screen shows it (sRGB)."""
    linear = min(max(linear, 0.0), 1.0)
    return 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1.0 / 2.4) - 0.055
