"""Run-time assurance: no plan is flown that has not been looked at, and there is always one to go on with.

The ladder, top rung first:

    PLAN      the tick's own plan, accepted by `examine`: finite, within limits, inside its regions on a dense time grid,
              at rest at its end
    SHIFTED   the last accepted plan, shifted to now: it slows down along its path and ends at rest (`stop_plan`); after a
              pause of this process a stop straight on from where the vehicle has come to, which nobody has examined
    BRAKE     no accepted plan to go on with, or it has been flown to its end: straight deceleration, then at rest (mission)

A region, and the band of height round the reference, count as kept when no point lies further outside than
`region_tolerance_m`. A vehicle that wind or an estimate that jumps has put outside may come back: its motion gets no
further out than it begins, stays inside once it has come in, and ends at most half as far outside. So what is flown
ends at rest inside its region, or on the way there. Regions are convex, so a chord between two grid points of one
region stays in it; where the region changes, both points must share one. What the curve bulges over its chord within
a grid step, a dt^2 / 8, is below a millimetre and left to the tolerance.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

GRID_S = 0.02
_EVERY_ALTITUDE = np.empty((0, 2))
_GROWTH_M = 1e-3  # what a motion that begins outside may add before it turns


class Rung(IntEnum):
    """How far down the ladder a tick is."""

    PLAN = 0
    SHIFTED = 1
    BRAKE = 2


class Fault(StrEnum):
    """Why a tick's own plan was not flown."""

    NONE = ""
    BLIND = "no usable estimate of the vehicle"
    SOLVER = "the solver gave no answer"
    RAISED = "the solver raised an error"
    NOT_FINITE = "the plan is not finite"
    LATE = "the tick came too late for its plan to end in a stop"
    LIMITS = "the plan passes the motion limits"
    REGION = "the plan leaves its regions"
    OBSTACLE = "an obstacle has appeared on the way"
    UNCERTAIN = "the autopilot no longer knows its position well enough"
    STOP = "the mission stops"


class AcceptedMotion(NamedTuple):
    """The largest motion of a plan that is flown: speed across and along z, acceleration likewise, jerk."""

    speed_mps: float
    climb_mps: float
    across_mps2: float
    up_mps2: float
    jerk_mps3: float


@dataclass(frozen=True)
class Bounds:
    """Beyond what a plan is refused: its motion, `AcceptedMotion` as (5,); distance from the reference's height;
    tolerance of the regions and of that band.
    """

    limits: Array
    height_band_m: float
    region_tolerance_m: float


def _beyond(point: Array, Lambda: Array, Gamma: Array, z_m: Array, k: int) -> float:
    """How far outside of region k a point (3,) lies; negative inside."""
    value = -np.inf
    for f in range(Gamma.shape[1]):
        value = max(value, Lambda[k, f, 0] * point[0] + Lambda[k, f, 1] * point[1] - Gamma[k, f])
    if len(z_m) > 0:
        value = max(value, z_m[k, 0] - point[2], point[2] - z_m[k, 1])
    return float(value)


_compiled_beyond: Callable[[Array, Array, Array, Array, int], float] = numba.njit(cache=True)(_beyond)


def _outside(points: Array, Lambda: Array, Gamma: Array, z_m: Array, region: Indices) -> Array:
    """Distance (m,) outside of the regions of points (m, 3); a chord counts with the better region, for its end."""
    distance = np.empty(len(points))
    for i in range(len(points)):
        value = _compiled_beyond(points[i], Lambda, Gamma, z_m, region[i])
        if i > 0 and region[i] != region[i - 1]:
            # The chord lies in the old region when its end does, in the new one when its start does.
            old = _compiled_beyond(points[i], Lambda, Gamma, z_m, region[i - 1])
            new = _compiled_beyond(points[i - 1], Lambda, Gamma, z_m, region[i])
            value = max(value, min(old, new))
        distance[i] = value
    return distance


_compiled_outside: Callable[[Array, Array, Array, Array, Indices], Array] = numba.njit(cache=True)(_outside)


def outside(points: Array, Lambda: Array, Gamma: Array, region: Indices, z_m: Array = _EVERY_ALTITUDE) -> Array:
    """Distance (m,) outside of their regions of points (m, 3) and the chords that lead to them; negative inside.

    Regions (M, F, 2), (M, F) may have altitudes `z_m` (M, 2).
    """
    return _compiled_outside(points, Lambda, Gamma, z_m, region)


def comes_back(distance_m: Array, tolerance_m: float) -> bool:
    """Whether a motion at these distances (m,) outside keeps to the tolerance, or comes back to it from outside."""
    begins, ends = float(distance_m[0]), float(distance_m[-1])
    out = distance_m > tolerance_m
    goes_out = bool((out[1:] & ~out[:-1]).any())
    nearer = ends <= max(tolerance_m, begins / 2) and float(distance_m.max()) <= begins + _GROWTH_M
    return not out.any() or (not goes_out and nearer)


def _largest_motion(states: Array) -> Array:
    largest = np.zeros(5)
    for i in range(len(states)):
        for d in range(12):
            if not np.isfinite(states[i, d]):
                return np.full(5, np.nan)
        vx, vy, vz, ax, ay, az, jx, jy, jz = states[i, 3:]
        largest[0] = max(largest[0], vx * vx + vy * vy)
        largest[1] = max(largest[1], vz * vz)
        largest[2] = max(largest[2], ax * ax + ay * ay)
        largest[3] = max(largest[3], az * az)
        largest[4] = max(largest[4], jx * jx + jy * jy + jz * jz)
    return np.sqrt(largest)


#: Largest speed across and climb, acceleration across and along z, and jerk (5,) of a motion (m, 12); NaN when any of it is not finite.
largest_motion: Callable[[Array], Array] = numba.njit(cache=True)(_largest_motion)


def examine(
    states: Array, offset_m: Array, height_m: Array, Lambda: Array, Gamma: Array, region: Indices, bounds: Bounds,
    z_m: Array = _EVERY_ALTITUDE,
) -> Fault:  # fmt: skip
    """The verdict on a motion (m, 12) every `GRID_S` whose points, shifted by `offset_m` (m, 3), are to lie in `region`
    (m,) and near the reference's `height_m` (m,).
    """
    largest = largest_motion(states)
    if np.isnan(largest[0]):
        return Fault.NOT_FINITE
    if (largest > bounds.limits).any():
        return Fault.LIMITS
    points = states[:, :3] + offset_m
    off_height = np.abs(points[:, 2] - height_m) - bounds.height_band_m
    off_region = outside(points, Lambda, Gamma, region, z_m)
    if np.isnan(off_height).any() or not np.isfinite(off_region).all():
        return Fault.NOT_FINITE
    tolerance_m = bounds.region_tolerance_m
    kept = comes_back(off_height, tolerance_m) and comes_back(off_region, tolerance_m)
    return Fault.NONE if kept else Fault.REGION


def describe(rung: Rung, fault: Fault, error: str = "") -> str:
    """A rung in words, with the solver's own where it raised."""
    if rung is Rung.PLAN:
        return "plans are accepted again"
    return f"{fault}{f' ({error})' if error else ''}; " + (
        "slowing down along the last plan" if rung is Rung.SHIFTED else "braking"
    )
