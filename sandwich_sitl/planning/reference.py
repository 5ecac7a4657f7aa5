"""A route becomes a timed reference inside a corridor. The paper's planning ends with nodes, which have no times.

tight route -> smooth curve -> time law -> one position a control period -> regions
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.config import PlannerConfig, RunConfig
from sandwich_sitl.errors import MapError
from sandwich_sitl.planning.corridor import (
    between_samples_m,
    nearest_places,
    neighbouring_quadrangle,
    paper_corridor,
    proven_corridor,
    safe_clearance_m,
    safe_speed_mps,
)
from sandwich_sitl.planning.flight_plan import Corridor, FlightFigures, Reference
from sandwich_sitl.planning.outlines import Outlines
from sandwich_sitl.planning.smoothing import Departure, smooth_route
from sandwich_sitl.planning.time_law import Limits, climb, fly, least_duration_s

Array = NDArray[np.float64]

KEPT_MARGIN = 0.8  # of the margin: what smoothing leaves between the curve and the radius-grown obstacles
_CLIMB = Limits(1.5, 0.35, 0.25, 0.2)  # leaving the ground asks for more patience than flying
_NEARER = 0.9  # of the route's own least clearance: the curve needs some of it
_CAP_M = 0.05  # spacing of the speeds that clearances allow


@dataclass(frozen=True)
class Ground:
    """What a reference is made for: the map, and the outlines of the obstacles grown by the vehicle's radius."""

    channel_map: ChannelMap
    outlines: Outlines


def limits_of(planner: PlannerConfig) -> Limits:
    """The configured limits of the reference."""
    return Limits(planner.speed_mps, planner.acceleration_mps2, planner.jerk_mps3, planner.snap_mps4)


def ground_of(config: RunConfig, channel_map: ChannelMap, obstacles: list[shapely.Polygon]) -> Ground:
    """`obstacles` are as they were given, not grown."""
    return Ground(channel_map, Outlines(obstacles, config.planner.vehicle_radius_m))


def timed_reference(config: RunConfig, ground: Ground, route_m: Array) -> tuple[Reference, Corridor, FlightFigures]:
    """Climb over the start, then along the tight route (n, 2) under the configured limits, inside a proven corridor.

    Raises `MapError` when the route is too near an obstacle.
    """
    limits, dt = limits_of(config.planner), 1.0 / config.mpc.rate_hz
    curve = route_curve(config, ground, route_m)
    cap = speed_cap(curve, ground.outlines, limits, config.mpc.step_s)
    timed = fly(curve, limits, cap)
    assert timed is not None, "from rest there is always a law"
    up = climb(config.altitude_m, climb_limits(config.planner), dt)
    xy = timed.sampled(dt)
    xyz = np.concatenate([
        np.column_stack([np.tile(xy[0], (len(up) - 1, 1)), up[:-1]]),
        np.column_stack([xy, np.full(len(xy), config.altitude_m)]),
    ])  # fmt: skip
    t = np.arange(len(xyz), dtype=np.float64) * dt
    reference, corridor = proven_corridor(t, xyz, ground.channel_map, ground.outlines, config.mpc.step_s)
    figures = FlightFigures(
        _length(route_m), _length(xy), timed.duration_s, least_duration_s(curve, limits, cap)
    )  # fmt: skip
    return reference, corridor, figures


def route_curve(config: RunConfig, ground: Ground, route_m: Array, departure: Departure | None = None) -> BSpline:
    """The smooth curve along a route; bends and berth grow with the way and the room the vehicle's speed needs."""
    planner = config.planner
    bending = planner.speed_mps**2 / planner.acceleration_mps2 / 1.5
    route = without_repeats(route_m)
    # In flight a route begins where the vehicle is, which may be nearer to an obstacle than a route from rest may be.
    kept = min(KEPT_MARGIN * planner.margin_m, _NEARER * ground.outlines.distance_m(route))
    wished = safe_clearance_m(np.array(planner.speed_mps), config.mpc.step_s)
    return smooth_route(route, ground.outlines, ground.channel_map.bounds_m, kept, bending, departure, float(wished))


def even_parameters(curve: BSpline) -> Array:
    """Even parameters over a curve, close enough for speeds that clearances allow."""
    end = float(curve.t[-1])
    return np.linspace(0.0, end, max(2, int(np.ceil(end / _CAP_M)) + 1))


def speed_cap(
    curve: BSpline, outlines: Outlines, limits: Limits, interval_s: float, above_m: Array | None = None
) -> Array:
    """Speeds at `even_parameters` at which the corridor's bound fits into the clearance from tops above `above_m`."""
    points = np.asarray(curve(even_parameters(curve)))[:, :2]
    matters = 2 * float(between_samples_m(np.array(limits.speed_mps), interval_s))
    clearance = np.pad(outlines.clearance(points, matters, above_m), 1, mode="edge")
    # Of three neighbours the least, for what lies between two of them.
    cap = safe_speed_mps(np.minimum(np.minimum(clearance[:-2], clearance[2:]), clearance[1:-1]), interval_s)
    if cap.min() <= 0.0:
        x, y = points[int(np.argmin(cap))]
        raise MapError(f"route: no speed is safe at ({x:.2f}, {y:.2f}); raise planner.margin_m or reduce mpc.step_s")
    return cap


def climb_limits(planner: PlannerConfig) -> Limits:
    """The limits on the way up: gentle ones, or the configured where those are lower."""
    limits = dataclasses.replace(limits_of(planner), speed_mps=min(planner.speed_mps, planner.climb_mps))
    lower = (min(a, b) for a, b in zip(dataclasses.astuple(_CLIMB), dataclasses.astuple(limits), strict=True))
    return Limits(*lower)


def without_repeats(route_m: Array) -> Array:
    """The route (n, 2) without points that repeat the one before; both ends stay."""
    far = np.hypot(*np.diff(route_m, axis=0).T) > 1e-9
    if not far.any():
        raise MapError("route: start and goal are the same point; move goal_m")
    return np.asarray(route_m[np.concatenate([[True], far])])


def _length(path: Array) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def paper_reference(config: RunConfig, channel_map: ChannelMap, route_m: Array) -> tuple[Reference, Corridor]:
    """One route node a step of `mpc.step_s`, so that the nodes' spacing sets the speed, and the paper's raw quadrangles."""
    step, dt = config.mpc.step_s, 1.0 / config.mpc.rate_hz
    up = climb(config.altitude_m, climb_limits(config.planner), dt)
    nodes_t = np.arange(len(route_m)) * step
    along = np.arange(0.0, nodes_t[-1] + dt, dt)
    xy = np.column_stack([np.interp(along, nodes_t, route_m[:, axis]) for axis in range(2)])
    quadrangles = np.array(
        [neighbouring_quadrangle(channel_map, place) for place in nearest_places(channel_map, route_m)]
    )
    node = np.clip(np.rint(along / step).astype(np.int64), 0, len(route_m) - 1)
    xyz = np.concatenate(
        [
            np.column_stack([np.tile(route_m[0], (len(up), 1)), up]),
            np.column_stack([xy, np.full(len(xy), config.altitude_m)]),
        ]
    )
    region = np.concatenate([np.zeros(len(up), dtype=np.int64), node])
    return Reference(np.arange(len(xyz), dtype=np.float64) * dt, xyz, region), paper_corridor(quadrangles)
