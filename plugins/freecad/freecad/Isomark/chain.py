# SPDX-License-Identifier: MIT OR Apache-2.0
"""Joins pieces of curves that share their ends into paths."""

#: Ends that are at most this far apart are the same point, mm.
SAME = 1e-4


def chained(pieces):
    """The paths that the pieces form, each a list of corners and whether it is closed.

    A piece is a list of corners (x, y, bulge) of which the last has no bulge. Pieces are joined where exactly two ends
    meet; at a branch they stay apart.
    """
    pieces = [piece for piece in pieces if len(piece) > 1]
    closed = [piece for piece in pieces if _near(piece[0], piece[-1]) and _has_extent(piece)]
    paths = [(_welded(piece), True) for piece in closed]
    open_pieces = [piece for piece in pieces if not _near(piece[0], piece[-1])]
    ends = {}
    for number, piece in enumerate(open_pieces):
        for at_end in (False, True):
            key = _node(ends, piece[-1] if at_end else piece[0])
            ends[key].append((number, at_end))
    next_of = {}
    for meeting in ends.values():
        if len(meeting) == 2:
            next_of[meeting[0]], next_of[meeting[1]] = meeting[1], meeting[0]
    used = set()
    # Open chains start at an end without a neighbour, the rest are closed.
    starts = [(n, e) for n in range(len(open_pieces)) for e in (False, True) if (n, e) not in next_of]
    starts += [(n, False) for n in range(len(open_pieces))]
    for start in starts:
        if start[0] not in used:
            paths.append(_follow(open_pieces, next_of, used, start))
    return paths


def _follow(pieces, next_of, used, start):
    corners = []
    entry = start
    while True:
        number, from_end = entry
        used.add(number)
        piece = _reversed(pieces[number]) if from_end else pieces[number]
        corners = corners[:-1] + piece
        entry = next_of.get((number, not from_end))
        if entry is None:
            return corners, False
        if entry[0] in used:
            return _welded(corners), True


def _reversed(piece):
    """The same piece from its end to its start: every bulge changes its sign and moves to the other end of its arc."""
    turned = [(x, y, 0.0) for x, y, _ in reversed(piece)]
    for number in range(len(piece) - 1):
        x, y, _ = turned[number]
        turned[number] = (x, y, -piece[len(piece) - 2 - number][2])
    return turned


def _welded(corners):
    """A closed path does not repeat its first corner."""
    return corners[:-1]


def _near(a, b):
    return abs(a[0] - b[0]) <= SAME and abs(a[1] - b[1]) <= SAME


def _has_extent(piece):
    return len(piece) > 2


def _node(ends, corner):
    """The key of the meeting point at the corner; points in neighbouring cells of the grid are found, too."""
    column, row = round(corner[0] / SAME), round(corner[1] / SAME)
    for key in ((column + i, row + j) for i in (0, -1, 1) for j in (0, -1, 1)):
        if key in ends:
            return key
    ends[(column, row)] = []
    return (column, row)
