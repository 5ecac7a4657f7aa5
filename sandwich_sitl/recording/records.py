"""What one control tick and one change of the mission leave in the log.

Positions are ENU metres in the world's frame, z up; times `t_s` are the vehicle's boot time in seconds. Wall-clock
times live only in `TickTiming`, which goes into metadata, so that equal seeds give equal payloads.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.mission.reports import ObstacleReport
from sandwich_sitl.mission.rerouting import Adopted
from sandwich_sitl.planning.flight_plan import Corridor, Reference
from sandwich_sitl.planning.replan import change_over

Vector = Sequence[float] | NDArray[np.float64]  # three components: east, north, up


@dataclass(frozen=True)
class ControlRecord:
    """One tick of the controller: what it was asked, what it believed, what it decided."""

    t_s: float
    phase: str  # name of the mission's state
    reference_m: Vector
    estimate_r_m: Vector
    estimate_v_mps: Vector
    model_a_mps2: Vector
    model_j_mps3: Vector
    setpoint_r_m: Vector
    setpoint_v_mps: Vector
    setpoint_a_mps2: Vector
    snap_mps4: Vector
    slack_m: float
    solver_status: int  # the solver's own code; 0: no solve in this tick
    solver_iterations: int
    region: int  # index into `Corridor`; -1: none
    clearance_m: float  # of the estimate; nan without obstacles
    offset_m: Vector  # of the vehicle from its set-points, which the controller aims off
    delay_s: float  # from a set-point to the motion it asks for
    reference_rate: float  # of the reference's clock; below 1 it waits for the vehicle
    rung: int  # of the assurance ladder: 0 the tick's own plan, 1 the last one, 2 brake
    fault: str  # why the tick's own plan was not flown, empty when it was


@dataclass(frozen=True)
class MissionRecord:
    """The mission's state, written when it changes."""

    state: str
    autopilot_mode: str
    armed: bool
    landed: bool
    reason: str = ""


@dataclass(frozen=True)
class ReportedObstacle:
    """An obstacle that was heard of in flight: ring (V, 2) without closing point, height None when unknown."""

    t_s: float
    name: str
    source: str  # message or sensor
    heard_s: float
    height_m: float | None
    ring_m: NDArray[np.float64]

    @classmethod
    def of(cls, t_s: float, report: ObstacleReport) -> Self:
        """What the log keeps of a report that was taken in at `t_s`."""
        obstacle = report.obstacle
        ring = shapely.get_coordinates(obstacle.polygon.exterior)[:-1]
        return cls(t_s, obstacle.name, str(report.source), report.heard_s, obstacle.height_m, ring)


@dataclass(frozen=True)
class PlanUpdate:
    """A plan that took the place of the one before at `t_s`, for an obstacle that was heard of at `heard_s`.

    `reference` are its samples from where it leaves the old one, at its time `reference.t_s[0]`; `corridor` the regions
    that it adds, the first of which has the number `first_region`.
    """

    t_s: float
    heard_s: float
    verdict: str  # route, stop, or onward: the rest of the way of a route
    reason: str
    route_m: NDArray[np.float64]
    reference: Reference
    first_region: int
    corridor: Corridor

    @classmethod
    def of(cls, adopted: Adopted) -> Self:
        """What the log keeps of a plan that was adopted."""
        replan = adopted.replan
        k = change_over(replan.reference, adopted.from_s)
        whole, corridor = replan.reference, replan.corridor
        reference = Reference(whole.t_s[k:], whole.xyz_m[k:], whole.region[k:])
        first = int(reference.region.min())
        added = Corridor(
            corridor.Lambda[first:], corridor.Gamma[first:], corridor.polygons_m[first:], corridor.neighbours_m[first:]
        )
        verdict = "onward" if adopted.onward else str(replan.verdict)
        return cls(adopted.t_s, adopted.heard_s, verdict, replan.why, replan.route_m, reference, first, added)


@dataclass(frozen=True)
class TickTiming:
    """Wall-clock seconds of one tick. `late_s`: how long after the end of its period the set-point went out, 0 when in time
    and in lockstep; `sent_s`: when that was by `time.monotonic()`.
    """

    solve_s: float
    loop_s: float
    late_s: float
    sent_s: float
