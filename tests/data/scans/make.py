"""Makes the scans of this folder with independent writers (see README.md): python make.py

The mandarin is that of tests/reference_cases; noise is 0.05 mm unless stated otherwise."""

import fast_simplification
import meshio
import numpy as np
import trimesh
from plyfile import PlyData, PlyElement
from stl import Mode, mesh as numpy_stl

random = np.random.default_rng(2023)


def mandarin(x, y):
    r = x**2 + y**2
    rib = 0.06 * np.real((x + 1j * y) ** 10) / (r**5 + 14.0**10)
    return 22.5 * np.sqrt(np.maximum(1 - r / 900, 0)) + rib


def disc(step, radius=28.5):
    count = int(radius / step)
    x, y = np.meshgrid(np.arange(-count, count + 1) * step, np.arange(-count, count + 1) * step)
    keep = np.hypot(x, y) <= radius
    return x[keep], y[keep]


def vertices(x, y, z, order=">f4"):
    table = np.zeros(len(x), dtype=[("quality", "f4"), ("z", "f8"), ("x", "f4"), ("red", "u1"), ("y", "f4")])
    table["x"], table["y"], table["z"], table["red"] = x, y, z, 200
    return PlyElement.describe(table, "vertex", comments=["laser line scanner, units: mm"])


x, y = disc(1.0)
z = mandarin(x, y) + 0.05 * random.normal(size=len(x))
points = np.column_stack([x, y, z])
PlyData([vertices(x, y, z)], byte_order="<", comments=["units: mm"]).write("mandarin-plyfile-little.ply")
PlyData([vertices(x, y, z)], byte_order=">").write("mandarin-plyfile-big.ply")
PlyData([vertices(x, y, z)], text=True).write("mandarin-plyfile-text.ply")
trimesh.PointCloud(points).export("mandarin-trimesh.ply")
np.savetxt("mandarin-numpy.xyz", np.column_stack([points, random.integers(0, 255, size=(len(x), 3))]), fmt="%.4f")

# A time-of-flight camera of 224 x 172 pixels, which writes metres: the fruit on a plate 30 mm below, noise of 0.3 mm,
# pixels without a value, and outliers of several mm. Reduced to every second row and column.
x, y = np.meshgrid((np.arange(0, 224, 2) - 112) * 0.6, (np.arange(0, 172, 2) - 86) * 0.6)
z = np.where(np.hypot(x, y) < 29, mandarin(x, y), -30.0) + 0.3 * random.normal(size=x.shape)
off = random.random(x.shape) < 0.02
z[off] += random.uniform(-8, 8, off.sum())
z[random.random(x.shape) < 0.1] = np.nan
with open("tof-semicolon.csv", "w", encoding="utf-8-sig", newline="\r\n") as file:
    file.write("# camera export\nX [m];Y [m];Z [m];confidence\n")
    for row in np.column_stack([x.ravel(), y.ravel(), z.ravel()]) / 1000:
        file.write(";".join(f"{value:.5f}".replace(".", ",") for value in row) + ";255\n")

# Meshes: a can of radius 30 mm, seen from above, as STL text and binary and as PLY.
u, v = np.meshgrid(np.radians(np.arange(-70, 71, 5)), np.arange(-40, 41, 20.0))
can = np.column_stack([30 * np.sin(u).ravel(), v.ravel(), 30 * np.cos(u).ravel()])
columns, rows = u.shape[1], u.shape[0]
faces = []
for row in range(rows - 1):
    for column in range(columns - 1):
        a = row * columns + column
        faces += [[a, a + 1, a + columns + 1], [a, a + columns + 1, a + columns]]
faces = np.array(faces)
solid = numpy_stl.Mesh(np.zeros(len(faces), dtype=numpy_stl.Mesh.dtype))
solid.vectors[:] = can[faces]
solid.save("can-numpy-stl-binary.stl", mode=Mode.BINARY)
solid.save("can-numpy-stl-text.stl", mode=Mode.ASCII)
meshio.Mesh(can, [("triangle", faces)]).write("can-meshio.ply", binary=False)
trimesh.Trimesh(can, faces, process=False).export("can-trimesh.ply", vertex_normal=True)

# Scanned meshes with noise whose triangles were reduced: a cylinder of radius 30 mm along x with 0.03 mm of noise, and a sphere of
# radius 50 mm with 0.01 mm, both about the origin.
for name, size, radius, along, noise, seed, share in [
    ("cylinder", [48, 36], 30, 0, 0.03, 1, 0.7),
    ("sphere", [36, 30], 50, 1, 0.01, 14, 0.8),
]:
    x, y = np.meshgrid(*(np.linspace(-length / 2, length / 2, 2 * length + 1) for length in size))
    z = np.sqrt(radius**2 - along * x**2 - y**2) + noise * np.random.default_rng(seed).normal(size=x.shape)
    noisy = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    corner = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    noisy, faces = fast_simplification.simplify(noisy.astype(np.float32), faces.astype(np.int32), share)
    trimesh.Trimesh(noisy, faces, process=False).export(f"{name}-reduced.ply", vertex_normal=False)
