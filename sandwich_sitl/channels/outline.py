"""Outlines: lower and upper envelope of shapes over x, which is their vertical closure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bounds = tuple[float, float, float, float]

_SAME = 1e-9  # of the extent: coordinates closer than this are one


@dataclass(frozen=True)
class Outline:
    """Lower and upper envelope (V, 2), left to right, x never falling."""

    lower: Array
    upper: Array
    own: bool  # the shape is its own closure

    def ring(self) -> Array:
        """Vertices (V, 2), counter-clockwise."""
        ring = np.concatenate([self.lower, self.upper[::-1]])
        return np.asarray(ring[(ring != np.roll(ring, 1, axis=0)).any(axis=1)])

    def right_profile(self) -> Array:
        """From the lowest point along the right to the highest (V, 2)."""
        lowest, highest = _last_extreme(-self.lower[:, 1]), _last_extreme(self.upper[:, 1])
        return np.concatenate([self.lower[lowest:], self.upper[highest:][::-1]])

    def left_profile(self) -> Array:
        """From the lowest point along the left to the highest (V, 2)."""
        lowest, highest = int(np.argmin(self.lower[:, 1])), int(np.argmax(self.upper[:, 1]))
        return np.concatenate([self.lower[: lowest + 1][::-1], self.upper[: highest + 1]])


def _last_extreme(values: Array) -> int:
    return len(values) - 1 - int(np.argmax(values[::-1]))


def outline_of(rings: list[Array], lids: Array, bounds: Bounds) -> Outline:
    """Closure of counter-clockwise rings (V, 2) and lids (L, 2, 2), down or up to a border that a ring touches."""
    ring = rings[0]
    floor = any((r[:, 1] == bounds[1]).any() for r in rings)
    ceiling = any((r[:, 1] == bounds[3]).any() for r in rings)
    if len(rings) == 1 and not len(lids) and not floor and not ceiling and _vertically_convex(ring):
        lower, upper = _chains(ring)
        return Outline(lower, upper, own=True)
    edges = np.concatenate([np.stack([r, np.roll(r, -1, axis=0)], axis=1) for r in rings] + [lids])
    swap = edges[:, 0, 0] > edges[:, 1, 0]
    edges[swap] = edges[swap, ::-1]
    breaks = _crossings(edges, lids)
    lower, upper = _envelope(edges, breaks, highest=False), _envelope(edges, breaks, highest=True)
    if floor:
        lower = np.array([[lower[0, 0], bounds[1]], [lower[-1, 0], bounds[1]]])
    if ceiling:
        upper = np.array([[upper[0, 0], bounds[3]], [upper[-1, 0], bounds[3]]])
    return Outline(lower, upper, own=False)


def _vertically_convex(ring: Array) -> bool:
    """Whether a ring goes right once and left once."""
    run = np.sign(np.roll(ring[:, 0], -1) - ring[:, 0])
    run = run[run != 0]
    return int((run != np.roll(run, 1)).sum()) == 2


def _chains(ring: Array) -> tuple[Array, Array]:
    """Lower and upper chain, left to right, of a vertically convex counter-clockwise ring."""
    x = ring[:, 0]
    at_left, at_right = np.flatnonzero(x == x.min()), np.flatnonzero(x == x.max())
    start, end = at_left[np.argmin(ring[at_left, 1])], at_right[np.argmin(ring[at_right, 1])]
    lower = ring[(start + np.arange((end - start) % len(ring) + 1)) % len(ring)]
    start, end = at_right[np.argmax(ring[at_right, 1])], at_left[np.argmax(ring[at_left, 1])]
    upper = ring[(start + np.arange((end - start) % len(ring) + 1)) % len(ring)]
    return lower, upper[::-1]


def _crossings(edges: Array, lids: Array) -> Array:
    """x (n,) at which edges (E, 2, 2) cross horizontal lids (L, 2, 2)."""
    found = [np.empty(0)]
    for (left, y), (right, _) in lids:
        (x0, y0), (x1, y1) = edges[:, 0].T, edges[:, 1].T
        crossing = (np.minimum(y0, y1) < y) & (y < np.maximum(y0, y1))
        x = x0[crossing] + (y - y0[crossing]) / (y1[crossing] - y0[crossing]) * (x1[crossing] - x0[crossing])
        found.append(x[(left < x) & (x < right)])
    return np.concatenate(found)


def _envelope(edges: Array, breaks: Array, *, highest: bool) -> Array:
    """The highest (or lowest) edge over every x as a polyline (V, 2); vertical steps where it changes edge.

    Edges (E, 2, 2) run left to right and cross only at the x in `breaks` (n,). Vertices are those of the edges and, at
    steps, the points of edges above or below them.
    """
    x = np.unique(np.concatenate([edges[:, :, 0].ravel(), breaks]))
    x = x[np.concatenate([[True], np.diff(x) > _SAME * (x[-1] - x[0])])]
    middle = (x[:-1] + x[1:]) / 2
    sloped = edges[edges[:, 1, 0] > edges[:, 0, 0]]
    first = np.searchsorted(middle, sloped[:, 0, 0])
    beyond = np.searchsorted(middle, sloped[:, 1, 0])
    best = np.full(len(middle), -1)
    height = np.full(len(middle), -np.inf)
    sign = 1.0 if highest else -1.0
    for k in range(len(sloped)):
        strips = slice(first[k], beyond[k])
        y = sign * _height(sloped[k], middle[strips])
        better = y > height[strips]
        best[strips][better] = k
        height[strips][better] = y[better]
    points: list[Array] = [_at(sloped[best[0]], x[0])]
    for k in range(1, len(middle)):
        if best[k] != best[k - 1]:
            points += [_at(sloped[best[k - 1]], x[k]), _at(sloped[best[k]], x[k])]
    points.append(_at(sloped[best[-1]], x[-1]))
    return _without_repeats(np.array(points))


def _without_repeats(path: Array) -> Array:
    """The path without points that are the one before but for rounding."""
    same = _SAME * (1 + float(np.abs(path).max()))
    return np.asarray(path[np.concatenate([[True], (np.abs(np.diff(path, axis=0)) > same).any(axis=1)])])


def _height(edge: Array, x: Array) -> Array:
    (x0, y0), (x1, y1) = edge
    return np.asarray(y0 + (x - x0) / (x1 - x0) * (y1 - y0))


def _at(edge: Array, x: float) -> Array:
    """The edge's point at x; its own vertex where that is at x."""
    span = _SAME * (1 + abs(x))
    for vertex in edge:
        if abs(vertex[0] - x) <= span:
            return np.asarray(vertex)
    return np.array([x, float(_height(edge, np.array([x]))[0])])
