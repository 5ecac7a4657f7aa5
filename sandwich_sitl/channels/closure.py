"""Closures: obstacles made fit to stand between channels, and the ground this takes kept aside as bays.

For disjoint vertically convex shapes "lies below at some x" has no cycle, so they can be levelled into
groups. Any shape is made so by filling every vertical line between its lowest and its highest point; shapes whose
fillings meet are filled together. Slots deep for their width are shut with horizontal lids (`streets`). What is filled
is not lost: every connected part is a *bay*, which opens into the channels beside it through its *lids*, the parts of
the closure's outline that lie in free ground.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from sandwich_sitl.channels.outline import Bounds, Outline, outline_of
from sandwich_sitl.channels.streets import find_lids

Array = NDArray[np.float64]

_SAME = 1e-9  # of the extent: coordinates closer than this are one
_MOST_ROUNDS = 12
_NO_LIDS = np.empty((0, 2, 2))


@dataclass(frozen=True)
class Closure:
    """One vertically convex barrier: its ring (V, 2), counter-clockwise, and the polygons it was made from.

    `members` are indices into the grown world; `bays` are the free ground inside it; `lids` (L, 2, 2) are the segments
    through which that ground opens outwards.
    """

    ring_m: Array
    members: tuple[int, ...]
    bays: tuple[Polygon, ...]
    lids: Array


@dataclass(frozen=True)
class _Cluster:
    """Rings that are closed together, the lids across their slots, and the outline of it all."""

    members: tuple[int, ...]
    lids: Array
    outline: Outline


def close_world(rings: Sequence[Array], bounds: Bounds) -> tuple[Closure, ...]:
    """Disjoint vertically convex closures of disjoint counter-clockwise rings (V, 2) inside `bounds`.

    A shape on the bottom or the top border is closed down or up to it.
    """
    clusters = _united(
        [_Cluster((k,), _NO_LIDS, outline_of([ring], _NO_LIDS, bounds)) for k, ring in enumerate(rings)], rings, bounds
    )
    for _ in range(_MOST_ROUNDS):
        found = find_lids([cluster.outline for cluster in clusters], bounds)
        if not found:
            break
        pairs = [(lids.a, lids.b) for lids in found]
        added: dict[int, list[Array]] = {min(lids.a, lids.b): [] for lids in found}
        for lids in found:
            added[min(lids.a, lids.b)].append(lids.segments)
        shut = [
            _Cluster(c.members, np.concatenate([c.lids, *added.get(k, [])]), c.outline) for k, c in enumerate(clusters)
        ]
        clusters = _united(_joined(shut, pairs, rings, bounds, touched=set(added)), rings, bounds)
    return tuple(_closure(cluster, rings, bounds) for cluster in clusters)


def _united(clusters: list[_Cluster], rings: Sequence[Array], bounds: Bounds) -> list[_Cluster]:
    """Clusters after joining those whose closures meet, until none do."""
    while len(clusters) > 1:
        polygons = [Polygon(cluster.outline.ring()) for cluster in clusters]
        pairs = shapely.STRtree(polygons).query(polygons, predicate="intersects").T
        pairs = pairs[pairs[:, 0] < pairs[:, 1]]
        if not len(pairs):
            break
        clusters = _joined(clusters, [(int(a), int(b)) for a, b in pairs], rings, bounds, touched=set())
    return clusters


def _joined(
    clusters: list[_Cluster],
    pairs: Sequence[tuple[int, int]],
    rings: Sequence[Array],
    bounds: Bounds,
    touched: set[int],
) -> list[_Cluster]:
    """Clusters with the pairs put together; outlines anew where that or a lid in `touched` changed them."""
    root = list(range(len(clusters)))

    def find(k: int) -> int:
        while root[k] != k:
            k = root[k]
        return k

    for a, b in pairs:
        root[find(b)] = find(a)
    groups: dict[int, list[int]] = {}
    for k in range(len(clusters)):
        groups.setdefault(find(k), []).append(k)
    joined = []
    for group in groups.values():
        if len(group) == 1 and group[0] not in touched:
            joined.append(clusters[group[0]])
            continue
        members = tuple(sorted(k for g in group for k in clusters[g].members))
        lids = np.concatenate([clusters[g].lids for g in group])
        joined.append(_Cluster(members, lids, outline_of([rings[k] for k in members], lids, bounds)))
    return joined


def _closure(cluster: _Cluster, rings: Sequence[Array], bounds: Bounds) -> Closure:
    outline = cluster.outline
    ring = outline.ring()
    if outline.own:
        return Closure(ring, cluster.members, (), _NO_LIDS)
    own = [rings[k] for k in cluster.members]
    solid = [Polygon(with_vertices(member, ring)) for member in own]
    ring = with_vertices(ring, np.concatenate(own))
    rest = shapely.difference(Polygon(ring), shapely.union_all(solid))
    bays = tuple(part for part in shapely.get_parts(rest) if isinstance(part, Polygon) and not part.is_empty)
    walls = {tuple(sorted((a, b))) for polygon in solid for a, b in _sides(polygon)}
    x_min, y_min, x_max, y_max = bounds
    lids = [
        (a, b)
        for a, b in _sides(Polygon(ring))
        if tuple(sorted((a, b))) not in walls
        and not any(a[axis] == b[axis] == value for axis, value in ((0, x_min), (1, y_min), (0, x_max), (1, y_max)))
    ]
    return Closure(ring, cluster.members, bays, np.array(lids).reshape(-1, 2, 2))


def _sides(polygon: Polygon) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    points = [(float(x), float(y)) for x, y in shapely.get_coordinates(polygon.exterior)]
    return list(itertools.pairwise(points))


def with_vertices(ring: Array, points: Array) -> Array:
    """The ring (V, 2) with those of `points` (n, 2) that lie inside one of its edges as vertices."""
    following = np.roll(ring, -1, axis=0)
    side = following - ring
    length = np.hypot(*side.T)
    pieces = []
    for start, step, size in zip(ring, side, length, strict=True):
        offset = points - start
        along = offset @ step / size
        beside = np.abs(offset[:, 0] * step[1] - offset[:, 1] * step[0]) / size
        tolerance = _SAME * (1 + size + np.abs(start).max())
        inside = (beside <= tolerance) & (along > tolerance) & (along < size - tolerance)
        order = np.argsort(along[inside])
        between = points[inside][order]
        apart = np.diff(along[inside][order], prepend=-np.inf) > tolerance
        pieces += [start[None], between[apart]]
    return np.concatenate(pieces)
