"""SET_POSITION_TARGET_LOCAL_NED: from the message's fields to a setpoint, or to the reason why it is refused.

NaN means "not given" throughout, as in PX4: ignore bits become NaN, nothing is checked for being finite.
"""

from dataclasses import dataclass
from math import cos, inf, isfinite, nan, sin
from typing import NamedTuple

from vehicle_sim.rotation import Quaternion, Vector, normalize, rotate, yaw_of

FRAME_LOCAL_NED = 1
FRAME_BODY_NED = 8
MASK_FORCE = 1 << 9
MASK_YAW = 1 << 10
MASK_YAW_RATE = 1 << 11
NO_VECTOR: Vector = (nan, nan, nan)
MASK_THROTTLE = 1 << 6
MASK_ATTITUDE = 1 << 7
_SANE = 1e7
_FASTEST_RADPS = 100.0


class TrajectorySetpoint(NamedTuple):
    """Position (m), velocity (m/s), acceleration (m/s^2), all NED, yaw (rad), yaw rate (rad/s); NaN is free."""

    position_ned_m: Vector = NO_VECTOR
    velocity_ned_mps: Vector = NO_VECTOR
    acceleration_ned_mps2: Vector = NO_VECTOR
    yaw_rad: float = nan
    yaw_rate_radps: float = nan


@dataclass(frozen=True)
class SetpointMessage:
    """The fields of the message."""

    frame: int
    type_mask: int
    position: Vector
    velocity: Vector
    acceleration: Vector
    yaw_rad: float
    yaw_rate_radps: float

    @property
    def ignores_all_axes(self) -> bool:
        """Every position, velocity and acceleration axis has its ignore bit."""
        return self.type_mask & 0x1FF == 0x1FF


class AttitudeSetpoint(NamedTuple):
    """Attitude, or body rates where it is None; thrust 0..1 of full; yaw rate on top of an attitude."""

    q_sp_wxyz: Quaternion | None
    rates_radps: Vector
    thrust: float


class Refusal(NamedTuple):
    """Why a setpoint is dropped; the text goes out as a critical STATUSTEXT."""

    text: str


def interpret_setpoint(message: SetpointMessage, q_wb_wxyz: Quaternion) -> TrajectorySetpoint | Refusal:
    """Rows 1 to 3 of PX4's behaviour: frames, ignore bits, force bit, body frame."""
    if message.frame not in (FRAME_LOCAL_NED, FRAME_BODY_NED):
        return Refusal(f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {message.frame} unsupported")
    mask = message.type_mask
    position = _masked(message.position, mask)
    velocity = _masked(message.velocity, mask >> 3)
    acceleration = _masked(message.acceleration, mask >> 6)
    if message.frame == FRAME_BODY_NED:
        position = NO_VECTOR
        velocity = _turn_by_yaw(velocity, yaw_of(q_wb_wxyz))
        acceleration = rotate(q_wb_wxyz, acceleration)
    if mask & MASK_FORCE and not _all_nan(acceleration):
        return Refusal("SET_POSITION_TARGET_LOCAL_NED force not supported")
    if _all_nan(position) and _all_nan(velocity) and _all_nan(acceleration):
        return Refusal("SET_POSITION_TARGET_LOCAL_NED invalid")
    return TrajectorySetpoint(
        position,
        velocity,
        acceleration,
        nan if mask & MASK_YAW else _number(message.yaw_rad),
        nan if mask & MASK_YAW_RATE else _number(message.yaw_rate_radps),
    )


def interpret_attitude(
    type_mask: int, q_wxyz: Quaternion, rates_radps: Vector, thrust: float
) -> AttitudeSetpoint | None:
    """SET_ATTITUDE_TARGET: an attitude unless it is ignored, else body rates if none of them is; None when nothing is left."""
    clean = [r if isfinite(r) and abs(r) < _FASTEST_RADPS else 0.0 for r in rates_radps]
    push = max(0.0, min(1.0, thrust)) if isfinite(thrust) and not type_mask & MASK_THROTTLE else 0.0
    norm = sum(value * value for value in q_wxyz)
    if not type_mask & MASK_ATTITUDE and isfinite(norm) and 0.25 < norm < 4.0:
        yaw_rate = 0.0 if type_mask & 4 else clean[2]
        return AttitudeSetpoint(normalize(q_wxyz), (0.0, 0.0, yaw_rate), push)
    if type_mask & MASK_ATTITUDE and not type_mask & 0b111:
        return AttitudeSetpoint(None, (clean[0], clean[1], clean[2]), push)
    return None


def is_flyable(setpoint: TrajectorySetpoint) -> bool:
    """PX4's check in the position controller: each axis has something, x and y in the same kind."""
    p, v, a = setpoint.position_ned_m, setpoint.velocity_ned_mps, setpoint.acceleration_ned_mps2
    for triple in (p, v, a):
        if isfinite(triple[0]) != isfinite(triple[1]):
            return False
    return all(isfinite(p[i]) or isfinite(v[i]) or isfinite(a[i]) for i in range(3))


def needs_position(setpoint: TrajectorySetpoint) -> bool:
    """Row 5: positions and velocities cannot be flown without an estimate of them, accelerations can."""
    given = (*setpoint.position_ned_m, *setpoint.velocity_ned_mps)
    return any(value == value for value in given)


def wants_to_climb(setpoint: TrajectorySetpoint, d_m: float) -> bool:
    """Row 22: a setpoint above the vehicle, or upward velocity or acceleration."""
    z, vz, az = setpoint.position_ned_m[2], setpoint.velocity_ned_mps[2], setpoint.acceleration_ned_mps2[2]
    if isfinite(z):
        return z < d_m - 0.1 or (z < d_m and isfinite(vz) and vz < -0.1)
    return (isfinite(vz) and vz < -0.3) or (not isfinite(vz) and isfinite(az) and az < -0.3)


def _masked(values: Vector, ignore: int) -> Vector:
    return (
        nan if ignore & 1 else _number(values[0]),
        nan if ignore & 2 else _number(values[1]),
        nan if ignore & 4 else _number(values[2]),
    )


def _number(value: float) -> float:
    """Infinite or absurd values (no vehicle is 10,000 km away) become NaN, so that no arithmetic downstream overflows."""
    return value if -_SANE < value < _SANE and abs(value) != inf else nan


def _all_nan(values: Vector) -> bool:
    return not any(isfinite(value) for value in values)


def _turn_by_yaw(values: Vector, yaw_rad: float) -> Vector:
    c, s = cos(yaw_rad), sin(yaw_rad)
    x, y, z = values
    return (c * x - s * y, s * x + c * y, z)
