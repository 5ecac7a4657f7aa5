"""Obstacles as prisms that stand on the ground: how far points and paths keep from them in three dimensions.

State: outlines in metres, united by height, so that a query costs one distance to a polygon for each height. The
distance of (x, y, z) to a prism of height h is  sqrt(d(x, y)^2 + max(z - h, 0)^2)  with d that to its outline.
"""

from collections.abc import Sequence
from copy import copy
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STEP_M = 0.005  # a path is looked at this often; between two looks a distance changes by less than half of it


class Prisms:
    """Obstacles with outlines (V, 2) and heights (n,); an infinite height reaches every altitude."""

    def __init__(self, rings_m: Sequence[Array], heights_m: Array) -> None:
        polygons: Any = np.array([shapely.Polygon(ring) for ring in rings_m], dtype=object)
        self._outlines = {
            height: shapely.union_all(polygons[heights_m == height]) for height in np.unique(heights_m).tolist()
        }
        for outline in self._outlines.values():
            shapely.prepare(outline)

    def joined_by(self, ring_m: Array, height_m: float) -> "Prisms":
        """These and one more."""
        joined = copy(self)
        outline = shapely.union(self._outlines.get(height_m, shapely.Polygon()), shapely.Polygon(ring_m))
        shapely.prepare(outline)
        joined._outlines = {**self._outlines, height_m: outline}
        return joined

    def distance_m(self, points: Array) -> Array:
        """Distance (n,) of points (n, 3) to the nearest prism, 0 inside, infinite where there is none."""
        least = np.full(len(points), np.inf)
        at = shapely.points(points[:, :2])
        for height, outline in self._outlines.items():
            over = np.maximum(points[:, 2] - height, 0.0)
            least = np.minimum(least, np.hypot(shapely.distance(outline, at), over))
        return least

    def distance_of_path_m(self, path: Array) -> float:
        """Least distance of a continuous path (n, 3): exact for prisms without top, which ask for (n, 2) only.

        For the others to half of `_STEP_M`.
        """
        least = np.inf
        line = shapely.LineString(path[:, :2]) if len(path) > 1 else shapely.Point(path[0, :2])
        closely: Array | None = None
        for height, outline in self._outlines.items():
            flat = float(shapely.distance(outline, line))
            if flat >= least or np.isinf(height):
                least = min(least, flat)
                continue
            closely = _refined(path) if closely is None else closely
            over = np.maximum(closely[:, 2] - height, 0.0)
            least = min(least, float(np.hypot(shapely.distance(outline, shapely.points(closely[:, :2])), over).min()))
        return least


def _refined(path: Array) -> Array:
    """The path with points at most `_STEP_M` apart."""
    steps = np.maximum(np.ceil(np.linalg.norm(np.diff(path, axis=0), axis=1) / _STEP_M), 1.0)
    at = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.arange(at[-1] + 1)
    return np.column_stack([np.interp(wanted, at, column) for column in path.T])
