"""From a grown world to a checked `ChannelMap` (paper, section III).

classify -> lay dividing streamlines -> spread boundary nodes -> solve Eq. (ellipticpde) channel by channel -> mend
folded cells -> check.

Why the result is one-to-one: every corner of every wall is a node, so the outer edges of a channel's grid are exactly
the channel's boundary; when all four corner Jacobians of every quad are positive, every quad is convex, and convex
quads of one orientation that fill a simple boundary overlap nowhere. Then no grid edge or diagonal meets the inside
of an obstacle either. Where a world's dead ends are too deep for that, they are closed, widest mouth last, and
counted as lost ground; a map that still folds is refused.
"""

import itertools

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.boundary import Streamline, columns_needed, spread_nodes
from sandwich_sitl.channels.channel_map import ChannelMap, MapQuality
from sandwich_sitl.channels.classify import classify
from sandwich_sitl.channels.dividers import lay_dividers
from sandwich_sitl.channels.elliptic import interpolate, residual, solve_elliptic
from sandwich_sitl.channels.untangle import Untangled, corner_sines, untangle
from sandwich_sitl.errors import MapError, NoRouteError
from sandwich_sitl.world.grow import GrownWorld
from sandwich_sitl.world.pockets import dead_ends, fill

Array = NDArray[np.float64]
Point = tuple[float, float]

_MOUTHS = (0.0, 4.0, 8.0, 16.0)  # in cells: dead ends behind narrower mouths are closed, tried in turn
_LEAST_SINE = 0.01  # of a corner's angle: 0.6 degrees
_TOLERANCE = 1e-3  # of a cell: Picard steps end when no node moves more


def build_channel_map(grown: GrownWorld, cell_m: float, min_rows: int, keep: tuple[Point, ...] = ()) -> ChannelMap:
    """The channel map of a grown world, cells of about `cell_m`; the points `keep` are never counted as dead ends.

    Raises `NoRouteError` when an obstacle splits the world from bottom to top and `MapError` when cells stay folded.
    """
    refused = ""
    for mouth in _MOUTHS:
        pockets = dead_ends(grown, mouth * cell_m, keep) if mouth else []
        try:
            return _build(grown, pockets, cell_m, min_rows)
        except _FoldedChannelError as error:
            refused = str(error)
        except NoRouteError:
            if not pockets:
                raise
            break  # closing this much splits the world in two
    raise MapError(
        f"channel map: {refused}, even with dead ends closed as far as that splits nothing; "
        "the map is refused: try a smaller planner.cell_m or a smaller planner.margin_m"
    )


class _FoldedChannelError(Exception):
    """A channel whose cells could not all be unfolded."""


def _build(grown: GrownWorld, pockets: list[shapely.Polygon], cell_m: float, min_rows: int) -> ChannelMap:
    x_min, y_min, x_max, y_max = grown.bounds_m
    filled = fill(grown, pockets)
    groups = classify(filled)
    dividers = lay_dividers(groups, grown.bounds_m, cell_m)
    m_phi = max(int(np.ceil((x_max - x_min) / cell_m)) + 1, columns_needed(dividers))
    streamlines = [spread_nodes(pieces, x_min, x_max, m_phi) for pieces in dividers]
    grids, repaired, residuals = [], 0, [0.0]
    for number, (below, above) in enumerate(itertools.pairwise(streamlines)):
        grid = _mapped_channel(below.upper, above.lower, cell_m, min_rows, f"channel {number + 1}")
        grids.append(grid.xy_m)
        repaired += int(grid.repaired.sum())
        residuals.append(_largest_residual(grid.xy_m, grid.repaired))
    inner = streamlines[1:-1]
    barrier = np.array([line.barrier for line in inner], dtype=np.int64).reshape(len(inner), m_phi)
    mean_heights = [float(line.lower[:, 1].mean() + line.upper[:, 1].mean()) / 2 for line in inner]
    return ChannelMap(
        bounds_m=grown.bounds_m,
        xy_m=tuple(grids),
        barred=barrier >= 0,
        barrier=np.where(barrier >= 0, _origins(filled, grown)[barrier], -1),
        Psi=np.maximum.accumulate(np.array([y_min, *mean_heights, y_max])),
        phi=np.linspace(x_min, x_max, m_phi),
        quality=_quality(grids, streamlines, repaired, max(residuals), grown.free_area_m2),
    )


def _origins(filled: GrownWorld, grown: GrownWorld) -> NDArray[np.int64]:
    """For each polygon with its pockets filled, the first polygon of the grown world in it; last, a -1 for none."""
    tree = shapely.STRtree(list(grown.polygons))
    inside = [tree.query(polygon, predicate="intersects") for polygon in filled.polygons]
    return np.array([*(int(found.min()) if found.size else -1 for found in inside), -1], dtype=np.int64)


def _mapped_channel(bottom: Array, top: Array, cell_m: float, min_rows: int, name: str) -> Untangled:
    """Solve and mend one channel between bottom (m_phi, 2) and top (m_phi, 2)."""
    start = interpolate(bottom, top, _rows(bottom, top, cell_m, min_rows))
    solved = solve_elliptic(start, _TOLERANCE * cell_m)
    if solved.last_move_m > cell_m:
        raise _FoldedChannelError(f"{name}: the grid equations do not converge (last move {solved.last_move_m:.2g} m)")
    mended = untangle(solved.xy_m, _LEAST_SINE)
    folded = int((corner_sines(mended.xy_m) <= 0).any(axis=-1).sum())
    if folded:
        raise _FoldedChannelError(f"{name}: {folded} of {mended.repaired.size} cells stay folded")
    return mended


def _rows(bottom: Array, top: Array, cell_m: float, min_rows: int) -> int:
    """m_j: nodes across a channel, for cells of about `cell_m` where it has its median width."""
    width = float(np.median(np.hypot(*(top - bottom).T)))
    return max(min_rows, int(np.ceil(width / cell_m)) + 1)


def _largest_residual(xy: Array, repaired: NDArray[np.bool_]) -> float:
    """Largest residual at interior nodes none of whose four cells was repaired."""
    touched = repaired[1:, 1:] | repaired[1:, :-1] | repaired[:-1, 1:] | repaired[:-1, :-1]
    values = residual(xy)[~touched]
    return float(values.max()) if values.size else 0.0


def _quality(
    grids: list[Array], streamlines: list[Streamline], repaired: int, max_residual_m: float, free_area_m2: float
) -> MapQuality:
    sines = np.concatenate([corner_sines(xy).reshape(-1, 4) for xy in grids])
    angles = np.degrees(np.concatenate([corner_angles(xy).ravel() for xy in grids]))
    mapped = sum(
        shapely.Polygon(np.concatenate([below.upper, above.lower[::-1]])).area
        for below, above in itertools.pairwise(streamlines)
    )
    return MapQuality(
        cells=len(sines),
        folded_cells=int((sines <= 0).any(axis=1).sum()),
        repaired_cells=repaired,
        min_jacobian_ratio=float(sines.min()),
        min_angle_deg=float(angles.min()),
        mean_angle_error_deg=float(np.abs(angles - 90.0).mean()),
        max_residual_m=max_residual_m,
        coverage=float(mapped / free_area_m2) if free_area_m2 > 0 else 0.0,
    )


def corner_angles(xy: Array) -> Array:
    """Angles in radians at the four corners of each cell, (m_phi - 1, m_j - 1, 4)."""
    corners = np.stack([xy[:-1, :-1], xy[1:, :-1], xy[1:, 1:], xy[:-1, 1:]], axis=2)
    onward, back = np.roll(corners, -1, axis=2) - corners, np.roll(corners, 1, axis=2) - corners
    cross = onward[..., 0] * back[..., 1] - onward[..., 1] * back[..., 0]
    return np.asarray(np.arctan2(cross, (onward * back).sum(axis=-1)))
