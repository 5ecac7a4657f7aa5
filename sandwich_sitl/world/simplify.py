"""Fewer vertices, never less obstacle: each step removes one vertex or one edge and only adds ground to the polygon.

Two moves, each allowed while it displaces the outline by less than the tolerance and the new outline lies that near to
the given polygon: a reflex vertex is dropped (the chord covers the notch), or a short convex edge is replaced by the
point where its two neighbours meet.
"""

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon
from shapely.geometry.polygon import orient

Array = NDArray[np.float64]

_MANY = 64  # vertices


def simplify_outwards(polygon: Polygon, tolerance_m: float) -> Polygon:
    """A valid polygon that covers `polygon` (its holes filled) and reaches at most `tolerance_m` further."""
    given = orient(Polygon(polygon.exterior))
    room = given.buffer(tolerance_m)
    shapely.prepare(room)
    ring = [np.asarray(point) for point in _thinned(given, tolerance_m, room).exterior.coords[:-1]]
    while len(ring) > 4:
        moves = [move for i in range(len(ring)) for move in _moves(ring, i, tolerance_m, room)]
        if not moves:
            break
        _, index, replacement, dropped = min(moves, key=lambda move: (move[0], move[1]))
        keep = [p for k, p in enumerate(ring) if k not in dropped]
        if replacement is not None:
            keep.insert(index - sum(1 for k in dropped if k < index), replacement)
        candidate = Polygon(keep)
        if not candidate.is_valid:
            break
        ring = keep
    return orient(Polygon(ring))


def _thinned(given: Polygon, tolerance_m: float, room: Polygon) -> Polygon:
    """An outline of very many vertices, grown by less than half the tolerance and thinned by less than that.

    Moves one at a time cost the square of the number of vertices.
    """
    if len(given.exterior.coords) <= _MANY:
        return given
    thinned = given.buffer(0.45 * tolerance_m, join_style="mitre", mitre_limit=1.5).simplify(0.4 * tolerance_m)
    if not isinstance(thinned, Polygon) or not thinned.covers(given) or not room.covers(thinned):
        return given
    return orient(Polygon(thinned.exterior))


def _moves(
    ring: list[Array], i: int, tolerance: float, room: Polygon
) -> list[tuple[float, int, Array | None, tuple[int, ...]]]:
    """Moves at vertex i that stay in `room`: (displacement, position, replacement or None, indices dropped)."""
    n = len(ring)
    before, here, after, second = ring[i - 1], ring[i], ring[(i + 1) % n], ring[(i + 2) % n]
    moves: list[tuple[float, int, Array | None, tuple[int, ...]]] = []
    chord = after - before
    length = float(np.hypot(*chord))
    turn = _cross(here - before, after - here)
    if length > 0 and turn <= 0:
        displacement = abs(_cross(chord, here - before)) / length
        if displacement < tolerance and room.covers(LineString([before, after])):
            moves.append((displacement, i, None, (i,)))
    if turn > 0 and _cross(after - here, second - after) > 0:
        apex = _meet(before, here, second, after)
        if apex is not None:
            edge = after - here
            displacement = abs(_cross(edge, apex - here)) / float(np.hypot(*edge))
            if displacement < tolerance and room.covers(LineString([before, apex, second])):
                moves.append((displacement, i, apex, (i, (i + 1) % n)))
    return moves


def _meet(a: Array, b: Array, c: Array, d: Array) -> Array | None:
    """Where the rays a->b and c->d meet beyond b and d, or None."""
    r, s = b - a, d - c
    denominator = _cross(r, s)
    if abs(denominator) < 1e-12:
        return None
    t, u = _cross(c - a, s) / denominator, _cross(c - a, r) / denominator
    return a + t * r if t > 1 and u > 1 else None


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])
