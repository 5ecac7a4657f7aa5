"""The shortest path itself, by A* over the corners that see each other.

What a corner sees is found when A* takes it up, by a cone of sight that goes from triangle to triangle of the
navigation mesh and splits at vertices, so nothing is prepared but the mesh and every decision is the sign of a cross
product. Only taut paths are followed (behind a corner the cone is that between the straight line and the wall), and
no cone is followed that cannot better the length at hand. So a good path to begin with makes the search local, and
when the search ends unlimited, its result is the optimum: that is a proof.

State: ENU metres. Directions and offsets are relative to the corner that looks.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sandwich_sitl.planning.nav_mesh import MANY, NavMesh

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
def _to_segment(x: float, y: float, a_x: float, a_y: float, b_x: float, b_y: float) -> float:
    """Distance from a point to a segment."""
    s_x, s_y = b_x - a_x, b_y - a_y
    share = ((x - a_x) * s_x + (y - a_y) * s_y) / (s_x * s_x + s_y * s_y)
    share = min(max(share, 0.0), 1.0)
    return float(np.hypot(x - a_x - share * s_x, y - a_y - share * s_y))


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
    best = np.full(len(xy), np.inf)
    came = np.full(len(xy), -1, dtype=np.int64)
    goal_cost, goal_from = bound, -2
    cone_at = np.empty((64, 2), dtype=np.int64)  # triangle to look into, its side looked through
    cone = np.empty((64, 4))  # right and left direction
    cones = 0
    queue = [(0.0, 0.0, -1)]
    while len(queue) > 0:
        total, cost, root = heapq.heappop(queue)
        if total >= goal_cost:
            break
        if root >= 0 and cost > best[root]:
            continue
        if 0 <= most_cones < cones:
            return _back(came, goal_from), goal_cost, False
        x, y = (start[0], start[1]) if root < 0 else (xy[root, 0], xy[root, 1])
        in_x, in_y, wraps = 0.0, 0.0, 3
        if root >= 0:
            parent = came[root]
            in_x = x - (start[0] if parent < 0 else xy[parent, 0])
            in_y = y - (start[1] if parent < 0 else xy[parent, 1])
            wraps = 0 if before[root] == MANY else _wraps(xy, before, after, root, in_x, in_y)
        everywhere = root < 0 or before[root] == MANY
        here = start_in if root < 0 else around[first[root] : first[root + 1]]
        for side_wrapped in range(1 if everywhere else 2):
            if not everywhere and not wraps & (1 << side_wrapped):
                continue
            taut_rx, taut_ry, taut_lx, taut_ly = in_x, in_y, in_x, in_y
            if not everywhere:
                wall = after[root] if side_wrapped == 0 else before[root]
                wall_x, wall_y = xy[wall, 0] - x, xy[wall, 1] - y
                if side_wrapped == 0:
                    taut_rx, taut_ry = wall_x, wall_y
                else:
                    taut_lx, taut_ly = wall_x, wall_y
            pending = 0
            for t in here:
                for g in goal_in:
                    if g == t:
                        g_x, g_y = goal[0] - x, goal[1] - y
                        through = cost + np.sqrt(g_x * g_x + g_y * g_y)
                        if through < goal_cost and (everywhere or _seen(g_x, g_y, taut_rx, taut_ry, taut_lx, taut_ly)):
                            goal_cost, goal_from = through, root
                for k in range(3):
                    a, b = triangles[t, k], triangles[t, (k + 1) % 3]
                    r_x, r_y, l_x, l_y = xy[a, 0] - x, xy[a, 1] - y, xy[b, 0] - x, xy[b, 1] - y
                    if corner[a] and a != root and (everywhere or _seen(r_x, r_y, taut_rx, taut_ry, taut_lx, taut_ly)):
                        _reach(xy, before, after, best, came, queue, a, root, cost, r_x, r_y, goal, goal_cost)
                    if a == root or b == root or beyond[t, k] < 0:
                        continue
                    length = np.sqrt((r_x - l_x) ** 2 + (r_y - l_y) ** 2)
                    if _cross(r_x, r_y, l_x, l_y) <= _TOUCH_M * length:
                        continue
                    if not everywhere:
                        has_r = _cross(taut_rx, taut_ry, r_x, r_y) >= 0 and _cross(r_x, r_y, taut_lx, taut_ly) >= 0
                        has_l = _cross(taut_rx, taut_ry, l_x, l_y) >= 0 and _cross(l_x, l_y, taut_lx, taut_ly) >= 0
                        r_in = _cross(r_x, r_y, taut_rx, taut_ry) >= 0 and _cross(taut_rx, taut_ry, l_x, l_y) >= 0
                        l_in = _cross(r_x, r_y, taut_lx, taut_ly) >= 0 and _cross(taut_lx, taut_ly, l_x, l_y) >= 0
                        if not (has_r or has_l or r_in or l_in):
                            continue
                        if not has_r:
                            r_x, r_y = taut_rx, taut_ry
                        if not has_l:
                            l_x, l_y = taut_lx, taut_ly
                    if pending == len(cone):
                        cone_at = np.concatenate((cone_at, np.empty_like(cone_at)))
                        cone = np.concatenate((cone, np.empty_like(cone)))
                    _into(triangles, beyond, cone_at, cone, pending, t, k, r_x, r_y, l_x, l_y)
                    pending += 1
            while pending > 0:
                pending -= 1
                cones += 1
                t, k = cone_at[pending]
                r_x, r_y, l_x, l_y = cone[pending]
                left, right, apex = triangles[t, k], triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
                near = _to_segment(x, y, xy[left, 0], xy[left, 1], xy[right, 0], xy[right, 1])
                far = _to_segment(goal[0], goal[1], xy[left, 0], xy[left, 1], xy[right, 0], xy[right, 1])
                if cost + near + far >= goal_cost:
                    continue
                for g in goal_in:
                    if g == t:
                        g_x, g_y = goal[0] - x, goal[1] - y
                        through = cost + np.sqrt(g_x * g_x + g_y * g_y)
                        if through < goal_cost and _seen(g_x, g_y, r_x, r_y, l_x, l_y):
                            goal_cost, goal_from = through, root
                c_x, c_y = xy[apex, 0] - x, xy[apex, 1] - y
                if corner[apex] and _seen(c_x, c_y, r_x, r_y, l_x, l_y):
                    _reach(xy, before, after, best, came, queue, apex, root, cost, c_x, c_y, goal, goal_cost)
                past_left = _cross(c_x, c_y, l_x, l_y) <= 0
                past_right = _cross(r_x, r_y, c_x, c_y) <= 0
                if pending + 2 > len(cone):
                    cone_at = np.concatenate((cone_at, np.empty_like(cone_at)))
                    cone = np.concatenate((cone, np.empty_like(cone)))
                if not past_right and beyond[t, (k + 1) % 3] >= 0:
                    e_x, e_y = (l_x, l_y) if past_left else (c_x, c_y)
                    _into(triangles, beyond, cone_at, cone, pending, t, (k + 1) % 3, r_x, r_y, e_x, e_y)
                    pending += 1
                if not past_left and beyond[t, (k + 2) % 3] >= 0:
                    e_x, e_y = (r_x, r_y) if past_right else (c_x, c_y)
                    _into(triangles, beyond, cone_at, cone, pending, t, (k + 2) % 3, e_x, e_y, l_x, l_y)
                    pending += 1
    return _back(came, goal_from), goal_cost, True


@njit(cache=True, nogil=True)
def _into(
    triangles: Ints,
    beyond: Ints,
    cone_at: Ints,
    cone: Array,
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
    cone_at[slot, 0], cone_at[slot, 1] = other, side
    cone[slot, 0], cone[slot, 1], cone[slot, 2], cone[slot, 3] = r_x, r_y, l_x, l_y


@njit(cache=True, nogil=True)
def _reach(
    xy: Array,
    before: Ints,
    after: Ints,
    best: Array,
    came: Ints,
    queue: list[tuple[float, float, int]],
    v: int,
    root: int,
    cost: float,
    d_x: float,
    d_y: float,
    goal: Array,
    goal_cost: float,
) -> None:
    """Corner v is seen from the root in direction d: take it up if that is shorter and the path can be taut there."""
    length = np.sqrt(d_x * d_x + d_y * d_y)
    through = cost + length
    if through >= best[v] or length <= _TOUCH_M:
        return
    total = through + np.sqrt((xy[v, 0] - goal[0]) ** 2 + (xy[v, 1] - goal[1]) ** 2)
    if total >= goal_cost:
        return
    if before[v] != MANY and _wraps(xy, before, after, v, d_x, d_y) == 0:
        return
    best[v], came[v] = through, root
    heapq.heappush(queue, (total, through, v))


@njit(cache=True, nogil=True)
def _back(came: Ints, last: int) -> Ints:
    """Vertices from the first to `last`."""
    count, v = 0, last
    while v >= 0:
        count, v = count + 1, came[v]
    path = np.empty(count, dtype=np.int64)
    v = last
    for k in range(count - 1, -1, -1):
        path[k] = v
        v = came[v]
    return path
