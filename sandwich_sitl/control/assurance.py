"""Run-time assurance: no plan is flown that has not been looked at, and there is always one to go on with.

The ladder, top rung first:

    PLAN      the tick's own plan, accepted by `examine`: finite, within limits, inside its regions on a dense time grid,
              at rest at its end
    SHIFTED   the last accepted plan, shifted to now: it slows down along its path and ends at rest (`stop_plan`)
    BRAKE     no accepted plan to go on with, or it has been flown to its end: straight deceleration (mission)
    HOLD      at rest (mission)

A region counts as kept when no point lies further outside than `region_tolerance_m`, or than the motion's first
point does: a vehicle that wind has pushed out may come back. Regions are convex, so a chord between two grid points of
one region stays in it; where the region changes, both points must share one. What the curve bulges over its chord
within a grid step, a dt^2 / 8, is below a millimetre and left to the tolerance.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

GRID_S = 0.02
_BEYOND = 1.25  # of a limit: limits are soft in the problem, a plan that passes them by more is refused


class Rung(IntEnum):
    """How far down the ladder a tick is."""

    PLAN = 0
    SHIFTED = 1
    BRAKE = 2
    HOLD = 3


class Fault(StrEnum):
    """Why a tick's own plan was not flown."""

    NONE = ""
    BLIND = "no usable estimate of the vehicle"
    SOLVER = "the solver gave no answer"
    NOT_FINITE = "the plan is not finite"
    LIMITS = "the plan passes the motion limits"
    REGION = "the plan leaves its regions"
    OBSTACLE = "an obstacle has appeared on the way"


@dataclass(frozen=True)
class Bounds:
    """What a plan may do: limits (4,) of speed, climb, acceleration, jerk, and the regions' tolerance."""

    limits: Array
    region_tolerance_m: float


def _outside(points: Array, Lambda: Array, Gamma: Array, region: Indices) -> tuple[float, float]:
    """First and largest distance outside of the regions of points (m, >= 2); chords count with the better region."""
    first, worst = 0.0, 0.0
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        value = -np.inf
        for f in range(Gamma.shape[1]):
            value = max(value, Lambda[region[i], f, 0] * x + Lambda[region[i], f, 1] * y - Gamma[region[i], f])
        if i == 0:
            first = value
        elif region[i] != region[i - 1]:
            # The chord lies in the old region when its end does, in the new one when its start does.
            old, new = -np.inf, -np.inf
            for f in range(Gamma.shape[1]):
                k = region[i - 1]
                old = max(old, Lambda[k, f, 0] * x + Lambda[k, f, 1] * y - Gamma[k, f])
                k = region[i]
                new = max(new, Lambda[k, f, 0] * points[i - 1, 0] + Lambda[k, f, 1] * points[i - 1, 1] - Gamma[k, f])
            value = max(value, min(old, new))
        worst = max(worst, value)
    return first, worst


outside: Callable[[Array, Array, Array, Indices], tuple[float, float]] = numba.njit(cache=True)(_outside)


def examine(states: Array, offset_m: Array, Lambda: Array, Gamma: Array, region: Indices, bounds: Bounds) -> Fault:
    """The verdict on a motion (m, 12) every `GRID_S` whose points lie in `region` (m,) when shifted by `offset_m` (m, 3)
    or (3,).
    """
    if not np.isfinite(states).all():
        return Fault.NOT_FINITE
    squares = states[:, 3:] ** 2
    plane, climb = squares[:, 0] + squares[:, 1], squares[:, 2]
    push, twist = squares[:, 3] + squares[:, 4] + squares[:, 5], squares[:, 6] + squares[:, 7] + squares[:, 8]
    largest = np.sqrt([plane.max(), climb.max(), push.max(), twist.max()])
    if (largest > _BEYOND * bounds.limits).any():
        return Fault.LIMITS
    first, worst = outside(states[:, :3] + offset_m, Lambda, Gamma, region)
    if worst > max(bounds.region_tolerance_m, first + 1e-3):
        return Fault.REGION
    return Fault.NONE


def describe(rung: Rung, fault: Fault) -> str:
    """A rung in words."""
    if rung is Rung.PLAN:
        return "plans are accepted again"
    return f"{fault}; " + ("slowing down along the last plan" if rung is Rung.SHIFTED else "braking")
