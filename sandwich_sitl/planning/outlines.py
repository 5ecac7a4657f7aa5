"""The edges of the obstacles grown by a distance, found by place.

Growing is mitred, so it never leaves out a point of the true Minkowski sum; every obstacle is grown alone, and beyond
the world's border too. An obstacle ends at its top; without one it reaches every altitude.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray

from sandwich_sitl.world.grow import mitred

Array = NDArray[np.float64]


class Outlines:
    """Edges (E, 4) of grown obstacles, as (ax, ay, bx, by) in metres, with an index of their places.

    `tops_m` (n,) are the obstacles' tops, by default infinite; `tops` (E,) those of the edges.
    """

    def __init__(self, obstacles: Sequence[shapely.Polygon], grown_m: float, tops_m: Array | None = None) -> None:
        self.solids = [mitred(polygon, grown_m) for polygon in obstacles]
        owner = [k for k, solid in enumerate(self.solids) for _ in shapely.get_parts(solid)]
        rings = [np.asarray(shapely.get_coordinates(shapely.get_exterior_ring(part)))
                 for solid in self.solids for part in shapely.get_parts(solid)]  # fmt: skip
        parts = [np.hstack([ring[:-1], ring[1:]]) for ring in rings]
        self.edges = np.concatenate(parts) if parts else np.empty((0, 4))
        self.tops_m = np.full(len(obstacles), np.inf) if tops_m is None else tops_m
        self.tops = np.repeat(self.tops_m[owner], [len(part) for part in parts]) if parts else np.empty(0)
        self._tree = shapely.STRtree(np.atleast_1d(np.asarray(shapely.linestrings(self.edges.reshape(-1, 2, 2)))))
        self._filled = shapely.STRtree(self.solids)

    def near(self, boxes: Array) -> list[Array]:
        """For boxes (n, 4), as (x_min, y_min, x_max, y_max), the edges (., 4) whose own boxes meet each."""
        return [edges for edges, _ in self.near_with_tops(boxes)]

    def near_with_tops(self, boxes: Array) -> list[tuple[Array, Array]]:
        """The same edges, with the tops (.,) of their obstacles."""
        which, found = self._tree.query(shapely.box(*boxes.T))
        order = np.lexsort((found, which))
        ends = np.searchsorted(which[order], np.arange(1, len(boxes)))
        chosen = found[order]
        return list(zip(np.split(self.edges[chosen], ends), np.split(self.tops[chosen], ends), strict=True))

    def keeps(self, line: Array, distance_m: float) -> bool:
        """Whether a polyline (n, 2) stays `distance_m` away from every grown obstacle."""
        return not len(self._filled.query(shapely.LineString(line), predicate="dwithin", distance=distance_m))

    def distance_m(self, line: Array) -> float:
        """Least distance of a polyline (n, 2) to the grown obstacles, infinite when there are none."""
        if not self.solids:
            return float("inf")
        whole = shapely.LineString(line)
        return float(whole.distance(self.solids[int(self._filled.nearest(whole))]))

    def clearance(self, points: Array, reach_m: float, above_m: Array | None = None) -> Array:
        """Distance (n,) of points (n, 2) outside to the grown obstacles, `reach_m` where there is nothing nearer.

        With `above_m` (n,) only to those with a top above it.
        """
        line = shapely.LineString(points) if len(points) > 1 else shapely.Point(points[0])
        found = np.sort(self._tree.query(line, predicate="dwithin", distance=reach_m))
        low = np.full(len(points), -np.inf) if above_m is None else above_m
        at = np.ascontiguousarray(points)
        return np.asarray(_clearance(at, low, self.edges[found], self.tops[found], float(reach_m)))


@njit(cache=True)
def _clearance(points: Array, low: Array, edges: Array, tops: Array, reach: float) -> Array:
    out = np.full(len(points), reach)
    for e in range(len(edges)):
        a_x, a_y, b_x, b_y = edges[e]
        d_x, d_y = b_x - a_x, b_y - a_y
        square = d_x * d_x + d_y * d_y
        for k in range(len(points)):
            if tops[e] <= low[k]:
                continue
            x, y = points[k, 0] - a_x, points[k, 1] - a_y
            share = 0.0 if square == 0.0 else min(1.0, max(0.0, (x * d_x + y * d_y) / square))
            out[k] = min(out[k], np.hypot(x - share * d_x, y - share * d_y))
    return out
