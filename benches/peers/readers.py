"""Checks isomark's drawings with other programs: entity counts, extents and printed pictures.

    sudo apt-get install --no-install-recommends gdal-bin libdxflib-dev librecad poppler-utils freecad g++
    python3 -m venv target/peers && target/peers/bin/pip install -r benches/peers/requirements.txt
    cargo build --release && target/peers/bin/python benches/peers/readers.py

Every drawing of tests/data/patterns is placed on a plane, in each DXF version that isomark writes. ezdxf must find nothing
to repair; GDAL, dxflib and FreeCAD's importer must find the same number of entities and the same extents; and LibreCAD must
print ink exactly where ezdxf has lines. Readers that are not installed are skipped. Exits with 1 if a reader disagrees.
"""

import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

import ezdxf
import numpy as np
from scipy.ndimage import distance_transform_edt

ROOT = pathlib.Path(__file__).resolve().parents[2]
VERSIONS = ["R2000", "R12", "R12-lines"]
# Extents may differ by this, mm: FreeCAD keeps seven digits of a coordinate.
CLOSE = 1e-4
# Ink and lines may be this far apart, pixels: half the width of the printed line plus rounding.
PIXELS = 4.0

PLANE = "v -300 -300 0\nv 300 -300 0\nv 300 300 0\nv -300 300 0\nf 1 2 3\nf 1 3 4\n"

COUNTER = r"""
#include <dxflib/dl_creationadapter.h>
#include <dxflib/dl_dxf.h>
#include <algorithm>
#include <cstdio>
struct Counter : DL_CreationAdapter {
    int count = 0;
    double box[4] = {1e300, 1e300, -1e300, -1e300};
    void see(double x, double y) {
        box[0] = std::min(box[0], x); box[1] = std::min(box[1], y);
        box[2] = std::max(box[2], x); box[3] = std::max(box[3], y);
    }
    void addLine(const DL_LineData& d) override { count++; see(d.x1, d.y1); see(d.x2, d.y2); }
    void addPoint(const DL_PointData& d) override { count++; see(d.x, d.y); }
    void addPolyline(const DL_PolylineData&) override { count++; }
    void addVertex(const DL_VertexData& d) override { see(d.x, d.y); }
};
int main(int, char** files) {
    Counter counter;
    DL_Dxf dxf;
    if (!dxf.in(files[1], &counter)) return 1;
    std::printf("[%d, [%.9f, %.9f, %.9f, %.9f]]\n", counter.count, counter.box[0], counter.box[1], counter.box[2], counter.box[3]);
}
"""

FREECAD = r"""
import json, os, FreeCAD, Import
parameters = FreeCAD.ParamGet("User parameter:BaseApp/Preferences/Mod/Draft")
for name in ["joingeometry", "groupLayers", "dxfCreateDraft"]:
    parameters.SetBool(name, False)
document = FreeCAD.newDocument("seen")
Import.readDXF(os.environ["DRAWING"], "seen")
shapes = [part.Shape for part in document.Objects if hasattr(part, "Shape") and not part.Shape.isNull()]
xs, ys = [], []
for shape in shapes:
    for vertex in shape.Vertexes:
        xs.append(vertex.X); ys.append(vertex.Y)
edges = sum(len(shape.Edges) + (len(shape.Vertexes) if not shape.Edges else 0) for shape in shapes)
open(os.environ["ANSWER"], "w").write(json.dumps([edges, [min(xs), min(ys), max(xs), max(ys)]]))
os._exit(0)
"""


def run(command, **options):
    return subprocess.run(
        command, check=True, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=300, **options
    ).stdout


def lines_of(file):
    """The entities as arrays of points (contours end with their first point), and the number of repairs by ezdxf."""
    document = ezdxf.readfile(file)
    auditor = document.audit()
    lines = []
    for entity in document.modelspace():
        kind = entity.dxftype()
        if kind == "LWPOLYLINE":
            points, closed = list(entity.get_points("xy")), entity.closed
        elif kind == "POLYLINE":
            points, closed = [tuple(v.dxf.location)[:2] for v in entity.vertices], entity.is_closed
        elif kind == "LINE":
            points, closed = [tuple(entity.dxf.start)[:2], tuple(entity.dxf.end)[:2]], False
        else:
            points, closed = [tuple(entity.dxf.location)[:2]], False
        lines.append(np.array(points + points[:1] if closed else points, dtype=float))
    return lines, len(auditor.errors) + len(auditor.fixes)


def by_gdal(file, _folder):
    output = run(["ogrinfo", "-ro", "-al", "-so", file])
    count = int(re.search(r"Feature Count: (\d+)", output)[1])
    box = re.search(r"Extent: \((.*), (.*)\) - \((.*), (.*)\)", output)
    return count, [float(edge) for edge in box.groups()]


def by_dxflib(file, folder):
    counter = folder / "counter"
    if not counter.exists():
        (folder / "counter.cpp").write_text(COUNTER)
        run(["g++", "-O1", "-o", counter, folder / "counter.cpp", "-ldxflib"])
    return tuple(json.loads(run([counter, file])))


def by_freecad(file, folder):
    script, answer = folder / "see.py", folder / "answer.json"
    script.write_text(FREECAD)
    answer.unlink(missing_ok=True)
    run(["freecadcmd", script], env=os.environ | {"DRAWING": str(file), "ANSWER": str(answer)})
    return tuple(json.loads(answer.read_text()))


def picture_of(file, folder, size):
    """LibreCAD's print in true size, or scaled to fit A4, as an array that is true where there is ink."""
    for old in folder.glob("*.pdf"):
        old.unlink()
    scale = min(1.0, 180 / size[0], 270 / max(size[1], 1e-9))
    command = ["librecad", "dxf2pdf", "-c", "-m", "-s", f"{scale:.6f}", "-t", folder, file]
    run(command, env=os.environ | {"QT_QPA_PLATFORM": "offscreen"})
    pdf = next(folder.glob("*.pdf"))
    run(["pdftoppm", "-r", "300", "-gray", "-singlefile", pdf, folder / "picture"])
    data = (folder / "picture.pgm").read_bytes()
    width, height = (int(number) for number in data.split(None, 3)[1:3])
    return np.frombuffer(data[-width * height :], dtype=np.uint8).reshape(height, width) < 128


def apart(ink, lines):
    """The largest distance from ink to lines or from lines to ink, pixels, after scaling both to the same box."""
    rows, columns = np.nonzero(ink)
    corner = np.array([columns.min(), rows.max()], dtype=float)
    size = np.array([np.ptp(columns), np.ptp(rows)], dtype=float)
    everything = np.concatenate(lines)
    low, extent = everything.min(axis=0), np.ptp(everything, axis=0)
    scale = np.max(size) / np.max(extent)
    drawn = np.zeros_like(ink)
    for line in lines:
        steps = [np.linspace(a, b, 2 + int(scale * np.hypot(*(b - a)))) for a, b in zip(line, line[1:])] or [line]
        at = (np.concatenate(steps) - low) * scale
        x, y = np.rint(corner[0] + at[:, 0]).astype(int), np.rint(corner[1] - at[:, 1]).astype(int)
        drawn[np.clip(y, 0, ink.shape[0] - 1), np.clip(x, 0, ink.shape[1] - 1)] = True
    return max(distance_transform_edt(~ink)[drawn].max(), distance_transform_edt(~drawn)[ink].max())


def main():
    binary = ROOT / "target/release/isomark"
    readers = {"ogrinfo": by_gdal, "freecadcmd": by_freecad}
    readers = {name: reader for name, reader in readers.items() if shutil.which(name)}
    if pathlib.Path("/usr/include/dxflib").exists() and shutil.which("g++"):
        readers["dxflib"] = by_dxflib
    has_librecad = bool(shutil.which("librecad") and shutil.which("pdftoppm"))
    print("readers:", ", ".join(["ezdxf", *readers] + ["librecad"] * has_librecad))
    wrong, judged = [], 0
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        part = folder / "plane.obj"
        part.write_text(PLANE)
        for version in VERSIONS:
            station = folder / "station.toml"
            station.write_text(
                '[station]\nname = "peers"\n[folders]\nhot = "hot"\nimport = "import"\n[field]\nwidth_mm = 700\n'
                f'height_mm = 700\n[output]\ndxf = "{version}"\n'
            )
            for pattern in sorted((ROOT / "tests/data/patterns").glob("*.dxf")):
                out = folder / "out.dxf"
                command = [binary, "correct", "--station", station, "--cache", folder / "cache", "--place", "0,0"]
                command += ["--part-unit", "mm", "--part-up", "z", "--out", out, part, pattern]
                out.unlink(missing_ok=True)
                done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
                if done.returncode != 0:
                    print(f"{version} {pattern.stem}: {done.stderr.splitlines()[0]}")
                    continue
                judged += 1
                lines, repairs = lines_of(out)
                if repairs:
                    wrong.append(f"{version} {pattern.stem}: ezdxf would repair {repairs}")
                points = np.concatenate(lines)
                box = [*points.min(axis=0), *points.max(axis=0)]
                sides = sum(max(len(line) - 1, 1) for line in lines)
                for reader, look in readers.items():
                    try:
                        count, seen = look(out, folder)
                    except (subprocess.SubprocessError, OSError, TypeError, ValueError) as error:
                        wrong.append(f"{version} {pattern.stem}: {reader} failed: {error}")
                        continue
                    # FreeCAD counts the sides of polylines, the other readers the entities.
                    expected = sides if reader == "freecadcmd" else len(lines)
                    off = max(abs(a - b) for a, b in zip(seen, box))
                    if count != expected or off > CLOSE:
                        wrong.append(f"{version} {pattern.stem}: {reader} finds {count} of {expected}, extents differ by {off:.6f} mm")
                if has_librecad:
                    off = apart(picture_of(out, folder, np.ptp(points, axis=0)), lines)
                    if off > PIXELS:
                        wrong.append(f"{version} {pattern.stem}: LibreCAD's ink is {off:.1f} pixels from the lines")
    print(f"{judged} drawings checked, {len(wrong)} differences")
    print(*wrong, sep="\n")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
