"""Position P and velocity PID with feed-forward, in PX4's structure: acceleration setpoint, thrust vector, attitude.

    v_sp = v_ff + P (p_sp - p)          a_sp = a_ff + K_p (v_sp - v) + I - K_d v_dot
    f    = (a_sp - g e_d) h / g         (normalised thrust vector in NED; h is the hover thrust)

NED, SI. State: the integral. Vertical thrust has priority; anti-windup as in PX4.
"""

from dataclasses import dataclass
from math import hypot, isfinite, radians, tan
from typing import NamedTuple

from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.autopilot.setpoints import TrajectorySetpoint
from vehicle_sim.rotation import Vector
from vehicle_sim.sensors import Estimate

_GRAVITY = 9.80665


class VelocityLimits(NamedTuple):
    """Largest horizontal, upward and downward speed asked for (m/s). `up_mps` may be negative during the take-off ramp."""

    horizontal_mps: float
    up_mps: float
    down_mps: float


class PositionOutput(NamedTuple):
    """Normalised thrust vector (NED), and the setpoints it came from."""

    thrust_ned: Vector
    velocity_sp_mps: Vector
    acceleration_sp_mps2: Vector


@dataclass(frozen=True)
class PositionGains:
    """Gains and limits read from the parameters."""

    xy_p: float
    z_p: float
    xy_vel_p: float
    xy_vel_i: float
    xy_vel_d: float
    z_vel_p: float
    z_vel_i: float
    z_vel_d: float
    hover: float
    thrust_min: float
    thrust_max: float
    thrust_xy_margin: float
    tilt_tangent: float

    @classmethod
    def of(cls, parameters: ParameterStore) -> "PositionGains":
        """Read the table."""
        return cls(
            parameters["MPC_XY_P"],
            parameters["MPC_Z_P"],
            parameters["MPC_XY_VEL_P_ACC"],
            parameters["MPC_XY_VEL_I_ACC"],
            parameters["MPC_XY_VEL_D_ACC"],
            parameters["MPC_Z_VEL_P_ACC"],
            parameters["MPC_Z_VEL_I_ACC"],
            parameters["MPC_Z_VEL_D_ACC"],
            parameters["MPC_THR_HOVER"],
            parameters["MPC_THR_MIN"],
            parameters["MPC_THR_MAX"],
            parameters["MPC_THR_XY_MARG"],
            tan(radians(parameters["MPC_TILTMAX_AIR"])),
        )


class PositionController:
    """The cascade; call `update` at a fixed period."""

    def __init__(self, gains: PositionGains) -> None:
        self.gains = gains
        self._integral = [0.0, 0.0, 0.0]

    def reset(self) -> None:
        """Forget the integral."""
        self._integral = [0.0, 0.0, 0.0]

    def update(
        self,
        setpoint: TrajectorySetpoint,
        estimate: Estimate,
        acceleration_ned_mps2: Vector,
        limits: VelocityLimits,
        dt_s: float,
    ) -> PositionOutput:
        """One period. `acceleration_ned_mps2` is the estimated derivative of the velocity."""
        g = self.gains
        velocity_sp = self._velocity_setpoint(setpoint, estimate.position_ned_m, limits)
        a_ff = setpoint.acceleration_ned_mps2
        velocity = estimate.velocity_ned_mps
        kp = (g.xy_vel_p, g.xy_vel_p, g.z_vel_p)
        kd = (g.xy_vel_d, g.xy_vel_d, g.z_vel_d)
        error = [0.0, 0.0, 0.0]
        acceleration = [0.0, 0.0, 0.0]
        for i in range(3):
            feed = a_ff[i] if a_ff[i] == a_ff[i] else 0.0
            if velocity_sp[i] == velocity_sp[i]:
                error[i] = velocity_sp[i] - velocity[i]
                feed += kp[i] * error[i] + self._integral[i] - kd[i] * acceleration_ned_mps2[i]
            acceleration[i] = feed
        thrust = self._thrust(acceleration)
        self._integrate(error, acceleration, thrust, dt_s)
        return PositionOutput(thrust, velocity_sp, (acceleration[0], acceleration[1], acceleration[2]))

    def _velocity_setpoint(self, setpoint: TrajectorySetpoint, position: Vector, limits: VelocityLimits) -> Vector:
        """v_ff + P (p_sp - p), limited so that the part that corrects position has priority. NaN where nothing is asked."""
        g = self.gains
        p_sp, v_ff = setpoint.position_ned_m, setpoint.velocity_ned_mps
        px, py, pz = g.xy_p * (p_sp[0] - position[0]), g.xy_p * (p_sp[1] - position[1]), g.z_p * (p_sp[2] - position[2])
        vx, vy = _limit_with_priority((px, py), (v_ff[0], v_ff[1]), limits.horizontal_mps)
        vz = _sum_given(pz, v_ff[2])
        if vz == vz:
            vz = max(-limits.up_mps, min(limits.down_mps, vz))
        return (vx, vy, vz)

    def _thrust(self, acceleration: list[float]) -> Vector:
        g = self.gains
        scale = g.hover / _GRAVITY
        up = max(g.thrust_min, min(g.thrust_max, (_GRAVITY - acceleration[2]) * scale))
        if hypot(acceleration[0], acceleration[1]) * scale > g.thrust_xy_margin:
            up = min(up, (g.thrust_max**2 - g.thrust_xy_margin**2) ** 0.5)
        room = min((g.thrust_max**2 - up * up) ** 0.5, g.tilt_tangent * up)
        x, y = acceleration[0] * scale, acceleration[1] * scale
        size = hypot(x, y)
        if size > room:
            x, y = x * room / size, y * room / size
        return (x, y, -up)

    def _integrate(self, error: list[float], wanted: list[float], thrust: Vector, dt_s: float) -> None:
        """Integral of the velocity error, with the horizontal error lowered by what saturation took (PX4's tracking scheme)."""
        g = self.gains
        scale = g.hover / _GRAVITY
        back = 2.0 / g.xy_vel_p
        for i in (0, 1):
            self._integral[i] += g.xy_vel_i * (error[i] - back * (wanted[i] - thrust[i] / scale)) * dt_s
        low = -thrust[2] <= g.thrust_min and error[2] > 0.0
        high = -thrust[2] >= g.thrust_max and error[2] < 0.0
        if not (low or high):
            self._integral[2] += g.z_vel_i * error[2] * dt_s
        self._integral[2] = max(-_GRAVITY, min(_GRAVITY, self._integral[2]))


def _sum_given(a: float, b: float) -> float:
    """a + b where NaN counts as absent; NaN when both are."""
    if a != a:
        return b
    return a if b != b else a + b


def _limit_with_priority(first: tuple[float, float], second: tuple[float, float], limit: float) -> tuple[float, float]:
    """first + s second with the largest s in 0..1 that keeps the length within the limit; NaN counts as absent."""
    if not (isfinite(first[0]) and isfinite(first[1])):
        first = (0.0, 0.0)
        if not (isfinite(second[0]) and isfinite(second[1])):
            return second
    if not (isfinite(second[0]) and isfinite(second[1])):
        second = (0.0, 0.0)
    ax, ay = first
    bx, by = second
    if hypot(ax + bx, ay + by) <= limit:
        return (ax + bx, ay + by)
    size = hypot(ax, ay)
    if size >= limit:
        return (ax * limit / size, ay * limit / size)
    b2, ab = bx * bx + by * by, ax * bx + ay * by
    share = (-ab + (ab * ab + b2 * (limit * limit - size * size)) ** 0.5) / b2
    return (ax + share * bx, ay + share * by)
