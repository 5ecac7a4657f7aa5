"""The mapped grid as a graph: 8 neighbours inside a channel, channels joined where their dividing streamline is free.

Source: paper, section IV; notes N10. The two sides of an obstacle wall are different nodes and get no link, which is
the paper's ban on crossing barred nodes; tips belong to both channels. In a bay the corners of a quad are linked, and
its lid nodes are the wall nodes of the channels beside it. Cells are convex, so every edge and diagonal stays in free
ground.

A place (b, i, j) names node (i, j) of channel b, or, from b = number of channels on, node i of a bay (j = 0).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.planning.search import Graph, Links

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MapGraph:
    """`graph`, `node[b][i, j]` (the number of node (i, j) of channel or bay b) and `place` (N, 3), a (b, i, j) each."""

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
    for bay, places in zip(channel_map.bays, channel_map.lid_places, strict=True):
        inner = np.ones(len(bay.xy_m), dtype=bool)
        inner[bay.lid_nodes] = False
        number = np.empty((len(inner), 1), dtype=np.int64)
        number[inner, 0] = count + np.arange(int(inner.sum()))
        number[bay.lid_nodes, 0] = [numbers[d][i, j] for d, i, j in places]
        count += int(inner.sum())
        numbers.append(number)
    place = np.empty((count, 3), dtype=np.int64)
    xy_m = np.empty((count, 2))
    nodes = [*channel_map.xy_m, *(bay.xy_m[:, None] for bay in channel_map.bays)]
    for b in reversed(range(len(numbers))):
        i, j = np.indices(numbers[b].shape)
        place[numbers[b]] = np.stack([np.full_like(i, b), i, j], axis=-1)
        xy_m[numbers[b]] = nodes[b]
    grids = [_grid_quads(number, gridded) for number, gridded in zip(numbers, channel_map.gridded, strict=False)]
    bays = [number[bay.quads, 0] for number, bay in zip(numbers[channel_map.channels :], channel_map.bays, strict=True)]
    quads = np.concatenate([np.empty((0, 4), dtype=np.int64), *grids, *bays])
    edges = np.concatenate([quads[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3))])
    return MapGraph(Graph.from_edges(xy_m, edges), tuple(numbers), place)


def _grid_quads(number: NDArray[np.int64], gridded: NDArray[np.bool_]) -> NDArray[np.int64]:
    corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=2)
    return np.asarray(corners[gridded].reshape(-1, 4))


def links(map_graph: MapGraph, channel_map: ChannelMap, point: Array) -> Links:
    """Links from a point (2,) to the corners of every cell that holds it; empty when it lies on no cell."""
    found: dict[int, float] = {}
    for cell in locate(channel_map, point):
        for node in cell_nodes(map_graph, channel_map, cell):
            found[node] = float(np.hypot(*(map_graph.graph.xy_m[node] - point)))
    return sorted(found.items())


def cell_nodes(map_graph: MapGraph, channel_map: ChannelMap, cell: tuple[int, int, int]) -> list[int]:
    """Numbers of the four corner nodes of a cell that `locate` found."""
    b, i, j = cell
    if b < channel_map.channels:
        return [int(node) for node in map_graph.node[b][i : i + 2, j : j + 2].ravel()]
    return [int(node) for node in map_graph.node[b][channel_map.bays[b - channel_map.channels].quads[i], 0]]


def locate(channel_map: ChannelMap, point: Array, tolerance_m: float = 1e-9) -> list[tuple[int, int, int]]:
    """Cells that hold a point (2,), more than one on shared edges: (channel, i, j), or (channels + bay, quad, 0)."""
    found = []
    for d, (xy, gridded) in enumerate(zip(channel_map.xy_m, channel_map.gridded, strict=True)):
        corners = np.stack([xy[:-1, :-1], xy[1:, :-1], xy[1:, 1:], xy[:-1, 1:]], axis=2)
        inside = _holds(corners, point, tolerance_m) & gridded[:, None]
        found += [(d, int(i), int(j)) for i, j in np.argwhere(inside)]
    for b, bay in enumerate(channel_map.bays, start=channel_map.channels):
        found += [(b, int(q), 0) for q in np.flatnonzero(_holds(bay.corners_m(), point, tolerance_m))]
    return found


def _holds(corners: Array, point: Array, tolerance_m: float) -> NDArray[np.bool_]:
    """Which convex quads (..., 4, 2) hold a point."""
    side = np.roll(corners, -1, axis=-2) - corners
    to_point = point - corners
    left_of = side[..., 0] * to_point[..., 1] - side[..., 1] * to_point[..., 0]
    return np.asarray((left_of >= -tolerance_m * np.hypot(side[..., 0], side[..., 1])).all(axis=-1))
