"""The chain of cells that a route on the map passes, as a line strictly inside free ground.

A route's nodes may lie on walls, where the side on which it passes cannot be read from coordinates. The cells know:
each edge of the route lies in a cell, and from one to the next the cells round the common node are walked through,
side by side. The line through their centres and the middles of their common sides tells which obstacles are passed on
which hand. Beside a lid a cell's side may be longer than its neighbour's: sides that leave a node in one direction are
the same side.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sandwich_sitl.planning.map_graph import MapGraph

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_SAME = 1e-9  # sine between directions that are one


def inner_line(map_graph: MapGraph, start: Array, nodes: Ints, goal: Array) -> Array:
    """The line (n, 2) from start (2,) to goal (2,) beside the route over `nodes` (k,), k >= 1.

    Where two cells of the route touch in nothing but the node, it passes the node itself.
    """
    cells = map_graph.cells
    first, around = map_graph.around
    return np.asarray(
        _line(
            map_graph.graph.xy_m, map_graph.quads, first, around,
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
def _with_both(quads: Ints, first: Ints, around: Ints, a: int, b: int) -> int:
    """A cell with both nodes, -1 when there is none."""
    for k in range(first[a], first[a + 1]):
        if _at(quads, around[k], b) >= 0:
            return int(around[k])
    return -1


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
def _line(
    xy: Array,
    quads: Ints,
    first: Ints,
    around: Ints,
    start: Array,
    start_in: Ints,
    nodes: Ints,
    goal: Array,
    goal_in: Ints,
) -> Array:
    points = [(start[0], start[1])]
    here = -1
    for cell in start_in:
        if _at(quads, cell, nodes[0]) >= 0:
            here = cell
    points.append(_centre(xy, quads, here))
    for k in range(len(nodes)):
        node = nodes[k]
        there = -1
        if k + 1 < len(nodes):
            there = _with_both(quads, first, around, node, nodes[k + 1])
            if _at(quads, here, nodes[k + 1]) >= 0:
                there = here
        else:
            for cell in goal_in:
                if _at(quads, cell, node) >= 0 and there != here:
                    there = cell
        fewest, way = 1 << 30, 0
        for step in (1, -1):
            cell, count = here, 0
            while cell >= 0 and cell != there and count < 1000:
                cell, _ = _beside(xy, quads, first, around, cell, node, step)
                count += 1
            if cell == there and count < fewest:
                fewest, way = count, step
        if way == 0:
            points.append((xy[node, 0], xy[node, 1]))
            points.append(_centre(xy, quads, there))
        else:
            cell = here
            while cell != there:
                cell, end = _beside(xy, quads, first, around, cell, node, way)
                points.append(((xy[node, 0] + xy[end, 0]) / 2, (xy[node, 1] + xy[end, 1]) / 2))
                points.append(_centre(xy, quads, cell))
        here = there
    points.append((goal[0], goal[1]))
    line = np.empty((len(points), 2))
    for k in range(len(points)):
        line[k, 0], line[k, 1] = points[k]
    return line


@njit(cache=True, nogil=True)
def _centre(xy: Array, quads: Ints, cell: int) -> tuple[float, float]:
    x, y = 0.0, 0.0
    for v in range(4):
        x += xy[quads[cell, v], 0] / 4
        y += xy[quads[cell, v], 1] / 4
    return x, y
