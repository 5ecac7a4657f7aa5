"""Altitude along a smooth curve over ground: from the start's floor up to the highest one that the curve needs, and down.

Each place needs the lowest floor on which it keeps its clearance. The least that never descends to climb again is

    P = min(max of what is needed up to here, max of what is needed from here on);

the profile is the lowest curve above P that is no steeper than a slope, P being wider by what follows: two moving
averages round its corners, and as heights of the control points of the curve's own quintic spline (which lies between
neighbouring ones, so it stays above P too) it becomes C^4. The slopes are those that cost no time, climb_mps or
descent_mps / speed_mps, and steeper where there is no room for them; what is left even then is climbed over the start,
and descended over the goal.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from sandwich_sitl.planning.outlines import Outlines
from sandwich_sitl.planning.time_law import Limits

Array = NDArray[np.float64]

_STEP_M = 0.05
_STEEPER = (0.9, 1.5, 2.2, 3.5, 6.0)  # slopes tried, in those that cost no time
_BEND_SHARE = 0.4  # of the acceleration: what rounding a corner of the profile takes at the speed flown there
AHEAD_M = 2.0  # a floor is reached this long before it is needed: longer than the stretch of a region
_REACH_KNOTS = 3  # a quintic spline's value depends on control points this many knots away
_SAME_M = 1e-6


@dataclass(frozen=True)
class Ends:
    """Altitudes over start and goal, and how fast to climb and to descend at most."""

    start_m: float
    goal_m: float
    climb_mps: float
    descent_mps: float


def needed_altitudes(points: Array, solids: Outlines, floors_m: Sequence[float], kept_m: float, over_m: float) -> Array:
    """Altitude (n,) of the lowest floor on which points (n, 2) keep `kept_m` from every solid that reaches it.

    A solid reaches a floor when its top is less than `over_m` below. Infinite where there is no such floor.
    """
    needed = np.full(len(points), np.inf)
    at = shapely.points(points)
    for altitude in sorted(floors_m, reverse=True):
        reaching = [solid for solid, top in zip(solids.solids, solids.tops_m, strict=True) if top > altitude - over_m]
        clear = np.ones(len(points), dtype=np.bool_)
        clear[shapely.STRtree(reaching).query(at, predicate="dwithin", distance=kept_m)[0]] = False
        needed[clear & (needed >= altitude)] = altitude
    return needed


def parameters(curve: BSpline) -> Array:
    """Even parameters (n,) over a curve, close enough to see every obstacle."""
    end = float(curve.t[-1])
    return np.linspace(0.0, end, max(2, int(np.ceil(end / _STEP_M)) + 1))


def lifted(curve: BSpline, needed_m: Array, ends: Ends, limits: Limits) -> BSpline:
    """The curve (x, y) with an altitude; `needed_m` (n,) belongs to `parameters`."""
    u = parameters(curve)
    knot = float(np.diff(curve.t).max())
    z = needed_m
    for steeper in _STEEPER:
        slopes = steeper * ends.climb_mps / limits.speed_mps, steeper * ends.descent_mps / limits.speed_mps
        speed = limits.speed_mps / max(1.0, steeper)
        bend_m = max(slopes) * speed**2 / (_BEND_SHARE * limits.acceleration_mps2)
        z = _profile(u, needed_m, ends, slopes, bend_m, AHEAD_M + _REACH_KNOTS * knot)
        if z[0] - ends.start_m < _SAME_M and z[-1] - ends.goal_m < _SAME_M:
            break
    places = np.array([curve.t[i + 1 : i + curve.k + 1].mean() for i in range(len(curve.c))])
    return BSpline(curve.t, np.column_stack([curve.c, np.interp(places, u, z)]), curve.k)


def _profile(u: Array, needed: Array, ends: Ends, slopes: tuple[float, float], bend_m: float, ahead_m: float) -> Array:
    """Heights (n,) at parameters (n,), at least those needed within `ahead_m`, averaged twice over `bend_m`."""
    step = float(u[1] - u[0])
    half = int(np.ceil(bend_m / 2 / step))
    wide = maximum_filter1d(needed, 2 * (int(np.ceil(ahead_m / step)) + 2 * half) + 1, mode="nearest")
    averaged = 2 * half + 1  # what is averaged at an end: both ends stay where they are
    wide[:averaged] = np.maximum(wide[:averaged], ends.start_m)
    wide[-averaged:] = np.maximum(wide[-averaged:], ends.goal_m)
    least = np.minimum(_highest_so_far(wide), _highest_so_far(wide[::-1])[::-1])
    up, down = slopes[0] * u, slopes[1] * u
    rising = _highest_so_far((least - up)[::-1])[::-1] + up
    falling = _highest_so_far(least + down) - down
    once = uniform_filter1d(np.maximum(rising, falling), 2 * half + 1, mode="nearest")
    return np.asarray(uniform_filter1d(once, 2 * half + 1, mode="nearest"))


def _highest_so_far(values: Array) -> Array:
    return np.asarray(np.maximum.accumulate(values))
