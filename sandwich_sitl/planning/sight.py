"""What a node of the mapped grid sees through its cells: the links of the paper's A* beyond its eight neighbours.

Eight neighbours leave gaps between their directions, up to 45 degrees where cells are square and more where they are
long or sheared, and a path pays for every gap. So between two neighbouring links further apart than `_WIDE_RAD`, a node
is also linked with the nodes that it sees between them. It looks through the sides of its cells, cell by cell, by cones
of sight that split at the corners met on the way. Cells are convex and a side that two cells share has free ground on
both, so a chord to a corner inside its cone lies in the cells it passes: exactly free, no obstacle is looked at. A
wall's sides are shared by no two cells, which bars the crossing.

State: nodes `xy` (N, 2) metres; cells `quads` (C, 4), counter-clockwise; side k of a cell runs from corner k to k + 1.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]

_WIDE_RAD = np.radians(36.0)  # a gap between links that is looked into
_NARROW_RAD = np.radians(8.0)  # links are not nearer to each other than this, but for those of one cell
_WIDE, _NARROW = float(np.tan(_WIDE_RAD)), float(np.tan(_NARROW_RAD))
_MOST_CELLS = 8  # looked into between two links
_ROOM = 4 * _MOST_CELLS
_ON_SIDE = 1e-9  # sine between the directions to a side's ends, seen from a point on it


@njit(cache=True, nogil=True)
def across_sides(quads: Ints, first: Ints, around: Ints) -> Ints32:
    """For each side of each cell (C, 4) what lies across: 4 * cell + its side, or -1 where there is no cell.

    Rows `around[first[n] : first[n + 1]]` are the cells at node n.
    """
    across = np.full(quads.shape, -1, dtype=np.int32)
    for cell in range(len(quads)):
        for k in range(4):
            start, end = quads[cell, k], quads[cell, (k + 1) % 4]
            for m in range(first[start], first[start + 1]):
                other = around[m]
                for side in range(4):
                    if quads[other, side] == end and quads[other, (side + 1) % 4] == start:
                        across[cell, k] = 4 * other + side
    return across


@njit(cache=True, nogil=True)
def linked_pairs(xy: Array, quads: Ints, across: Ints32, wide: bool) -> Ints32:
    """Pairs of nodes (E, 2) to link, some of them twice: corners of one cell and, if `wide`, nodes seen in wide gaps."""
    pairs = np.empty((16 * len(quads) + 256, 2), dtype=np.int32)
    cone, place = np.empty((_ROOM, 4)), np.empty(_ROOM, dtype=np.int32)
    seen = np.empty(_ROOM, dtype=np.int32)
    count = 0
    for cell in range(len(quads)):
        if count + 256 > len(pairs):
            pairs = np.concatenate((pairs, np.empty_like(pairs)))
        for k in range(4):
            node = quads[cell, k]
            for step in range(1, 4 - k):
                pairs[count, 0], pairs[count, 1] = node, quads[cell, k + step]
                count += 1
            for side in ((k + 1) % 4, (k + 2) % 4):
                if wide and _wide(xy, quads, across, xy[node, 0], xy[node, 1], cell, side):
                    found = _look(xy, quads, across, xy[node, 0], xy[node, 1], cell, side, cone, place, seen, 0)
                    for m in range(found):
                        pairs[count, 0], pairs[count, 1] = node, seen[m]
                        count += 1
    return pairs[:count]


@njit(cache=True, nogil=True)
def seen_from(xy: Array, quads: Ints, across: Ints32, cells: Ints, x: float, y: float, wide: bool) -> Ints:
    """Nodes to link a point with that lies in `cells`: their corners and, if `wide`, nodes seen in wide gaps."""
    cone, place = np.empty((_ROOM, 4)), np.empty(_ROOM, dtype=np.int32)
    seen = np.empty(len(cells) * 4 * (_ROOM + 1), dtype=np.int32)
    count = 0
    for cell in cells:
        for k in range(4):
            seen[count] = quads[cell, k]
            count += 1
            if wide and _wide(xy, quads, across, x, y, cell, k):
                count = _look(xy, quads, across, x, y, cell, k, cone, place, seen, count)
    return np.unique(seen[:count]).astype(np.int64)


@njit(cache=True, nogil=True)
def _wide(xy: Array, quads: Ints, across: Ints32, x: float, y: float, cell: int, side: int) -> bool:
    """Whether (x, y) in a cell, not on the side, sees a wide gap through it."""
    start, end = quads[cell, side], quads[cell, (side + 1) % 4]
    r_x, r_y, l_x, l_y = xy[start, 0] - x, xy[start, 1] - y, xy[end, 0] - x, xy[end, 1] - y
    flat = _ON_SIDE * (r_x * r_x + r_y * r_y + l_x * l_x + l_y * l_y)
    return bool(across[cell, side] >= 0 and r_x * l_y - r_y * l_x > flat and _apart(r_x, r_y, l_x, l_y, _WIDE))


@njit(cache=True, nogil=True)
def _look(
    xy: Array,
    quads: Ints,
    across: Ints32,
    x: float,
    y: float,
    cell: int,
    side: int,
    cone: Array,
    place: Ints32,
    seen: Ints32,
    count: int,
) -> int:
    """Add to `seen` what (x, y) in a cell sees through one of its sides; the new count.

    `cone` (right and left direction) and `place` (4 * cell + the side it is entered by) are room to work in.
    """
    start, end = quads[cell, side], quads[cell, (side + 1) % 4]
    r_x, r_y, l_x, l_y = xy[start, 0] - x, xy[start, 1] - y, xy[end, 0] - x, xy[end, 1] - y
    place[0] = across[cell, side]
    cone[0, 0], cone[0, 1], cone[0, 2], cone[0, 3] = r_x, r_y, l_x, l_y
    pending, looked = 1, 0
    while pending > 0 and looked < _MOST_CELLS:
        pending, looked = pending - 1, looked + 1
        cell, entry = place[pending] // 4, place[pending] % 4
        r_x, r_y, l_x, l_y = cone[pending, 0], cone[pending, 1], cone[pending, 2], cone[pending, 3]
        # The cone leaves by the other three sides, from right to left; (b_x, b_y) is where the side begins.
        b_x, b_y = r_x, r_y
        for step in range(1, 4):
            e_x, e_y = l_x, l_y
            if step < 3:
                corner = quads[cell, (entry + step + 1) % 4]
                c_x, c_y = xy[corner, 0] - x, xy[corner, 1] - y
                if r_x * c_y - r_y * c_x <= 0:
                    e_x, e_y = r_x, r_y
                elif c_x * l_y - c_y * l_x > 0:
                    e_x, e_y = c_x, c_y
                    if _apart(r_x, r_y, c_x, c_y, _NARROW) and _apart(c_x, c_y, l_x, l_y, _NARROW):
                        seen[count] = corner
                        count += 1
            if b_x * e_y - b_y * e_x <= 0:
                continue
            beyond = across[cell, (entry + step) % 4]
            if beyond >= 0 and _apart(b_x, b_y, e_x, e_y, _WIDE):
                place[pending] = beyond
                cone[pending, 0], cone[pending, 1], cone[pending, 2], cone[pending, 3] = b_x, b_y, e_x, e_y
                pending += 1
            b_x, b_y = e_x, e_y
    return count


@njit(cache=True, nogil=True)
def _apart(r_x: float, r_y: float, l_x: float, l_y: float, tangent: float) -> bool:
    """Whether the angle from r counter-clockwise to l, below half a turn, exceeds one below a right angle."""
    return bool(r_x * l_y - r_y * l_x > tangent * (r_x * l_x + r_y * l_y))
