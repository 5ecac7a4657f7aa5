"""The edges of the obstacles grown by a distance, found by place.

Growing is mitred, so it never leaves out a point of the true Minkowski sum; every obstacle is grown alone, and beyond
the world's border too.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray

from sandwich_sitl.world.grow import mitred

Array = NDArray[np.float64]


class Outlines:
    """Edges (E, 4) of grown obstacles, as (ax, ay, bx, by) in metres, with an index of their places."""

    def __init__(self, obstacles: Sequence[shapely.Polygon], grown_m: float) -> None:
        self.solids = [mitred(polygon, grown_m) for polygon in obstacles]
        rings = [np.asarray(shapely.get_coordinates(shapely.get_exterior_ring(part)))
                 for solid in self.solids for part in shapely.get_parts(solid)]  # fmt: skip
        parts = [np.hstack([ring[:-1], ring[1:]]) for ring in rings]
        self.edges = np.concatenate(parts) if parts else np.empty((0, 4))
        self._tree = shapely.STRtree(np.atleast_1d(np.asarray(shapely.linestrings(self.edges.reshape(-1, 2, 2)))))
        self._filled = shapely.STRtree(self.solids)

    def near(self, boxes: Array) -> list[Array]:
        """For boxes (n, 4), as (x_min, y_min, x_max, y_max), the edges (., 4) whose own boxes meet each."""
        which, found = self._tree.query(shapely.box(*boxes.T))
        order = np.lexsort((found, which))
        ends = np.searchsorted(which[order], np.arange(1, len(boxes)))
        return list(np.split(self.edges[found[order]], ends))

    def keeps(self, line: Array, distance_m: float) -> bool:
        """Whether a polyline (n, 2) stays `distance_m` away from every grown obstacle."""
        return not len(self._filled.query(shapely.LineString(line), predicate="dwithin", distance=distance_m))

    def distance_m(self, line: Array) -> float:
        """Least distance of a polyline (n, 2) to the grown obstacles, infinite when there are none."""
        if not self.solids:
            return float("inf")
        whole = shapely.LineString(line)
        return float(whole.distance(self.solids[int(self._filled.nearest(whole))]))

    def clearance(self, points: Array, reach_m: float) -> Array:
        """Distance (n,) of points (n, 2) outside to the grown obstacles, `reach_m` where there is nothing nearer."""
        line = shapely.LineString(points) if len(points) > 1 else shapely.Point(points[0])
        found = self._tree.query(line, predicate="dwithin", distance=reach_m)
        return np.asarray(_clearance(np.ascontiguousarray(points), self.edges[np.sort(found)], float(reach_m)))


@njit(cache=True)
def _clearance(points: Array, edges: Array, reach: float) -> Array:
    out = np.full(len(points), reach)
    for e in range(len(edges)):
        a_x, a_y, b_x, b_y = edges[e]
        d_x, d_y = b_x - a_x, b_y - a_y
        square = d_x * d_x + d_y * d_y
        for k in range(len(points)):
            x, y = points[k, 0] - a_x, points[k, 1] - a_y
            share = 0.0 if square == 0.0 else min(1.0, max(0.0, (x * d_x + y * d_y) / square))
            out[k] = min(out[k], np.hypot(x - share * d_x, y - share * d_y))
    return out
