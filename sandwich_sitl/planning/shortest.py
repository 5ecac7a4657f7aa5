"""The shortest path itself, by A* over the corners that see each other.

What a corner sees is found when A* takes it up, by a cone of sight that goes from triangle to triangle of the
navigation mesh and splits at vertices, so nothing is prepared but the mesh and every decision is the sign of a cross
product. Only taut paths are followed (behind a corner the cone is that between the straight line and the wall), and
no cone is followed that cannot better the length at hand. So a good path to begin with makes the search local, and
when the search ends unlimited, its result is the optimum: that is a proof.

State: ENU metres. Directions and offsets are relative to the corner that looks.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sandwich_sitl.planning.heap import doubled, pop, push
from sandwich_sitl.planning.nav_mesh import NavMesh
from sandwich_sitl.planning.search import trace

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_GRAZE = 1e-12  # sine: a corner this far outside a cone is seen
_ON_LINE = 1e-9  # sine: a wall this far on the wrong side still leaves the path taut
_TOUCH_M = 1e-9


@dataclass(frozen=True)
class ShortPath:
    """Points (n, 2) from start to goal; `proven`: no path is shorter."""

    points_m: Array
    length_m: float
    proven: bool


def shortest_path(
    mesh: NavMesh, start: Array, goal: Array, known: Array | None = None, most_cones: int | None = None
) -> ShortPath | None:
    """Shortest path between two points (2,) of free ground, or None when the ground does not join them.

    `known` (n, 2) is a path already found, the result when nothing is shorter. After `most_cones` cones of sight the
    search gives up and the shortest path so far is returned, not proven.
    """
    start_in, goal_in = mesh.index.holding(start, _TOUCH_M), mesh.index.holding(goal, _TOUCH_M)
    bound = np.inf if known is None else float(np.hypot(*np.diff(known, axis=0).T).sum())
    vertices, length, proven = _search(
        mesh.xy_m, mesh.triangles, mesh.beyond, mesh.before, mesh.after, mesh.corner, mesh.first, mesh.around,
        np.asarray(start, dtype=float), start_in, np.asarray(goal, dtype=float), goal_in, bound,
        -1 if most_cones is None else most_cones,
    )  # fmt: skip
    if length < bound:
        return ShortPath(np.concatenate([start[None], mesh.xy_m[vertices], goal[None]]), float(length), bool(proven))
    return None if known is None else ShortPath(known, bound, bool(proven))


class _Stack(NamedTuple):
    """Cones to look through: triangle and side (n, 2), right and left direction (n, 4)."""

    side: Ints
    cone: Array


@njit(cache=True, nogil=True)
def _cross(a_x: float, a_y: float, b_x: float, b_y: float) -> float:
    return a_x * b_y - a_y * b_x


@njit(cache=True, nogil=True)
def _seen(d_x: float, d_y: float, r_x: float, r_y: float, l_x: float, l_y: float) -> bool:
    """Whether direction d lies in the cone from r counter-clockwise to l, or grazes it."""
    d = np.sqrt(d_x * d_x + d_y * d_y)
    slack_r = _GRAZE * d * np.sqrt(r_x * r_x + r_y * r_y)
    slack_l = _GRAZE * d * np.sqrt(l_x * l_x + l_y * l_y)
    ahead = d_x * (r_x + l_x) + d_y * (r_y + l_y) >= 0.0 or _cross(r_x, r_y, l_x, l_y) > 0.0
    return bool(ahead and _cross(r_x, r_y, d_x, d_y) >= -slack_r and _cross(d_x, d_y, l_x, l_y) >= -slack_l)


@njit(cache=True, nogil=True)
def _to_segment(p: Array, a: Array, b: Array) -> float:
    """Distance from a point to a segment."""
    s_x, s_y, d_x, d_y = b[0] - a[0], b[1] - a[1], p[0] - a[0], p[1] - a[1]
    share = min(max((d_x * s_x + d_y * s_y) / (s_x * s_x + s_y * s_y), 0.0), 1.0)
    d_x, d_y = d_x - share * s_x, d_y - share * s_y
    return float(np.sqrt(d_x * d_x + d_y * d_y))


@njit(cache=True, nogil=True)
def _wraps(xy: Array, before: Ints, after: Ints, v: int, d_x: float, d_y: float) -> int:
    """How a path that arrives at vertex v in direction d may go on: 1 wall on its right, 2 on its left, 3 both, 0 not."""
    p, q = before[v], after[v]
    p_x, p_y, q_x, q_y = xy[p, 0] - xy[v, 0], xy[p, 1] - xy[v, 1], xy[q, 0] - xy[v, 0], xy[q, 1] - xy[v, 1]
    d = np.sqrt(d_x * d_x + d_y * d_y)
    to_p, slack_p = _cross(d_x, d_y, p_x, p_y), _ON_LINE * d * np.sqrt(p_x * p_x + p_y * p_y)
    to_q, slack_q = _cross(d_x, d_y, q_x, q_y), _ON_LINE * d * np.sqrt(q_x * q_x + q_y * q_y)
    on_right = to_p <= slack_p and to_q <= slack_q
    on_left = to_p >= -slack_p and to_q >= -slack_q
    return (1 if on_right else 0) + (2 if on_left else 0)


@njit(cache=True, nogil=True)
def _search(
    xy: Array,
    triangles: Ints,
    beyond: Ints,
    before: Ints,
    after: Ints,
    corner: NDArray[np.bool_],
    first: Ints,
    around: Ints,
    start: Array,
    start_in: Ints,
    goal: Array,
    goal_in: Ints,
    bound: float,
    most_cones: int,
) -> tuple[Ints, float, bool]:
    """Vertices between start and goal, length and whether the search was exhaustive."""
    vertices = len(xy)
    best = np.full(vertices, np.inf)
    came = np.full(vertices, -1, dtype=np.int64)
    seen = np.empty(2 * vertices + 16, dtype=np.int64)
    stack = _Stack(np.empty((2 * vertices + 16, 2), dtype=np.int64), np.empty((2 * vertices + 16, 4)))
    heap_cost, heap_node, waiting = np.empty(64), np.empty(64, dtype=np.int64), 0
    goal_cost, goal_from, root, cones, everywhere = bound, -2, -1, 0, np.zeros(4)
    while True:
        cost = 0.0 if root < 0 else best[root]
        at = start if root < 0 else xy[root]
        here = start_in if root < 0 else around[first[root] : first[root + 1]]
        wraps = 4
        if root >= 0:
            parent = start if came[root] < 0 else xy[came[root]]
            wraps = _wraps(xy, before, after, root, at[0] - parent[0], at[1] - parent[1])
        for way in (1, 2, 4):
            if not wraps & way:
                continue
            taut = everywhere
            if way == 1:
                taut = _cone(xy[after[root]], at, at, parent)
            elif way == 2:
                taut = _cone(at, parent, xy[before[root]], at)
            number, looked, length = _look(
                xy, triangles, beyond, corner, at, root, here, taut, goal, goal_in, goal_cost - cost, stack, seen
            )
            cones += looked
            if cost + length < goal_cost:
                goal_cost, goal_from = cost + length, root
            for k in range(number):
                v = seen[k]
                d_x, d_y = xy[v, 0] - at[0], xy[v, 1] - at[1]
                through = cost + np.sqrt(d_x * d_x + d_y * d_y)
                total = through + np.sqrt((xy[v, 0] - goal[0]) ** 2 + (xy[v, 1] - goal[1]) ** 2)
                if through >= best[v] or total >= goal_cost or _wraps(xy, before, after, v, d_x, d_y) == 0:
                    continue
                best[v], came[v] = through, root
                if waiting == len(heap_cost):
                    heap_cost, heap_node = doubled(heap_cost), doubled(heap_node)
                push(heap_cost, heap_node, waiting, total, v)
                waiting += 1
        root = -1
        while waiting > 0 and root < 0:
            total, v = heap_cost[0], heap_node[0]
            waiting -= 1
            pop(heap_cost, heap_node, waiting)
            ahead = np.sqrt((xy[v, 0] - goal[0]) ** 2 + (xy[v, 1] - goal[1]) ** 2)
            if total <= best[v] + ahead:
                root = v
        if root < 0 or total >= goal_cost:
            return trace(came, goal_from), goal_cost, True
        if 0 <= most_cones < cones:
            return trace(came, goal_from), goal_cost, False


@njit(cache=True, nogil=True)
def _cone(r_to: Array, r_from: Array, l_to: Array, l_from: Array) -> Array:
    cone = np.empty(4)
    cone[0], cone[1] = r_to[0] - r_from[0], r_to[1] - r_from[1]
    cone[2], cone[3] = l_to[0] - l_from[0], l_to[1] - l_from[1]
    return cone


@njit(cache=True, nogil=True)
def _look(
    xy: Array,
    triangles: Ints,
    beyond: Ints,
    corner: NDArray[np.bool_],
    at: Array,
    root: int,
    here: Ints,
    taut: Array,
    goal: Array,
    goal_in: Ints,
    bound: float,
    stack: _Stack,
    seen: Ints,
) -> tuple[int, int, float]:
    """Look from a point in the triangles `here` through the cone `taut` (zero: all round).

    Corners in sight, from which a path to the goal may be shorter than `bound`, go to `seen`. Returns their number,
    the number of cones and the distance of the goal, infinite when out of sight.
    """
    x, y = at[0], at[1]
    g_x, g_y = goal[0] - x, goal[1] - y
    to_goal = np.sqrt(g_x * g_x + g_y * g_y)
    everywhere = taut[0] == 0.0 and taut[1] == 0.0
    count, cones, pending, found = 0, 0, 0, np.inf
    for t in here:
        if _is_in(goal_in, t) and (everywhere or _seen(g_x, g_y, taut[0], taut[1], taut[2], taut[3])):
            found = to_goal
        for k in range(3):
            a, b = triangles[t, k], triangles[t, (k + 1) % 3]
            r_x, r_y, l_x, l_y = xy[a, 0] - x, xy[a, 1] - y, xy[b, 0] - x, xy[b, 1] - y
            if (
                corner[a]
                and r_x * r_x + r_y * r_y > _TOUCH_M * _TOUCH_M
                and (everywhere or _seen(r_x, r_y, taut[0], taut[1], taut[2], taut[3]))
                and not _is_in(seen[:count], a)
            ):
                seen[count] = a
                count += 1
            length = np.sqrt((r_x - l_x) ** 2 + (r_y - l_y) ** 2)
            if root in (a, b) or beyond[t, k] < 0 or _cross(r_x, r_y, l_x, l_y) <= _TOUCH_M * length:
                continue
            if not everywhere:
                has_r = _within(taut[0], taut[1], taut[2], taut[3], r_x, r_y)
                has_l = _within(taut[0], taut[1], taut[2], taut[3], l_x, l_y)
                r_in = _within(r_x, r_y, l_x, l_y, taut[0], taut[1])
                l_in = _within(r_x, r_y, l_x, l_y, taut[2], taut[3])
                if not (has_r or has_l or r_in or l_in):
                    continue
                if not has_r:
                    r_x, r_y = taut[0], taut[1]
                if not has_l:
                    l_x, l_y = taut[2], taut[3]
            _into(triangles, beyond, stack, pending, t, k, r_x, r_y, l_x, l_y)
            pending += 1
    while pending > 0:
        pending -= 1
        cones += 1
        t, k = stack.side[pending, 0], stack.side[pending, 1]
        r_x, r_y = stack.cone[pending, 0], stack.cone[pending, 1]
        l_x, l_y = stack.cone[pending, 2], stack.cone[pending, 3]
        left, right, apex = triangles[t, k], triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
        if _to_segment(at, xy[left], xy[right]) + _to_segment(goal, xy[left], xy[right]) >= bound:
            continue
        if _is_in(goal_in, t) and _seen(g_x, g_y, r_x, r_y, l_x, l_y):
            found = to_goal
        c_x, c_y = xy[apex, 0] - x, xy[apex, 1] - y
        if corner[apex] and _seen(c_x, c_y, r_x, r_y, l_x, l_y) and count < len(seen):
            seen[count] = apex
            count += 1
        past_left = _cross(c_x, c_y, l_x, l_y) <= 0
        past_right = _cross(r_x, r_y, c_x, c_y) <= 0
        if not past_right and beyond[t, (k + 1) % 3] >= 0:
            e_x, e_y = (l_x, l_y) if past_left else (c_x, c_y)
            _into(triangles, beyond, stack, pending, t, (k + 1) % 3, r_x, r_y, e_x, e_y)
            pending += 1
        if not past_left and beyond[t, (k + 2) % 3] >= 0:
            e_x, e_y = (r_x, r_y) if past_right else (c_x, c_y)
            _into(triangles, beyond, stack, pending, t, (k + 2) % 3, e_x, e_y, l_x, l_y)
            pending += 1
    return count, cones, found


@njit(cache=True, nogil=True)
def _is_in(numbers: Ints, wanted: int) -> bool:
    found = False
    for number in numbers:
        found |= number == wanted
    return found


@njit(cache=True, nogil=True)
def _within(r_x: float, r_y: float, l_x: float, l_y: float, d_x: float, d_y: float) -> bool:
    """Whether direction d lies in the cone from r counter-clockwise to l, less than half a turn wide.

    A cone without width, as along a wall, does not hold the direction straight behind it.
    """
    ahead = d_x * (r_x + l_x) + d_y * (r_y + l_y) >= 0.0 or _cross(r_x, r_y, l_x, l_y) > 0.0
    return bool(ahead and _cross(r_x, r_y, d_x, d_y) >= 0 and _cross(d_x, d_y, l_x, l_y) >= 0)


@njit(cache=True, nogil=True)
def _into(
    triangles: Ints,
    beyond: Ints,
    stack: _Stack,
    slot: int,
    t: int,
    k: int,
    r_x: float,
    r_y: float,
    l_x: float,
    l_y: float,
) -> None:
    """Put down the cone that leaves triangle t by side k."""
    other = beyond[t, k]
    side = 0
    while triangles[other, (side + 1) % 3] != triangles[t, k]:
        side += 1
    stack.side[slot, 0], stack.side[slot, 1] = other, side
    stack.cone[slot, 0], stack.cone[slot, 1] = r_x, r_y
    stack.cone[slot, 2], stack.cone[slot, 3] = l_x, l_y
