"""Proof that a channel map is what it claims, for the map at hand.

The four laws: (1) every quad has four positive corner Jacobians; (2) no edge that a search may use meets the interior of
a grown obstacle; (3) nearly all free ground is mapped and the rest is named; (4) channels share nodes exactly where no
wall parts them.

Law 2 by exact geometry: quads with positive corners are convex, so their edges and diagonals lie inside them; the quads
of one orientation inside a simple outline fill it and overlap nowhere; the outlines of the channels' stretches are
simple and apart, and neither they nor a bay's quads meet an obstacle shrunk by the tolerance.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.bays import Bay
from sandwich_sitl.channels.cells import quad_areas, quad_sines
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.errors import MapError

Array = NDArray[np.float64]

LEAST_COVERAGE = 0.995
_TOLERANCE = 1e-9  # of the extent


@dataclass(frozen=True)
class MapCheck:
    """What fails, counted: the map is sound when all are zero and the coverage suffices."""

    folded_cells: int
    blocked: int  # stretches of channels and quads of bays that meet the interior of a grown obstacle
    doubled_share: float  # area that channels cover twice, or mapped beyond the free area, over the latter
    coverage: float  # mapped over free area
    unshared_nodes: int  # nodes of free streamlines or lids that are not the same point on both sides
    stray_nodes: int  # barred nodes that lie off every wall

    @property
    def failures(self) -> tuple[str, ...]:
        """One phrase for each law that does not hold."""
        laws = (
            (self.folded_cells == 0, f"{self.folded_cells} cells are folded"),
            (self.blocked == 0, f"{self.blocked} stretches or quads meet an obstacle"),
            (self.doubled_share <= 1e-9, f"{self.doubled_share:.2g} of the mapped area is mapped twice"),
            (self.coverage >= LEAST_COVERAGE, f"only {self.coverage:.4f} of the free ground is mapped"),
            (self.unshared_nodes == 0, f"{self.unshared_nodes} nodes differ between neighbouring channels"),
            (self.stray_nodes == 0, f"{self.stray_nodes} barred nodes lie off every wall"),
        )
        return tuple(phrase for holds, phrase in laws if not holds)


def check_map(channel_map: ChannelMap) -> MapCheck:
    """Prove laws 1 to 4; raises `MapError` naming those that fail."""
    found = examine(channel_map)
    if found.failures:
        raise MapError(f"channel map: {'; '.join(found.failures)}; the map is refused: try another planner.cell_m")
    return found


def examine(channel_map: ChannelMap) -> MapCheck:
    """The check's findings, good or bad."""
    corners = channel_map.corners_m()
    grown = channel_map.grown
    x_min, y_min, x_max, y_max = grown.bounds_m
    tolerance = _TOLERANCE * max(x_max - x_min, y_max - y_min)
    area = float(quad_areas(corners).sum())
    free = grown.free_area_m2
    return MapCheck(
        folded_cells=int((quad_sines(corners) <= 0).any(axis=1).sum()),
        blocked=_blocked(channel_map, tolerance),
        doubled_share=max(_doubled(channel_map), area - free) / free if free > 0 else 0.0,
        coverage=area / free if free > 0 else 1.0,
        unshared_nodes=_unshared(channel_map),
        stray_nodes=_stray(channel_map, tolerance),
    )


def _blocked(channel_map: ChannelMap, tolerance: float) -> int:
    """Stretches of channels and quads of bays that meet an obstacle shrunk by the tolerance."""
    shrunk = [polygon.buffer(-tolerance, join_style="mitre") for polygon in channel_map.grown.polygons]
    solid = [part for polygon in shrunk for part in shapely.get_parts(polygon) if not part.is_empty]
    ground = [
        *_stretches(channel_map),
        *(quad for bay in channel_map.bays for quad in np.asarray(shapely.polygons(bay.corners_m()), dtype=object)),
    ]
    if not solid or not ground:
        return 0
    shapely.prepare(ground)
    meeting, _ = shapely.STRtree(solid).query(ground, predicate="intersects")
    return len(np.unique(meeting))


def _stretches(channel_map: ChannelMap) -> list[shapely.Polygon]:
    """Outlines of the gridded stretches of every channel."""
    outlines = []
    for xy, gridded in zip(channel_map.xy_m, channel_map.gridded, strict=True):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], gridded, [False]]).astype(int)))
        for start, end in zip(edges[::2], edges[1::2], strict=True):
            low, high = xy[start : end + 1, 0], xy[start : end + 1, -1]
            outlines.append(shapely.Polygon(np.concatenate([low, xy[end, 1:-1], high[::-1], xy[start, -2:0:-1]])))
    return outlines


def _unshared(channel_map: ChannelMap) -> int:
    """Free streamline nodes and lid nodes whose two copies differ."""
    count = 0
    for d, barred in enumerate(channel_map.barred):
        below, above = channel_map.xy_m[d][:, -1], channel_map.xy_m[d + 1][:, 0]
        same = (below == above).all(axis=1) | np.isnan(below).any(axis=1) | np.isnan(above).any(axis=1)
        count += int((~same & ~barred).sum())
    for bay, places in zip(channel_map.bays, channel_map.lid_places, strict=True):
        channel_nodes = np.array([channel_map.xy_m[d][i, j] for d, i, j in places]).reshape(-1, 2)
        count += int((bay.xy_m[bay.lid_nodes] != channel_nodes).any(axis=1).sum())
    return count


def _stray(channel_map: ChannelMap, tolerance: float) -> int:
    """Barred nodes of cells that are neither on an obstacle's outline nor on a bay's."""
    nodes = [
        channel_map.xy_m[channel][barred & _has_cells(channel_map.gridded[channel]), row]
        for d, barred in enumerate(channel_map.barred)
        for channel, row in ((d, -1), (d + 1, 0))
    ]
    points = np.asarray(shapely.points(np.concatenate([np.empty((0, 2)), *nodes])), dtype=object)
    if not len(points):
        return 0
    lines = np.array([polygon.exterior for polygon in channel_map.grown.polygons], dtype=object)
    walls = shapely.STRtree(
        np.concatenate([lines, *(_outer_edges(bay) for bay in channel_map.bays), *_lost_outlines(channel_map)])
    )
    _, distance = walls.query_nearest(points, return_distance=True, all_matches=False)
    return int((distance > tolerance).sum())


def _has_cells(gridded: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which columns of nodes (m_phi,) have cells beside them."""
    return np.concatenate([gridded[:1], gridded[1:] | gridded[:-1], gridded[-1:]])


def _lost_outlines(channel_map: ChannelMap) -> list[NDArray[np.object_]]:
    """A wall runs straight across the mouth of a sliver that is left out."""
    return [np.array([shapely.LinearRing(lost.ring_m)], dtype=object) for lost in channel_map.lost]


def _outer_edges(bay: Bay) -> NDArray[np.object_]:
    """Edges of a bay's outline, lids and walls, as lines."""
    sides = np.sort(np.stack([bay.quads, np.roll(bay.quads, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, uses = np.unique(sides, axis=0, return_counts=True)
    return np.asarray(shapely.linestrings(bay.xy_m[edges[uses == 1]]), dtype=object).reshape(-1)


def _doubled(channel_map: ChannelMap) -> float:
    """Area that channels cover twice, from the outlines: those and one orientation leave no other way to overlap."""
    outlines = _stretches(channel_map)
    total = sum(outline.area for outline in outlines)
    crossed = sum(0.0 if outline.is_valid else outline.area for outline in outlines)
    return crossed if crossed > 0 else float(total - shapely.union_all(outlines).area)
