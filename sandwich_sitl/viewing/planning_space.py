"""Motion space -> planning space: where in (phi, psi) a point (x, y) lies.

Each cell of the channel map is cut into two triangles, on which (phi, psi) is interpolated linearly; at the nodes this
is the map itself. A point in no cell (inside an obstacle's grown outline, or beyond the border)
is moved to the nearest one first.
"""

import itertools
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap

Array = NDArray[np.float64]

_JUMP = 0.1  # of the planning space's extent
FLAT_M2 = 1e-12  # a triangle of less than half this area cannot be interpolated on


class PlanningSpace:
    """The inverse of one channel map, with its search tree built once."""

    def __init__(self, channel_map: ChannelMap) -> None:
        planning = [
            np.stack(np.meshgrid(channel_map.phi, channel_map.psi_rows(d), indexing="ij"), axis=-1)
            for d in range(channel_map.channels)
        ]
        corners_xy = np.concatenate([np.empty((0, 3, 2)), *(_triangles(grid) for grid in channel_map.xy_m)])
        corners_pq = np.concatenate([np.empty((0, 3, 2)), *(_triangles(grid) for grid in planning)])
        edges = np.stack([corners_xy[:, 1] - corners_xy[:, 0], corners_xy[:, 2] - corners_xy[:, 0]], axis=-1)
        kept = np.abs(np.linalg.det(edges)) > FLAT_M2
        self._origins, self._edges, self._corners_pq = corners_xy[kept, 0], edges[kept], corners_pq[kept]
        self._cells: Any = shapely.polygons(corners_xy[kept])
        self._tree = shapely.STRtree(self._cells)

    def locate(self, xy_m: Array) -> Array:
        """(phi, psi) (K, 2) of points (K, 2) in ENU metres; in a bay those of the nearest cell, nan without channels."""
        if not len(self._origins):
            return np.full((len(xy_m), 2), np.nan)
        points = shapely.points(xy_m)
        cell = self._tree.nearest(points)
        return self._in_cell(cell, points)

    def pieces(self, line_m: Array, step_m: float, reach_m: float) -> list[Array]:
        """What a polyline (n, 2) looks like: pieces (m, 2) in (phi, psi), read every `step_m`.

        It is broken where it runs further than `reach_m` from every channel's cell, through a bay, and where two points
        beside each other lie far apart, across a barred wall.
        """
        if not len(self._origins):
            return []
        dense_m = _dense(line_m, step_m)
        points = shapely.points(dense_m)
        cell = self._tree.nearest(points)
        where = self._in_cell(cell, points)
        span = np.ptp(self._corners_pq.reshape(-1, 2), axis=0)
        near = shapely.distance(self._cells[cell], points) <= reach_m
        broken = ~(near[1:] & near[:-1]) | (np.abs(np.diff(where, axis=0)) > _JUMP * span).any(axis=1)
        return [piece for piece in np.split(where, np.flatnonzero(broken) + 1) if len(piece) > 1]

    def _in_cell(self, cell: Any, points: Any) -> Array:
        on_cell_m = shapely.get_coordinates(shapely.shortest_line(self._cells[cell], points))[::2]
        weights = np.linalg.solve(self._edges[cell], (on_cell_m - self._origins[cell])[..., None])[..., 0]
        p, q, r = (self._corners_pq[cell, k] for k in range(3))
        result: Array = p + weights[:, :1] * (q - p) + weights[:, 1:] * (r - p)
        return result


def _dense(line_m: Array, step_m: float) -> Array:
    """Points along a polyline (n, 2) at most `step_m` apart, its own among them."""
    parts = [
        np.linspace(a, b, max(1, int(np.ceil(np.hypot(*(b - a)) / step_m))), endpoint=False)
        for a, b in itertools.pairwise(line_m)
    ]
    return np.concatenate([*parts, line_m[-1:]])


def _triangles(grid: Array) -> Array:
    """The cells of a grid (M, N, 2), each cut along one diagonal: corners (T, 3, 2)."""
    low_left, low_right = grid[:-1, :-1], grid[1:, :-1]
    up_left, up_right = grid[:-1, 1:], grid[1:, 1:]
    lower = np.stack([low_left, low_right, up_right], axis=2)
    upper = np.stack([low_left, up_right, up_left], axis=2)
    return np.concatenate([lower.reshape(-1, 3, 2), upper.reshape(-1, 3, 2)])
