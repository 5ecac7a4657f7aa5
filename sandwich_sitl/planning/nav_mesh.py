"""The free ground as a coarse navigation mesh: a constrained Delaunay triangulation with no vertex but wall corners.

Every vertex lies on a wall, so a walk from triangle to triangle without turning back *is* a homotopy class, and the
shortest path of that class turns at vertices of the walk's sides only.

Source: the grown world. State: ENU metres; triangles counter-clockwise; side k of a triangle runs from its corner k to
corner k + 1. Walls run with the free ground on their left.
"""

from dataclasses import dataclass

import numpy as np
import pythoncdt
import shapely
from numpy.typing import NDArray

from sandwich_sitl.planning.cell_index import CellIndex, rows_of
from sandwich_sitl.world.grow import GrownWorld, snapped

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_FLAT = 1e-9  # sine of a turn that does not count


@dataclass(frozen=True)
class NavMesh:
    """Vertices `xy_m` (V, 2), `triangles` (T, 3) and the triangle beyond each side, `beyond` (T, 3), -1 at a wall.

    `before` and `after` (V,) are the neighbours along the wall; `corner` (V,) tells at which vertices a shortest path
    may turn. Where walls touch in a point there is a vertex for each side, for there is no way between them. Rows
    `around[first[v] : first[v + 1]]` are the triangles at vertex v.
    """

    xy_m: Array
    triangles: Ints
    beyond: Ints
    before: Ints
    after: Ints
    corner: NDArray[np.bool_]
    first: Ints
    around: Ints
    index: CellIndex


def build_nav_mesh(grown: GrownWorld) -> NavMesh:
    """Triangulate the ground between the grown obstacles, whose outlines may be touched."""
    xy, walls = _outlines(grown)
    triangles = _triangulated(xy, walls) if len(xy) else np.empty((0, 3), dtype=np.int64)
    beyond = _beyond(triangles, len(xy))
    xy, triangles = _parted(xy, triangles, beyond)
    before, after = _walls(triangles, beyond, len(xy))
    first, around = rows_of(triangles, len(xy))
    return NavMesh(
        xy_m=xy,
        triangles=triangles,
        beyond=beyond,
        before=before,
        after=after,
        corner=_corners(xy, before, after),
        first=first,
        around=around,
        index=CellIndex.of(xy[triangles]),
    )


def _outlines(grown: GrownWorld) -> tuple[Array, Ints]:
    """Vertices and wall edges of the free ground."""
    solid = shapely.union_all(list(snapped(grown).polygons))
    free = shapely.difference(shapely.box(*grown.bounds_m), solid)
    rings = [
        shapely.get_coordinates(ring)[:-1]
        for part in shapely.get_parts(free)
        if isinstance(part, shapely.Polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    if not rings:
        return np.empty((0, 2)), np.empty((0, 2), dtype=np.int64)
    xy, number = np.unique(np.concatenate(rings), axis=0, return_inverse=True)
    edges, start = [], 0
    for ring in rings:
        own = number.ravel()[start : start + len(ring)]
        edges.append(np.column_stack([own, np.roll(own, -1)]))
        start += len(ring)
    return xy, np.concatenate(edges)


def _triangulated(xy: Array, walls: Ints) -> Ints:
    mesh = pythoncdt.Triangulation(
        pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.NOT_ALLOWED, 0.0
    )
    mesh.insert_vertices([pythoncdt.V2d(x, y) for x, y in xy.tolist()])
    mesh.insert_edges([pythoncdt.Edge(a, b) for a, b in walls.tolist()])
    mesh.erase_outer_triangles_and_holes()
    return np.asarray(mesh.triangles_array()["vertices"].astype(np.int64))


def _beyond(triangles: Ints, vertices: int) -> Ints:
    """The triangle beyond each side: the one that has the same side the other way round."""
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    key, turned = start * vertices + end, end * vertices + start
    order = np.argsort(key)
    at = np.minimum(np.searchsorted(key[order], turned), max(len(key) - 1, 0))
    there = order[at] if len(key) else at
    return np.where(key[there] == turned, there // 3, -1).reshape(-1, 3)


def _parted(xy: Array, triangles: Ints, beyond: Ints) -> tuple[Array, Ints]:
    """A vertex of its own for each fan of triangles round a point where walls touch."""
    walls = np.bincount(triangles[beyond < 0], minlength=len(xy))
    triangles = triangles.copy()
    added: list[Array] = []
    for v in np.flatnonzero(walls > 1).tolist():
        left = set(np.flatnonzero((triangles == v).any(axis=1)).tolist())
        for fan in range(int(walls[v])):
            reached, number = [left.pop()], v if fan == 0 else len(xy) + len(added)
            for t in reached:
                joined = left.intersection(beyond[t].tolist())
                left -= joined
                reached += sorted(joined)
            triangles[reached] = np.where(triangles[reached] == v, number, triangles[reached])
            if fan:
                added.append(xy[v])
    return np.concatenate([xy, np.array(added).reshape(-1, 2)]), triangles


def _walls(triangles: Ints, beyond: Ints, vertices: int) -> tuple[Ints, Ints]:
    start, end = triangles[beyond < 0], np.roll(triangles, -1, axis=1)[beyond < 0]
    before, after = np.full(vertices, -1, dtype=np.int64), np.full(vertices, -1, dtype=np.int64)
    after[start], before[end] = end, start
    return before, after


def _corners(xy: Array, before: Ints, after: Ints) -> NDArray[np.bool_]:
    """Where the free angle is 180 degrees or more."""
    into, out = xy - xy[before], xy[after] - xy
    turn = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
    flat = _FLAT * np.hypot(*into.T) * np.hypot(*out.T)
    return np.asarray((before >= 0) & (turn <= flat))
