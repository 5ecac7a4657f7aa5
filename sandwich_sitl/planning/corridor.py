"""Convex regions along the reference, from the paper's neighbouring quadrangles (paper, section V-A).

The quadrangle of node (i, j) has the corners (i-1, j-1), (i+1, j-1), (i+1, j+1), (i-1, j+1); its four sides, counter-
clockwise, are half-planes Lambda [x, y] <= Gamma. It may be non-convex, may miss the reference, its sides may cut an
obstacle, and at walls and borders some corners do not exist. So the reference is cut into stretches; a region grows
(`inflation`) from the quadrangle of the node nearest to its stretch where that is convex, holds the stretch and keeps
its distance, and from the stretch itself where it is not. Every region holds its stretch, with the sample before and
after it, and meets no grown obstacle.

Between samples. The controller holds the vehicle in its regions at instants T apart. Any instant between two of them
is at most T / 2 from one, so the vehicle is at most  v T / 2  from the union of their two regions as long as it is no
faster than v. That bound, `between_samples_m` with v = 1.25 v_reference + 0.05 m/s, is kept between every region and
the obstacles grown by the vehicle's radius.

Floors. With `Headroom` a region is a prism: it has a lowest and a highest altitude round those of its stretch, and
only the obstacles that reach it, or what the vehicle may sink below it between samples, are kept out of its polygon.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sandwich_sitl.channels.bays import Bay
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.errors import MapError
from sandwich_sitl.planning.flight_plan import Corridor, Reference
from sandwich_sitl.planning.inflation import inflate
from sandwich_sitl.planning.outlines import Outlines

Array = NDArray[np.float64]
HalfPlanes = list[tuple[Array, float]]

FACES = 8
SPEED_SHARE, SPEED_MORE_MPS = 1.25, 0.05  # the flown speed is at most this share of the reference's and this more
SAFE_SHARE = 0.8  # of a clearance: what is kept for between samples
_STRETCH_M = 1.0
_HAIR_M = 1e-6
REACH_M = 6.0  # how far a region may reach from its seed
_REACHES_M = (REACH_M, 4.0, 2.5, 1.5, 0.8, 0.4, 0.2, 0.1, 0.05)  # tried in turn
_MOST_RASTER = 2000  # cells along the longer side
_NEXT = np.array([1, 2, 3, 0])  # corner of a quadrangle after each
_NODES_WITHIN = 2.0  # of the largest gap to the nearest node, in median edges of the map
_RISE_M = 1.5  # most that a stretch over one spot climbs


@dataclass(frozen=True)
class Headroom:
    """What a floor keeps above the tops of the obstacles grown by the vehicle's radius, and the widest half of a band."""

    margin_m: float
    band_m: float

    def band(self, t_s: Array, z_m: Array, interval_s: float) -> tuple[float, float, float]:
        """Lowest and highest altitude of a region for samples (n,), and that above which tops are in its way."""
        sinking = float(np.abs(np.diff(z_m) / np.diff(t_s)).max()) if len(z_m) > 1 else 0.0
        bound = float(between_samples_m(np.array(sinking), interval_s))
        half = min(self.band_m, self.margin_m - bound - _HAIR_M)
        low, high = float(z_m.min()) - half, float(z_m.max()) + half
        return low, high, low - bound


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


def between_samples_m(speed_mps: Array, interval_s: float) -> Array:
    """What a vehicle that tracks a reference of this speed may leave its regions by between samples, metres."""
    return np.asarray((SPEED_SHARE * speed_mps + SPEED_MORE_MPS) * interval_s / 2)


def safe_clearance_m(speed_mps: Array, interval_s: float) -> Array:
    """Clearance of which `between_samples_m` takes the usual share: the inverse of `safe_speed_mps`."""
    return np.asarray(between_samples_m(speed_mps, interval_s) / SAFE_SHARE)


def safe_speed_mps(clearance_m: Array, interval_s: float, share: float = SAFE_SHARE) -> Array:
    """Speed at which `between_samples_m` takes this share of the clearance."""
    return np.asarray(np.maximum((share * clearance_m * 2 / interval_s - SPEED_MORE_MPS) / SPEED_SHARE, 0.0))


def proven_corridor(
    t_s: Array, xyz_m: Array, channel_map: ChannelMap, outlines: Outlines, interval_s: float,
    headroom: Headroom | None = None,
) -> tuple[Reference, Corridor]:  # fmt: skip
    """The reference (K,), (K, 3) with its regions, none of which comes nearer to an obstacle than the bound above.

    `outlines` are the obstacles grown by the vehicle's radius. Without `headroom` obstacles have no top and regions no
    altitude. Raises `MapError` when a step is too near to an obstacle.
    """
    xy = xyz_m[:, :2]
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    count = max(1, round(float(travelled[-1]) / _STRETCH_M))
    starts = np.unique(np.searchsorted(travelled, np.linspace(0.0, travelled[-1], count + 1)[:-1] - 1e-12))
    spans = list(zip(starts.tolist(), [*starts[1:].tolist(), len(xy)], strict=True))
    if headroom is not None:
        spans = [part for span in spans for part in _by_height(xyz_m[:, 2], span)]
    speed = speeds_mps(t_s, xy)
    centres = xy[[(a + b) // 2 for a, b in spans]]
    quadrangles = [neighbouring_quadrangle(channel_map, place) for place in nearest_places(channel_map, centres)]
    widest = REACH_M + float(between_samples_m(speed.max(), interval_s)) + _HAIR_M
    boxes = np.array([
        _box(np.concatenate([xy[max(0, a - 1) : b + 1], quadrangle]), widest)
        for (a, b), quadrangle in zip(spans, quadrangles, strict=True)
    ])  # fmt: skip
    regions: list[Array] = []
    polygons: list[Array] = []
    neighbours: list[Array] = []
    bands: list[tuple[float, float]] = []
    region = np.empty(len(xy), dtype=np.int64)
    for span, quadrangle, (edges, tops) in zip(spans, quadrangles, outlines.near_with_tops(boxes), strict=True):
        waiting = [span]
        while waiting:
            a, b = waiting.pop()
            first = max(0, a - 1)
            keep = float(between_samples_m(speed[first : b + 1].max(), interval_s)) + _HAIR_M
            z = xyz_m[first : b + 1, 2]
            low, high, reached = (
                headroom.band(t_s[first : b + 1], z, interval_s) if headroom else (-np.inf, np.inf, -np.inf)
            )
            found = _region(xy[first : b + 1], quadrangle, edges[tops > reached], keep)
            if found is None and b - a > 1:
                waiting += [((a + b) // 2, b), (a, (a + b) // 2)]
                continue
            if found is None:
                raise MapError(f"corridor: the reference is too near an obstacle at ({xy[a, 0]:.2f}, {xy[a, 1]:.2f})")
            region[a:b] = len(regions)
            regions.append(found[0])
            polygons.append(found[1])
            neighbours.append(quadrangle)
            bands.append((low, high))
    corridor = _stacked(
        [[(plane[:2], float(plane[2])) for plane in planes] for planes in regions], polygons, np.array(neighbours)
    )
    if headroom is not None:
        corridor = replace(corridor, z_m=np.array(bands))
    return Reference(t_s, xyz_m, region), corridor


def _by_height(z_m: Array, span: tuple[int, int]) -> list[tuple[int, int]]:
    """A span of samples cut where it climbs or sinks by more than `_RISE_M`."""
    a, b = span
    steps = np.floor(np.concatenate([[0.0], np.cumsum(np.abs(np.diff(z_m[a:b])))]) / _RISE_M)
    cuts = (a + np.flatnonzero(np.diff(steps)) + 1).tolist()
    return list(zip([a, *cuts], [*cuts, b], strict=True))


def speeds_mps(t_s: Array, points_m: Array) -> Array:
    """Speed (K,) round each sample (K, d): the larger of those of the steps before and after it."""
    step = np.linalg.norm(np.diff(points_m, axis=0), axis=1) / np.diff(t_s)
    return np.asarray(np.maximum(np.append(step, 0.0), np.append(0.0, step)))


def nearest_places(channel_map: ChannelMap, points: Array) -> list[tuple[int, int, int]]:
    """Places (d, i, j) of the map's nodes nearest to points (n, 2); a bay's places are (channels + bay, node, 0)."""
    grids = [*channel_map.xy_m, *(bay.xy_m[:, None] for bay in channel_map.bays)]
    nodes = np.concatenate([grid.reshape(-1, 2) for grid in grids])
    x_min, y_min, x_max, y_max = channel_map.bounds_m
    finest = max(x_max - x_min, y_max - y_min) / _MOST_RASTER  # a map without channels has no median edge
    size = max(channel_map.quality.median_edge_m * _NODES_WITHIN, finest)
    there = np.flatnonzero(~np.isnan(nodes[:, 0]))  # bays leave holes in the grid
    near = _same_cells(nodes[there], points, size)
    chosen = there[near] if near.any() else there
    gap, found = cKDTree(nodes[chosen]).query(points)
    nearest = chosen[found]
    # Far from the nodes beside it a point may have a nearer one; a tree of all nodes costs more than these few do.
    for k in np.flatnonzero(gap > size).tolist():
        nearest[k] = there[np.argmin(np.hypot(nodes[there, 0] - points[k, 0], nodes[there, 1] - points[k, 1]))]
    first = np.cumsum([0, *(grid.shape[0] * grid.shape[1] for grid in grids)])
    places = []
    for node in nearest:
        d = int(np.searchsorted(first, node, side="right")) - 1
        i, j = divmod(int(node - first[d]), grids[d].shape[1])
        places.append((d, i, j))
    return places


def _same_cells(nodes: Array, points: Array, size: float) -> NDArray[np.bool_]:
    """Which nodes lie in the cells of a raster that hold a point, or beside them."""
    x, y = nodes.T  # a column at a time: numpy is slow along short rows
    low = np.floor(np.minimum(points.min(axis=0), [x.min(), y.min()]) / size) - 1
    high = np.floor(np.maximum(points.max(axis=0), [x.max(), y.max()]) / size) + 1
    raster = np.zeros((high - low + 1).astype(np.int64), dtype=np.bool_)
    at = (np.floor(points / size) - low).astype(np.int64)
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            raster[at[:, 0] + dx, at[:, 1] + dy] = True
    i, j = (np.floor(column / size).astype(np.int64) - int(first) for column, first in zip((x, y), low, strict=True))
    return np.asarray(raster[i, j])


def _region(stretch: Array, quadrangle: Array, edges: Array, keep_m: float) -> tuple[Array, Array] | None:
    """Half-planes (F, 3) and corners of the larger of the regions grown from the quadrangle and from the stretch."""
    seeds = [hull(stretch)]
    if sound(quadrangle, stretch):
        seeds.append(quadrangle)
    grown = [found for seed in seeds if (found := _grown(seed, edges, keep_m)) is not None]
    return max(grown, key=lambda found: float(shapely.Polygon(found[1]).area), default=None)


def _grown(seed: Array, edges: Array, keep_m: float) -> tuple[Array, Array] | None:
    for reach in _REACHES_M:
        planes, ring = inflate(seed, edges, _box(seed, reach), keep_m, FACES)
        if len(planes):
            return planes, ring
    return None


def sound(quadrangle: Array, stretch: Array) -> bool:
    """Whether a quadrangle is convex, counter-clockwise and holds the stretch."""
    side = quadrangle[_NEXT] - quadrangle
    after = side[_NEXT]
    if float((side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0]).min()) <= 0.0:
        return False
    return all(float((stretch @ n).max()) < g - _HAIR_M for n, g in _sides(quadrangle))


def hull(points: Array) -> Array:
    """Corners of the convex hull of points, counter-clockwise; two for a line, one for a point."""
    shape = shapely.MultiPoint(points).convex_hull
    corners = np.asarray(shapely.get_coordinates(shape))
    if not isinstance(shape, shapely.Polygon):
        return corners
    return corners[:-1] if shapely.is_ccw(shapely.linearrings(corners)) else corners[:0:-1]


def _sides(corners: Array) -> HalfPlanes:
    """Outward half-planes of a counter-clockwise ring's sides that have a length; rows of Lambda and Gamma, scaled."""
    side = np.roll(corners, -1, axis=0) - corners
    length = np.hypot(*side.T)
    normals = np.column_stack([side[:, 1], -side[:, 0]])
    return [(n / size, float(n @ c) / size) for n, c, size in zip(normals, corners, length, strict=True) if size > 1e-9]


def _box(points: Array, reach: float) -> Array:
    """(x_min, y_min, x_max, y_max) of points, `reach` wider."""
    return np.concatenate([points.min(axis=0) - reach, points.max(axis=0) + reach])


def _stacked(regions: list[HalfPlanes], polygons: list[Array], quadrangles: Array) -> Corridor:
    Lambda, Gamma = np.empty((len(regions), FACES, 2)), np.empty((len(regions), FACES))
    for m, planes in enumerate(regions):
        for f in range(FACES):
            Lambda[m, f], Gamma[m, f] = planes[min(f, len(planes) - 1)]
    return Corridor(Lambda, Gamma, tuple(polygons), quadrangles)
