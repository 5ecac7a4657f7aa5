"""What the mapped route is measured against: the paper's A* on a uniform grid, and the exact shortest path.

Notes N11: an 8-connected grid costs up to 8.24 % over the straight line, so a gain over it says little without the
exact optimum beside it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.planning.free_space import FreeSpace
from sandwich_sitl.planning.search import FoundPath, Graph, Links, astar, grid_edges, knights_edges

Array = NDArray[np.float64]


@dataclass(frozen=True)
class UniformGrid:
    """A uniform grid over the bounds, without the edges that enter an obstacle."""

    free: FreeSpace
    graph: Graph
    reach_m: float  # start and goal are joined to the nodes within it that they can see

    def path(self, start: Array, goal: Array) -> Array | None:
        """A* path (n, 2) between two points (2,); None when it finds none."""
        xy, reach = self.graph.xy_m, self.reach_m
        start_links, goal_links = _visible(self.free, xy, start, reach), _visible(self.free, xy, goal, reach)
        found = astar(self.graph, start_links, goal, goal_links)
        return None if found is None else path_points(self.graph, found, start, goal)


def uniform_grid(free: FreeSpace, nodes: int, *, wide: bool = False) -> UniformGrid:
    """The grid of about `nodes` nodes, 8-connected, or `wide` with the knight's moves too: 16 neighbours.

    Ends are joined to the nodes of their cell and its neighbours.
    """
    x_min, y_min, x_max, y_max = free.bounds_m
    spacing = np.sqrt((x_max - x_min) * (y_max - y_min) / nodes)
    n_x, n_y = max(2, round((x_max - x_min) / spacing) + 1), max(2, round((y_max - y_min) / spacing) + 1)
    x, y = np.linspace(x_min, x_max, n_x), np.linspace(y_min, y_max, n_y)
    xy = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    number = np.arange(n_x * n_y).reshape(n_x, n_y)
    edges = np.concatenate([grid_edges(number), knights_edges(number)]) if wide else grid_edges(number)
    outside = ~free.covered(xy)
    edges = edges[outside[edges].all(axis=1)]
    edges = edges[~free.blocked(xy[edges[:, 0]], xy[edges[:, 1]])]
    return UniformGrid(free, Graph.from_edges(xy, edges), 2.0 * float(np.hypot(x[1] - x[0], y[1] - y[0])))


def grid_astar(free: FreeSpace, nodes: int, start: Array, goal: Array) -> Array | None:
    """A* path (n, 2) on a uniform grid of about `nodes` nodes; None when it finds none."""
    return uniform_grid(free, nodes).path(start, goal)


@dataclass(frozen=True)
class VisibilityGraph:
    """Convex corners of obstacles, joined where they see each other.

    The inner vertices of a shortest path are such corners (a known property of shortest paths among polygons).
    """

    free: FreeSpace
    graph: Graph

    @classmethod
    def of(cls, free: FreeSpace, rings: tuple[Array, ...]) -> "VisibilityGraph":
        """Every pair of corners tested; time and memory grow with the square of their number."""
        x_min, y_min, x_max, y_max = free.bounds_m
        corners = np.concatenate([np.empty((0, 2)), *(_convex_corners(ring) for ring in rings)])
        inside = (corners >= (x_min, y_min)).all(axis=1) & (corners <= (x_max, y_max)).all(axis=1)
        corners = corners[inside & ~free.covered(corners)] if len(corners) else corners
        a, b = np.triu_indices(len(corners), k=1)
        seen = ~free.blocked(corners[a], corners[b]) if len(a) else np.empty(0, dtype=bool)
        return cls(free, Graph.from_edges(corners, np.stack([a[seen], b[seen]], axis=1)))

    def path(self, start: Array, goal: Array) -> Array | None:
        """Shortest path (n, 2) between two points (2,); None when there is none."""
        if not self.free.blocked(start[None], goal[None])[0]:
            return np.stack([start, goal])
        corners = self.graph.xy_m
        start_links = _visible(self.free, corners, start, np.inf)
        found = astar(self.graph, start_links, goal, _visible(self.free, corners, goal, np.inf))
        return None if found is None else path_points(self.graph, found, start, goal)


def exact_shortest_path(free: FreeSpace, rings: tuple[Array, ...], start: Array, goal: Array) -> Array | None:
    """Euclidean shortest path (n, 2) among the obstacles, by A* on the visibility graph; None when there is none."""
    return VisibilityGraph.of(free, rings).path(start, goal)


def path_points(graph: Graph, found: FoundPath, start: Array, goal: Array) -> Array:
    """The path (n, 2) with its end points, repeated points removed."""
    points = np.concatenate([start[None], graph.xy_m[found.nodes], goal[None]])
    keep = np.concatenate([[True], np.hypot(*np.diff(points, axis=0).T) > 1e-9])
    return np.asarray(points[keep])


def path_length(points: Array) -> float:
    """Length in metres of a polyline (n, 2) or (n, 3)."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _visible(free: FreeSpace, xy: Array, point: Array, reach: float) -> Links:
    distance = np.hypot(*(xy - point).T) if len(xy) else np.empty(0)
    near = np.flatnonzero(distance <= reach)
    if not near.size:
        return []
    clear = near[~free.blocked(np.broadcast_to(point, (len(near), 2)), xy[near])]
    return [(int(node), float(distance[node])) for node in clear]


def _convex_corners(ring: Array) -> Array:
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    return ring[before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] > 0]
