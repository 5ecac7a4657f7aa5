"""The convex regions of a flight by the numbers that its log uses, and how far places lie outside of them."""

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.planning.flight_plan import Corridor
from sandwich_sitl.recording.reader import RunLog

Array = NDArray[np.float64]


def whole_corridor(log: RunLog) -> Corridor | None:
    """Every region of the flight by its number: those of the plan before take-off, then those of each new one."""
    if log.plan is None:
        return None
    parts = [log.plan.corridor, *(update.corridor for update in log.updates)]
    return Corridor(
        np.concatenate([part.Lambda for part in parts]),
        np.concatenate([part.Gamma for part in parts]),
        tuple(ring for part in parts for ring in part.polygons_m),
        np.concatenate([part.neighbours_m for part in parts]),
        log.plan.corridor.z_m,
    )


def outside_m(corridor: Corridor, r_m: Array, region: NDArray[np.int64]) -> Array:
    """How far places (n, 3) lie outside of the regions (n,), also above or below them; negative inside."""
    beyond = np.einsum("kfd,kd->kf", corridor.Lambda[region], r_m[:, :2]) - corridor.Gamma[region]
    if len(corridor.z_m):
        low_m, high_m = corridor.z_m[region].T
        beyond = np.column_stack([beyond, low_m - r_m[:, 2], r_m[:, 2] - high_m])
    return np.asarray(beyond.max(axis=1, initial=-np.inf))
