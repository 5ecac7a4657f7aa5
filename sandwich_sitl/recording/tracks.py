"""The tracks of a finished run: one row a message, in the order of log time.

Times `t_s` are the vehicle's boot time in seconds, positions ENU metres, attitudes body to world as w, x, y, z.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class ControlTrack:
    """`/control/telemetry`: the fields of `ControlRecord`, vectors (K, 3), scalars (K,)."""

    t_s: Array
    phase: tuple[str, ...]
    reference_m: Array
    estimate_r_m: Array
    estimate_v_mps: Array
    model_a_mps2: Array
    model_j_mps3: Array
    setpoint_r_m: Array
    setpoint_v_mps: Array
    setpoint_a_mps2: Array
    snap_mps4: Array
    slack_m: Array
    clearance_m: Array
    solver_status: Integers
    solver_iterations: Integers
    region: Integers
    offset_m: Array
    delay_s: Array
    reference_rate: Array
    rung: Integers
    fault: tuple[str, ...]


@dataclass(frozen=True)
class PoseTrack:
    """Poses over time: `r_m` (K, 3), `q_wxyz` (K, 4)."""

    t_s: Array
    r_m: Array
    q_wxyz: Array


@dataclass(frozen=True)
class MissionTrack:
    """`/mission/state`: each row holds from its time until the next row's."""

    t_s: Array
    state: tuple[str, ...]
    autopilot_mode: tuple[str, ...]
    armed: NDArray[np.bool_]
    landed: NDArray[np.bool_]
    reason: tuple[str, ...]


@dataclass(frozen=True)
class LogLine:
    """One line of `/log` or `/vehicle/log`; `level` is debug, info, warning, error, fatal or unknown."""

    t_s: float
    level: str
    name: str
    message: str


@dataclass(frozen=True)
class Frame:
    """One MAVLink frame and the topic it was logged on."""

    t_ns: int
    topic: str
    data: bytes


@dataclass(frozen=True)
class WallTimings:
    """Wall-clock seconds of each tick (K,), as in `TickTiming`."""

    tick: Integers
    t_s: Array  # log time of the message written before
    solve_s: Array
    loop_s: Array
    late_s: Array
    sent_s: Array
