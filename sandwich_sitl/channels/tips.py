"""Tips: where on a barrier's face a dividing streamline arrives and leaves.

A tip looks to the neighbour in its chain: where the two faces overlap in height it lies in the middle of the overlap,
else at the end of the face that is nearer, so that streamlines bend little and leave no wedge between themselves and a
wall. Where a level way out would meet another barrier or cut a bulge of its own, the extreme vertex itself is the tip.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.barrier import Barrier

Array = NDArray[np.float64]

_DEEPEST = 0.4  # of a barrier's width: a tip lies no further from its extreme x
_HAIR_M = 1e-9
_SAME = 0.02  # of a face: a vertex this near the wanted height serves as tip


def place_tips(groups: Sequence[Sequence[Barrier]], everyone: Sequence[Barrier]) -> tuple[tuple[Barrier, ...], ...]:
    """The chains with both tips of every barrier on their rings; `everyone` are all barriers of the world."""
    tree = shapely.STRtree([shapely.Polygon(barrier.ring_m) for barrier in everyone])
    number = {id(barrier): k for k, barrier in enumerate(everyone)}
    taken: list[shapely.Polygon] = []
    placed = []
    for chain in groups:
        row = []
        for k, barrier in enumerate(chain):
            before = chain[k - 1].right_face() if k > 0 else None
            after = chain[k + 1].left_face() if k + 1 < len(chain) else None
            own = number[id(barrier)]
            left, right = (
                None if at_border else _tip(face, facing, x_end, barrier.x_max - barrier.x_min, tree, own, taken)
                for at_border, face, facing, x_end in (
                    (barrier.on_left, barrier.left_face(), before, barrier.x_min),
                    (barrier.on_right, barrier.right_face(), after, barrier.x_max),
                )
            )
            ring = barrier.ring_m
            for tip in (left, right):
                ring = ring if tip is None else _with_vertex(ring, tip)
            row.append(replace(barrier, ring_m=ring, left_tip=left, right_tip=right))
        placed.append(tuple(row))
    return tuple(placed)


def _tip(
    face: Array,
    facing: Array | None,
    x_end: float,
    width: float,
    tree: shapely.STRtree,
    own: int,
    taken: list[shapely.Polygon],
) -> Array:
    """The tip (2,) on a face (F, 2) that looks to the face `facing` of its neighbour."""
    point = _at_height(face, _wanted(face, facing))
    if point[0] == x_end:
        return point
    extreme = face[face[:, 0] == x_end]
    nearest = np.asarray(extreme[np.argmin(np.abs(extreme[:, 1] - point[1]))])
    if abs(point[0] - x_end) > _DEEPEST * width:
        return nearest
    beside = face[(face[:, 1] - point[1]) * (extreme[0, 1] - point[1]) > 0]
    sliver = shapely.MultiPoint([point, (x_end, point[1]), *beside]).convex_hull
    others = [k for k in tree.query(sliver, predicate="intersects").tolist() if k != own]
    way = shapely.LineString(np.array([point, [x_end, point[1]]]))
    through = shapely.intersection(tree.geometries[own], way).length > _HAIR_M
    if others or through or any(sliver.intersects(other) for other in taken):
        return nearest
    assert isinstance(sliver, shapely.Polygon)
    taken.append(sliver)
    return point


def _wanted(face: Array, facing: Array | None) -> float:
    """Height at which the streamline should meet a face."""
    low, high = float(face[0, 1]), float(face[-1, 1])
    if facing is None:
        return (low + high) / 2
    return float(np.clip((max(low, facing[0, 1]) + min(high, facing[-1, 1])) / 2, low, high))


def _at_height(face: Array, y: float) -> Array:
    """The point of a face (F, 2), which rises, at height y; a vertex of it where one is near."""
    nearest = int(np.argmin(np.abs(face[:, 1] - y)))
    if abs(face[nearest, 1] - y) <= _SAME * (face[-1, 1] - face[0, 1]):
        return np.asarray(face[nearest])
    return np.array([np.interp(y, face[:, 1], face[:, 0]), y])


def _with_vertex(ring: Array, point: Array) -> Array:
    """The ring with `point`, which lies on it, as a vertex."""
    if (ring == point).all(axis=1).any():
        return ring
    side = np.roll(ring, -1, axis=0) - ring
    length2 = (side**2).sum(axis=1)
    along = np.clip(((point - ring) * side).sum(axis=1) / length2, 0.0, 1.0)
    distance = np.hypot(*(ring + along[:, None] * side - point).T)
    return np.insert(ring, int(np.argmin(distance)) + 1, point, axis=0)
