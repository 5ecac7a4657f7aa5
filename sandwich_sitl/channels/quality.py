"""Figures of merit of a channel map's cells."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.channels.bays import Bay
from sandwich_sitl.channels.cells import quad_angles, quad_areas, quad_sides, quad_sines
from sandwich_sitl.channels.channel_map import MapQuality
from sandwich_sitl.world.grow import GrownWorld

Array = NDArray[np.float64]


def measure(
    channels: Array, bays: Sequence[Bay], repaired_cells: int, max_residual_m: float, grown: GrownWorld
) -> MapQuality:
    """Quality of the channels' cells (n, 4, 2) and the bays that map the grown world."""
    corners = np.concatenate([channels, *(bay.corners_m() for bay in bays)])
    sines = quad_sines(corners)
    angles = np.degrees(quad_angles(corners))
    sides = quad_sides(channels)
    along, across = (sides[:, 0] + sides[:, 2]) / 2, (sides[:, 1] + sides[:, 3]) / 2
    aspect = np.maximum(along, across) / np.minimum(along, across)
    free = grown.free_area_m2
    return MapQuality(
        cells=len(corners),
        bay_cells=len(corners) - len(channels),
        folded_cells=int((sines <= 0).any(axis=1).sum()),
        repaired_cells=repaired_cells,
        min_jacobian_ratio=float(sines.min(initial=1.0)),
        min_angle_deg=float(angles.min(initial=90.0)),
        mean_angle_error_deg=float(np.abs(angles - 90.0).mean()) if angles.size else 0.0,
        median_edge_m=float(np.median(sides)) if sides.size else 0.0,
        p95_aspect=float(np.percentile(aspect, 95)) if aspect.size else 1.0,
        max_residual_m=max_residual_m,
        coverage=float(quad_areas(corners).sum() / free) if free > 0 else 0.0,
    )
