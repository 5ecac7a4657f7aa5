"""Pull a line tight: the shortest path that passes the obstacles on the same hands.

The line is followed from triangle to triangle of the navigation mesh; turning back at once cancels; what is left, the
sleeve, is the line's homotopy class, and the funnel algorithm (Chazelle 1982; Lee and Preparata 1984) finds the
shortest path through the sides it crosses in linear time.

State: ENU metres.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sandwich_sitl.planning.nav_mesh import NavMesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_TOUCH_M = 1e-9


def pulled_tight(mesh: NavMesh, line: Array) -> Array | None:
    """The shortest path (k, 2) homotopic to a line (n, 2) whose inner points lie off all walls.

    None when the line cannot be followed: it leaves the free ground or meets a vertex.
    """
    within = mesh.index.holding(line[1], _TOUCH_M)
    if not len(within):
        return None
    back = _followed(mesh.xy_m, mesh.triangles, mesh.beyond, line[1::-1], int(within[0]))
    ahead = _followed(mesh.xy_m, mesh.triangles, mesh.beyond, line[1:], int(within[0]))
    if not len(back) or not len(ahead):
        return None
    sleeve = _reduced(np.concatenate([back[::-1], ahead[1:]]))
    left, right = _gates(mesh.triangles, mesh.beyond, sleeve)
    ends = line[[0, -1]]
    return np.asarray(_funnel(ends, np.ascontiguousarray(mesh.xy_m[left]), np.ascontiguousarray(mesh.xy_m[right])))


@njit(cache=True, nogil=True)
def _turn(p_x: float, p_y: float, q_x: float, q_y: float, c: Array) -> float:
    """Positive when c lies left of the line from p to q."""
    return float((q_x - p_x) * (c[1] - p_y) - (q_y - p_y) * (c[0] - p_x))


@njit(cache=True, nogil=True)
def _inside(xy: Array, triangles: Ints, t: int, q: Array) -> bool:
    for k in range(3):
        a, b = xy[triangles[t, k]], xy[triangles[t, (k + 1) % 3]]
        if _turn(a[0], a[1], b[0], b[1], q) < -_TOUCH_M * np.hypot(b[0] - a[0], b[1] - a[1]):
            return False
    return True


@njit(cache=True, nogil=True)
def _followed(xy: Array, triangles: Ints, beyond: Ints, line: Array, t: int) -> Ints:
    """Triangles that a line passes from triangle t on; empty when it meets a wall."""
    passed = [t]
    for m in range(1, len(line)):
        p, q = line[m - 1], line[m]
        if _inside(xy, triangles, t, q):
            continue
        side = -1
        for k in range(3):
            a, b = xy[triangles[t, k]], xy[triangles[t, (k + 1) % 3]]
            if (
                _turn(a[0], a[1], b[0], b[1], q) < 0
                and _turn(p[0], p[1], q[0], q[1], a) <= 0
                and _turn(p[0], p[1], q[0], q[1], b) >= 0
            ):
                side = k
        while side >= 0:
            other = beyond[t, side]
            if other < 0:
                return np.empty(0, dtype=np.int64)
            back = 0
            while triangles[other, (back + 1) % 3] != triangles[t, side]:
                back += 1
            t = other
            passed.append(t)
            if _inside(xy, triangles, t, q):
                break
            apex = xy[triangles[t, (back + 2) % 3]]
            side = (back + (2 if _turn(p[0], p[1], q[0], q[1], apex) < 0 else 1)) % 3
            if len(passed) > 100 * len(triangles) + 100 * len(line):
                return np.empty(0, dtype=np.int64)
        if side < 0:
            return np.empty(0, dtype=np.int64)
    return np.array(passed)


@njit(cache=True, nogil=True)
def _reduced(passed: Ints) -> Ints:
    """The walk without turning back."""
    kept = np.empty(len(passed), dtype=np.int64)
    count = 0
    for t in passed:
        if count > 0 and kept[count - 1] == t:
            continue
        if count > 1 and kept[count - 2] == t:
            count -= 1
            continue
        kept[count] = t
        count += 1
    return kept[:count]


@njit(cache=True, nogil=True)
def _gates(triangles: Ints, beyond: Ints, sleeve: Ints) -> tuple[Ints, Ints]:
    """Left and right vertices of the sides that a sleeve crosses."""
    gates = len(sleeve) - 1
    left, right = np.empty(gates, dtype=np.int64), np.empty(gates, dtype=np.int64)
    for m in range(gates):
        for k in range(3):
            if beyond[sleeve[m], k] == sleeve[m + 1]:
                right[m], left[m] = triangles[sleeve[m], k], triangles[sleeve[m], (k + 1) % 3]
    return left, right


@njit(cache=True, nogil=True)
def _funnel(ends: Array, left: Array, right: Array) -> Array:
    """Shortest path from ends[0] to ends[1] through gates with left and right posts (g, 2) each."""
    gates = len(left)
    posts_l, posts_r = np.empty((gates + 1, 2)), np.empty((gates + 1, 2))
    posts_l[:gates], posts_r[:gates] = left, right
    posts_l[gates], posts_r[gates] = ends[1], ends[1]
    path = [(ends[0, 0], ends[0, 1])]
    apex_x, apex_y = ends[0, 0], ends[0, 1]
    at_l, at_r = -1, -1  # the funnel's posts; -1: the apex itself
    k = 0
    while k <= gates:
        new_r, new_l = posts_r[k], posts_l[k]
        if at_r < 0 or _turn(apex_x, apex_y, posts_r[at_r, 0], posts_r[at_r, 1], new_r) >= 0:
            if at_l < 0 or _turn(apex_x, apex_y, posts_l[at_l, 0], posts_l[at_l, 1], new_r) <= 0:
                at_r = k
            else:
                apex_x, apex_y = posts_l[at_l]
                path.append((apex_x, apex_y))
                k = _past(posts_l, at_l)
                at_l, at_r = -1, -1
                continue
        if at_l < 0 or _turn(apex_x, apex_y, posts_l[at_l, 0], posts_l[at_l, 1], new_l) <= 0:
            if at_r < 0 or _turn(apex_x, apex_y, posts_r[at_r, 0], posts_r[at_r, 1], new_l) >= 0:
                at_l = k
            else:
                apex_x, apex_y = posts_r[at_r]
                path.append((apex_x, apex_y))
                k = _past(posts_r, at_r)
                at_l, at_r = -1, -1
                continue
        k += 1
    if path[-1] != (ends[1, 0], ends[1, 1]) or len(path) == 1:
        path.append((ends[1, 0], ends[1, 1]))
    points = np.empty((len(path), 2))
    for m in range(len(path)):
        points[m, 0], points[m, 1] = path[m]
    return points


@njit(cache=True, nogil=True)
def _past(posts: Array, at: int) -> int:
    """The first gate after the last one in a row that has the same post."""
    k = at + 1
    while k < len(posts) and posts[k, 0] == posts[at, 0] and posts[k, 1] == posts[at, 1]:
        k += 1
    return k
