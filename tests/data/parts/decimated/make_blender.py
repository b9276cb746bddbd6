"""Writes parts that Blender's Decimate modifier (Collapse) reduced: python3 with the module bpy."""
import bpy
import numpy as np


def mouse(x, y):
    along = y / 55
    across = x / (30 * (1 - 0.05 * along * along))
    along = along + 6 / 55 * (1 - along * along)
    inside = 1 - 0.55 * across**2 - 0.45 * across**4 - 0.5 * along**2 - 0.5 * along**4
    return 38 * np.maximum(inside, 0) ** 0.45


PARTS = [  # name, height, length of the edges that are left
    ("sphere", lambda x, y: np.sqrt(1600 - x * x - y * y) - 40, 1.5),
    ("saddle", lambda x, y: (x * x - y * y) / 60, 3.0),
    ("mouse", mouse, 3.0),
]

for name, height, edge in PARTS:
    count = 131
    line = np.linspace(-26, 26, count)
    x, y = np.meshgrid(line, line, indexing="ij")
    points = np.c_[x.ravel(), y.ravel(), height(x, y).ravel()]
    nodes = np.arange(count * count).reshape(count, count)
    a, b, c, d = (nodes[rows, columns].ravel() for rows, columns in (
        (slice(None, -1), slice(None, -1)), (slice(1, None), slice(None, -1)),
        (slice(1, None), slice(1, None)), (slice(None, -1), slice(1, None))))
    triangles = np.r_[np.c_[a, b, c], np.c_[a, c, d]]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points.tolist(), [], triangles.tolist())
    part = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(part)
    part.modifiers.new("Decimate", "DECIMATE").ratio = 2 * (52 / edge) ** 2 / len(triangles)
    bpy.ops.wm.obj_export(filepath=f"bl45-{name}.obj", forward_axis="Y", up_axis="Z", export_materials=False,
                          export_normals=False, export_uv=False)
