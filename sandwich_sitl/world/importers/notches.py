"""Fewer corners for outlines made of cells: chords over notches, which only add ground, and never in a passage.

Input: simple polygons without holes, one length unit. A chord replaces a chain of an outline when the whole chain lies
on its inner side and within a tolerance, so that the outline's corners are corners of the input and every added point
lies within the tolerance of the input. A chord is kept when the rectangle on its outer side, `gap` deep, holds neither
an obstacle nor ground added by another chord. Then a disc of diameter <= gap that was in the way of the added ground
slides along the chord instead: what it must not touch beside the rectangle blocks the ends of the slide only. Hence no
passage of that width is closed, and no pair of facing points comes nearer than gap that was not so before.
"""

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.polygon import orient

Point = tuple[float, float]
Ring = list[Point]
Polygons = NDArray[np.object_]

_LONGEST_CHAIN = 200  # corners; bounds the work on outlines that curl
_TURN = math.pi / 2  # a chain's corners stay this near to the direction in which it sets out
_CLEAR = 1e-6  # of the gap: obstacles may touch a rectangle


def fill_notches(polygons: Sequence[Polygon], tolerance: float, gap: float) -> list[Polygon]:
    """Polygons that cover the given ones, reach at most `tolerance` further and keep passages up to `gap` as they are."""
    rings: list[Ring] = [_start_at_hull(orient(polygon)) for polygon in polygons]
    depth = max(gap, tolerance)
    chords = [
        (index, first, last)
        for index, ring in enumerate(rings)
        for first, last in _chords(ring, tolerance)
        if last - first > 1
    ]
    if not chords:
        return list(polygons)
    kept = _undisturbed(polygons, rings, chords, depth)
    filled: list[Polygon] = []
    for index, ring in enumerate(rings):
        skipped = {k for i, first, last in kept.get(index, []) for k in range(first + 1, last) if i == index}
        candidate = Polygon([point for k, point in enumerate(ring) if k not in skipped])
        filled.append(candidate if skipped and candidate.is_valid else polygons[index])
    return filled


def _start_at_hull(polygon: Polygon) -> Ring:
    """Corners counter-clockwise from the lowest leftmost one, which no chord may skip."""
    ring: Ring = [(float(x), float(y)) for x, y in polygon.exterior.coords[:-1]]
    start = min(range(len(ring)), key=lambda k: ring[k])
    return ring[start:] + ring[:start]


def _chords(ring: Ring, tolerance: float) -> list[tuple[int, int]]:
    """Longest admissible chain from each corner on, as pairs of positions; the ring's start closes the last one."""
    closed = [*ring, ring[0]]
    pairs: list[tuple[int, int]] = []
    first = 0
    while first < len(ring):
        last = _farthest(closed, first, tolerance)
        pairs.append((first, last))
        first = last
    return pairs


def _farthest(ring: Ring, first: int, tolerance: float) -> int:
    """Last corner whose chord from `first` has the chain between on its left, no farther off than the tolerance.

    A chain begins with a turn to the right: after one to the left it is better begun at the next corner.
    """
    x0, y0 = ring[first]
    dx, dy = ring[first + 1][0] - x0, ring[first + 1][1] - y0
    ahead = math.atan2(dy, dx)
    low, high, best = -_TURN, _TURN, first + 1
    if first + 2 < len(ring) and dx * (ring[first + 2][1] - y0) > dy * (ring[first + 2][0] - x0):
        return best
    for k in range(first + 1, min(len(ring), first + _LONGEST_CHAIN)):
        dx, dy = ring[k][0] - x0, ring[k][1] - y0
        distance = math.hypot(dx, dy)
        angle = math.remainder(math.atan2(dy, dx) - ahead, math.tau)
        if low <= angle <= high:
            best = k
        elif abs(angle) > _TURN:
            break
        high = min(high, angle)
        if distance > tolerance:
            low = max(low, angle - math.asin(tolerance / distance))
        if low > high:
            break
    return best


def _undisturbed(
    polygons: Sequence[Polygon], rings: list[Ring], chords: list[tuple[int, int, int]], depth: float
) -> dict[int, list[tuple[int, int, int]]]:
    """Chords by ring whose outer rectangle is free of obstacles and of the ground that other chords add."""
    chains = [(rings[i] + rings[i][:1])[first : last + 1] for i, first, last in chords]
    outer = np.array([Polygon(_rectangle(chain[0], chain[-1], depth)) for chain in chains])
    disturbed = np.zeros(len(chords), dtype=bool)
    disturbed[_touching(outer, np.array(polygons))[0]] = True
    free = np.flatnonzero(~disturbed)
    added = np.array([Polygon(chains[k]).buffer(0) for k in free])
    for a, b in sorted(zip(*_touching(outer[free], added), strict=True)):
        if a != b and not disturbed[free[a]]:
            disturbed[free[b]] = True
    kept: dict[int, list[tuple[int, int, int]]] = {}
    for k in np.flatnonzero(~disturbed):
        kept.setdefault(chords[k][0], []).append(chords[k])
    return kept


def _touching(small: Polygons, large: Polygons) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Positions of the pairs that intersect. The large ones are prepared: each may have very many corners."""
    a, b = shapely.STRtree(large).query(small)
    shapely.prepare(large)
    touching = shapely.intersects(large[b], small[a])
    return a[touching], b[touching]


def _rectangle(a: Point, b: Point, depth: float) -> list[Point]:
    """Rectangle to the right of a -> b, a hair off the chord and short of its ends."""
    length = math.dist(a, b)
    tx, ty = (b[0] - a[0]) / length, (b[1] - a[1]) / length
    off = _CLEAR * min(depth, length)
    corners = [(off, off), (length - off, off), (length - off, depth), (off, depth)]
    return [(a[0] + s * tx + d * ty, a[1] + s * ty - d * tx) for s, d in corners]
