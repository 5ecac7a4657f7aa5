"""Exact line-of-sight tests against the grown obstacles, whose outlines may be touched."""

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

Array = NDArray[np.float64]


class FreeSpace:
    """Obstacles prepared for many segment tests.

    Touching is allowed: polygons are shrunk by a hair (1e-7 of the extent) before the test, so that segments along a
    wall are free. Where a polygon touches the border it is first extended beyond it: there is no way between the two.
    """

    def __init__(self, rings_m: tuple[Array, ...], bounds_m: tuple[float, float, float, float]) -> None:
        x_min, y_min, x_max, y_max = bounds_m
        self.bounds_m = bounds_m
        hair = 1e-7 * max(x_max - x_min, y_max - y_min)
        frame = shapely.box(*bounds_m)
        reach = 1e4 * hair
        beyond = shapely.difference(shapely.buffer(frame, reach, join_style="mitre"), frame)
        solid = [_through_border(shapely.Polygon(ring), beyond, reach) for ring in rings_m]
        shrunk = shapely.buffer(np.array(solid, dtype=object), -hair, join_style="mitre")
        self._tree = shapely.STRtree(shrunk)

    def blocked(self, a: Array, b: Array) -> NDArray[np.bool_]:
        """Whether segments from a (n, 2) to b (n, 2) enter an obstacle: (n,)."""
        return self._hit(shapely.linestrings(np.stack([a, b], axis=1)), len(a))

    def covered(self, points: Array) -> NDArray[np.bool_]:
        """Whether points (n, 2) lie inside an obstacle: (n,)."""
        return self._hit(shapely.points(points), len(points))

    def _hit(self, geometries: Any, count: int) -> NDArray[np.bool_]:
        hit = np.zeros(count, dtype=np.bool_)
        hit[self._tree.query(geometries, predicate="intersects")[0]] = True
        return hit


def _through_border(polygon: shapely.Polygon, beyond: shapely.Geometry, reach_m: float) -> shapely.Geometry:
    """The polygon with what it touches of the border extended into the strip beyond it."""
    touching = shapely.buffer(shapely.intersection(polygon, beyond), reach_m, join_style="mitre")
    return shapely.union(polygon, shapely.intersection(touching, beyond))
