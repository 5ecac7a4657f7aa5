"""The mapped grid as a graph, its channels joined where their dividing streamline is free.

Source: paper, section IV. The corners of a cell are linked, in a channel hence the eight neighbours in the
planning space; the paper leaves open which they are, and a `wide` graph links, where these eight leave wide gaps between
their directions in motion space, what is seen there too (`sight`). The two sides of an obstacle wall are different nodes and no
link leads across, which is the paper's ban on crossing barred nodes; tips belong to both channels. A bay's lid nodes
are the wall nodes of the channels beside it. Cells are convex, so every link stays in free ground.

A place (b, i, j) names node (i, j) of channel b, or, from b = number of channels on, node i of a bay (j = 0).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.planning.cell_index import CellIndex, rows_of
from sandwich_sitl.planning.search import Graph, Links, distances_to
from sandwich_sitl.planning.sight import across_sides, linked_pairs, seen_from

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Place = tuple[int, int, int]

_SAME = 1e-9  # of the extent: nodes closer than this are one
_ROWS = 2**31  # more than the extent has of these
_OFF_WALL = 1e3  # of that distance


@dataclass(frozen=True)
class MapGraph:
    """The graph, and its cells for finding the one that holds a point.

    `node[b][i, j]` is the number of node (i, j) of channel or bay b, `place` (N, 3) a (b, i, j) of each node. Cells
    have the corner nodes `quads` (C, 4), counter-clockwise, and `cell_place` (C, 3): (channel, i, j) of the lowest
    corner, or (channels + bay, quad, 0). `around` are compressed rows (first, cells) of the cells at each node,
    `across` (C, 4) for each side of a cell 4 * cell + side of the cell that shares it, -1 where there is none.
    """

    graph: Graph
    node: tuple[Ints, ...]
    place: Ints
    quads: Ints
    cell_place: Ints
    around: tuple[Ints, Ints]
    across: NDArray[np.int32]
    wide: bool

    @cached_property
    def cells(self) -> CellIndex:
        """Spatial index of the cells."""
        return CellIndex.of(self.graph.xy_m[self.quads])


def build_map_graph(channel_map: ChannelMap, *, wide: bool = True) -> MapGraph:
    """Number the nodes, shared ones once, and link neighbours; `wide` with those in sight in wide gaps."""
    numbers: list[Ints] = []
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
    twins = _twins(channel_map)
    for b, (bay, places) in enumerate(zip(channel_map.bays, channel_map.lid_places, strict=True)):
        own, bays, nodes_there = twins[b]
        inner = np.ones(len(bay.xy_m), dtype=bool)
        inner[bay.lid_nodes] = inner[own] = False
        number = np.empty((len(inner), 1), dtype=np.int64)
        number[inner, 0] = count + np.arange(int(inner.sum()))
        number[bay.lid_nodes, 0] = [numbers[d][i, j] for d, i, j in places]
        number[own, 0] = [numbers[channel_map.channels + c][k, 0] for c, k in zip(bays, nodes_there, strict=True)]
        count += int(inner.sum())
        numbers.append(number)
    place = np.empty((count, 3), dtype=np.int64)
    xy_m = np.empty((count, 2))
    nodes = [*channel_map.xy_m, *(bay.xy_m[:, None] for bay in channel_map.bays)]
    for b in reversed(range(len(numbers))):
        own = numbers[b]
        place[own, 0] = b
        place[own, 1], place[own, 2] = np.arange(own.shape[0])[:, None], np.arange(own.shape[1])
        xy_m[own] = nodes[b]
    quads, cell_place = _cells(channel_map, numbers)
    first, cells = rows_of(quads, count)
    across = across_sides(quads, first, cells)
    graph = Graph.from_edges(xy_m, linked_pairs(xy_m, quads, across, wide))
    return MapGraph(graph, tuple(numbers), place, quads, cell_place, (first, cells), across, wide)


def _twins(channel_map: ChannelMap) -> list[tuple[Ints, Ints, Ints]]:
    """For each bay its nodes that are also an earlier bay's: own number, that bay, number there.

    Where two bays meet along a dividing streamline their meshers halved the same sides. Off every wall two nodes at one
    point are one; on a wall they may lie on two sides of an obstacle's corner.
    """
    bays = channel_map.bays
    of = np.repeat(np.arange(len(bays)), [len(bay.xy_m) for bay in bays])
    number = np.concatenate([np.empty(0, dtype=np.int64), *(np.arange(len(bay.xy_m)) for bay in bays)])
    free = np.ones(len(of), dtype=bool)
    begin = np.searchsorted(of, np.arange(len(bays)))
    free[
        np.concatenate([np.empty(0, dtype=np.int64), *(a + bay.lid_nodes for a, bay in zip(begin, bays, strict=True))])
    ] = False
    xy = np.concatenate([np.empty((0, 2)), *(bay.xy_m for bay in bays)])
    x_min, y_min, x_max, y_max = channel_map.bounds_m
    tolerance = _SAME * max(x_max - x_min, y_max - y_min)
    at = np.flatnonzero(free)
    column, row = np.rint((xy[at] - (x_min, y_min)) / tolerance).astype(np.int64).T
    _, first, group = np.unique(column * _ROWS + row, return_index=True, return_inverse=True)
    earlier = at[first[group]]
    again = np.flatnonzero(of[earlier] < of[at])
    walls = shapely.STRtree([polygon.exterior for polygon in channel_map.grown.polygons])
    points = np.asarray(shapely.points(xy[at[again]]), dtype=object)
    on_wall = np.unique(walls.query(points, predicate="dwithin", distance=_OFF_WALL * tolerance)[0])
    again = np.delete(again, on_wall)
    mine, theirs = at[again], earlier[again]
    return [
        (number[mine[of[mine] == b]], of[theirs[of[mine] == b]], number[theirs[of[mine] == b]])
        for b in range(len(bays))
    ]


def _cells(channel_map: ChannelMap, numbers: list[Ints]) -> tuple[Ints, Ints]:
    """Corner nodes (C, 4) and places (C, 3) of all cells, channels first."""
    quads, places = [np.empty((0, 4), dtype=np.int64)], [np.empty((0, 3), dtype=np.int64)]
    for d, gridded in enumerate(channel_map.gridded):
        number = numbers[d]
        corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=2)
        quads.append(corners[gridded].reshape(-1, 4))
        columns, rows = np.flatnonzero(gridded), np.arange(number.shape[1] - 1)
        places.append(
            np.column_stack([np.full(len(quads[-1]), d), np.repeat(columns, len(rows)), np.tile(rows, len(columns))])
        )
    for b, bay in enumerate(channel_map.bays, start=channel_map.channels):
        quads.append(numbers[b][bay.quads, 0])
        number = np.arange(len(bay.quads))
        places.append(np.column_stack([np.full_like(number, b), number, np.zeros_like(number)]))
    return np.concatenate(quads), np.concatenate(places)


def links(map_graph: MapGraph, point: Array) -> Links:
    """Links from a point (2,) to the corners of its cells, and in a wide graph to nodes in wide gaps between those.

    Empty when it lies on no cell.
    """
    xy_m, cells = map_graph.graph.xy_m, map_graph.cells.holding(point)
    x, y = float(point[0]), float(point[1])
    nodes = seen_from(xy_m, map_graph.quads, map_graph.across, cells, x, y, map_graph.wide)
    lengths = np.hypot(*(xy_m[nodes] - point).T)
    return list(zip(nodes.tolist(), lengths.tolist(), strict=True))


def distances(map_graph: MapGraph, start: Array, goals: Array) -> Array:
    """Lengths (G,) of the shortest routes on the map from one point (2,) to many (G, 2), in one search.

    Infinite where there is no route; where start and goal share a cell, the straight line.
    """
    found = distances_to(map_graph.graph, links(map_graph, start), [links(map_graph, goal) for goal in goals])
    here = set(map_graph.cells.holding(start).tolist())
    shared = np.array([not here.isdisjoint(map_graph.cells.holding(goal).tolist()) for goal in goals], dtype=bool)
    return np.where(shared, np.hypot(*(goals - start).T), found)


def locate(map_graph: MapGraph, point: Array, tolerance_m: float = 1e-9) -> list[Place]:
    """Cells that hold a point (2,), more than one on shared edges: (channel, i, j), or (channels + bay, quad, 0)."""
    cells = map_graph.cells.holding(point, tolerance_m)
    return [(int(b), int(i), int(j)) for b, i, j in map_graph.cell_place[cells]]
