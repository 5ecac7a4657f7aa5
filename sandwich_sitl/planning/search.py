"""A* over a graph with straight-line costs: the one search behind both the mapped grid and the paper's baseline.

Cost of an edge is its length in motion space (the paper's geodesic nodal distance), the heuristic the straight line
to the goal: admissible and consistent, so the path is a shortest one of the graph.

The queue is a ring of buckets, a small part of an edge wide. Inside a bucket order does not matter: a node whose cost
falls is taken up again, and the search ends with the first bucket that can hold nothing better than the goal's cost,
so the result is as exact as with a sorted queue (Dial 1969; Denardo and Fox 1979).

State: `xy_m` (N, 2), rows of neighbours in compressed form, lengths in metres.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Links = list[tuple[int, float]]  # (node, length)

_BUCKETS_PER_EDGE = 64  # of mean length; with wider ones most nodes are taken up again and again
_MOST_BUCKETS = 200_000


@dataclass(frozen=True)
class Graph:
    """Nodes `xy_m` (N, 2) and, in compressed rows, the neighbours of each with the edge lengths."""

    xy_m: Array
    first: Ints
    neighbour: NDArray[np.int32]
    length_m: Array

    @classmethod
    def from_edges(cls, xy: Array, edges: NDArray[np.integer[Any]]) -> "Graph":
        """Undirected graph from edges (E, 2); doubled edges are kept once, loops left out."""
        pairs = np.ascontiguousarray(edges, dtype=np.int32)
        first, neighbour, length = _rows(np.ascontiguousarray(xy, dtype=np.float64), pairs)
        return cls(xy, first, neighbour, length)

    @cached_property
    def bucket_m(self) -> float:
        """Width of a bucket of the search queue."""
        if not len(self.length_m):
            return 1.0
        longest = float(self.length_m.max())
        return max(float(self.length_m.mean()) / _BUCKETS_PER_EDGE, 2 * longest / _MOST_BUCKETS, 1e-12)

    @cached_property
    def longest_m(self) -> float:
        """Length of the longest edge."""
        return float(self.length_m.max()) if len(self.length_m) else 0.0

    def reachable(self, sources: list[int]) -> NDArray[np.bool_]:
        """Which nodes (N,) can be reached from any of the sources."""
        return np.asarray(_reached(self.first, self.neighbour, np.array(sources, dtype=np.int64)))


def grid_edges(number: Ints) -> Ints:
    """Edges (E, 2) between the 8-connected neighbours of a grid of node numbers (m, n)."""
    pairs = [
        (number[:-1], number[1:]),
        (number[:, :-1], number[:, 1:]),
        (number[:-1, :-1], number[1:, 1:]),
        (number[:-1, 1:], number[1:, :-1]),
    ]
    return np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])


def knights_edges(number: Ints) -> Ints:
    """Edges (E, 2) between nodes of a grid of numbers (m, n) that are a knight's move apart."""
    pairs = [
        (number[:-2, :-1], number[2:, 1:]),
        (number[:-2, 1:], number[2:, :-1]),
        (number[:-1, :-2], number[1:, 2:]),
        (number[1:, :-2], number[:-1, 2:]),
    ]
    return np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])


@dataclass(frozen=True)
class FoundPath:
    """Nodes of a path without its two end points, and its length with them."""

    nodes: list[int]
    length_m: float


def astar(graph: Graph, start_links: Links, goal: Array, goal_links: Links) -> FoundPath | None:
    """Shortest path between two points joined to the graph by links, or None; the heuristic aims at `goal` (2,)."""
    if not start_links or not goal_links:
        return None
    length, last, came, _ = _search(
        graph.xy_m, graph.first, graph.neighbour, graph.length_m, graph.bucket_m, graph.longest_m,
        *_columns(start_links), *_columns(goal_links), float(goal[0]), float(goal[1]), True,
    )  # fmt: skip
    return FoundPath(trace(came, last).tolist(), float(length)) if last >= 0 else None


def distances_to(graph: Graph, start_links: Links, goals: Sequence[Links]) -> Array:
    """Lengths (G,) of the shortest paths from one point to many, each given by its links; infinite without a path."""
    targets = np.array([node for links in goals for node, _ in links], dtype=np.int64)
    if not start_links or not len(targets):
        return np.full(len(goals), np.inf)
    _, _, _, best = _search(
        graph.xy_m, graph.first, graph.neighbour, graph.length_m, graph.bucket_m, graph.longest_m,
        *_columns(start_links), targets, np.zeros(len(targets)), 0.0, 0.0, False,
    )  # fmt: skip
    return np.array([min((float(best[node]) + cost for node, cost in links), default=np.inf) for links in goals])


def _columns(links: Links) -> tuple[Ints, Array]:
    return np.array([node for node, _ in links], dtype=np.int64), np.array([cost for _, cost in links], dtype=float)


@njit(cache=True, nogil=True)
def _search(
    xy: Array,
    first: Ints,
    neighbour: NDArray[np.int32],
    length: Array,
    width: float,
    longest: float,
    start_nodes: Ints,
    start_costs: Array,
    goal_nodes: Ints,
    goal_costs: Array,
    goal_x: float,
    goal_y: float,
    one_goal: bool,
) -> tuple[float, int, NDArray[np.int32], Array]:
    """Goal's cost, its node before (-1: none), the node before each and the cost of each.

    With `one_goal` the goal links lead to one goal at (goal_x, goal_y). Without it there is no heuristic, and the
    search ends when every goal node has its final cost.
    """
    n = len(xy)
    best = np.full(n, np.inf)
    came = np.full(n, -1, dtype=np.int32)
    wanted = np.zeros(n, dtype=np.int8)
    missing = 0
    for node in goal_nodes:
        missing += wanted[node] == 0
        wanted[node] = 1
    low, high = np.inf, 0.0
    for k in range(len(start_nodes)):
        node = start_nodes[k]
        ahead = np.hypot(xy[node, 0] - goal_x, xy[node, 1] - goal_y) if one_goal else 0.0
        low, high = min(low, start_costs[k] + ahead), max(high, start_costs[k] + ahead)
    ring = int((2.0 * longest + high - low) / width) + 4
    head = np.full(ring, -1, dtype=np.int32)
    entry_node = np.empty(1024, dtype=np.int32)
    entry_next = np.empty(1024, dtype=np.int32)
    entry_cost = np.empty(1024)
    used, spare, waiting = 0, -1, 0
    goal_cost, goal_from = np.inf, -1
    bucket = 0
    for k in range(len(start_nodes)):
        node = start_nodes[k]
        if start_costs[k] >= best[node]:
            continue
        best[node] = start_costs[k]
        ahead = np.hypot(xy[node, 0] - goal_x, xy[node, 1] - goal_y) if one_goal else 0.0
        slot = int((start_costs[k] + ahead - low) / width) % ring
        entry_node[used], entry_cost[used], entry_next[used] = node, start_costs[k], head[slot]
        head[slot] = used
        used, waiting = used + 1, waiting + 1
    while waiting > 0:
        slot = bucket % ring
        entry = head[slot]
        if entry < 0:
            bucket += 1
            if low + bucket * width >= goal_cost or (missing == 0 and not one_goal):
                break
            continue
        head[slot] = entry_next[entry]
        entry_next[entry], spare = spare, entry
        waiting -= 1
        node, cost = entry_node[entry], entry_cost[entry]
        if cost > best[node]:
            continue
        if wanted[node] > 0:
            if one_goal:
                for k in range(len(goal_nodes)):
                    if goal_nodes[k] == node and cost + goal_costs[k] < goal_cost:
                        goal_cost, goal_from = cost + goal_costs[k], node
            elif wanted[node] == 1:
                missing -= 1
                wanted[node] = 2
        for k in range(first[node], first[node + 1]):
            other = neighbour[k]
            through = cost + length[k]
            if through >= best[other]:
                continue
            best[other], came[other] = through, node
            if one_goal:
                d_x, d_y = xy[other, 0] - goal_x, xy[other, 1] - goal_y
                total = through + np.sqrt(d_x * d_x + d_y * d_y)
                if total >= goal_cost:
                    continue
            else:
                total = through
            if spare >= 0:
                entry, spare = spare, entry_next[spare]
            else:
                if used == len(entry_node):
                    entry_node = np.concatenate((entry_node, np.empty_like(entry_node)))
                    entry_next = np.concatenate((entry_next, np.empty_like(entry_next)))
                    entry_cost = np.concatenate((entry_cost, np.empty_like(entry_cost)))
                entry, used = used, used + 1
            slot = max(bucket, int((total - low) / width)) % ring
            entry_node[entry], entry_cost[entry], entry_next[entry] = other, through, head[slot]
            head[slot] = entry
            waiting += 1
    return goal_cost, goal_from, came, best


@njit(cache=True, nogil=True)
def trace(came: NDArray[np.signedinteger], last: int) -> Ints:
    """Nodes from the first to `last`."""
    count, node = 0, last
    while node >= 0:
        count, node = count + 1, came[node]
    nodes = np.empty(count, dtype=np.int64)
    node = last
    for k in range(count - 1, -1, -1):
        nodes[k] = node
        node = came[node]
    return nodes


@njit(cache=True, nogil=True)
def _reached(first: Ints, neighbour: NDArray[np.int32], sources: Ints) -> NDArray[np.bool_]:
    seen = np.zeros(len(first) - 1, dtype=np.bool_)
    stack = np.empty(len(seen), dtype=np.int64)
    count = 0
    for node in sources:
        if not seen[node]:
            seen[node] = True
            stack[count] = node
            count += 1
    while count > 0:
        count -= 1
        node = stack[count]
        for k in range(first[node], first[node + 1]):
            other = neighbour[k]
            if not seen[other]:
                seen[other] = True
                stack[count] = other
                count += 1
    return seen


@njit(cache=True, nogil=True)
def _rows(xy: Array, pairs: NDArray[np.int32]) -> tuple[Ints, NDArray[np.int32], Array]:
    """Compressed rows of neighbours and lengths: pairs sorted by their lower node and turned round, doubled ones and loops left out."""
    n = len(xy)
    begin = np.zeros(n + 1, dtype=np.int64)
    for e in range(len(pairs)):
        begin[min(pairs[e, 0], pairs[e, 1]) + 1] += 1
    for node in range(n):
        begin[node + 1] += begin[node]
    higher = np.empty(len(pairs), dtype=np.int32)
    kept = np.zeros(n, dtype=np.int64)
    first = np.zeros(n + 1, dtype=np.int64)
    for e in range(len(pairs)):
        low, high = min(pairs[e, 0], pairs[e, 1]), max(pairs[e, 0], pairs[e, 1])
        k, end = begin[low], begin[low] + kept[low]
        while k < end and higher[k] != high:
            k += 1
        if k == end and low != high:
            higher[k] = high
            kept[low] += 1
            first[low + 1] += 1
            first[high + 1] += 1
    for node in range(n):
        first[node + 1] += first[node]
    neighbour, length = np.empty(first[n], dtype=np.int32), np.empty(first[n])
    filled = first[:-1].copy()
    for low in range(n):
        for k in range(begin[low], begin[low] + kept[low]):
            high = higher[k]
            d_x, d_y = xy[low, 0] - xy[high, 0], xy[low, 1] - xy[high, 1]
            d = np.sqrt(d_x * d_x + d_y * d_y)
            neighbour[filled[low]], length[filled[low]] = high, d
            neighbour[filled[high]], length[filled[high]] = low, d
            filled[low] += 1
            filled[high] += 1
    return first, neighbour, length
