"""Surfaces that are given by formulas, and their shapes in FreeCAD; lengths are measured on the formula."""

import math
import random

import FreeCAD
import Part

Vector = FreeCAD.Vector


class Can:
    """An upright cylinder about the z axis."""

    def __init__(self, radius, height):
        self.radius, self.height = radius, height

    def shape(self):
        return Part.makeCylinder(self.radius, self.height)

    def outside(self, p):
        """How far a point is outside, mm; negative inside."""
        return math.hypot(p[0], p[1]) - self.radius


class Cone:
    """An upright cone about the z axis."""

    def __init__(self, below, above, height):
        self.below, self.above, self.height = below, above, height

    def shape(self):
        return Part.makeCone(self.below, self.above, self.height)

    def outside(self, p):
        radius = self.below + (self.above - self.below) * p[2] / self.height
        return math.hypot(p[0], p[1]) - radius


class Mouse:
    """The back of a computer mouse, 60 x 110 x 38 mm: the formula of isomark's own reference shapes."""

    def height(self, x, y):
        y0 = y / 55.0
        across = x / (30.0 * (1.0 - 0.05 * y0 * y0))
        along = y0 + (6.0 / 55.0) * (1.0 - y0 * y0)
        inside = 1.0 - 0.55 * across**2 - 0.45 * across**4 - 0.5 * along**2 - 0.5 * along**4
        return 38.0 * max(inside, 0.0) ** 0.45

    def shape(self):
        xs = [x * 0.5 for x in range(-46, 47, 3)]
        ys = [y * 0.5 for y in range(-76, 77, 3)]
        surface = Part.BSplineSurface()
        surface.interpolate([[Vector(x, y, self.height(x, y)) for y in ys] for x in xs])
        return surface.toShape()

    def outside(self, p):
        return p[2] - self.height(p[0], p[1])


def lifted(surface, placement, frame, x, y):
    """The point of the surface under a point of the field, in the document, or None.

    The field has the axes of the frame, and its zero is that of the document. The laser is at +z of the frame.
    """
    turn = placement.inverse()
    base = [frame.x[i] * x + frame.y[i] * y for i in range(3)]

    def outside(depth):
        return surface.outside(turn.multVec(Vector(*(base[i] + frame.z[i] * depth for i in range(3)))))

    depth = 300.0
    while outside(depth) > 0.0:
        depth -= 1.0
        if depth < -300.0:
            return None
    low, high = depth, depth + 1.0
    for _ in range(45):
        middle = (low + high) / 2.0
        low, high = (middle, high) if outside(middle) < 0.0 else (low, middle)
    return tuple(base[i] + frame.z[i] * low for i in range(3))


def length_on(surface, placement, frame, corners, closed):
    """The length on the surface of a polyline of the field, mm."""
    if closed:
        corners = corners + corners[:1]
    total, last = 0.0, None
    for (x0, y0), (x1, y1) in zip(corners, corners[1:]):
        pieces = max(1, math.ceil(math.hypot(x1 - x0, y1 - y0) / 0.25))
        for piece in range(pieces + 1):
            if piece == 0 and last is not None:
                continue
            t = piece / pieces
            point = lifted(surface, placement, frame, x0 + (x1 - x0) * t, y0 + (y1 - y0) * t)
            if point is None:
                raise AssertionError("the corrected drawing leaves the surface at %.3f, %.3f" % (x0, y0))
            if last is not None:
                total += math.dist(last, point)
            last = point
    return total


def polylines(data):
    """The corners of all LWPOLYLINE and POINT entities of a DXF file in order, and whether each is closed."""
    lines = [line.strip() for line in data.decode("ascii", "replace").splitlines()]
    groups = [(int(code), value) for code, value in zip(lines[::2], lines[1::2]) if code]
    found, kind = [], ""
    section = ""
    for number, (code, value) in enumerate(groups):
        if code == 2 and groups[number - 1] == (0, "SECTION"):
            section = value
        if section != "ENTITIES":
            continue
        if code == 0:
            kind = value
            if kind in ("LWPOLYLINE", "POINT"):
                found.append(([], False))
        elif kind in ("LWPOLYLINE", "POINT"):
            corners, closed = found[-1]
            if code == 10:
                corners.append([float(value), 0.0])
            elif code == 20:
                corners[-1][1] = float(value)
            elif code == 70:
                found[-1] = (corners, value == "1")
    return [([tuple(corner) for corner in corners], closed) for corners, closed in found]


def any_rotation(seed):
    """A rotation that is the same in every run."""
    numbers = random.Random(seed)
    return FreeCAD.Rotation(*(numbers.uniform(-180.0, 180.0) for _ in range(3)))
