"""A map with one more obstacle, at the cost of the ground it touches.

The obstacle's cells, and a column beside them on each side, are given up as a stretch of their channel and meshed
anew as a bay with the obstacle cut out; bays that it touches are meshed anew likewise. All other cells, and every
node on a channel's sides, stay as they are, so channels need not be solved again. The result obeys the laws that
`check` proves; a whole new build would lay its channels round the obstacle instead.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from sandwich_sitl.channels.bays import Bay, mesh_ground
from sandwich_sitl.channels.channel_map import ChannelMap, LostGround, MapQuality
from sandwich_sitl.channels.quality import measure
from sandwich_sitl.channels.stretches import stretch_inside, stretch_outline, widened
from sandwich_sitl.world.grow import GrownWorld

Array = NDArray[np.float64]
Place = tuple[int, int, int]

_THIN = 0.04  # of a cell: ground that is nowhere twice as wide is left out


def update_map(channel_map: ChannelMap, obstacle: Polygon, name: str, cell_m: float) -> ChannelMap:
    """The map with a grown obstacle, ENU metres, added; cells of new bays are about `cell_m`."""
    inside = shapely.intersection(obstacle, shapely.box(*channel_map.bounds_m))
    if not isinstance(inside, Polygon) or inside.is_empty:
        return channel_map
    obstacle = inside
    grown, shut_in = _with_obstacle(channel_map.grown, obstacle, name)
    shapely.prepare([obstacle, shut_in])
    gridded, xy_m, ground = channel_map.gridded.copy(), list(channel_map.xy_m), []
    for d, xy in enumerate(channel_map.xy_m):
        stretches = _stretches_hit(xy, gridded[d], obstacle, shut_in)
        if stretches:
            xy_m[d] = xy.copy()
        for start, end in stretches:
            nodes = _outline_places(d, xy.shape[1], start, end, len(xy))
            ground.append(
                (f"columns {start}-{end} of channel {d + 1}", Polygon(stretch_outline(xy, start, end)), nodes)
            )
        for start, end in stretches:
            gridded[d, start:end] = False
            xy_m[d][stretch_inside(len(xy), start, end), 1:-1] = np.nan
    kept = []
    for b, bay in enumerate(channel_map.bays):
        if _meets(bay, obstacle) or _meets(bay, shut_in):
            ground.append((bay.name, _outline_of(bay), [(d, i, j) for d, i, j in channel_map.lid_places[b].tolist()]))
        else:
            kept.append(b)
    bays = [channel_map.bays[b] for b in kept]
    lid_places = [channel_map.lid_places[b] for b in kept]
    lost = list(channel_map.lost)
    for label, polygon, places in ground:
        for part in shapely.get_parts(shapely.difference(polygon, obstacle)):
            if shut_in.contains(part.representative_point()):
                continue
            if part.buffer(-_THIN * cell_m).is_empty:
                lost.append(LostGround(f"sliver of {label}", shapely.get_coordinates(part.exterior)[:-1], part.area))
                continue
            bay, at = _meshed(label, part, places, channel_map.xy_m, cell_m)
            bays.append(bay)
            lid_places.append(at)
    updated = replace(
        channel_map,
        grown=grown,
        xy_m=tuple(xy_m),
        gridded=gridded,
        bays=tuple(bays),
        lid_places=tuple(lid_places),
        lost=tuple(lost),
    )
    return replace(updated, quality=_quality(channel_map, updated))


def _stretches_hit(
    xy: Array, gridded: NDArray[np.bool_], obstacle: Polygon, shut_in: BaseGeometry
) -> list[tuple[int, int]]:
    """Stretches (start, end) of columns of nodes round the cells that the obstacle touches."""
    x_min, y_min, x_max, y_max = obstacle.bounds
    low, high = np.fmin(xy[:-1], xy[1:]), np.fmax(xy[:-1], xy[1:])
    low, high = np.fmin(low[:, :-1], low[:, 1:]), np.fmax(high[:, :-1], high[:, 1:])
    near = (low[..., 0] <= x_max) & (high[..., 0] >= x_min) & (low[..., 1] <= y_max) & (high[..., 1] >= y_min)
    cells = np.argwhere(near & gridded[:, None])
    i, j = cells.T
    corners = np.stack([xy[i, j], xy[i + 1, j], xy[i + 1, j + 1], xy[i, j + 1]], axis=1)
    hit = np.zeros(len(gridded), dtype=bool)
    hit[i[shapely.intersects(obstacle, shapely.polygons(corners))]] = True
    if not shut_in.is_empty:
        middle = (xy[:-1, :-1] + xy[1:, 1:]) / 2
        hit |= (shapely.contains_xy(shut_in, middle[..., 0], middle[..., 1]) & gridded[:, None]).any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], gridded, [False]]).astype(int)))
    return [
        stretch
        for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        for stretch in widened(xy, hit, first, last)
    ]


def _outline_places(d: int, m_j: int, start: int, end: int, m_phi: int) -> list[Place]:
    """Places of the nodes on the outline of a stretch of channel d."""
    sides = [(d, i, j) for i in range(start, end + 1) for j in (0, m_j - 1)]
    ends = [(d, i, j) for i in (start, end) if 0 < i < m_phi - 1 for j in range(1, m_j - 1)]
    return sides + ends


def _meets(bay: Bay, obstacle: BaseGeometry) -> bool:
    low, high = bay.xy_m.min(axis=0), bay.xy_m.max(axis=0)
    if not obstacle.intersects(shapely.box(*low, *high)):
        return False
    return bool(shapely.intersects(obstacle, shapely.polygons(bay.corners_m())).any())


def _outline_of(bay: Bay) -> Polygon:
    """The ground of a bay, with all its outer nodes as vertices."""
    ground = shapely.coverage_union_all(shapely.polygons(bay.corners_m()))
    assert isinstance(ground, Polygon)
    return ground


def _meshed(
    name: str, part: Polygon, places: Sequence[Place], xy_m: Sequence[Array], cell_m: float
) -> tuple[Bay, NDArray[np.int64]]:
    """A bay on the polygon and the places of those of the nodes that are its own."""
    at = {tuple(xy_m[d][i, j].tolist()): (d, i, j) for d, i, j in places}
    bay = mesh_ground(name, part, at.keys(), cell_m)
    found = [at[x, y] for x, y in bay.xy_m[bay.lid_nodes].tolist()]
    return bay, np.array(found, dtype=np.int64).reshape(-1, 3)


def _with_obstacle(grown: GrownWorld, obstacle: Polygon, name: str) -> tuple[GrownWorld, BaseGeometry]:
    """The grown world with the obstacle, one with the polygons that it meets, and the ground that they now shut in."""
    met = [k for k, polygon in enumerate(grown.polygons) if polygon.intersects(obstacle)]
    kept = [k for k in range(len(grown.polygons)) if k not in met]
    united = shapely.union_all([obstacle, *(grown.polygons[k] for k in met)])
    parts = tuple(shapely.orient_polygons(Polygon(part.exterior)) for part in shapely.get_parts(united))
    joined = "+".join([*(grown.names[k] for k in met), name])
    shut_in = shapely.union_all(list(parts)).difference(united)
    world = replace(
        grown,
        polygons=(*(grown.polygons[k] for k in kept), *parts),
        names=(*(grown.names[k] for k in kept), *(joined for _ in parts)),
    )
    return world, shut_in


def _quality(old: ChannelMap, new: ChannelMap) -> MapQuality:
    """Counts anew; of angles and sizes, the worst of old and new cells, and the old ones' averages."""
    before = {id(bay) for bay in old.bays}
    added = [bay for bay in new.bays if id(bay) not in before]
    fresh = measure(np.empty((0, 4, 2)), added, 0, 0.0, new.grown)
    cells = [int(gridded.sum()) * (xy.shape[1] - 1) for xy, gridded in zip(new.xy_m, new.gridded, strict=True)]
    in_bays = sum(len(bay.quads) for bay in new.bays)
    unmapped = sum(lost.area_m2 for lost in new.lost) - sum(lost.area_m2 for lost in old.lost)
    mapped = (
        old.quality.coverage * old.grown.free_area_m2 - (old.grown.free_area_m2 - new.grown.free_area_m2) - unmapped
    )
    return replace(
        old.quality,
        cells=sum(cells) + in_bays,
        bay_cells=in_bays,
        min_jacobian_ratio=min(old.quality.min_jacobian_ratio, fresh.min_jacobian_ratio),
        min_angle_deg=min(old.quality.min_angle_deg, fresh.min_angle_deg),
        coverage=mapped / new.grown.free_area_m2,
    )
