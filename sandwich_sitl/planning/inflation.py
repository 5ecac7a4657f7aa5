"""Convex free regions round a convex seed, by separating half-planes (numba).

Given a seed (a convex polygon, a segment or a point) and the edges of the obstacles, the part of an edge that is
nearest to the seed is separated from it by the line through its nearest point, across the shortest connection; every
edge loses what lies beyond that line; repeat until nothing is left (the separation step of IRIS, Deits and Tedrake
2015, and of DecompUtil, Liu et al. 2017; here in the Euclidean metric). A last pass moves every line inwards by
`keep_m`. As an edge only loses parts beyond unmoved lines, the region keeps `keep_m` from all of it.

The region is bounded by an axis-aligned box. Half-planes are n . x <= g with unit n, metres. No state.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TINY_M = 1e-9
_ROOM_M = 0.1


@njit(cache=True)
def inflate(seed: Array, edges: Array, box: Array, keep_m: float, most: int) -> tuple[Array, Array]:
    """Half-planes (F, 3) as (n_x, n_y, g) and corners (V, 2), counter-clockwise, of a region round `seed` (S, 2).

    `seed` is convex and counter-clockwise, `edges` (E, 4) are segments (ax, ay, bx, by), `box` is (x_min, y_min, x_max,
    y_max) and holds the seed. F = 0 when more than `most` half-planes are needed or when an edge is within `keep_m` of
    the seed.
    """
    none = np.empty((0, 3)), np.empty((0, 2))
    left = edges.copy()
    count = 0
    for e in range(len(left)):
        if _clip_to_box(left, e, box, keep_m):
            left[count] = left[e]
            count += 1
    away = np.empty((count, 5))
    for e in range(count):
        _nearest(seed, left[e], away[e])
    cuts = np.empty((4 * most, 3))
    faces = 0
    while count > 0:
        e = int(np.argmin(away[:count, 0]))
        gap = away[e, 0]
        if gap <= keep_m + _TINY_M or faces == len(cuts):
            return none
        n_x, n_y = (away[e, 3] - away[e, 1]) / gap, (away[e, 4] - away[e, 2]) / gap
        g = n_x * away[e, 3] + n_y * away[e, 4]
        cuts[faces, 0], cuts[faces, 1], cuts[faces, 2] = n_x, n_y, g - keep_m
        faces += 1
        kept = 0
        for k in range(count):
            verdict = _clip(left[k], n_x, n_y, g - _TINY_M)
            if verdict < 2:
                if verdict == 1:
                    _nearest(seed, left[k], away[k])
                left[kept], away[kept] = left[k], away[k]
                kept += 1
        count = kept
    planes = np.empty((faces + 4, 3))
    planes[0], planes[1] = (1.0, 0.0, box[2]), (0.0, 1.0, box[3])
    planes[2], planes[3] = (-1.0, 0.0, -box[0]), (0.0, -1.0, -box[1])
    planes[4:] = cuts[:faces]
    ring, carrier = _intersection(planes, box)
    if len(ring) < 3 or len(ring) > most:
        return none
    return planes[carrier], ring


@njit(cache=True)
def drawn_back(planes: Array, box: Array, by_m: float) -> Array:
    """The half-planes (F, 3) of a region in a box, moved inwards by `by_m`, or by a half or a quarter of it.

    They are as they were when even that leaves less than a region `_ROOM_M` from all sides.
    """
    walls = np.empty((4 + len(planes), 3))
    walls[0], walls[1] = (1.0, 0.0, box[2]), (0.0, 1.0, box[3])
    walls[2], walls[3] = (-1.0, 0.0, -box[0]), (0.0, -1.0, -box[1])
    for _ in range(3):
        walls[4:] = planes
        walls[4:, 2] -= by_m + _ROOM_M
        ring, _ = _intersection(walls, box)
        if len(ring) >= 3:
            moved = planes.copy()
            moved[:, 2] -= by_m
            return moved
        by_m /= 2
    return planes


@njit(cache=True)
def _intersection(planes: Array, box: Array) -> tuple[Array, NDArray[np.int64]]:
    """Corners (V, 2) of the half-planes' intersection and, for each, the half-plane of the side that begins there.

    The first four half-planes are the box's own.
    """
    room = len(planes) + 8
    ring, carrier = np.empty((room, 2)), np.empty(room, dtype=np.int64)
    ring[0], ring[1], ring[2], ring[3] = (box[0], box[1]), (box[2], box[1]), (box[2], box[3]), (box[0], box[3])
    carrier[0], carrier[1], carrier[2], carrier[3] = 3, 0, 1, 2
    size = 4
    new_ring, new_carrier = np.empty((room, 2)), np.empty(room, dtype=np.int64)
    for f in range(4, len(planes)):
        n_x, n_y, g = planes[f]
        made = 0
        for k in range(size):
            following = (k + 1) % size
            here = n_x * ring[k, 0] + n_y * ring[k, 1] - g
            there = n_x * ring[following, 0] + n_y * ring[following, 1] - g
            if here <= 0.0:
                new_ring[made], new_carrier[made] = ring[k], carrier[k]
                made += 1
            if (here <= 0.0) != (there <= 0.0):
                share = here / (here - there)
                new_ring[made] = ring[k] + share * (ring[following] - ring[k])
                new_carrier[made] = f if here <= 0.0 else carrier[k]
                made += 1
        size = 0
        for k in range(made):
            following = (k + 1) % made
            apart = abs(new_ring[k, 0] - new_ring[following, 0]) + abs(new_ring[k, 1] - new_ring[following, 1])
            if apart > _TINY_M:
                ring[size], carrier[size] = new_ring[k], new_carrier[k]
                size += 1
    return ring[:size].copy(), carrier[:size].copy()


@njit(cache=True)
def _clip(edge: Array, n_x: float, n_y: float, g: float) -> int:
    """Keep the part of an edge with n . x < g, in place: 0 nothing lost, 1 shortened, 2 nothing left."""
    a = n_x * edge[0] + n_y * edge[1] - g
    b = n_x * edge[2] + n_y * edge[3] - g
    if a < 0.0 and b < 0.0:
        return 0
    if a >= 0.0 and b >= 0.0:
        return 2
    share = a / (a - b)
    x, y = edge[0] + share * (edge[2] - edge[0]), edge[1] + share * (edge[3] - edge[1])
    if a >= 0.0:
        edge[0], edge[1] = x, y
    else:
        edge[2], edge[3] = x, y
    return 1


@njit(cache=True)
def _clip_to_box(edges: Array, e: int, box: Array, reach: float) -> bool:
    """Keep the part of edge `e` inside the box grown by `reach`; false when nothing is left."""
    edge = edges[e]
    if _clip(edge, 1.0, 0.0, box[2] + reach) == 2 or _clip(edge, -1.0, 0.0, reach - box[0]) == 2:
        return False
    return bool(_clip(edge, 0.0, 1.0, box[3] + reach) != 2 and _clip(edge, 0.0, -1.0, reach - box[1]) != 2)


@njit(cache=True)
def _nearest(seed: Array, edge: Array, out: Array) -> None:
    """Distance of an edge to the seed, then the nearest points of seed and edge: (gap, px, py, qx, qy).

    The gap is 0 when they meet.
    """
    size = len(seed)
    out[0] = np.inf
    outside = size < 3
    for k in range(size):
        x, y = seed[k]
        following = (k + 1) % size
        end_x, end_y = seed[following]
        if size >= 3:
            cross = (end_x - x) * (edge[1] - y) - (end_y - y) * (edge[0] - x)
            outside = outside or cross < 0.0
        if size >= 2 and _crossing(x, y, end_x, end_y, edge):
            out[0] = 0.0
            return
        _closer(x, y, edge[0], edge[1], edge[2], edge[3], out, False)
        _closer(edge[0], edge[1], x, y, end_x, end_y, out, True)
        _closer(edge[2], edge[3], x, y, end_x, end_y, out, True)
    if not outside:
        out[0] = 0.0


@njit(cache=True)
def _closer(x: float, y: float, a_x: float, a_y: float, b_x: float, b_y: float, out: Array, swap: bool) -> None:
    """Take point (x, y) and its nearest point of segment a b as the nearest pair when they are nearer than `out`."""
    d_x, d_y = b_x - a_x, b_y - a_y
    square = d_x * d_x + d_y * d_y
    share = 0.0 if square == 0.0 else min(1.0, max(0.0, ((x - a_x) * d_x + (y - a_y) * d_y) / square))
    q_x, q_y = a_x + share * d_x, a_y + share * d_y
    gap = np.hypot(x - q_x, y - q_y)
    if gap < out[0]:
        out[0] = gap
        if swap:
            out[1], out[2], out[3], out[4] = q_x, q_y, x, y
        else:
            out[1], out[2], out[3], out[4] = x, y, q_x, q_y


@njit(cache=True)
def _crossing(a_x: float, a_y: float, b_x: float, b_y: float, edge: Array) -> bool:
    """Whether segment a b crosses an edge properly."""
    d_x, d_y = b_x - a_x, b_y - a_y
    first = d_x * (edge[1] - a_y) - d_y * (edge[0] - a_x)
    second = d_x * (edge[3] - a_y) - d_y * (edge[2] - a_x)
    e_x, e_y = edge[2] - edge[0], edge[3] - edge[1]
    third = e_x * (a_y - edge[1]) - e_y * (a_x - edge[0])
    fourth = e_x * (b_y - edge[1]) - e_y * (b_x - edge[0])
    return bool(first * second < 0.0 and third * fourth < 0.0)
