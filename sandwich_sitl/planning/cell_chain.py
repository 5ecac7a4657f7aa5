"""The chain of cells that a route on the map passes, as a line strictly inside free ground.

A route's nodes may lie on walls, where the side on which it passes cannot be read from coordinates. The cells know:
each link of the route lies in a cell or in a few that it crosses side by side, and from one link to the next the cells
round the common node are walked through, side by side too. The line through their centres and the middles of their
common sides tells which obstacles are passed on which hand. Beside a lid a cell's side may be longer than its
neighbour's: sides that leave a node in one direction are the same side.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sandwich_sitl.planning.map_graph import MapGraph

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]

_MOST_CROSSED = 64  # cells that one link crosses
_SAME = 1e-9  # sine between directions that are one


def inner_line(map_graph: MapGraph, start: Array, nodes: Ints, goal: Array) -> Array:
    """The line (n, 2) from start (2,) to goal (2,) beside the route over `nodes` (k,), k >= 1.

    Where two cells of the route touch in nothing but the node, it passes the node itself.
    """
    cells = map_graph.cells
    first, around = map_graph.around
    return np.asarray(
        _line(
            map_graph.graph.xy_m, map_graph.quads, first, around, map_graph.across,
            np.asarray(start, dtype=float), cells.holding(start), np.asarray(nodes, dtype=np.int64),
            np.asarray(goal, dtype=float), cells.holding(goal),
        )
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _at(quads: Ints, cell: int, node: int) -> int:
    """Which corner of a cell a node is, -1 when it is none."""
    for v in range(4):
        if quads[cell, v] == node:
            return v
    return -1


@njit(cache=True, nogil=True)
def _crossed(xy: Array, quads: Ints, across: Ints32, x: float, y: float, cell: int, node: int, chain: Ints) -> int:
    """Cells that the chord from (x, y), in or at a corner of a cell, to a node passes, into `chain`; 0: not this way.

    Each is entered through the side that it shares with the one before.
    """
    d_x, d_y = xy[node, 0] - x, xy[node, 1] - y
    count = 0
    while cell >= 0 and count < len(chain):
        chain[count] = cell
        count += 1
        if _at(quads, cell, node) >= 0:
            return count
        beyond = -1
        for k in range(4):
            a, b = xy[quads[cell, k]], xy[quads[cell, (k + 1) % 4]]
            right = d_x * (a[1] - y) - d_y * (a[0] - x)
            left = d_x * (b[1] - y) - d_y * (b[0] - x)
            if right < 0 < left:
                beyond = across[cell, k] // 4
        cell = beyond
    return 0


@njit(cache=True, nogil=True)
def _first_crossed(
    xy: Array, quads: Ints, across: Ints32, x: float, y: float, cells: Ints, node: int, chain: Ints
) -> int:
    """`_crossed` from that of the cells from which it goes the shortest way; 0: from none."""
    best, fewest = -1, len(chain) + 1
    for cell in cells:
        count = _crossed(xy, quads, across, x, y, cell, node, chain)
        if 0 < count < fewest:
            best, fewest = cell, count
    return 0 if best < 0 else _crossed(xy, quads, across, x, y, best, node, chain)


@njit(cache=True, nogil=True)
def _beside(xy: Array, quads: Ints, first: Ints, around: Ints, cell: int, node: int, step: int) -> tuple[int, int]:
    """The next cell round a node, counter-clockwise for step 1, and the far end of the common side; -1 at a wall."""
    end = quads[cell, (_at(quads, cell, node) - step) % 4]
    d_x, d_y = xy[end, 0] - xy[node, 0], xy[end, 1] - xy[node, 1]
    d = d_x * d_x + d_y * d_y
    for k in range(first[node], first[node + 1]):
        other = around[k]
        begin = quads[other, (_at(quads, other, node) + step) % 4]
        if other == cell:
            continue
        if begin == end:
            return int(other), int(end)
        e_x, e_y = xy[begin, 0] - xy[node, 0], xy[begin, 1] - xy[node, 1]
        e = e_x * e_x + e_y * e_y
        if abs(d_x * e_y - d_y * e_x) <= _SAME * np.sqrt(d * e) and d_x * e_x + d_y * e_y > 0:
            return int(other), int(end) if d < e else int(begin)
    return -1, -1


@njit(cache=True, nogil=True)
def _turn_round(
    xy: Array,
    quads: Ints,
    first: Ints,
    around: Ints,
    node: int,
    here: int,
    there: int,
    points: list[tuple[float, float]],
) -> None:
    """Walk from one cell at a node to another, the shorter way round; across the node itself if there is no way."""
    fewest, way = first[node + 1] - first[node] + 1, 0
    for step in (1, -1):
        cell, count = here, 0
        while cell >= 0 and cell != there and count < fewest:
            cell, _ = _beside(xy, quads, first, around, cell, node, step)
            count += 1
        if cell >= 0 and cell == there and count < fewest:
            fewest, way = count, step
    if way == 0:
        points.append((xy[node, 0], xy[node, 1]))
        if there >= 0:
            points.append(_centre(xy, quads, there))
        return
    cell = here
    while cell != there:
        cell, end = _beside(xy, quads, first, around, cell, node, way)
        points.append(((xy[node, 0] + xy[end, 0]) / 2, (xy[node, 1] + xy[end, 1]) / 2))
        points.append(_centre(xy, quads, cell))


@njit(cache=True, nogil=True)
def _line(
    xy: Array,
    quads: Ints,
    first: Ints,
    around: Ints,
    across: Ints32,
    start: Array,
    start_in: Ints,
    nodes: Ints,
    goal: Array,
    goal_in: Ints,
) -> Array:
    points = [(start[0], start[1])]
    chain = np.empty(_MOST_CROSSED, dtype=np.int64)
    here = -1
    for k in range(len(nodes) + 1):
        if k == 0:
            count = _first_crossed(xy, quads, across, start[0], start[1], start_in, nodes[0], chain)
        elif k == len(nodes):
            count = _first_crossed(xy, quads, across, goal[0], goal[1], goal_in, nodes[k - 1], chain)
            chain[:count] = chain[:count][::-1].copy()
        else:
            node = nodes[k - 1]
            cells = around[first[node] : first[node + 1]]
            if here >= 0 and _at(quads, here, nodes[k]) >= 0:
                cells = np.array([here])
            count = _first_crossed(xy, quads, across, xy[node, 0], xy[node, 1], cells, nodes[k], chain)
        there = chain[0] if count else -1
        if k > 0:
            _turn_round(xy, quads, first, around, nodes[k - 1], here, there, points)
        for m in range(count):
            if m > 0:
                points.append(_middle_between(xy, quads, across, chain[m - 1], chain[m]))
            if m > 0 or k == 0:
                points.append(_centre(xy, quads, chain[m]))
        here = chain[count - 1] if count else -1
    points.append((goal[0], goal[1]))
    line = np.empty((len(points), 2))
    for k in range(len(points)):
        line[k, 0], line[k, 1] = points[k]
    return line


@njit(cache=True, nogil=True)
def _middle_between(xy: Array, quads: Ints, across: Ints32, cell: int, other: int) -> tuple[float, float]:
    """Middle of the side that two cells share."""
    k = 0
    while across[cell, k] // 4 != other:
        k += 1
    a, b = xy[quads[cell, k]], xy[quads[cell, (k + 1) % 4]]
    return (a[0] + b[0]) / 2, (a[1] + b[1]) / 2


@njit(cache=True, nogil=True)
def _centre(xy: Array, quads: Ints, cell: int) -> tuple[float, float]:
    x, y = 0.0, 0.0
    for v in range(4):
        x += xy[quads[cell, v], 0] / 4
        y += xy[quads[cell, v], 1] / 4
    return x, y
