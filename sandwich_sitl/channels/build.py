"""From a grown world to a `ChannelMap` (paper, section III).

close vertically -> mesh the bays -> classify -> lay dividing streamlines -> spread boundary nodes -> solve
Eq. (ellipticpde) channel by channel -> unfold -> measure

Why the result is one-to-one: every corner of every wall is a node, so the outer edges of a channel's grid are exactly
the channel's boundary; when all four corner Jacobians of every quad are positive, every quad is convex, and convex
quads of one orientation that fill a simple boundary overlap nowhere. Then no grid edge or diagonal meets the inside of
an obstacle either. Closing makes the walls functions of x, with vertical steps, so that the channels are free of the
deep pockets in which a grid folds; `check` proves the outcome for the map at hand.
"""

import itertools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sandwich_sitl.channels.barrier import Barrier
from sandwich_sitl.channels.bays import Bay, mesh_bay
from sandwich_sitl.channels.boundary import Streamline, columns_needed, spread_nodes
from sandwich_sitl.channels.channel_map import ChannelMap, Flow, LostGround, grid_quads
from sandwich_sitl.channels.classify import classify
from sandwich_sitl.channels.closure import Closure, close_world, with_vertices
from sandwich_sitl.channels.dividers import lay_dividers
from sandwich_sitl.channels.elliptic import interpolate, residual, solve_elliptic
from sandwich_sitl.channels.flow import turned_back, turned_world
from sandwich_sitl.channels.quality import measure
from sandwich_sitl.channels.stations import lay_stations
from sandwich_sitl.channels.stretches import Sound, without_folds
from sandwich_sitl.channels.untangle import untangle
from sandwich_sitl.world.grow import GrownWorld, snapped

Array = NDArray[np.float64]

LEAST_SINE = 0.01  # of a corner's angle: 0.6 degrees
SOLVED = 2e-3  # of a cell: residual up to which a node counts as on the solution; the rest count as repaired
_TOLERANCE = 1e-3  # of a cell: largest component of a residual at which cycles end
_THREADS = 2
_BLOCK = 4  # intervals across a channel come in multiples of this, those along it of twice this: multigrid halves them
_THIN = 0.04  # of a cell: a pocket that is nowhere twice as wide, and no passage, is left out
_SAME = 1e-9  # of the extent: nodes closer than this are one


def build_channel_map(grown: GrownWorld, cell_m: float, min_rows: int, flow: Flow = "x") -> ChannelMap:
    """The channel map of a grown world, cells of about `cell_m`, channels along `flow`.

    Where a barrier reaches across the flow from border to border no channel passes, and all ground is mapped as bays.
    """
    grown = snapped(grown)
    world = turned_world(grown, flow)
    x_min, y_min, x_max, y_max = world.bounds_m
    barriers, bays, lost = _barriers(world, cell_m)
    if any(barrier.on_bottom and barrier.on_top for barrier in barriers):
        return turned_back(_without_channels(world, cell_m, flow), grown)
    dividers = lay_dividers(classify(barriers, y_min, y_max, cell_m), world.bounds_m, cell_m)
    m_phi = _rounded(max(int(np.ceil((x_max - x_min) / cell_m)), columns_needed(dividers, cell_m) - 1), 2 * _BLOCK) + 1
    stations = lay_stations([shapely.Polygon(barrier.ring_m) for barrier in barriers], world.bounds_m)
    streamlines = [spread_nodes(pieces, stations, m_phi, cell_m) for pieces in dividers]
    grids = _solved(streamlines, cell_m, min_rows)
    bays += tuple(bay for grid in grids for bay in grid.sound.bays)
    bays, lid_places = _joined_lids(bays, [grid.sound for grid in grids], max(x_max - x_min, y_max - y_min))
    inner = streamlines[1:-1]
    barrier = np.array([line.barrier for line in inner], dtype=np.int64).reshape(len(inner), m_phi)
    mean_heights = [float(line.lower[:, 1].mean() + line.upper[:, 1].mean()) / 2 for line in inner]
    cells = np.concatenate([grid_quads(grid.sound.xy_m, grid.sound.gridded) for grid in grids])
    channel_map = ChannelMap(
        grown=world,
        flow=flow,
        xy_m=tuple(grid.sound.xy_m for grid in grids),
        gridded=np.array([grid.sound.gridded for grid in grids]),
        barred=barrier >= 0,
        barrier=barrier,
        Psi=np.maximum.accumulate(np.array([y_min, *mean_heights, y_max])),
        phi=np.linspace(x_min, x_max, m_phi),
        bays=bays,
        lid_places=lid_places,
        lost=lost,
        quality=measure(
            cells, bays, sum(grid.repaired_cells for grid in grids), max(grid.max_residual_m for grid in grids), world
        ),
    )
    return turned_back(channel_map, grown)


def _without_channels(world: GrownWorld, cell_m: float, flow: Flow) -> ChannelMap:
    """Each connected part of the free ground as a bay."""
    x_min, y_min, x_max, y_max = world.bounds_m
    free = shapely.box(*world.bounds_m).difference(shapely.union_all(list(world.polygons)))
    no_lids = np.empty((0, 2, 2))
    parts = [part for part in shapely.get_parts(free) if not part.buffer(-_THIN * cell_m).is_empty]
    bays = tuple(mesh_bay(f"ground {k}", part, no_lids, cell_m) for k, part in enumerate(parts, start=1))
    m_phi = 2
    return ChannelMap(
        grown=world,
        flow=flow,
        xy_m=(),
        gridded=np.empty((0, m_phi - 1), dtype=bool),
        barred=np.empty((0, m_phi), dtype=bool),
        barrier=np.empty((0, m_phi), dtype=np.int64),
        Psi=np.array([y_min, y_max]),
        phi=np.array([x_min, x_max]),
        bays=bays,
        lid_places=tuple(np.empty((0, 3), dtype=np.int64) for _ in bays),
        lost=(),
        quality=measure(np.empty((0, 4, 2)), bays, 0, 0.0, world),
    )


def _rounded(intervals: int, multiple: int) -> int:
    return -(-intervals // multiple) * multiple


def _barriers(world: GrownWorld, cell_m: float) -> tuple[tuple[Barrier, ...], tuple[Bay, ...], tuple[LostGround, ...]]:
    """Barriers of the closed world, whose outlines have the nodes of the bays' lids as vertices."""
    barriers: list[Barrier] = []
    bays: list[Bay] = []
    lost: list[LostGround] = []
    for closure in close_world(world.rings_m(), world.bounds_m):
        name = "+".join(dict.fromkeys(world.names[k] for k in closure.members))
        inside, left_out = _meshed(closure, name, cell_m)
        bays += inside
        lost += left_out
        points = np.concatenate([np.empty((0, 2)), *(bay.xy_m[bay.lid_nodes] for bay in inside)])
        ring = with_vertices(closure.ring_m, points) if len(points) else closure.ring_m
        barriers.append(Barrier(closure.members[0], name, ring, world.bounds_m))
    return tuple(barriers), tuple(bays), tuple(lost)


def _meshed(closure: Closure, name: str, cell_m: float) -> tuple[list[Bay], list[LostGround]]:
    """The closure's bays, and the pockets too thin to mesh."""
    bays, lost = [], []
    for number, polygon in enumerate(closure.bays, start=1):
        lids = [lid for lid in closure.lids if shapely.LineString(lid).intersection(polygon).length > 0]
        thin = polygon.buffer(-_THIN * cell_m).is_empty
        if thin and len(lids) < 2:
            ring = shapely.get_coordinates(polygon.exterior)[:-1]
            lost.append(LostGround(f"pocket {number} of '{name}'", ring, polygon.area))
        else:
            bays.append(mesh_bay(f"bay {number} of '{name}'", polygon, np.array(lids).reshape(-1, 2, 2), cell_m))
    return bays, lost


@dataclass(frozen=True)
class _Channel:
    sound: Sound
    repaired_cells: int
    max_residual_m: float


def _solved(streamlines: Sequence[Streamline], cell_m: float, min_rows: int) -> list[_Channel]:
    """Every channel's grid; channels do not depend on each other."""
    sides = [(below.upper, above.lower) for below, above in itertools.pairwise(streamlines)]
    names = [f"channel {d + 1}" for d in range(len(sides))]
    with ThreadPoolExecutor(_THREADS) as pool:
        jobs = [
            pool.submit(_mapped_channel, *side, name, cell_m, min_rows) for side, name in zip(sides, names, strict=True)
        ]
        return [job.result() for job in jobs]


def _mapped_channel(bottom: Array, top: Array, name: str, cell_m: float, min_rows: int) -> _Channel:
    """Solve and mend one channel between bottom (m_phi, 2) and top (m_phi, 2)."""
    start = interpolate(bottom, top, _rows(bottom, top, cell_m, min_rows))
    solved = solve_elliptic(start, _TOLERANCE * cell_m)
    mended = untangle(solved.xy_m, LEAST_SINE)
    sound = without_folds(mended.xy_m, name, cell_m)
    left = np.where(mended.moved, 0.0, residual(mended.xy_m))
    unsettled = left > SOLVED * cell_m
    repaired = mended.repaired | _cells_round(unsettled)
    return _Channel(sound, int(repaired[sound.gridded].sum()), float(left[~unsettled].max()))


def _cells_round(nodes: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells (m_phi - 1, m_j - 1) with one of the nodes (m_phi, m_j)."""
    return np.asarray(nodes[1:, 1:] | nodes[1:, :-1] | nodes[:-1, 1:] | nodes[:-1, :-1])


def _rows(bottom: Array, top: Array, cell_m: float, min_rows: int) -> int:
    """m_j: nodes across a channel, for cells of about `cell_m` where it has its median width."""
    width = float(np.median(np.hypot(*(top - bottom).T)))
    return _rounded(max(min_rows - 1, int(np.ceil(width / cell_m))), _BLOCK) + 1


def _joined_lids(
    bays: tuple[Bay, ...], grids: Sequence[Sound], extent_m: float
) -> tuple[tuple[Bay, ...], tuple[NDArray[np.int64], ...]]:
    """Bays whose lid nodes are those with a channel node at the same point, and the places (L, 3) of the latter.

    A node that the mesher put on a lid by itself may have no partner: it hangs on a straight side.
    """
    places, points = _outer_nodes(grids)
    if not bays or not len(points):
        return bays, tuple(np.empty((0, 3), dtype=np.int64) for _ in bays)
    tree = cKDTree(points)
    joined, lid_places = [], []
    for bay in bays:
        distance, found = tree.query(bay.xy_m[bay.lid_nodes], distance_upper_bound=_SAME * extent_m)
        met, nearest = np.isfinite(distance), np.asarray(found)
        xy = bay.xy_m.copy()
        xy[bay.lid_nodes[met]] = points[nearest[met]]
        joined.append(replace(bay, xy_m=xy, lid_nodes=bay.lid_nodes[met]))
        lid_places.append(places[nearest[met]])
    return tuple(joined), tuple(lid_places)


def _outer_nodes(grids: Sequence[Sound]) -> tuple[NDArray[np.int64], Array]:
    """Places (n, 3) and points (n, 2) of the nodes on the sides of channels and beside their gaps."""
    places = [np.empty((0, 3), dtype=np.int64)]
    for d, grid in enumerate(grids):
        m_phi, m_j = grid.xy_m.shape[:2]
        i, j = np.indices((m_phi, m_j))
        beside_gap = np.zeros(m_phi, dtype=bool)
        beside_gap[1:-1] = np.diff(grid.gridded)
        outer = (j == 0) | (j == m_j - 1) | beside_gap[:, None]
        places.append(np.column_stack([np.full(int(outer.sum()), d), i[outer], j[outer]]))
    found = np.concatenate(places)
    points = [grid.xy_m[at[:, 1], at[:, 2]] for grid, at in zip(grids, places[1:], strict=True)]
    return found, np.concatenate([np.empty((0, 2)), *points])
