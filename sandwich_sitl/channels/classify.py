"""Obstacles into groups R_1 .. R_{p-1}, automatically (the paper draws them by hand; notes N5, N6).

Obstacles that touch the bottom or top border become part of that border. The others are ordered by "lies below at
some x" on their vertical hulls; a level is the longest chain below, so no two obstacles of a level share an x, each
level is a left-to-right chain, and the number of levels is the least possible. An obstacle with slack takes the level
nearest its height.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.barrier import Barrier
from sandwich_sitl.channels.hull import VerticalHull, ring_edges, vertical_hull
from sandwich_sitl.channels.levels import assign_levels
from sandwich_sitl.channels.tips import insert_vertex, place_tip
from sandwich_sitl.errors import NoRouteError
from sandwich_sitl.world.grow import GrownWorld

Array = NDArray[np.float64]

_BRIDGE_M = 0.02  # thinner than any grid cell, thick enough for its two walls to be two


@dataclass(frozen=True)
class Classification:
    """`bottom` and `top` touch those borders; `groups[d]` (d = 0 .. p - 2) are the chains R_{d+1}, left to right."""

    bottom: tuple[Barrier, ...]
    top: tuple[Barrier, ...]
    groups: tuple[tuple[Barrier, ...], ...]


def classify(grown: GrownWorld) -> Classification:
    """Group the obstacles of a grown world.

    Raises `NoRouteError` naming the obstacle when one reaches from the bottom to the top border.
    """
    barriers = _untangled(grown)
    y_min, y_max = grown.bounds_m[1], grown.bounds_m[3]
    touches = {b.index: (_touches(b.ring_m, y_min), _touches(b.ring_m, y_max)) for b in barriers}
    for barrier in barriers:
        if all(touches[barrier.index]):
            raise NoRouteError(
                f"obstacle '{barrier.name}' reaches from the bottom to the top border and splits the world in two; "
                "remove it, or plan each side on its own"
            )
    bottom = _along_border([b for b in barriers if touches[b.index][0]], y_min, grown.bounds_m)
    top = _along_border([b for b in barriers if touches[b.index][1]], y_max, grown.bounds_m)
    inner = _tipped(barriers, {b.index for b in barriers if not any(touches[b.index])}, grown.bounds_m)
    return Classification(bottom, top, assign_levels(inner, y_min, y_max))


def _tipped(barriers: list[Barrier], inner: set[int], bounds: tuple[float, float, float, float]) -> list[Barrier]:
    """The inner barriers with their tips; slivers keep clear of every hull and of each other."""
    taken = [barrier.hull.polygon() for barrier in barriers]
    tipped = []
    for k, barrier in enumerate(barriers):
        if barrier.index not in inner:
            continue
        others = taken[:k] + taken[k + 1 :]
        ring, tips = barrier.ring_m, []
        for left, border in ((True, bounds[0]), (False, bounds[2])):
            at_border = (ring[:, 0] == border).any()
            tips.append(None if at_border else place_tip(barrier.ring_m, left=left, others=others))
        ways_out = [tip.edges(ring[ring[:, 0] == tip.x_end_m][0]) for tip in tips if tip is not None]
        for tip in tips:
            ring = ring if tip is None else insert_vertex(ring, tip.point_m)
        hull = vertical_hull(np.concatenate([ring_edges(barrier.ring_m), *ways_out]))
        taken[k] = hull.polygon()
        tipped.append(replace(barrier, ring_m=ring, hull=hull, left_tip=tips[0], right_tip=tips[1]))
    return tipped


def _touches(ring: Array, y: float) -> bool:
    return bool((ring[:, 1] == y).any())


def _along_border(barriers: list[Barrier], y: float, bounds: tuple[float, float, float, float]) -> tuple[Barrier, ...]:
    """Left to right by contact with the border; one in a pocket that another encloses with the border is dropped."""

    def contact(barrier: Barrier) -> tuple[float, float]:
        ring = barrier.ring_m
        x = ring[ring[:, 1] == y, 0]
        round_left, round_right = (ring[:, 0] == bounds[0]).any(), (ring[:, 0] == bounds[2]).any()
        return -np.inf if round_left else float(x.min()), np.inf if round_right else float(x.max())

    def reach(barrier: Barrier) -> float:
        return float(barrier.ring_m[:, 1].max() - barrier.ring_m[:, 1].min())

    kept: list[Barrier] = []
    for barrier in sorted(barriers, key=reach, reverse=True):
        left, right = contact(barrier)
        if not any(a <= left and right <= b for a, b in (contact(other) for other in kept)):
            kept.append(barrier)
    return tuple(sorted(kept, key=contact))


def _untangled(grown: GrownWorld) -> list[Barrier]:
    """Barriers with disjoint hulls: obstacles whose hulls overlap are tied together by the shortest bridges."""
    barriers = [_single(k, grown) for k in range(len(grown.polygons))]
    while (pair := _overlapping(barriers, grown.bounds_m)) is not None:
        a, b = (barriers[k] for k in pair)
        barriers = [barrier for barrier in barriers if barrier is not a and barrier is not b]
        barriers += _tied(a, b, grown)
    return barriers


def _single(index: int, grown: GrownWorld) -> Barrier:
    ring = _snapped(grown.rings_m()[index], grown.bounds_m)
    return Barrier(index, grown.names[index], ring, _hull_of(ring, grown.bounds_m))


def _tied(a: Barrier, b: Barrier, grown: GrownWorld) -> list[Barrier]:
    """Two barriers that interlock, tied by a thin bridge: together, or one of them with the border the other touches.

    Filling the ground between them would lose it; a bridge bars one crossing and loses a strip of `_BRIDGE_M`.
    """
    bridge = shapely.shortest_line(shapely.Polygon(a.ring_m), shapely.Polygon(b.ring_m))
    for y in (grown.bounds_m[1], grown.bounds_m[3]):
        for inner, outer in ((a, b), (b, a)):
            if _touches(outer.ring_m, y) and not _touches(inner.ring_m, y):
                nearest = inner.ring_m[np.argmin(np.abs(inner.ring_m[:, 1] - y))]
                upright = shapely.LineString([nearest, (nearest[0], y)])
                blocked = any(upright.intersection(polygon).length > 1e-6 for polygon in grown.polygons)
                if upright.length < bridge.length and not blocked:
                    return [outer, _joined([inner], upright, grown.bounds_m)]
    return [_joined([a, b], bridge, grown.bounds_m)]


def _joined(barriers: list[Barrier], bridge: shapely.LineString, bounds: tuple[float, float, float, float]) -> Barrier:
    strip = bridge.buffer(_BRIDGE_M / 2, cap_style="square") & shapely.box(*bounds)
    union = shapely.union_all([strip, *(shapely.Polygon(barrier.ring_m) for barrier in barriers)])
    assert isinstance(union, shapely.Polygon)
    ring = _snapped(shapely.get_coordinates(shapely.orient_polygons(union).exterior)[:-1], bounds)
    index, name = min(barrier.index for barrier in barriers), "+".join(barrier.name for barrier in barriers)
    return Barrier(index, name, ring, _hull_of(ring, bounds))


def _snapped(ring: Array, bounds: tuple[float, float, float, float]) -> Array:
    """Coordinates within rounding of a border lie on it exactly."""
    ring = ring.copy()
    tolerance = 1e-7 * max(bounds[2] - bounds[0], bounds[3] - bounds[1])
    for axis, value in ((0, bounds[0]), (1, bounds[1]), (0, bounds[2]), (1, bounds[3])):
        ring[np.abs(ring[:, axis] - value) < tolerance, axis] = value
    return ring


def _hull_of(ring: Array, bounds: tuple[float, float, float, float]) -> VerticalHull:
    floor = bounds[1] if _touches(ring, bounds[1]) else None
    ceiling = bounds[3] if _touches(ring, bounds[3]) else None
    return vertical_hull(ring_edges(ring), floor, ceiling)


def _overlapping(barriers: list[Barrier], bounds: tuple[float, float, float, float]) -> tuple[int, int] | None:
    """The first pair whose hulls meet. Two barriers on the same border may: along it their order is given."""
    if len(barriers) < 2:
        return None
    hulls = [barrier.hull.polygon() for barrier in barriers]
    for a, b in shapely.STRtree(hulls).query(hulls, predicate="intersects").T:
        same_border = any(
            _touches(barriers[a].ring_m, y) and _touches(barriers[b].ring_m, y) for y in (bounds[1], bounds[3])
        )
        if a < b and not same_border:
            return int(a), int(b)
    return None
