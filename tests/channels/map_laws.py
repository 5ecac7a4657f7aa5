"""The laws of a channel map, measured with shapely and formulas written out here, not with `channels.check`."""

import itertools

import numpy as np
import shapely
from shapely import Polygon, box

from sandwich_sitl.channels.build import SOLVED
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.planning.map_graph import MapGraph, build_map_graph, locate

Array = np.ndarray

LEAST_COVERAGE = 0.995
INVERSE_M = 1e-9


def map_quads(channel_map: ChannelMap) -> Array:
    """Corners (cells, 4, 2) of all cells, collected node by node."""
    quads = [np.empty((0, 4, 2))]
    for xy, gridded in zip(channel_map.xy_m, channel_map.gridded, strict=True):
        columns = np.flatnonzero(gridded)
        quads += [np.stack([xy[i, :-1], xy[i + 1, :-1], xy[i + 1, 1:], xy[i, 1:]], axis=1) for i in columns]
    quads += [bay.xy_m[bay.quads] for bay in channel_map.bays]
    return np.concatenate(quads)


def check_laws(channel_map: ChannelMap) -> None:
    """Laws 1 to 4; reachability; look-up of points. Raises `AssertionError`."""
    grown = channel_map.grown
    quads = map_quads(channel_map)
    hair = 1e-9 * max(grown.bounds_m[2] - grown.bounds_m[0], grown.bounds_m[3] - grown.bounds_m[1])
    check_cells(channel_map, quads)
    map_graph = build_map_graph(channel_map)
    check_edges(channel_map, map_graph, hair)
    check_cover(channel_map, quads)
    check_shared_nodes(channel_map, hair)
    check_reachability(channel_map, map_graph)


def check_cells(channel_map: ChannelMap, quads: Array) -> None:
    """Law 1, and the counts that the map reports."""
    onward, back = np.roll(quads, -1, axis=1) - quads, np.roll(quads, 1, axis=1) - quads
    jacobian = onward[..., 0] * back[..., 1] - onward[..., 1] * back[..., 0]
    assert (jacobian > 0).all()
    quality = channel_map.quality
    assert (quality.folded_cells, quality.cells) == (0, len(quads))
    assert quality.bay_cells == sum(len(bay.quads) for bay in channel_map.bays)
    assert 0 <= quality.repaired_cells <= quality.cells - quality.bay_cells
    sines = jacobian / np.hypot(*np.moveaxis(onward, -1, 0)) / np.hypot(*np.moveaxis(back, -1, 0))
    assert quality.min_jacobian_ratio <= sines.min(initial=1.0) * (1 + 1e-6)


def check_edges(channel_map: ChannelMap, map_graph: MapGraph, hair_m: float) -> None:
    """Law 2: every edge of the graph against every obstacle shrunk by a hair, and inside the bounds."""
    graph = map_graph.graph
    start = np.repeat(np.arange(len(graph.xy_m)), np.diff(graph.first))
    once = start < graph.neighbour
    lines = shapely.linestrings(np.stack([graph.xy_m[start[once]], graph.xy_m[graph.neighbour[once]]], axis=1))
    shrunk = shapely.buffer(np.array(channel_map.grown.polygons, dtype=object), -hair_m, join_style="mitre")
    assert shapely.STRtree(shrunk).query(lines, predicate="intersects").size == 0
    used = graph.xy_m[np.unique(start)]
    x_min, y_min, x_max, y_max = channel_map.bounds_m
    assert (used >= (x_min - hair_m, y_min - hair_m)).all()
    assert (used <= (x_max + hair_m, y_max + hair_m)).all()


def check_cover(channel_map: ChannelMap, quads: Array) -> None:
    """Law 3: cells overlap nowhere, cover the free ground but for what is named as lost, and that is little."""
    grown = channel_map.grown
    free = box(*grown.bounds_m).difference(shapely.union_all(list(grown.polygons)))
    cells = shapely.polygons(quads)
    mapped = shapely.union_all(cells, grid_size=1e-8)
    assert np.isclose(shapely.area(cells).sum(), mapped.area, rtol=1e-6)
    if free.area > 0:
        assert mapped.area / free.area >= LEAST_COVERAGE
        assert np.isclose(channel_map.quality.coverage, mapped.area / free.area, rtol=1e-6)
    named = shapely.union_all([Polygon(lost.ring_m) for lost in channel_map.lost])
    unnamed = free.difference(mapped.buffer(1e-6)).difference(named.buffer(1e-6))
    assert unnamed.area <= 1e-6 * free.area
    assert all(np.isclose(Polygon(lost.ring_m).area, lost.area_m2) for lost in channel_map.lost)


def check_shared_nodes(channel_map: ChannelMap, hair_m: float) -> None:
    """Law 4: the two sides of a dividing streamline are one where it is free and apart on walls, nowhere else."""
    walls = shapely.union_all(
        [
            *(polygon.exterior for polygon in channel_map.grown.polygons),
            *(shapely.LinearRing(lost.ring_m) for lost in channel_map.lost),
            *(shapely.coverage_union_all(shapely.polygons(bay.corners_m())).boundary for bay in channel_map.bays),
        ]
    )
    for d, (below, above) in enumerate(itertools.pairwise(channel_map.xy_m)):
        barred = channel_map.barred[d]
        cells = [columns_with_cells(channel_map.gridded[k]) for k in (d, d + 1)]
        both = cells[0] & cells[1]
        np.testing.assert_array_equal(below[both & ~barred, -1], above[both & ~barred, 0])
        assert (below[both & barred, -1] != above[both & barred, 0]).any(axis=1).all()
        np.testing.assert_array_equal(channel_map.barrier[d] >= 0, barred)
        for side, has in ((below[:, -1], cells[0]), (above[:, 0], cells[1])):
            assert (shapely.distance(walls, shapely.points(side[barred & has])) <= hair_m).all()
    for bay, places in zip(channel_map.bays, channel_map.lid_places, strict=True):
        at = [channel_map.xy_m[d][i, j] for d, i, j in places]
        np.testing.assert_array_equal(bay.xy_m[bay.lid_nodes], np.reshape(at, (-1, 2)))


def columns_with_cells(gridded: Array) -> Array:
    """Columns of nodes (m_phi,) with a gridded column of cells on one side."""
    return np.concatenate([gridded, [False]]) | np.concatenate([[False], gridded])


def check_reachability(channel_map: ChannelMap, map_graph: MapGraph) -> None:
    """Two cells are joined by the graph exactly when free ground joins them: parts of the free polygon, by shapely."""
    free = box(*channel_map.bounds_m).difference(shapely.union_all(list(channel_map.grown.polygons)))
    parts = [part for part in shapely.get_parts(free) if part.area > 0]
    first = [numbers.ravel()[0:0] for numbers in map_graph.node]
    for b, numbers in enumerate(map_graph.node):
        if b < channel_map.channels:
            first[b] = numbers[:-1, :-1][channel_map.gridded[b]].ravel()
        else:
            first[b] = numbers[channel_map.bays[b - channel_map.channels].quads[:, 0], 0]
    nodes = np.concatenate([np.empty(0, dtype=np.int64), *first])
    middles = map_quads(channel_map).mean(axis=1)
    inside, part = shapely.STRtree(parts).query(shapely.points(middles), predicate="intersects")
    np.testing.assert_array_equal(inside, np.arange(len(middles)))
    for k in np.unique(part):
        own = nodes[part == k]
        reached = map_graph.graph.reachable([int(own[0])])
        assert reached[own].all()
        assert not reached[nodes[part != k]].any()


def second_differences(xy: Array) -> Array:
    """The residual of Eq. (ellipticpde) written out with shifted arrays, as a displacement (m_phi - 2, m_j - 2)."""
    d_phi, d_psi = np.gradient(xy, axis=0)[1:-1, 1:-1], np.gradient(xy, axis=1)[1:-1, 1:-1]
    a, b, c = (d_psi**2).sum(axis=-1), (d_phi * d_psi).sum(axis=-1), (d_phi**2).sum(axis=-1)
    along = np.diff(xy, 2, axis=0)[:, 1:-1]
    across = np.diff(xy, 2, axis=1)[1:-1]
    mixed = np.gradient(np.gradient(xy, axis=0), axis=1)[1:-1, 1:-1]
    value = a[..., None] * along - 2 * b[..., None] * mixed + c[..., None] * across
    return np.hypot(*np.moveaxis(value, -1, 0)) / (2 * (a + c))


def check_residual(channel_map: ChannelMap, cell_m: float) -> None:
    """Law 5: cells with a corner at which Eq. (ellipticpde) does not hold are all reported as repaired."""
    off = 0
    for xy, gridded in zip(channel_map.xy_m, channel_map.gridded, strict=True):
        apart = np.zeros(xy.shape[:2], dtype=bool)
        with np.errstate(invalid="ignore"):
            apart[1:-1, 1:-1] = second_differences(xy) > SOLVED * cell_m * (1 + 1e-6)
        inside = np.zeros(len(xy), dtype=bool)
        inside[1:-1] = gridded[1:] & gridded[:-1]
        apart &= inside[:, None]
        touched = apart[1:, 1:] | apart[1:, :-1] | apart[:-1, 1:] | apart[:-1, :-1]
        off += int(touched[gridded].sum())
    assert off <= channel_map.quality.repaired_cells
    assert channel_map.quality.max_residual_m <= SOLVED * cell_m


def check_lookup(channel_map: ChannelMap, points: Array) -> None:
    """Law 6: every free point that is not lost lies in a cell, and the inverse of the cell's map gives it back."""
    map_graph = build_map_graph(channel_map)
    for point in points:
        found = locate(map_graph, point)
        assert found, point
        for b, i, j in found:
            if b < channel_map.channels:
                xy = channel_map.xy_m[b]
                corners = np.array([xy[i, j], xy[i + 1, j], xy[i + 1, j + 1], xy[i, j + 1]])
            else:
                bay = channel_map.bays[b - channel_map.channels]
                corners = bay.xy_m[bay.quads[i]]
            u, v = bilinear_inverse(corners, point)
            assert -1e-6 < u < 1 + 1e-6
            assert -1e-6 < v < 1 + 1e-6
            back = bilinear(corners, u, v)
            assert np.hypot(*(back - point)) < INVERSE_M


def free_points(channel_map: ChannelMap, count: int, seed: int) -> Array:
    """Random points (count, 2) in free ground that the map has not given up."""
    rng = np.random.default_rng(seed)
    lost = [Polygon(lost.ring_m).buffer(1e-6) for lost in channel_map.lost]
    solid = shapely.union_all([*channel_map.grown.polygons, *lost])
    shapely.prepare(solid)
    x_min, y_min, x_max, y_max = channel_map.bounds_m
    found = np.empty((0, 2))
    while len(found) < count:
        points = rng.uniform((x_min, y_min), (x_max, y_max), (4 * count, 2))
        found = np.concatenate([found, points[~shapely.contains_xy(solid, points)]])
    return found[:count]


def bilinear(corners: Array, u: float, v: float) -> Array:
    """The bilinear map of a quad (4, 2), counter-clockwise, at (u, v)."""
    a, b, c, d = corners
    return (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d


def bilinear_inverse(corners: Array, point: Array) -> tuple[float, float]:
    """(u, v) of a point, by Newton's method from the middle; on a convex quad the Jacobian is positive all over."""
    a, b, c, d = corners
    w = np.array([0.5, 0.5])
    for _ in range(60):
        u, v = w
        off = bilinear(corners, u, v) - point
        jacobian = np.column_stack([(1 - v) * (b - a) + v * (c - d), (1 - u) * (d - a) + u * (c - b)])
        step = np.linalg.solve(jacobian, off)
        w = np.clip(w - step, -0.05, 1.05)
        if np.abs(step).max() < 1e-14:
            break
    return float(w[0]), float(w[1])
