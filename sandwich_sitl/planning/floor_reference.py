"""A route on one floor becomes a 3-D reference that leaves the start's floor and comes down to the goal's on the way.

route -> smooth curve over ground, clear of what reaches its floor -> altitude along it (`floor_profile`) -> time law of
the curve in space -> regions with altitudes

Limits on speed, acceleration, jerk and snap are those of the motion in space; climbing and sinking are also held to
`planner.climb_mps` and `descent_mps`.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.ndimage import minimum_filter1d

from sandwich_sitl.config import RunConfig
from sandwich_sitl.planning.corridor import Headroom, proven_corridor
from sandwich_sitl.planning.flight_plan import Corridor, FlightFigures, Reference
from sandwich_sitl.planning.floor_profile import AHEAD_M, Ends, lifted, needed_altitudes, parameters
from sandwich_sitl.planning.floors import Floor, headroom_of, solid_outlines
from sandwich_sitl.planning.outlines import Outlines
from sandwich_sitl.planning.reference import (
    KEPT_MARGIN,
    Ground,
    climb_limits,
    even_parameters,
    limits_of,
    route_curve,
    speed_cap,
)
from sandwich_sitl.planning.time_law import Limits, climb, fly, least_duration_s
from sandwich_sitl.world.world import World

Array = NDArray[np.float64]

_ANY_SPEED_MPS = 1e3
_HAIR_M = 1e-9
_LEVEL_M = 1e-3  # this near to a floor the vehicle is on it


@dataclass(frozen=True)
class Way:
    """The way from take-off's end to the beginning of the landing: length in space, climb, descent (m), floors changed."""

    length_m: float
    climbed_m: float
    descended_m: float
    changes: int


def floor_reference(
    config: RunConfig, ground: Ground, floor: Floor, world: World, route_m: Array
) -> tuple[Reference, Corridor, FlightFigures]:
    """Climb over the start, along the route (n, 2) of a floor, and down to the goal's floor, inside a proven corridor.

    `ground.outlines` are the obstacles that reach the floor, `world` holds all. Raises `MapError` when the route is too
    near an obstacle, `InputError` when the vertical margin is too small.
    """
    limits, headroom, solids = limits_of(config.planner), headroom_of(config), solid_outlines(config, world)
    curve = _climbing_curve(config, route_curve(config, ground, route_m), floor, solids)
    cap = _cap(curve, solids, limits, headroom, config)
    timed = fly(curve, limits, cap)
    assert timed is not None, "from rest there is always a law"
    dt = 1.0 / config.mpc.rate_hz
    along = timed.sampled(dt)
    up, down = _over_the_ends(config, float(along[0, 2]), float(along[-1, 2]), dt)
    xyz = np.concatenate([_over(along[0], up[:-1]), along, _over(along[-1], down[1:])])
    t = np.arange(len(xyz), dtype=np.float64) * dt
    reference, corridor = proven_corridor(t, xyz, ground.channel_map, solids, config.mpc.step_s, headroom)
    figures = FlightFigures(
        _length(route_m), _length(along[:, :2]), timed.duration_s, least_duration_s(curve, limits, cap)
    )  # fmt: skip
    return reference, corridor, figures


def way_of(reference: Reference, ends_m: tuple[float, float], floors_m: tuple[float, ...]) -> Way:
    """The way of a reference between the start's and the goal's floor, `ends_m`."""
    xyz = reference.xyz_m
    began = int(np.argmax(xyz[:, 2] >= ends_m[0] - _HAIR_M))
    xyz = np.concatenate([[[*xyz[0, :2], ends_m[0]]], xyz[began:]])
    rise = np.diff(xyz[:, 2])
    on = np.abs(xyz[:, 2, None] - np.array(floors_m)) < _LEVEL_M
    visited = np.argmax(on, axis=1)[on.any(axis=1)]
    changes = int(np.abs(np.diff(visited)).sum())
    return Way(_length(xyz), float(rise[rise > 0].sum()), float(-rise[rise < 0].sum()), changes)


def _climbing_curve(config: RunConfig, flat: BSpline, floor: Floor, solids: Outlines) -> BSpline:
    """A curve over ground with its altitude between the floors of start and goal and the route's."""
    planner = config.planner
    kept = KEPT_MARGIN * planner.margin_m
    needed = needed_altitudes(flat(parameters(flat)), solids, planner.floors_m, kept, planner.vertical_margin_m)
    ends = Ends(config.altitude_m, config.landing_altitude_m, planner.climb_mps, planner.descent_mps)
    return lifted(flat, np.minimum(needed, floor.altitude_m), ends, limits_of(planner))


def _cap(curve: BSpline, solids: Outlines, limits: Limits, headroom: Headroom, config: RunConfig) -> Array:
    """Speeds in space that clearances and the limit on climbing allow."""
    u = even_parameters(curve)
    z = np.asarray(curve(u))[:, 2]
    window = 2 * int(np.ceil(AHEAD_M / (u[1] - u[0]))) + 1
    above = minimum_filter1d(z, window, mode="nearest") - headroom.margin_m
    slope = np.asarray(curve.derivative(1)(u))
    rate = np.linalg.norm(slope, axis=1)
    vertical = np.where(slope[:, 2] > 0, config.planner.climb_mps, config.planner.descent_mps)
    climbing = vertical * rate / np.maximum(np.abs(slope[:, 2]), rate / _ANY_SPEED_MPS)
    return np.asarray(np.minimum(speed_cap(curve, solids, limits, config.mpc.step_s, above), climbing))


def _over_the_ends(config: RunConfig, first_m: float, last_m: float, dt_s: float) -> tuple[Array, Array]:
    """Altitudes (n,) of the climb over the start and of the descent over the goal, if there is one, from rest to rest."""
    gently = climb_limits(config.planner)
    up, drop = climb(first_m, gently, dt_s), last_m - config.landing_altitude_m
    if drop < _LEVEL_M:
        return up, np.array([last_m])
    slowly = replace(gently, speed_mps=min(gently.speed_mps, config.planner.descent_mps))
    return up, last_m - climb(drop, slowly, dt_s)


def _over(place: Array, z_m: Array) -> Array:
    return np.column_stack([np.tile(place[:2], (len(z_m), 1)), z_m])


def _length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
