# SPDX-License-Identifier: MIT OR Apache-2.0
"""The marking frame: where the drawing's origin is on the part, where its x points and where the laser is. mm."""

import math

#: How far two frames may differ and be the same: their origins in mm, their axes as the cosine of the angle.
SAME_ORIGIN, SAME_AXIS = 0.02, 0.999999


def add(a, b):
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scaled(a, factor):
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    length = math.sqrt(dot(a, a))
    if length == 0.0:
        raise ValueError("a vector of length zero has no direction")
    return scaled(a, 1.0 / length)


class Frame:
    """A right-handed frame: its +Z points to the laser, its +X is the drawing's x."""

    def __init__(self, origin, z, x):
        self.origin = tuple(origin)
        self.z = unit(z)
        # x is made perpendicular to z, so that rounding in a placement does not matter.
        self.x = unit(subtract(x, scaled(self.z, dot(x, self.z))))
        self.y = cross(self.z, self.x)

    @classmethod
    def on_surface(cls, point, normal):
        """A frame at a point of a surface, upright in the view: its y is as close to +Z of the document as possible.

        On a horizontal surface, its y is +Y of the document.
        """
        normal = unit(normal)
        up = (0.0, 0.0, 1.0) if abs(normal[2]) < 0.99 else (0.0, 1.0, 0.0)
        return cls(point, normal, cross(up, normal))

    def other_side(self):
        """The same frame, seen from behind: turned by 180° about its y."""
        return Frame(self.origin, scaled(self.z, -1.0), scaled(self.x, -1.0))

    def is_same(self, other):
        """Whether another frame has the same origin and axes."""
        away = subtract(self.origin, other.origin)
        axes = min(dot(self.z, other.z), dot(self.x, other.x))
        return dot(away, away) <= SAME_ORIGIN**2 and axes >= SAME_AXIS

    def local(self, point):
        """The coordinates of a point of the document in this frame."""
        from_origin = subtract(point, self.origin)
        return (dot(from_origin, self.x), dot(from_origin, self.y), dot(from_origin, self.z))

    def document(self, point):
        """The coordinates in the document of a point in this frame."""
        u, v, w = point
        return add(self.origin, add(scaled(self.x, u), add(scaled(self.y, v), scaled(self.z, w))))
