"""The mapped grid as a graph: 8 neighbours inside a channel, channels joined where their dividing streamline is free.

Source: paper, section IV; notes N10. The two sides of an obstacle wall are different nodes and get no link, which is
the paper's ban on crossing barred nodes; tips belong to both channels. Cells are convex, so every edge and diagonal
stays in free ground.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.planning.search import Graph, Links, grid_edges

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MapGraph:
    """`graph`, `node[d][i, j]` (the number of grid node (i, j) of channel d) and `place` (N, 3), a (d, i, j) each."""

    graph: Graph
    node: tuple[NDArray[np.int64], ...]
    place: NDArray[np.int64]


def build_map_graph(channel_map: ChannelMap) -> MapGraph:
    """Number the nodes, shared ones once, and link neighbours."""
    numbers: list[NDArray[np.int64]] = []
    count = 0
    for d, xy in enumerate(channel_map.xy_m):
        fresh = np.ones(xy.shape[:2], dtype=bool)
        if d > 0:
            fresh[:, 0] = channel_map.barred[d - 1]
        number = np.empty(xy.shape[:2], dtype=np.int64)
        number[fresh] = count + np.arange(int(fresh.sum()))
        if d > 0:
            free = ~channel_map.barred[d - 1]
            number[free, 0] = numbers[-1][free, -1]
        count += int(fresh.sum())
        numbers.append(number)
    place = np.empty((count, 3), dtype=np.int64)
    xy_m = np.empty((count, 2))
    for d in reversed(range(len(numbers))):
        i, j = np.indices(numbers[d].shape)
        place[numbers[d]] = np.stack([np.full_like(i, d), i, j], axis=-1)
        xy_m[numbers[d]] = channel_map.xy_m[d]
    edges = np.concatenate([grid_edges(number) for number in numbers])
    return MapGraph(Graph.from_edges(xy_m, edges), tuple(numbers), place)


def links(map_graph: MapGraph, channel_map: ChannelMap, point: Array) -> Links:
    """Links from a point (2,) to the corners of every cell that holds it; empty when it lies on no cell."""
    found: dict[int, float] = {}
    for d, i, j in locate(channel_map, point):
        for node in map_graph.node[d][i : i + 2, j : j + 2].ravel().tolist():
            found[node] = float(np.hypot(*(map_graph.graph.xy_m[node] - point)))
    return sorted(found.items())


def locate(channel_map: ChannelMap, point: Array, tolerance_m: float = 1e-9) -> list[tuple[int, int, int]]:
    """Cells (channel, i, j) that hold a point (2,), more than one on shared edges."""
    found = []
    for d, xy in enumerate(channel_map.xy_m):
        corners = np.stack([xy[:-1, :-1], xy[1:, :-1], xy[1:, 1:], xy[:-1, 1:]], axis=2)
        side = np.roll(corners, -1, axis=2) - corners
        to_point = point - corners
        left_of = side[..., 0] * to_point[..., 1] - side[..., 1] * to_point[..., 0]
        inside = (left_of >= -tolerance_m * np.hypot(side[..., 0], side[..., 1])).all(axis=2)
        found += [(d, int(i), int(j)) for i, j in np.argwhere(inside)]
    return found
