"""What the tests share: parts that are given by a formula, lengths on them, and a scene in mm."""

import importlib
import math
import re
import tempfile
import time
import unittest
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

ISOMARK = ""
MODULE = ""
LIMIT_S = 60

# Of a station.
SETTINGS = """[station]
name = "test"
[folders]
hot = "hot"
import = "import"
[field]
width_mm = 250
height_mm = 250
# With the usual 0.01 mm, the chords of small letters lose 0.02 mm a turn, which is more than the correction leaves.
[correction]
tolerance_mm = 0.002
[watch]
settle_ms = 100
rescan_s = 0.5
incomplete_s = 2
"""


def addon(name):
    """A module of the installed add-on."""
    return importlib.import_module(f"{MODULE}.{name}")


def until(condition, limit_s=LIMIT_S):
    """Waits for a condition and returns its value."""
    deadline = time.monotonic() + limit_s
    while not (value := condition()):
        if time.monotonic() > deadline:
            raise AssertionError("this did not happen in time")
        time.sleep(0.02)
    return value


class SceneTest(unittest.TestCase):
    """A test with an empty scene in mm and an isomark that is found."""

    def setUp(self):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        if MODULE not in bpy.context.preferences.addons:
            bpy.ops.preferences.addon_enable(module=MODULE)
        bpy.context.scene.unit_settings.scale_length = 0.001
        self.preferences = bpy.context.preferences.addons[MODULE].preferences
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        station = self.folder / "station.toml"
        station.write_text(SETTINGS)
        self.preferences.program, self.preferences.station, self.preferences.hot_folder = ISOMARK, str(station), ""

    def tearDown(self):
        addon("session").end()

    @property
    def settings(self):
        """The settings of the scene."""
        return bpy.context.scene.isomark

    def use(self, part, drawings, frame=None):
        """Chooses the part, the drawing and the frame."""
        self.settings.part, self.settings.frame = part, frame
        self.settings.drawings.clear()
        for item in drawings:
            self.settings.drawings.add().item = item
        bpy.context.view_layer.update()

    def trouble(self, action, *arguments):
        """What the add-on reports when this fails."""
        with self.assertRaises(addon("trouble").Trouble) as caught:
            action(*arguments)
        self.assertRegex(caught.exception.what, r"^[A-Z].*\.$")
        self.assertRegex(caught.exception.remedy, r"^[A-Z].*\.$")
        return caught.exception


class Can:
    """A cylinder of radius 33 mm along z, with flat ends."""
    radius, height = 33.0, 110.0

    def part(self):
        """The object, as Add > Mesh > Cylinder makes it."""
        bpy.ops.mesh.primitive_cylinder_add(vertices=256, radius=self.radius, depth=self.height)
        return named("Can")

    def distance(self, points):
        """Distance of points from the surface."""
        return np.hypot(points[:, 0], points[:, 1]) - self.radius

    frame_matrix = Matrix(((1, 0, 0, 0), (0, 0, -1, -33), (0, 1, 0, 10), (0, 0, 0, 1)))


class Mouse:
    """A surface that is curved in two directions, like the back of a computer mouse."""
    frame_matrix = Matrix.Translation((0, 0, 14))

    @staticmethod
    def height(x, y):
        """The formula."""
        return 14 * np.cos(x / 30) * np.cos(y / 55)

    def part(self):
        """The object: a smooth mesh with edges of 0.75 mm."""
        x, y = np.meshgrid(np.linspace(-30, 30, 81), np.linspace(-48, 48, 129))
        rows, columns = x.shape
        points = np.column_stack([x.ravel(), y.ravel(), self.height(x, y).ravel()])
        first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        faces = np.column_stack([first, first + 1, first + columns + 1, first + columns])
        mesh = bpy.data.meshes.new("Mouse")
        mesh.from_pydata(points.tolist(), [], faces.tolist())
        mesh.polygons.foreach_set("use_smooth", [True] * len(faces))
        item = bpy.data.objects.new("Mouse", mesh)
        bpy.context.scene.collection.objects.link(item)
        return item

    def distance(self, points):
        """Height of points above the surface."""
        return points[:, 2] - self.height(points[:, 0], points[:, 1])


def named(name):
    """The active object, with a new name."""
    item = bpy.context.object
    item.name = name
    return item


def frame_at(matrix):
    """An empty as the frame."""
    item = bpy.data.objects.new("frame", None)
    bpy.context.scene.collection.objects.link(item)
    item.matrix_world = matrix
    return item


def drawings(matrix):
    """One object of each kind in the plane of the frame, 40 x 26 mm together."""
    bpy.ops.object.text_add()
    text = named("Text")
    text.data.body, text.data.size = "Größe", 9
    bpy.ops.curve.primitive_bezier_circle_add(radius=6)
    bezier = named("Bezier")
    bpy.ops.curve.primitive_nurbs_circle_add(radius=5)
    nurbs = named("Nurbs")
    data = bpy.data.curves.new("Poly", "CURVE")
    spline = data.splines.new("POLY")
    spline.points.add(3)
    for point, place in zip(spline.points, ((0, 0), (12, 0), (12, 7), (0, 7))):
        point.co = (*place, 0, 1)
    spline.use_cyclic_u = True
    poly = bpy.data.objects.new("Poly", data)
    bpy.context.scene.collection.objects.link(poly)
    items = [text, bezier, nurbs, poly, pencil()]
    for item, place in zip(items, ((-18, 3), (-10, -6), (4, -5), (8, -10), (-2, 8))):
        item.matrix_world = matrix @ Matrix.Translation((*place, 0))
    bpy.context.view_layer.update()
    return items


def pencil():
    """A closed stroke of grease pencil: a triangle with sides of 6, 8 and 10 mm."""
    corners = ((0, 0, 0), (8, 0, 0), (0, 6, 0))
    if bpy.app.version < (4, 3, 0):
        data = bpy.data.grease_pencils.new("Pencil")
        stroke = data.layers.new("Lines").frames.new(1).strokes.new()
        stroke.points.add(3)
        for point, corner in zip(stroke.points, corners):
            point.co = corner
        stroke.use_cyclic = True
    else:
        data = getattr(bpy.data, "grease_pencils_v3", bpy.data.grease_pencils).new("Pencil")
        frame = data.layers.new("Lines").frames.new(1)
        frame.drawing.add_strokes([3])
        stroke = frame.drawing.strokes[0]
        for point, corner in zip(stroke.points, corners):
            point.position = corner
        stroke.cyclic = True
    item = bpy.data.objects.new("Pencil", data)
    bpy.context.scene.collection.objects.link(item)
    return item


def drawn_length(item):
    """The length of a curve or of the outlines of a text, mm, from Blender's own tessellation in small steps."""
    if item.type not in ("CURVE", "FONT"):
        return 24.0
    copy = item.copy()
    copy.data = item.data.copy()
    copy.data.resolution_u = 64
    for spline in getattr(copy.data, "splines", ()):
        spline.resolution_u = 64
    copy.data.fill_mode = "NONE" if copy.data.dimensions == "2D" else copy.data.fill_mode
    bpy.context.scene.collection.objects.link(copy)
    evaluated = copy.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    points = np.array([vertex.co[:] for vertex in mesh.vertices], float)
    ends = np.array([edge.vertices[:] for edge in mesh.edges])
    length = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1).sum()
    evaluated.to_mesh_clear()
    bpy.data.objects.remove(copy)
    return float(length)


def polylines(path):
    """The polylines of a DXF: layer, closed, points."""
    lines = path.read_text(encoding="ascii").splitlines()
    groups = list(zip((int(code) for code in lines[::2]), lines[1::2]))
    found, at = [], None
    for code, value in groups:
        if code == 0:
            at = None
            if value == "LWPOLYLINE":
                at = ["", False, []]
                found.append(at)
        elif at is not None and code == 8:
            at[0] = re.sub(r"\\U\+([0-9A-F]{4})", lambda match: chr(int(match[1], 16)), value)
        elif at is not None and code == 70:
            at[1] = value.strip() == "1"
        elif at is not None and code == 10:
            at[2].append([float(value)])
        elif at is not None and code == 20:
            at[2][-1].append(float(value))
    return [(layer, closed, np.array(points)) for layer, closed, points in found]


def length(points, closed=False):
    """The length of a polyline."""
    points = np.vstack([points, points[:1]]) if closed else points
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def off(line, points):
    """The distance of each point from a polyline."""
    begin, step = line[:-1], np.diff(line, axis=0)
    squared = np.maximum((step ** 2).sum(axis=1), 1e-18)
    along = np.clip(((points[:, None] - begin) * step).sum(axis=2) / squared, 0, 1)
    return np.linalg.norm(begin + along[:, :, None] * step - points[:, None], axis=2).min(axis=1)


def node_group(item):
    """A new geometry-node modifier of an object: its group, with the nodes of its input and its output."""
    modifier = item.modifiers.new("Nodes", "NODES")
    modifier.node_group = group = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    if hasattr(group, "interface"):
        for side in ("INPUT", "OUTPUT"):
            group.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")
    else:
        group.inputs.new("NodeSocketGeometry", "Geometry")
        group.outputs.new("NodeSocketGeometry", "Geometry")
    return group, group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")


def on_surface(shape, points, matrix):
    """Points of the laser's view, mm, on the surface: along the beam, by bisection between the horizon and the laser."""
    axes = np.array(matrix)[:3, :3]
    origin = points @ axes[:, :2].T
    near, far = np.full(len(points), 60.0), np.zeros(len(points))
    for _ in range(60):
        middle = (near + far) / 2
        outside = shape.distance(origin + middle[:, None] * axes[:, 2]) > 0
        near, far = np.where(outside, middle, near), np.where(outside, far, middle)
    return origin + near[:, None] * axes[:, 2]


def length_on_surface(shape, points, closed, matrix):
    """The length that the laser marks: straight lines in the view, in small steps on the surface."""
    points = np.vstack([points, points[:1]]) if closed else points
    pieces = [points[:1]]
    for begin, end in zip(points, points[1:]):
        count = max(1, math.ceil(np.linalg.norm(end - begin) / 0.1))
        pieces.append(begin + (end - begin) * np.linspace(0, 1, count + 1)[1:, None])
    return length(on_surface(shape, np.vstack(pieces), matrix))
