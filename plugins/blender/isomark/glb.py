# SPDX-License-Identifier: GPL-3.0-or-later
"""Binary glTF: writes a part with its marking frame, reads the mark on the part.

Blender's own exporter is not used: its options changed between 3.4 and 5.0, it ignores the unit scale of the scene, depends
on the selection and the names in the file, and renames nodes whose name is taken.
"""

import json
import struct
from collections import namedtuple

import numpy as np

from .trouble import Trouble

_MAGIC, _VERSION, _JSON, _BIN = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
_FLOAT, _UNSIGNED = 5126, 5125
_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_LINES, _STRIP, _TRIANGLES = 1, 3, 4
_SCHEMA = "isomark.on-part/"

# A piece of a mesh with one material: its name (or None), points in m and unit normals with Z up, and triangles.
Piece = namedtuple("Piece", "material points normals triangles")

# What isomark draws on the part: `facts` is its description; the other four are lists of Shape.
OnPart = namedtuple("OnPart", "facts mark ink drawn view")

# Points in m with Z up, their colours (linear RGB, or None), and for surfaces the triangles.
Shape = namedtuple("Shape", "points colors triangles")


def _y_up(vectors):
    return np.column_stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]])


def _z_up(vectors):
    return np.column_stack([vectors[:, 0], -vectors[:, 2], vectors[:, 1]])


def write_part(name, pieces, frame=None):
    """The part as a GLB file. `frame` is the origin of the marking frame in m and its rotation as a quaternion
    (w, x, y, z), both with Z up; it becomes the node `isomark`."""
    chunks, views, accessors, materials, primitives = [], [], [], [], []

    def add(values, kind, component, target, bounds=False):
        data = np.ascontiguousarray(values).tobytes()
        views.append({"buffer": 0, "byteOffset": sum(map(len, chunks)), "byteLength": len(data), "target": target})
        chunks.append(data)
        accessor = {"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind}
        if bounds:
            accessor["min"] = [float(value) for value in values.min(axis=0)]
            accessor["max"] = [float(value) for value in values.max(axis=0)]
        accessors.append(accessor)
        return len(accessors) - 1

    for piece in pieces:
        points, normals = _y_up(piece.points).astype("<f4"), _y_up(piece.normals).astype("<f4")
        primitive = {
            "attributes": {
                "POSITION": add(points, "VEC3", _FLOAT, 34962, bounds=True),
                "NORMAL": add(normals, "VEC3", _FLOAT, 34962),
            },
            "indices": add(piece.triangles.astype("<u4").reshape(-1), "SCALAR", _UNSIGNED, 34963),
            "mode": _TRIANGLES,
        }
        if piece.material is not None:
            primitive["material"] = len(materials)
            materials.append({"name": piece.material, "doubleSided": True})
        primitives.append(primitive)

    nodes = [{"name": name, "mesh": 0}]
    if frame is not None:
        (x, y, z), (w, i, j, k) = frame
        nodes.append({"name": "isomark", "translation": [x, z, -y], "rotation": [i, k, -j, w]})
    document = {
        "asset": {"version": "2.0", "generator": "isomark for Blender"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": [{"name": name, "primitives": primitives}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": sum(map(len, chunks))}],
    }
    if materials:
        document["materials"] = materials
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(chunks)
    length = 12 + 8 + len(text) + 8 + len(body)
    head = struct.pack("<IIIII", _MAGIC, _VERSION, length, len(text), _JSON)
    return head + text + struct.pack("<II", len(body), _BIN) + body


def read_on_part(data):
    """What isomark wrote with `--on-part`.

    Raises Trouble for a file that is not of this kind or is damaged.
    """
    try:
        document, body = _chunks(data)
        root = next(node for node in document["nodes"] if node.get("name") == "isomark-mark" and "extras" in node)
        facts = root["extras"]["isomark"] if "isomark" in root["extras"] else root["extras"]
        schema = str(facts.get("schema"))
        if not schema.startswith(_SCHEMA + "1"):
            raise Trouble(f"The mark on the part has the form {schema}, which this add-on cannot read.",
                          "Install the newest add-on.")
        shapes = {"mark": [], "mark-ink": [], "drawn": [], "view": []}
        for index in root.get("children", []):
            node = document["nodes"][index]
            if node.get("name") in shapes and "mesh" in node:
                for primitive in document["meshes"][node["mesh"]]["primitives"]:
                    shapes[node["name"]].extend(_shapes(document, body, primitive))
        return OnPart(facts, shapes["mark"], shapes["mark-ink"], shapes["drawn"], shapes["view"])
    except (KeyError, IndexError, ValueError, TypeError, AttributeError, StopIteration, struct.error) as error:
        raise Trouble("The mark on the part, written by isomark, cannot be read.",
                      "Install an isomark and an add-on of the same version.") from error


def _chunks(data):
    magic, version, length = struct.unpack_from("<III", data)
    if magic != _MAGIC or version != _VERSION or length > len(data):
        raise ValueError("not a whole GLB file")
    document, body, at = None, b"", 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        chunk = data[at + 8:at + 8 + size]
        if kind == _JSON:
            document = json.loads(chunk)
        elif kind == _BIN:
            body = chunk
        at += 8 + size
    return document, body


def _values(document, body, index):
    accessor = document["accessors"][index]
    view = document["bufferViews"][accessor["bufferView"]]
    kind, width, count = np.dtype(_KINDS[accessor["componentType"]]), _WIDTHS[accessor["type"]], accessor["count"]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    stride = view.get("byteStride", kind.itemsize * width)
    if count and start + stride * (count - 1) + kind.itemsize * width > len(body):
        raise ValueError("an accessor ends after the buffer")
    values = np.ndarray((count, width), kind, body, start, (stride, kind.itemsize))
    if accessor.get("normalized"):
        return values / np.iinfo(kind).max
    return values


def _shapes(document, body, primitive):
    """The shapes of a primitive: one for a strip or a surface, one a line for loose lines."""
    attributes = primitive["attributes"]
    points = _z_up(_values(document, body, attributes["POSITION"]).astype(float))
    colors = None
    if "COLOR_0" in attributes:
        colors = _values(document, body, attributes["COLOR_0"])[:, :3].astype(float)
    order = np.arange(len(points))
    if "indices" in primitive:
        order = _values(document, body, primitive["indices"])[:, 0].astype(int)
    if len(order) and order.max() >= len(points):
        raise ValueError("an index after the last point")
    mode = primitive.get("mode", _TRIANGLES)
    if mode == _TRIANGLES:
        return [Shape(points, colors, order[:len(order) // 3 * 3].reshape(-1, 3))]
    runs = [order] if mode == _STRIP else _joined(order[:len(order) // 2 * 2].reshape(-1, 2)) if mode == _LINES else []
    return [Shape(points[run], None if colors is None else colors[run], None) for run in runs if len(run) > 1]


def _joined(pairs):
    """Runs of lines in which each begins at the end of the one before."""
    if not len(pairs):
        return []
    breaks = np.flatnonzero(pairs[1:, 0] != pairs[:-1, 1]) + 1
    return [np.append(run[:, 0], run[-1, 1]) for run in np.split(pairs, breaks)]
