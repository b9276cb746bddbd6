# SPDX-License-Identifier: GPL-3.0-or-later
"""Bezier curves and NURBS to points, closer than a tolerance to the curve."""

import math

import numpy as np

# Greatest distance between a curve and its points, mm. A full turn of a curve loses twice this length.
TOLERANCE = 0.0005
# Most pieces of one Bezier segment or of one span of a NURBS.
MOST_PIECES = 2000


def bezier(knots, lefts, rights, closed):
    """Points of a Bezier spline: its knots with their left and right handles, all as arrays of mm."""
    count = len(knots)
    points = [knots[:1]]
    for start in range(count if closed else count - 1):
        end = (start + 1) % count
        points.append(_cubic(np.array([knots[start], rights[start], lefts[end], knots[end]])))
    points = np.vstack(points)
    return points[:-1] if closed and count > 1 else points


def _cubic(control):
    """Points of a cubic segment without the first."""
    if _is_straight(control):
        return control[3:]
    bend = np.linalg.norm(control[:-2] - 2 * control[1:-1] + control[2:], axis=1).max()
    # Wang's bound: a cubic with second differences up to `bend`, cut into n equal pieces, is closer than
    # 3/4 bend / n² to its chords.
    pieces = min(MOST_PIECES, max(1, math.ceil(math.sqrt(0.75 * bend / TOLERANCE))))
    t = np.linspace(0, 1, pieces + 1)[1:, None]
    a, b, c, d = control
    return (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t ** 2 * c + t ** 3 * d


def _is_straight(control):
    """Whether both handles are on the chord."""
    chord = control[3] - control[0]
    length = np.linalg.norm(chord)
    if length < 1e-9:
        return bool(np.linalg.norm(control - control[0], axis=1).max() < 1e-9)
    handles = control[1:3] - control[0]
    along = handles @ chord / length
    across = np.linalg.norm(handles - np.outer(along / length, chord), axis=1)
    return bool(across.max() < 1e-7 and along.min() >= 0 and along.max() <= length)


def nurbs(control, weights, order, closed, clamped, piecewise):
    """Points of a NURBS as Blender draws it: `clamped` is its option Endpoint, `piecewise` its option Bezier.

    Like Blender, joins the control points where their number does not fit the options.
    """
    count = len(control)
    whole = not (piecewise and closed) or (count > order and count % (order - 1) == 0)
    if order < 2 or count < order or not whole:
        return control
    knots = _knots(count, order, closed, clamped, piecewise)
    if closed:
        control, weights = np.vstack([control, control[:order - 1]]), np.append(weights, weights[:order - 1])
    homogeneous = np.column_stack([control * weights[:, None], weights])
    # With the option Bezier, the last control points may be left over.
    spans = [span for span in range(order - 1, len(control)) if knots[span + 1] > knots[span]]
    if not spans:
        return control
    points = [_rational(homogeneous, knots, order, spans[0], np.array([knots[spans[0]]]))]
    points = np.vstack([*points, *(_span(homogeneous, knots, order, span) for span in spans)])
    return points[:-1] if closed else points


def _knots(count, order, closed, clamped, piecewise):
    """The knot vector: every value is repeated `inner` times, the first one `head` times. A closed one repeats its first
    differences at its end, a clamped one ends with `order` equal knots."""
    inner = order - 1 if piecewise else 1
    head = order - int(closed) if clamped else min(2, inner)
    tail = 2 * order - 1 if closed else order if clamped else 0
    total = count + order + (order - 1 if closed else 0)
    lead = [0.0] if clamped and closed else []
    value, values = float(len(lead)), list(lead)
    left = head
    while len(values) < total - tail:
        values.append(value)
        left -= 1
        if left == 0:
            value, left = value + 1, inner
    # The tail refers to the first knots, which it may reach itself.
    for index in range(tail):
        values.append(value + values[index] - values[0])
    return values


def _span(homogeneous, knots, order, span):
    """Points of one polynomial piece without the first, refined until the chords are close to the curve."""
    begin, end = knots[span], knots[span + 1]
    if order == 2:
        return _rational(homogeneous, knots, order, span, np.array([end]))
    pieces = 4
    while True:
        t = np.linspace(begin, end, 2 * pieces + 1)
        points = _rational(homogeneous, knots, order, span, t)
        middles = (points[:-2:2] + points[2::2]) / 2
        sag = np.linalg.norm(points[1::2] - middles, axis=1).max()
        # The points between are kept, which leaves a quarter of this sag.
        if sag <= 4 * TOLERANCE or pieces >= MOST_PIECES:
            return points[1:]
        pieces = min(MOST_PIECES, max(pieces + 1, math.ceil(pieces * math.sqrt(sag / (4 * TOLERANCE)) * 1.05)))


def _rational(homogeneous, knots, order, span, t):
    """De Boor's algorithm at all parameters at the same time."""
    degree = order - 1
    rows = [np.repeat(homogeneous[span - degree + index][None], len(t), axis=0) for index in range(order)]
    for level in range(1, order):
        for index in range(degree, level - 1, -1):
            low, high = knots[span - degree + index], knots[span + 1 + index - level]
            share = ((t - low) / (high - low))[:, None] if high > low else np.zeros((len(t), 1))
            rows[index] = (1 - share) * rows[index - 1] + share * rows[index]
    return rows[degree][:, :-1] / rows[degree][:, -1:]


def chains(edges):
    """Edges, given as pairs of points, joined where two of them meet: for each chain its points, and whether it is closed."""
    meeting = {}
    for number, edge in enumerate(edges):
        for point in edge:
            meeting.setdefault(point, []).append(number)
    # From the ends first; what is then left are rings.
    starts = [point for point in meeting if len(meeting[point]) != 2] + list(meeting)
    found, is_used = [], [False] * len(edges)
    for start in starts:
        for number in meeting[start]:
            chain = [start]
            while not is_used[number]:
                is_used[number] = True
                first, second = edges[number]
                chain.append(second if chain[-1] == first else first)
                if len(meeting[chain[-1]]) == 2:
                    number = sum(meeting[chain[-1]]) - number
            if len(chain) > 1:
                is_ring = len(chain) > 3 and chain[0] == chain[-1]
                found.append((chain[:-1] if is_ring else chain, is_ring))
    return found
