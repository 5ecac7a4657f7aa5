"""The `planner` and `replan` sections of a run: the plan before take-off, and new plans in flight.

Keys carry their units: `_m` metres, `_mps` and so on; altitudes above the start.
"""

import itertools
from typing import Annotated, Literal

from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass

from sandwich_sitl.world_config import STRICT, Positive


def _rising(floors_m: tuple[float, ...]) -> tuple[float, ...]:
    """Floors are named from the lowest up, each once."""
    if any(upper <= lower for lower, upper in itertools.pairwise(floors_m)):
        raise ValueError(f"{list(floors_m)} must rise from floor to floor; give {sorted(set(floors_m))}")
    return floors_m


AltitudeM = Annotated[float, Field(ge=1, le=500)]


@dataclass(frozen=True, config=STRICT)
class PlannerConfig:
    """Channel map, route and time law."""

    vehicle_radius_m: Positive
    margin_m: Annotated[float, Field(gt=0, description="added to the radius when obstacles are grown for planning")]
    cell_m: Annotated[float, Field(gt=0, description="edge length asked of a cell of the mapped grid")] = 1.0
    flow: Annotated[
        Literal["auto", "x", "y"], Field(description="axis the channels run along; auto: that of the shorter route")
    ] = "auto"
    keep_map: Annotated[
        bool, Field(description="keep the map in the user's cache for the next run of the same world")
    ] = True
    min_rows: Annotated[int, Field(ge=3, description="least number of nodes across a channel")] = 5
    route: Annotated[
        Literal["sandwich", "tight", "exact"],
        Field(
            description="route to fly: the paper's A* on the map, that pulled tight, or the proven shortest; "
            "paper mode always flies the first"
        ),
    ] = "tight"
    speed_mps: Annotated[float, Field(ge=0.1, le=30)] = 3.0
    acceleration_mps2: Annotated[float, Field(ge=0.1, le=20)] = 2.0
    jerk_mps3: Annotated[float, Field(ge=0.1, le=500)] = 10.0
    snap_mps4: Annotated[float, Field(ge=0.1, le=5000)] = 60.0
    climb_mps: Annotated[
        float, Field(ge=0.1, le=10, description="vertical speed; below the autopilot's (PX4: MPC_Z_VEL_MAX_UP)")
    ] = 1.5
    descent_mps: Annotated[
        float, Field(ge=0.1, le=10, description="the same downwards (PX4: MPC_Z_VEL_MAX_DN, 1.5 by default)")
    ] = 1.2
    floors_m: Annotated[
        tuple[AltitudeM, ...],
        AfterValidator(_rising),
        Field(
            description="altitudes to fly at, from the lowest up; altitude_m must be one of them. A floor sees only the "
            "obstacles that reach it. Empty: altitude_m alone, and every obstacle reaches it"
        ),
    ] = ()
    vertical_margin_m: Annotated[
        float, Field(ge=0.2, le=100, description="what a floor keeps above an obstacle, besides vehicle_radius_m")
    ] = 1.0
    climb_cost: Annotated[
        float, Field(ge=0, le=1000, description="metres of level flight that a metre of climb between floors is worth")
    ] = 2.0
    descent_cost: Annotated[float, Field(ge=0, le=1000, description="the same for a metre of descent")] = 1.0


@dataclass(frozen=True, config=STRICT)
class ReplanConfig:
    """What happens when an obstacle is reported in flight."""

    budget_s: Annotated[
        float, Field(ge=0.06, le=5, description="from a report to the first set-point of the new plan, run clock")
    ] = 0.15
    tries: Annotated[int, Field(ge=1, le=10, description="how often a late plan is asked for again")] = 4
    sensor_tolerance_m: Annotated[
        float, Field(gt=0, description="a range sensor's return this near a known obstacle is that obstacle's")
    ] = 0.5
    sensor_depth_m: Annotated[
        float, Field(gt=0, description="how far an obstacle is taken to reach behind the face that a sensor sees")
    ] = 1.0
