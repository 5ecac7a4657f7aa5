"""Tips: where a dividing streamline meets a barrier and where it leaves it (notes N3).

The left tip lies in the middle of the barrier's left face: the run of steep edges round its leftmost vertex. From
there the streamline leaves horizontally to the x of the leftmost vertex; the sliver between that line and the face
then belongs to neither neighbour's way, so the barrier's hull takes it in. Where another hull is in the way the
leftmost vertex itself is the tip.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

Array = NDArray[np.float64]

_STEEP = np.tan(np.radians(55.0))  # |dy/dx| from which an edge counts to the face


@dataclass(frozen=True)
class Tip:
    """`point_m` (2,) on the ring, and the x at which the free streamline ends."""

    point_m: Array
    x_end_m: float

    def edges(self, extreme: Array) -> Array:
        """The way out and the drop to the extreme vertex, as edges (2, 2, 2) for the hull."""
        end = np.array([self.x_end_m, self.point_m[1]])
        return np.array([[self.point_m, end], [end, extreme]])


def place_tip(ring: Array, *, left: bool, others: list[Polygon]) -> Tip:
    """The tip of a counter-clockwise ring (V, 2) on its left or right side; slivers stay clear of `others`."""
    x_end = float(ring[:, 0].min() if left else ring[:, 0].max())
    extreme = int(np.flatnonzero(ring[:, 0] == x_end)[0])
    plain = Tip(ring[extreme], x_end)
    face = _face(ring, extreme)
    point = _middle(face)
    if np.array_equal(point, plain.point_m):
        return plain
    start = np.array([x_end, point[1]])
    if point[0] == x_end:
        return Tip(point, x_end)
    between = (
        face[np.minimum(face[:, 1], point[1]) == face[:, 1]]
        if ring[extreme, 1] < point[1]
        else face[face[:, 1] >= point[1]]
    )
    sliver = Polygon([start, *between, point]).convex_hull
    body = Polygon(ring)
    reach = shapely.LineString([start, point])
    clear = not shapely.intersects(sliver, shapely.union_all(others)) if others else True
    if not isinstance(sliver, Polygon) or not clear or body.intersection(reach).length > 1e-9:
        return plain
    return Tip(point, x_end)


def insert_vertex(ring: Array, point: Array) -> Array:
    """The ring with `point`, which lies on it, as a vertex."""
    if (ring == point).all(axis=1).any():
        return ring
    following = np.roll(ring, -1, axis=0)
    edge = following - ring
    share = np.clip(((point - ring) * edge).sum(axis=1) / (edge**2).sum(axis=1), 0.0, 1.0)
    distance = np.hypot(*(ring + share[:, None] * edge - point).T)
    return np.insert(ring, int(np.argmin(distance)) + 1, point, axis=0)


def _face(ring: Array, extreme: int) -> Array:
    """Vertices of the run of steep edges through vertex `extreme`, in ring order, monotone in y."""
    n = len(ring)
    first = last = extreme
    while last - extreme < n and _steep(ring[last % n], ring[(last + 1) % n], ring[extreme], ring[last % n]):
        last += 1
    while extreme - first < n and _steep(ring[first % n], ring[(first - 1) % n], ring[extreme], ring[first % n]):
        first -= 1
    return ring[np.arange(first, last + 1) % n]


def _steep(a: Array, b: Array, origin: Array, reached: Array) -> bool:
    """Whether edge a -> b is steep and goes on in the direction of y taken from `origin` to `reached`."""
    step = b - a
    onward = (reached[1] - origin[1]) * step[1] >= 0
    return bool(onward and abs(step[1]) > _STEEP * abs(step[0]))


def _middle(path: Array) -> Array:
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    half = arc[-1] / 2
    return np.array([np.interp(half, arc, path[:, 0]), np.interp(half, arc, path[:, 1])])
