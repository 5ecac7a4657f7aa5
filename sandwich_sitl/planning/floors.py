"""Parallel horizontal floors (paper, remark on three dimensions): which obstacles a floor sees, and what changing costs.

Obstacles stand on the ground, so a floor sees all that the floors above it see: what is free on one floor is free on
every higher one. The cost of a route is its length over ground, `climb_cost` for a metre of climb and `descent_cost`
for a metre of descent between floors. Take any route and let m be its highest floor. Flown on m from its first point to
its last it is as long over ground, stays free, and climbs and descends no more. So the best route that reaches floor m
is the shortest path of floor m, and the best of all is that of the floor with the least

    L_m + climb_cost (z_m - z_start) + descent_cost (z_m - z_goal),      z_m >= z_start, z_goal.

Where on its way it climbs and descends does not change that cost: it may be anywhere free on both floors
(`floor_profile`).
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.config import RunConfig
from sandwich_sitl.errors import InputError
from sandwich_sitl.planning.corridor import Headroom, between_samples_m
from sandwich_sitl.planning.outlines import Outlines
from sandwich_sitl.world.grow import GrownWorld, grow
from sandwich_sitl.world.world import World

Array = NDArray[np.float64]

_LEAST_BAND_M = 0.1


@dataclass(frozen=True)
class Floor:
    """One floor: its altitude, the obstacles that reach it, and these grown for planning."""

    altitude_m: float
    world: World
    grown: GrownWorld


def route_floors(config: RunConfig, world: World, detail_m: float) -> tuple[Floor, ...]:
    """The floors that a route may rise to, from the lowest up; one that sees every obstacle where none are configured."""
    planner = config.planner
    reach = planner.vehicle_radius_m + planner.margin_m
    if not planner.floors_m:
        return (Floor(config.altitude_m, world, grow(world, reach, detail_m)),)
    ends = max(config.altitude_m, config.landing_altitude_m)
    seen = [(z, seen_from(config, world, z)) for z in planner.floors_m if z >= ends]
    return tuple(Floor(z, part, grow(part, reach, detail_m)) for z, part in seen)


def seen_from(config: RunConfig, world: World, altitude_m: float) -> World:
    """The world with the obstacles alone that a floor at this altitude cannot fly over; unknown heights reach it."""
    keep = config.planner.vehicle_radius_m + config.planner.vertical_margin_m
    blocking = tuple(o for o in world.obstacles if o.height_m is None or o.height_m + keep > altitude_m)
    return dataclasses.replace(world, obstacles=blocking)


def climb_cost_m(config: RunConfig, altitude_m: float) -> float:
    """What rising to a floor after take-off and leaving it before landing is worth, in metres of level flight."""
    planner = config.planner
    up, down = altitude_m - config.altitude_m, altitude_m - config.landing_altitude_m
    return planner.climb_cost * up + planner.descent_cost * down


def check_ground(config: RunConfig, world: World) -> None:
    """Raise `InputError` when an obstacle, however low, is in the way of the climb over the start or of the landing."""
    reach = config.planner.vehicle_radius_m + config.planner.margin_m
    for key, (x, y) in (("start_m", config.start_m), ("goal_m", config.goal_m)):
        for obstacle in world.obstacles:
            gap = obstacle.polygon.distance(shapely.Point(x, y))
            if gap < reach:
                raise InputError(
                    f"{key}: ({x:g}, {y:g}) is {gap:.2f} m from obstacle '{obstacle.name}', which stands in or beside the way "
                    f"from or to the ground; keep at least {reach:g} m (planner.vehicle_radius_m + planner.margin_m)"
                )


def headroom_of(config: RunConfig) -> Headroom:
    """What regions keep above obstacles. Raises `InputError` when the margin leaves nothing for what they are kept for."""
    planner = config.planner
    fastest = max(planner.climb_mps, planner.descent_mps)
    least = float(between_samples_m(np.array(fastest), config.mpc.step_s)) + _LEAST_BAND_M
    if planner.vertical_margin_m < least:
        raise InputError(
            f"planner.vertical_margin_m: {planner.vertical_margin_m:g} is less than {fastest:g} m/s up or down need; use "
            f"at least {np.ceil(100 * least) / 100:.2f}, or reduce planner.climb_mps, planner.descent_mps or mpc.step_s"
        )
    return Headroom(planner.vertical_margin_m, config.mpc.height_band_m)


def solid_outlines(config: RunConfig, world: World) -> Outlines:
    """All obstacles grown by the vehicle's radius, sideways and upwards."""
    radius = config.planner.vehicle_radius_m
    tops = np.array([np.inf if o.height_m is None else o.height_m + radius for o in world.obstacles], dtype=float)
    return Outlines([o.polygon for o in world.obstacles], radius, tops)
