"""Convex regions along the route: the paper's neighbouring quadrangles, mended where they fail (paper, section V-A;
notes N17).

The quadrangle of node (i, j) has the corners (i-1, j-1), (i+1, j-1), (i+1, j+1), (i-1, j+1); its four sides, counter-
clockwise, are half-planes Lambda [x, y] <= Gamma. It may be non-convex, may miss the reference, its sides may cut an
obstacle, and at walls and borders some corners do not exist. Mending: each half-plane moves outwards until the
stretch of reference that belongs to the node lies inside with a margin; then, while the region meets an obstacle
grown by the vehicle's radius, the half-plane that separates the nearest such piece from the stretch is added. A
region therefore always holds its stretch and meets no grown obstacle: both by exact geometry.
"""

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.bays import Bay
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.errors import MapError
from sandwich_sitl.planning.flight_plan import Corridor

Array = NDArray[np.float64]
HalfPlanes = list[tuple[Array, float]]

FACES = 8
_AREA_M2 = 1e-9
_MOST_CUTS = 40
_HAIR_M = 1e-6  # a separating half-plane keeps this much off the obstacle, so that no sliver of it stays


def neighbouring_quadrangle(channel_map: ChannelMap, place: tuple[int, int, int]) -> Array:
    """Corners (4, 2), counter-clockwise; beyond a free dividing streamline they belong to the next channel.

    Where a neighbour does not exist (wall, border of the world) the node's own row or column takes its place. In a bay it is
    the box round the node's quads.
    """
    d, i, j = place
    if d >= channel_map.channels:
        return _box_round(channel_map.bays[d - channel_map.channels], i)
    xy = channel_map.xy_m[d]
    west, east = max(i - 1, 0), min(i + 1, xy.shape[0] - 1)
    corners = np.array(
        [
            _row_below(channel_map, d, west, j, i),
            _row_below(channel_map, d, east, j, i),
            _row_above(channel_map, d, east, j, i),
            _row_above(channel_map, d, west, j, i),
        ]
    )
    return np.where(np.isnan(corners), xy[i, j], corners)


def _box_round(bay: Bay, node: int) -> Array:
    """The box (4, 2) round the quads of a bay's node."""
    quads = bay.corners_m()[(bay.quads == node).any(axis=1)].reshape(-1, 2)
    (x0, y0), (x1, y1) = quads.min(axis=0), quads.max(axis=0)
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def _row_below(channel_map: ChannelMap, d: int, i: int, j: int, node_i: int) -> Array:
    if j > 0:
        return np.asarray(channel_map.xy_m[d][i, j - 1])
    free = d > 0 and not channel_map.barred[d - 1, node_i] and not channel_map.barred[d - 1, i]
    return np.asarray(channel_map.xy_m[d - 1][i, -2] if free else channel_map.xy_m[d][i, 0])


def _row_above(channel_map: ChannelMap, d: int, i: int, j: int, node_i: int) -> Array:
    xy = channel_map.xy_m[d]
    if j < xy.shape[1] - 1:
        return np.asarray(xy[i, j + 1])
    last = channel_map.channels - 1
    free = d < last and not channel_map.barred[d, node_i] and not channel_map.barred[d, i]
    return np.asarray(channel_map.xy_m[d + 1][i, 1] if free else xy[i, -1])


def paper_corridor(quadrangles: Array) -> Corridor:
    """The quadrangles (M, 4, 2) as they are: Lambda, Gamma of the paper with rows scaled to unit length."""
    regions = [_sides(quadrangle) or [(np.zeros(2), 0.0)] for quadrangle in quadrangles]
    return _stacked(regions, list(quadrangles), quadrangles)


def mended_corridor(
    quadrangles: Array, stretches: list[Array], solid: list[shapely.Polygon], margin_m: float, reach_m: float
) -> Corridor:
    """Regions (M) that hold their stretch (n, 2) of reference with `margin_m` where obstacles allow.

    They meet no polygon of `solid`. No side is further than `reach_m` from the stretch. Raises `MapError` when a
    stretch itself meets an obstacle.
    """
    tree = shapely.STRtree(solid)
    regions, polygons = [], []
    for quadrangle, stretch in zip(quadrangles, stretches, strict=True):
        planes, polygon = _mended(quadrangle, stretch, tree, margin_m, reach_m)
        regions.append(planes)
        polygons.append(shapely.get_coordinates(shapely.orient_polygons(polygon).exterior)[:-1])
    return _stacked(regions, polygons, quadrangles)


def _mended(
    quadrangle: Array, stretch: Array, tree: shapely.STRtree, margin_m: float, reach_m: float
) -> tuple[HalfPlanes, shapely.Polygon]:
    for reach in (reach_m, reach_m / 2, reach_m / 4, margin_m):
        box = _sides(_box(stretch, max(reach, margin_m)))
        widened = [(n, max(g, float((stretch @ n).max()) + margin_m)) for n, g in _sides(quadrangle)]
        planes = _cut(widened + box, stretch, tree)
        polygon = _polygon(planes, stretch)
        kept = [(n, g) for n, g in planes if _supports(polygon, n, g)]
        if len(kept) <= FACES:
            return kept, polygon
    raise MapError(f"corridor: no region of at most {FACES} sides near ({stretch[0, 0]:.2f}, {stretch[0, 1]:.2f})")


def _cut(planes: HalfPlanes, stretch: Array, tree: shapely.STRtree) -> HalfPlanes:
    """Add the half-planes that separate the region from every obstacle of the tree."""
    core = shapely.MultiPoint(stretch).convex_hull
    planes = list(planes)
    for _ in range(_MOST_CUTS):
        region = _polygon(planes, stretch)
        pieces = [tree.geometries[k].intersection(region) for k in tree.query(region)]
        pieces = [piece for piece in pieces if piece.area > _AREA_M2]
        if not pieces:
            return planes
        nearest = min(pieces, key=core.distance)
        p, q = shapely.get_coordinates(shapely.shortest_line(core, nearest))
        gap = float(np.hypot(*(q - p)))
        if gap < 2 * _HAIR_M:
            raise MapError(f"corridor: the reference meets an obstacle at ({q[0]:.2f}, {q[1]:.2f})")
        normal = (q - p) / gap
        planes.append((normal, float(normal @ q) - _HAIR_M))
    raise MapError(f"corridor: no region free of obstacles near ({stretch[0, 0]:.2f}, {stretch[0, 1]:.2f})")


def _sides(corners: Array) -> HalfPlanes:
    """Outward half-planes of a counter-clockwise ring's sides that have a length; rows of Lambda and Gamma, scaled."""
    side = np.roll(corners, -1, axis=0) - corners
    length = np.hypot(*side.T)
    normals = np.column_stack([side[:, 1], -side[:, 0]])
    return [(n / size, float(n @ c) / size) for n, c, size in zip(normals, corners, length, strict=True) if size > 1e-9]


def _box(points: Array, reach: float) -> Array:
    (x0, y0), (x1, y1) = points.min(axis=0) - reach, points.max(axis=0) + reach
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def _polygon(planes: HalfPlanes, stretch: Array) -> shapely.Polygon:
    """The region as a polygon: a large box clipped by each half-plane (Sutherland-Hodgman)."""
    ring = _box(stretch, 1e3)
    for normal, offset in planes:
        value = ring @ normal - offset
        following, following_value = np.roll(ring, -1, axis=0), np.roll(value, -1)
        points = []
        for a, b, va, vb in zip(ring, following, value, following_value, strict=True):
            if va <= 0:
                points.append(a)
            if (va < 0 < vb) or (vb < 0 < va):
                points.append(a + va / (va - vb) * (b - a))
        ring = np.array(points).reshape(-1, 2)
        if len(ring) < 3:
            raise MapError(f"corridor: empty region near ({stretch[0, 0]:.2f}, {stretch[0, 1]:.2f})")
    return shapely.Polygon(ring)


def _supports(polygon: shapely.Polygon, normal: Array, offset: float) -> bool:
    """Whether the half-plane carries a side of the polygon."""
    ring = shapely.get_coordinates(polygon.exterior)
    on_side = np.abs(ring @ normal - offset) < 1e-9 * (1 + abs(offset))
    return bool((on_side[1:] & on_side[:-1] & (np.hypot(*np.diff(ring, axis=0).T) > 1e-9)).any())


def _stacked(regions: list[HalfPlanes], polygons: list[Array], quadrangles: Array) -> Corridor:
    Lambda, Gamma = np.empty((len(regions), FACES, 2)), np.empty((len(regions), FACES))
    for m, planes in enumerate(regions):
        for f in range(FACES):
            Lambda[m, f], Gamma[m, f] = planes[min(f, len(planes) - 1)]
    return Corridor(Lambda, Gamma, tuple(polygons), quadrangles)
