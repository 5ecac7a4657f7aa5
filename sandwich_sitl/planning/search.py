"""A* over a graph with straight-line costs: the one search behind both the mapped grid and the paper's baseline.

Cost of an edge is its length in motion space (the paper's geodesic nodal distance), the heuristic the straight line
to the goal: admissible and consistent, so the path is a shortest one of the graph.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Links = list[tuple[int, float]]  # (node, length)


@dataclass(frozen=True)
class Graph:
    """Nodes `xy_m` (N, 2) and, in compressed rows, the neighbours of each with the edge lengths."""

    xy_m: Array
    first: NDArray[np.int64]
    neighbour: NDArray[np.int64]
    length_m: Array

    @classmethod
    def from_edges(cls, xy: Array, edges: NDArray[np.int64]) -> "Graph":
        """Undirected graph from edges (E, 2); doubled edges are kept once."""
        edges = np.unique(np.sort(edges, axis=1), axis=0)
        both = np.concatenate([edges, edges[:, ::-1]])
        both = both[np.lexsort((both[:, 1], both[:, 0]))]
        first = np.searchsorted(both[:, 0], np.arange(len(xy) + 1))
        length = np.hypot(*(xy[both[:, 0]] - xy[both[:, 1]]).T)
        return cls(xy, first.astype(np.int64), both[:, 1].astype(np.int64), length)

    def reachable(self, sources: list[int]) -> NDArray[np.bool_]:
        """Which nodes (N,) can be reached from any of the sources."""
        seen = np.zeros(len(self.xy_m), dtype=bool)
        seen[sources] = True
        frontier = np.array(sources, dtype=np.int64)
        while frontier.size:
            spans = [self.neighbour[self.first[k] : self.first[k + 1]] for k in frontier]
            following = np.unique(np.concatenate(spans)) if spans else np.empty(0, dtype=np.int64)
            frontier = following[~seen[following]]
            seen[frontier] = True
        return seen


def grid_edges(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges (E, 2) between the 8-connected neighbours of a grid of node numbers (m, n)."""
    pairs = [
        (number[:-1], number[1:]),
        (number[:, :-1], number[:, 1:]),
        (number[:-1, :-1], number[1:, 1:]),
        (number[:-1, 1:], number[1:, :-1]),
    ]
    return np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])


@dataclass(frozen=True)
class FoundPath:
    """Nodes of a path without its two end points, and its length with them."""

    nodes: list[int]
    length_m: float


def astar(graph: Graph, start_links: Links, goal: Array, goal_links: Links) -> FoundPath | None:
    """Shortest path between two points joined to the graph by links, or None; the heuristic aims at `goal` (2,)."""
    x, y = graph.xy_m[:, 0].tolist(), graph.xy_m[:, 1].tolist()
    first, neighbour, length = graph.first.tolist(), graph.neighbour.tolist(), graph.length_m.tolist()
    to_goal = dict(goal_links)
    goal_x, goal_y = float(goal[0]), float(goal[1])
    goal_node = len(x)
    best: dict[int, float] = {}
    came: dict[int, int] = {}
    heap: list[tuple[float, int]] = []
    for node, cost in start_links:
        if cost < best.get(node, np.inf):
            best[node] = cost
            came[node] = -1
            heapq.heappush(heap, (cost + ((x[node] - goal_x) ** 2 + (y[node] - goal_y) ** 2) ** 0.5, node))
    closed: set[int] = set()
    while heap:
        _, node = heapq.heappop(heap)
        if node in closed:
            continue
        closed.add(node)
        if node == goal_node:
            return FoundPath(_trace(came, came[goal_node]), best[goal_node])
        cost = best[node]
        if node in to_goal and cost + to_goal[node] < best.get(goal_node, np.inf):
            best[goal_node] = cost + to_goal[node]
            came[goal_node] = node
            heapq.heappush(heap, (best[goal_node], goal_node))
        for k in range(first[node], first[node + 1]):
            other = neighbour[k]
            through = cost + length[k]
            if other not in closed and through < best.get(other, np.inf):
                best[other] = through
                came[other] = node
                heapq.heappush(heap, (through + ((x[other] - goal_x) ** 2 + (y[other] - goal_y) ** 2) ** 0.5, other))
    return None


def _trace(came: dict[int, int], node: int) -> list[int]:
    path = []
    while node != -1:
        path.append(node)
        node = came[node]
    return path[::-1]
