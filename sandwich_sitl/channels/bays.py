"""Bays: the ground inside a vertical closure as an unstructured mesh of convex quads.

A bay is a constrained Delaunay triangulation of its polygon, refined to the cell size (CDT, after Ruppert), every
triangle cut into three quads at its centroid and the middles of its sides. Such a quad is convex whatever the triangle:
its corners lie on two sides of the triangle and on the medians between them. So the bilinear map of each cell is
one-to-one with no equation to solve. The vertices and side middles on a lid are nodes of the bay *and* become nodes of
the wall of the channel beside it, which is how a route passes.
"""

from collections.abc import Container
from dataclasses import dataclass

import numpy as np
import pythoncdt
import shapely
from numpy.typing import NDArray
from shapely import Polygon

Array = NDArray[np.float64]

_SIDE = 2.3  # cells: side of a triangle whose quads have about the area of a cell
_LEAST_ANGLE_RAD = np.radians(20.0)  # where the polygon's own corners allow
_SHORTEST = 0.25  # of a side: no refinement below
_MOST_VERTICES = 2_000_000
_SAME = 1e-9  # of the extent: points closer than this are one


@dataclass(frozen=True)
class Bay:
    """Nodes `xy_m` (N, 2), quads (Q, 4) of node numbers counter-clockwise, and the node numbers on its lids."""

    name: str
    xy_m: Array
    quads: NDArray[np.int64]
    lid_nodes: NDArray[np.int64]

    def corners_m(self) -> Array:
        """Corners (Q, 4, 2) of the quads."""
        return np.asarray(self.xy_m[self.quads])


def mesh_bay(name: str, polygon: Polygon, lids: Array, cell_m: float) -> Bay:
    """Mesh a bay between lids (L, 2, 2), segments of its outline, with quads of about `cell_m`."""
    vertices, triangles = _triangulated(polygon, _SIDE * cell_m)
    xy, quads = _quartered(vertices, triangles)
    on_lid = np.zeros(len(xy), dtype=bool)
    for start, end in lids:
        found = _on_segment(xy, start, end)
        on_lid |= found
        for axis in np.flatnonzero(start == end):
            xy[found, axis] = start[axis]  # a side halved again and again drifts by a rounding error
    return Bay(name, xy, quads, np.flatnonzero(on_lid))


def mesh_ground(name: str, polygon: Polygon, lid_points: Container[tuple[float, float]], cell_m: float) -> Bay:
    """Mesh any ground; its lid nodes are the vertices of its outline that are among `lid_points`."""
    vertices, triangles = _triangulated(polygon, _SIDE * cell_m)
    xy, quads = _quartered(vertices, triangles)
    return Bay(name, xy, quads, np.flatnonzero([(x, y) in lid_points for x, y in xy.tolist()]))


def _triangulated(polygon: Polygon, side_m: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (V, 2) and triangles (T, 3), counter-clockwise."""
    rings = [
        shapely.get_coordinates(shapely.segmentize(ring, side_m))[:-1]
        for ring in (polygon.exterior, *polygon.interiors)
    ]
    number = np.arange(sum(len(ring) for ring in rings))
    following = np.concatenate(
        [np.roll(part, -1) for part in np.split(number, np.cumsum([len(r) for r in rings])[:-1])]
    )
    points, of = _merged(np.concatenate(rings))
    edges = np.column_stack([of[number], of[following]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    mesh = pythoncdt.Triangulation(
        pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.NOT_ALLOWED, 0.0
    )
    mesh.insert_vertices([pythoncdt.V2d(x, y) for x, y in points.tolist()])
    mesh.insert_edges([pythoncdt.Edge(a, b) for a, b in edges.tolist()])
    outside = mesh.collect_outer_triangles_and_holes()
    shortest = _SHORTEST * side_m
    for criterion, threshold in (
        (pythoncdt.RefinementCriterion.SMALLEST_ANGLE, float(_LEAST_ANGLE_RAD)),
        (pythoncdt.RefinementCriterion.LARGEST_AREA, 0.6 * side_m**2),
    ):
        mesh.refine_triangles(_MOST_VERTICES, criterion, threshold, outside, shortest)
    mesh.finalize_triangulation(outside)
    table = mesh.vertices_array()
    vertices = np.column_stack([table["x"], table["y"]])
    return vertices, mesh.triangles_array()["vertices"].astype(np.int64)


def _merged(points: Array) -> tuple[Array, NDArray[np.int64]]:
    """Points (n, 2) without those that are another one but for rounding, and for each the one that stands for it.

    A hole may touch the outline in a point, which then stands in both rings.
    """
    cell = _SAME * (1 + float(np.abs(points).max()))
    _, first, of = np.unique(np.rint(points / cell).astype(np.int64), axis=0, return_index=True, return_inverse=True)
    return points[first], of.reshape(-1)


def _quartered(vertices: Array, triangles: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Three quads a triangle: (corner, middle of the side after it, centroid, middle of the side before it)."""
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    unique, number = np.unique(sides, axis=0, return_inverse=True)
    middle = len(vertices) + number.reshape(-1, 3)
    centroid = len(vertices) + len(unique) + np.arange(len(triangles))
    quads = np.stack(
        [triangles, middle, np.repeat(centroid[:, None], 3, axis=1), np.roll(middle, 1, axis=1)], axis=2
    ).reshape(-1, 4)
    xy = np.concatenate([vertices, vertices[unique].mean(axis=1), vertices[triangles].mean(axis=1)])
    used, renumbered = np.unique(quads, return_inverse=True)
    return xy[used], renumbered.reshape(-1, 4)


def _on_segment(xy: Array, start: Array, end: Array) -> NDArray[np.bool_]:
    """Which points (N, 2) lie on a segment."""
    side = end - start
    length = float(np.hypot(*side))
    offset = xy - start
    along = offset @ side / length
    beside = np.abs(offset[:, 0] * side[1] - offset[:, 1] * side[0]) / length
    tolerance = 1e-9 * (1 + length + float(np.abs(start).max()))
    return np.asarray((beside <= tolerance) & (along >= -tolerance) & (along <= length + tolerance))
