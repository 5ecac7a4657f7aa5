"""What one control tick and one change of the mission leave in the log.

Positions are ENU metres in the world's frame, z up; times `t_s` are the vehicle's boot time in seconds. Wall-clock
times live only in `TickTiming`, which goes into metadata, so that equal seeds give equal payloads.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
class TickTiming:
    """Wall-clock seconds of one tick. `late_s`: how long after its deadline the work ended, 0 when in time."""

    solve_s: float
    loop_s: float
    late_s: float
