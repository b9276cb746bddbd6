"""Compares isomark with the flattening methods of a well-known library, in one run with the same measurements.

    python3 -m venv target/peers && target/peers/bin/pip install -r benches/peers/requirements.txt
    cargo build --release && target/peers/bin/python benches/peers/flattenings.py

Three surfaces that are given by a formula are meshed. On each, isomark and the LSCM, ARAP and SLIM of libigl (Jacobson,
Panozzo and others) place the letters of examples/patterns. Neither measures itself: this script projects the images of
all pieces of the outlines (at most 0.25 mm) and of all squares of the inked area (0.2 mm) onto the formula, and compares
lengths, areas and angles with those drawn.

libigl flattens only the neighbourhood of the letters, because flattening the whole part is several times worse, and gets
the uniform scale that minimises its length error. Times are the shortest of several runs: for isomark the whole process
that reads and fits the part (one run), and the map alone as the report of a new process states it, with the surface kept;
for libigl the calls alone, on a mesh that is already in memory.
"""

import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import time

import ezdxf
import ezdxf.path
import igl
import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import Delaunay, cKDTree

PIECE, SQUARE, EDGE = 0.25, 0.2, 0.75
ROOT = pathlib.Path(__file__).resolve().parents[2]


def sphere(x, y):
    return np.sqrt(np.maximum(900 - x * x - y * y, 0))


def mandarin(x, y):
    square = x * x + y * y
    ribs = np.real((x + 1j * y) ** 10)
    return 22.5 * np.sqrt(np.maximum(1 - square / 900, 0)) + 0.06 * ribs / (square**5 + 14.0**10)


def mouse(x, y):
    y0 = y / 55
    across = x / (30 * (1 - 0.05 * y0 * y0))
    along = y0 + (6 / 55) * (1 - y0 * y0)
    inside = 1 - 0.55 * across**2 - 0.45 * across**4 - 0.5 * along**2 - 0.5 * along**4
    return 38 * np.maximum(inside, 0) ** 0.45


CASES = {"sphere": (sphere, (0.0, 0.0)), "mandarin": (mandarin, (0.0, 3.0)), "mouse": (mouse, (0.0, 8.0))}


def letters():
    """The outlines of the letters, centred on the origin, with corners at most PIECE apart."""
    outlines = []
    for entity in ezdxf.readfile(ROOT / "examples/patterns/letters.dxf").modelspace():
        path = ezdxf.path.make_path(entity)
        corners = np.array([(v.x, v.y) for v in path.flattening(0.0005)])
        if np.allclose(corners[0], corners[-1]):
            corners = corners[:-1]
        closed = np.vstack([corners, corners[:1]])
        outline = []
        for a, b in zip(closed, closed[1:]):
            count = max(1, math.ceil(np.hypot(*(b - a)) / PIECE))
            outline.extend(a + (b - a) * k / count for k in range(count))
        outlines.append(np.array(outline))
    every = np.vstack(outlines)
    middle = (every.min(0) + every.max(0)) / 2
    return [outline - middle for outline in outlines]


def squares_inside(outlines):
    """Centres of the squares of an axis-parallel grid inside the outlines by the even-odd rule."""
    every = np.vstack(outlines)
    half = np.abs(every).max(0)
    count = np.ceil(2 * half / SQUARE).astype(int)
    xs, ys = [(np.arange(n) - (n - 1) / 2) * SQUARE for n in count]
    x, y = [grid.ravel() for grid in np.meshgrid(xs, ys)]
    inside = np.zeros(x.shape, bool)
    for outline in outlines:
        for (ax, ay), (bx, by) in zip(outline, np.roll(outline, -1, 0)):
            if ay != by:
                crossed = (ay > y) != (by > y)
                inside ^= crossed & (x < ax + (y - ay) / (by - ay) * (bx - ax))
    return np.column_stack([x[inside], y[inside]])


class Drawing:
    """Letters and squares as one list of points, so that one call of a map is enough."""

    def __init__(self, at):
        self.outlines = [outline + at for outline in letters()]
        centers = squares_inside(letters()) + at
        half = SQUARE / 2
        corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
        self.squares = centers[:, None, :] + corners[None, :, :]
        self.points = np.vstack([*self.outlines, self.squares.reshape(-1, 2)])

    def judge(self, images, height):
        """e_l (mm), e_a (mm²) and the largest angular distortion over the squares (degrees)."""
        lifted = np.column_stack([images, height(images[:, 0], images[:, 1])])
        length_error, start = 0.0, 0
        for outline in self.outlines:
            on_part = lifted[start : start + len(outline)]
            start += len(outline)
            drawn = np.linalg.norm(np.roll(outline, -1, 0) - outline, axis=1)
            real = np.linalg.norm(np.roll(on_part, -1, 0) - on_part, axis=1)
            length_error += np.abs(real - drawn).sum()
        a, b, c, d = lifted[start:].reshape(-1, 4, 3).transpose(1, 0, 2)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1) + np.linalg.norm(np.cross(c - a, d - a), axis=1)
        area_error = np.abs(area / 2 - SQUARE**2).sum()
        across, up = (b - a) + (c - d), (d - a) + (c - b)
        e, f, g = (across**2).sum(1), (across * up).sum(1), (up**2).sum(1)
        twice = 2 * np.sqrt(np.maximum(e * g - f * f, 0))
        angle = 2 * np.arcsin(np.sqrt(np.maximum(e + g - twice, 0) / (e + g + twice)))
        return length_error, area_error, math.degrees(angle.max())


def graph_mesh(height, low, high):
    """The graph of `height` over a rectangle, in rows of nearly equilateral triangles with edges of about EDGE."""
    columns = math.ceil((high[0] - low[0]) / EDGE)
    rows = math.ceil((high[1] - low[1]) / (EDGE * math.sqrt(0.75)))
    row, column = np.meshgrid(np.arange(rows + 1), np.arange(columns + 1), indexing="ij")
    x = low[0] + (column + 0.5 * (row % 2)) * (high[0] - low[0]) / columns
    y = low[1] + row * (high[1] - low[1]) / rows
    points = np.column_stack([x.ravel(), y.ravel()])
    faces = Delaunay(points).simplices
    a, b, c = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    faces[twice < 0] = faces[twice < 0][:, ::-1]
    # The convex hull of shifted rows has slivers at its sides.
    faces = faces[np.abs(twice) > 0.2 * EDGE**2]
    used = np.unique(faces)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    points = points[used]
    return np.column_stack([points, height(points[:, 0], points[:, 1])]), number[faces].astype(np.int64)


class Isomark:
    """Runs isomark on files."""

    def __init__(self, program, folder, runs):
        self.program, self.folder, self.runs = program, folder, runs

    def images(self, name, height, at, method):
        drawing = Drawing(np.array(at))
        # A disc instead of a rectangle: most parts look like that from above.
        part = self.folder / f"{name}.obj"
        if not part.exists():
            vertices, faces = graph_mesh(height, (-28.5, -28.5), (28.5, 28.5))
            disc = np.hypot(vertices[:, 0], vertices[:, 1]) <= 28.5
            faces = faces[disc[faces].all(1)]
            with open(part, "w", encoding="ascii") as file:
                file.writelines("v %.9f %.9f %.9f\n" % tuple(v) for v in vertices)
                file.writelines("f %d %d %d\n" % tuple(f + 1) for f in faces)
        pattern, corrected = self.folder / "letters.dxf", self.folder / "corrected.dxf"
        document = ezdxf.new("R2000", units=4)
        space = document.modelspace()
        for outline in drawing.outlines:
            space.add_lwpolyline(outline, close=True, dxfattribs={"layer": "INK"})
        for square in drawing.squares:
            space.add_lwpolyline(square, close=True, dxfattribs={"layer": "SQUARES"})
        document.saveas(pattern)
        report = self.folder / "report.json"
        command = [self.program, "correct", part, pattern, "-o", corrected, "--report", report]
        command += ["--ink-layers", "INK", "--vertices", "keep", "--cache", self.folder / "cache", *method]
        whole, mapped = None, math.inf
        for _ in range(self.runs):
            begin = time.perf_counter()
            done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
            whole = whole or time.perf_counter() - begin
            if done.returncode != 0:
                sys.exit(f"isomark failed on {name}: {done.stderr}")
            timings = {entry["stage"]: entry["ms"] for entry in json.loads(report.read_text())["timings"]}
            mapped = min(mapped, timings.get("map", 0.0))
        images = {"INK": [], "SQUARES": []}
        for entity in ezdxf.readfile(corrected).modelspace():
            images[entity.dxf.layer].append(np.array([(x, y) for x, y, *_ in entity.get_points()]))
        images = np.vstack(images["INK"] + images["SQUARES"])
        assert images.shape == drawing.points.shape, (images.shape, drawing.points.shape)
        return drawing, images, mapped, whole


def inverse_of(flat, vertices, faces, points):
    """The points of the view that belong to points of the flattened mesh, linear in each triangle."""
    a, b, c = (flat[faces[:, k]] for k in range(3))
    u, v = b - a, c - a
    twice = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    near = cKDTree((a + b + c) / 3).query(points, k=12)[1]
    images = np.full((len(points), 2), np.nan)
    best = np.full(len(points), -np.inf)
    for column in near.T:
        w = points - a[column]
        s = (w[:, 0] * v[column, 1] - w[:, 1] * v[column, 0]) / twice[column]
        t = (u[column, 0] * w[:, 1] - u[column, 1] * w[:, 0]) / twice[column]
        inside = np.minimum(np.minimum(s, t), 1 - s - t)
        better = inside > best
        corners = [vertices[faces[column, k], :2] for k in range(3)]
        image = corners[0] * (1 - s - t)[:, None] + corners[1] * s[:, None] + corners[2] * t[:, None]
        images[better] = image[better]
        best = np.maximum(best, inside)
    if best.min() < -0.05:
        sys.exit(f"the neighbourhood is too small for the letters ({best.min():.2f})")
    return images


def lscm(vertices, faces):
    loop = igl.boundary_loop(faces)
    far = loop[len(loop) // 2]
    fixed = np.array([loop[0], far], dtype=np.int64)
    distance = np.linalg.norm(vertices[loop[0]] - vertices[far])
    return igl.lscm(vertices, faces, fixed, np.array([[0.0, 0.0], [distance, 0.0]]))[0]


def arap(vertices, faces, steps=100):
    start = lscm(vertices, faces)
    data = igl.ARAPData()
    # Fixing one vertex has no effect on the energy, because shifting all vertices does not change it.
    held = np.array([len(vertices) // 2], dtype=np.int32)
    igl.arap_precomputation(vertices, faces, 2, held, data)
    flat = start
    for _ in range(steps):
        flat = igl.arap_solve(start[held], data, flat)
    return flat


def slim(vertices, faces, steps=40):
    start = lscm(vertices, faces)
    data = igl.slim_precompute(
        np.asfortranarray(vertices),
        np.asfortranarray(faces.astype(np.int32)),
        np.asfortranarray(start),
        igl.MappingEnergyType.SYMMETRIC_DIRICHLET,
        np.zeros(0, dtype=np.int32),
        np.asfortranarray(np.zeros((0, 2))),
        0.0,
    )
    return igl.slim_solve(data, steps)[:, :2]


def flattened(method, height, at, runs):
    """The images of the drawing's points by libigl, with the best scale, and the shortest time of several runs."""
    drawing = Drawing(np.array(at))
    reach = np.abs(drawing.points - at).max(0) + 3 * EDGE
    vertices, faces = graph_mesh(height, np.array(at) - reach, np.array(at) + reach)
    elapsed = math.inf
    for _ in range(runs):
        begin = time.perf_counter()
        flat = method(vertices, faces)
        elapsed = min(elapsed, time.perf_counter() - begin)
    # A flattening may be rotated, mirrored and shifted: it is placed so that the anchor and the x direction there agree.
    where = np.linalg.norm(vertices[:, :2] - at, axis=1).argsort()[:12]
    source = np.column_stack([vertices[where, :2] - at, np.ones(len(where))])
    jacobian = np.linalg.lstsq(source, flat[where], rcond=None)[0]
    linear, origin = jacobian[:2].T, jacobian[2]
    if np.linalg.det(linear) < 0:
        flat, linear, origin = flat * (1, -1), linear * ((1,), (-1,)), origin * (1, -1)
    turn = -math.atan2(linear[1, 0], linear[0, 0])
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    flat = (flat - origin) @ rotation.T

    def at_scale(scale):
        images = inverse_of(flat * scale + at, vertices, faces, drawing.points)
        return images, drawing.judge(images, height)

    def area_of(points):
        a, b, c = (points[faces[:, k]] for k in range(3))
        return np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum()

    lying = np.column_stack([flat, np.zeros(len(flat))])
    even = math.sqrt(area_of(vertices) / area_of(lying))
    found = minimize_scalar(lambda s: at_scale(s)[1][0], bounds=(even * 0.98, even * 1.02), method="bounded",
                            options={"xatol": 1e-5})
    return at_scale(found.x)[1], elapsed, len(faces)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--isomark", default=ROOT / "target/release/isomark", help="the built program")
    arguments.add_argument("--runs", type=int, default=20, help="runs of which the shortest counts")
    arguments.add_argument("--json", action="store_true", help="print the rows as JSON")
    arguments = arguments.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        isomark = Isomark(arguments.isomark, pathlib.Path(folder), arguments.runs)
        for name, (height, at) in CASES.items():
            for label, method in {
                "isomark, ink": ["--method", "isometric"],
                "isomark, uniform": ["--method", "isometric", "--weighting", "uniform"],
                "no correction": ["--method", "none"],
            }.items():
                drawing, images, mapped, whole = isomark.images(name, height, at, method)
                figures = drawing.judge(images, height)
                rows.append((name, label, *figures, mapped, f"whole process {1e3 * whole:.0f} ms"))
            for label, peer in {"libigl LSCM": lscm, "libigl ARAP": arap, "libigl SLIM": slim}.items():
                figures, elapsed, count = flattened(peer, height, at, arguments.runs)
                rows.append((name, label, *figures, 1e3 * elapsed, f"{count} triangles"))
    if arguments.json:
        keys = ("case", "method", "length_error_mm", "area_error_mm2", "angle_error_deg", "map_ms", "remark")
        print(json.dumps([dict(zip(keys, row)) for row in rows], indent=1))
        return
    print(f"{'case':<10}{'method':<18}{'e_l mm':>9}{'e_a mm2':>9}{'angle':>8}{'map ms':>9}  {'e_l x':>6}")
    for row in rows:
        case, label, length, area, angle, elapsed, remark = row
        ours = next(r[2] for r in rows if r[0] == case and r[1] == "isomark, ink")
        print(f"{case:<10}{label:<18}{length:9.3f}{area:9.3f}{angle:7.2f}°{elapsed:9.1f}  {length / ours:6.1f}  {remark}")


if __name__ == "__main__":
    main()
