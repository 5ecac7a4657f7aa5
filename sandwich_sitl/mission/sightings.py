"""What a range sensor sees that nobody knew: `RangeScan` to convex obstacle polygons (pure).

A return says that something in its sector (bearing +- width / 2) is `range` away; where in the sector it does not say,
and nothing of what lies behind. So:

 - a return nearer to a known obstacle than the tolerance, and half its sector's width more, is explained by it;
 - the others, sector beside sector, form a cluster while they are no further apart than two sectors and `_JUMP_M`;
 - a cluster is cut into pieces that are straight within `_STRAIGHT_M`, and a piece becomes the convex hull of its
   returns' sectors, from their ranges to `depth_m` behind.

Angles in radians counter-clockwise from east, ENU metres.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.config import ReplanConfig
from sandwich_sitl.mission.vehicle_view import RangeScan

Array = NDArray[np.float64]

_JUMP_M = 0.6
_STRAIGHT_M = 0.25
_NEARLY_M = 1.0  # a vehicle may be lower than it believes


@dataclass(frozen=True)
class Explained:
    """Obstacles that returns may come from, by place, and their tops (n,)."""

    tree: shapely.STRtree
    tops_m: Array

    @classmethod
    def by(cls, polygons: Iterable[shapely.Polygon], tops_m: Sequence[float] | None = None) -> "Explained":
        """Index polygons; without tops they reach every altitude."""
        tree = shapely.STRtree(list(polygons))
        return cls(tree, np.full(len(tree.geometries), np.inf) if tops_m is None else np.array(tops_m, dtype=float))

    def near(self, points: Array, within_m: Array, altitude_m: float) -> NDArray[np.bool_]:
        """Which points (n, 2) at an altitude lie within their distance (n,) of an obstacle that reaches it, or nearly."""
        found = np.zeros(len(points), dtype=bool)
        if len(self.tree.geometries) and len(points):
            which, owner = self.tree.query(shapely.points(points), predicate="dwithin", distance=within_m)
            found[which[self.tops_m[owner] > altitude_m - _NEARLY_M]] = True
        return found


def unexplained(
    scan: RangeScan, known: Explained, config: ReplanConfig, altitude_m: float = -np.inf
) -> list[shapely.Polygon]:
    """Outlines of what the scan shows beside the known obstacles, one a straight piece.

    `altitude_m` is that of the scan: a known obstacle that ends well below it explains nothing.
    """
    hits = np.flatnonzero(np.isfinite(scan.ranges_m))
    points = scan.origin_m + scan.ranges_m[hits, None] * _directions(scan.bearings_rad[hits])
    doubt_m = config.sensor_tolerance_m + scan.ranges_m[hits] * np.tan(scan.width_rad / 2)
    new = hits[~known.near(points, doubt_m, altitude_m)]
    return [
        _outline(scan, piece, config.sensor_depth_m)
        for cluster in _clusters(scan, new.tolist())
        for piece in _straight(scan, cluster)
    ]


def _directions(bearings: Array) -> Array:
    return np.column_stack([np.cos(bearings), np.sin(bearings)])


def _clusters(scan: RangeScan, new: list[int]) -> list[list[int]]:
    """Runs of neighbouring sectors whose returns are near each other; round the seam of a full circle too."""
    clusters: list[list[int]] = []
    for sector in new:
        if clusters and clusters[-1][-1] == sector - 1 and _together(scan, sector - 1, sector):
            clusters[-1].append(sector)
        else:
            clusters.append([sector])
    last = len(scan.ranges_m) - 1
    full = (last + 1) * scan.width_rad > 2 * np.pi - 1e-6
    if full and len(clusters) > 1 and clusters[0][0] == 0 and clusters[-1][-1] == last and _together(scan, last, 0):
        clusters[0] = clusters.pop() + clusters[0]
    return clusters


def _together(scan: RangeScan, first: int, second: int) -> bool:
    a, b = float(scan.ranges_m[first]), float(scan.ranges_m[second])
    apart = float(np.sqrt(max(0.0, a * a + b * b - 2 * a * b * np.cos(scan.width_rad))))
    return apart <= _JUMP_M + 2 * scan.width_rad * min(a, b)


def _straight(scan: RangeScan, cluster: Sequence[int]) -> list[Sequence[int]]:
    """The cluster cut where its returns leave the line between its ends by more than `_STRAIGHT_M`."""
    points = scan.ranges_m[cluster, None] * _directions(scan.bearings_rad[cluster])
    chord = points[-1] - points[0]
    length = float(np.hypot(*chord))
    if len(cluster) < 3 or length < 1e-9:
        return [cluster]
    off = np.abs(chord[0] * (points[:, 1] - points[0, 1]) - chord[1] * (points[:, 0] - points[0, 0])) / length
    corner = int(np.argmax(off))
    if off[corner] <= _STRAIGHT_M:
        return [cluster]
    return _straight(scan, cluster[: corner + 1]) + _straight(scan, cluster[corner:])


def _outline(scan: RangeScan, piece: Sequence[int], depth_m: float) -> shapely.Polygon:
    ranges, bearings, half = scan.ranges_m[piece], scan.bearings_rad[piece], scan.width_rad / 2
    rays = np.concatenate([_directions(bearings - half), _directions(bearings + half)])
    near = np.tile(ranges, 2)[:, None]
    corners = scan.origin_m + np.concatenate([near * rays, (near + depth_m) * rays])
    hull = shapely.MultiPoint(corners).convex_hull
    assert isinstance(hull, shapely.Polygon), "a depth gives every outline an area"
    return hull
