"""The last look at a setpoint before it is sent.

State: none. Input: the setpoint, the one sent before it and how long ago, the measured position; ENU metres, seconds. A
rejected setpoint is reported by its reason and not sent, so that the autopilot's own failsafe decides when there is
nothing better. After a pause the vehicle is somewhere else, so what counts between setpoints is a speed.
"""

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.mission.setpoint import Setpoint

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Fence:
    """Limits of what may be asked of the vehicle.

    `bounds_m` is x_min, y_min, x_max, y_max and `z_m` lowest and highest altitude; `step_mps` how far two setpoints that
    follow each other may lie apart for each second between them, `least_step_m` how far in any case: the push-off from the
    ground asks for 0.2 m at once, at every rate. `reach_m` is how far a setpoint may lie from the vehicle.
    """

    bounds_m: tuple[float, float, float, float]
    z_m: tuple[float, float]
    speed_mps: float = 20.0
    acceleration_mps2: float = 20.0
    step_mps: float = 30.0
    least_step_m: float = 0.3
    reach_m: float = 10.0


def fence_around(
    bounds_m: tuple[float, float, float, float],
    altitude_m: float,
    speed_mps: float,
    acceleration_mps2: float,
    slack_m: float = 5.0,
) -> Fence:
    """World bounds and flight altitude with `slack_m` on every side. `speed_mps` and `acceleration_mps2` are what plans
    may reach and pass in any case; steps may be half as fast again.
    """
    x_min, y_min, x_max, y_max = bounds_m
    widened = (x_min - slack_m, y_min - slack_m, x_max + slack_m, y_max + slack_m)
    speed_mps = max(Fence.speed_mps, speed_mps)
    acceleration_mps2 = max(Fence.acceleration_mps2, acceleration_mps2)
    return Fence(widened, (-slack_m, altitude_m + slack_m), speed_mps, acceleration_mps2, step_mps=1.5 * speed_mps)


def objection(
    setpoint: Setpoint, previous: Setpoint | None, since_s: float, measured_m: Vector | None, fence: Fence
) -> str | None:
    """Why this setpoint, `since_s` after the one sent before it, must not be sent, or None."""
    if not isfinite(setpoint.yaw_rad):
        return f"yaw {setpoint.yaw_rad} is not finite"
    for name, vector, limit in (
        ("velocity", setpoint.v_mps, fence.speed_mps),
        ("acceleration", setpoint.a_mps2, fence.acceleration_mps2),
    ):
        if vector is not None and not _length(vector) <= limit:
            return f"{name} {_show(vector)} is not below {limit:g}"
    if setpoint.r_m is None:
        return None
    before_m = None if previous is None else previous.r_m
    return _position_objection(
        setpoint.r_m, before_m, max(fence.step_mps * since_s, fence.least_step_m), measured_m, fence
    )


def _position_objection(
    r_m: Vector, before_m: Vector | None, step_m: float, measured_m: Vector | None, fence: Fence
) -> str | None:
    x, y, z = r_m.tolist()
    x_min, y_min, x_max, y_max = fence.bounds_m
    z_min, z_max = fence.z_m
    if not (x_min <= x <= x_max and y_min <= y <= y_max and z_min <= z <= z_max):
        return f"position {_show(r_m)} m is outside of the fence {fence.bounds_m}, z {fence.z_m}"
    if before_m is not None and _length(r_m - before_m) > step_m:
        return f"position {_show(r_m)} m lies more than {step_m:g} m from the last setpoint {_show(before_m)}"
    if measured_m is not None and _length(r_m - measured_m) > fence.reach_m:
        return f"position {_show(r_m)} m lies more than {fence.reach_m:g} m from the vehicle at {_show(measured_m)}"
    return None


def _length(vector: Vector) -> float:
    x, y, z = vector.tolist()
    return float((x * x + y * y + z * z) ** 0.5)


def _show(vector: Vector) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in vector.tolist()) + ")"
