"""What becomes of tight routes: duration over the time-optimal law's, and the room that the corridor gives."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.bench.plan_worlds import BenchWorld
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.config import PlannerConfig, RunConfig
from sandwich_sitl.errors import MapError
from sandwich_sitl.planning.decomposition import areas_m2
from sandwich_sitl.planning.proof import prove_corridor
from sandwich_sitl.planning.reference import ground_of, timed_reference
from sandwich_sitl.world_config import WorldConfig

Array = NDArray[np.float64]

SPEEDS = ((3.0, 2.0), (6.0, 4.0), (10.0, 6.0))  # m/s and m/s2
_JERK_PER_S, _SNAP_PER_S2 = 5.0, 30.0  # of the acceleration: as in the default limits
_ALTITUDE_M = 10.0


@dataclass
class FlightScores:
    """Flights under the limits of one speed: the way along the route, the climb left out of durations.

    `duration_ratio` is over `least_duration_s` along the same curve, `curve_ratio` the curve's length over the
    route's; areas are means per control step.
    """

    speed_mps: float
    acceleration_mps2: float
    duration_ratio: list[float] = field(default_factory=list)
    curve_ratio: list[float] = field(default_factory=list)
    corridor_m2: list[float] = field(default_factory=list)
    quadrangle_m2: list[float] = field(default_factory=list)
    decomposition_m2: list[float] = field(default_factory=list)
    proven: int = 0
    refused: list[str] = field(default_factory=list)


def fly_routes(world: BenchWorld, channel_map: ChannelMap, routes: Sequence[Array]) -> tuple[FlightScores, ...]:
    """Time each route (n, 2) under the limits of each speed, and put it into its corridor."""
    scores = tuple(FlightScores(*speed) for speed in SPEEDS)
    rings = [shapely.get_coordinates(shapely.orient_polygons(body).exterior)[:-1] for body in world.bodies]
    for score in scores:
        config = _config(world, score.speed_mps, score.acceleration_mps2)
        ground = ground_of(config, channel_map, world.bodies)
        for route in routes:
            try:
                reference, corridor, figures = timed_reference(config, ground, route)
            except MapError as error:
                score.refused.append(str(error))
                continue
            own, paper, free = areas_m2(reference, corridor, ground.outlines)
            score.duration_ratio.append(figures.duration_s / figures.least_duration_s)
            score.curve_ratio.append(figures.curve_m / figures.route_m)
            score.corridor_m2.append(own)
            score.quadrangle_m2.append(paper)
            score.decomposition_m2.append(free)
            score.proven += prove_corridor(reference, corridor, rings, world.radius_m, config.mpc.step_s).proven
    return scores


def _config(world: BenchWorld, speed_mps: float, acceleration_mps2: float) -> RunConfig:
    x, y = world.grown.bounds_m[:2]
    planner = PlannerConfig(
        vehicle_radius_m=world.radius_m, margin_m=world.margin_m, speed_mps=speed_mps,
        acceleration_mps2=acceleration_mps2, jerk_mps3=_JERK_PER_S * acceleration_mps2,
        snap_mps4=_SNAP_PER_S2 * acceleration_mps2,
    )  # fmt: skip
    return RunConfig(
        world=WorldConfig(bounds_m=world.grown.bounds_m), start_m=(x, y), goal_m=(x, y), altitude_m=_ALTITUDE_M,
        planner=planner,
    )  # fmt: skip
