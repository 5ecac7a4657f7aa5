"""Position P and velocity PID with feed-forward, in PX4's structure: acceleration setpoint, thrust vector, attitude.

    v_sp = v_ff + P (p_sp - p)          a_sp = a_ff + K_p (v_sp - v) + I - K_d v_dot
    f    = (a_sp - g e_d) h / g         (normalised thrust vector in NED; h is the hover thrust)

NED, SI. State: the integral. Vertical thrust has priority; anti-windup as in PX4.
"""

from math import hypot, isfinite, radians, sqrt, tan
from typing import NamedTuple

from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.autopilot.setpoints import TrajectorySetpoint
from vehicle_sim.compiled import inlined
from vehicle_sim.rotation import Vector

_GRAVITY = 9.80665


class VelocityLimits(NamedTuple):
    """Largest horizontal, upward and downward speed asked for (m/s). `up_mps` may be negative during the take-off ramp."""

    horizontal_mps: float
    up_mps: float
    down_mps: float


class PositionOutput(NamedTuple):
    """Normalised thrust vector (NED), the setpoints it came from, and the integral of the velocity error."""

    thrust_ned: Vector
    velocity_sp_mps: Vector
    acceleration_sp_mps2: Vector
    integral_mps2: Vector


class Motion(NamedTuple):
    """What the controller looks at: estimated position, velocity and the velocity's derivative, NED."""

    position_m: Vector
    velocity_mps: Vector
    acceleration_mps2: Vector


class PositionGains(NamedTuple):
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


@inlined
def control_position(
    setpoint: TrajectorySetpoint,
    motion: Motion,
    integral: Vector,
    limits: VelocityLimits,
    gains: PositionGains,
    dt_s: float,
) -> PositionOutput:
    """One period of the cascade; a fixed period is taken for granted."""
    g = gains
    velocity_sp = _velocity_setpoint(setpoint, motion.position_m, limits, gains)
    ff, v, a = setpoint.acceleration_ned_mps2, motion.velocity_mps, motion.acceleration_mps2
    ex, ey, ez = _error(velocity_sp[0], v[0]), _error(velocity_sp[1], v[1]), _error(velocity_sp[2], v[2])
    wanted = (
        _acceleration(ff[0], velocity_sp[0], g.xy_vel_p * ex + integral[0] - g.xy_vel_d * a[0]),
        _acceleration(ff[1], velocity_sp[1], g.xy_vel_p * ey + integral[1] - g.xy_vel_d * a[1]),
        _acceleration(ff[2], velocity_sp[2], g.z_vel_p * ez + integral[2] - g.z_vel_d * a[2]),
    )
    thrust = _thrust(wanted, gains)
    grown = _integrate(integral, (ex, ey, ez), wanted, thrust, gains, dt_s)
    return PositionOutput(thrust, velocity_sp, wanted, grown)


@inlined
def _error(asked: float, is_now: float) -> float:
    return asked - is_now if asked == asked else 0.0


@inlined
def _acceleration(feed_forward: float, velocity_sp: float, feedback: float) -> float:
    """Feed-forward where given, feedback where a velocity is asked for."""
    feed = feed_forward if feed_forward == feed_forward else 0.0
    return feed + feedback if velocity_sp == velocity_sp else feed


@inlined
def _velocity_setpoint(
    setpoint: TrajectorySetpoint, position: Vector, limits: VelocityLimits, g: PositionGains
) -> Vector:
    """v_ff + P (p_sp - p), limited so that the part that corrects position has priority. NaN where nothing is asked."""
    p_sp, v_ff = setpoint.position_ned_m, setpoint.velocity_ned_mps
    px, py, pz = g.xy_p * (p_sp[0] - position[0]), g.xy_p * (p_sp[1] - position[1]), g.z_p * (p_sp[2] - position[2])
    vx, vy = _limit_with_priority((px, py), (v_ff[0], v_ff[1]), limits.horizontal_mps)
    vz = _sum_given(pz, v_ff[2])
    if vz == vz:
        vz = max(-limits.up_mps, min(limits.down_mps, vz))
    return (vx, vy, vz)


@inlined
def _thrust(acceleration: Vector, g: PositionGains) -> Vector:
    scale = g.hover / _GRAVITY
    up = max(g.thrust_min, min(g.thrust_max, (_GRAVITY - acceleration[2]) * scale))
    if hypot(acceleration[0], acceleration[1]) * scale > g.thrust_xy_margin:
        up = min(up, sqrt(g.thrust_max * g.thrust_max - g.thrust_xy_margin * g.thrust_xy_margin))
    room = min(sqrt(g.thrust_max * g.thrust_max - up * up), g.tilt_tangent * up)
    x, y = acceleration[0] * scale, acceleration[1] * scale
    size = hypot(x, y)
    if size > room:
        x, y = x * room / size, y * room / size
    return (x, y, -up)


@inlined
def _integrate(
    integral: Vector, error: Vector, wanted: Vector, thrust: Vector, g: PositionGains, dt_s: float
) -> Vector:
    """Integral of the velocity error, with the horizontal error lowered by what saturation took (PX4's tracking scheme)."""
    scale = g.hover / _GRAVITY
    back = 2.0 / g.xy_vel_p
    ix = integral[0] + g.xy_vel_i * (error[0] - back * (wanted[0] - thrust[0] / scale)) * dt_s
    iy = integral[1] + g.xy_vel_i * (error[1] - back * (wanted[1] - thrust[1] / scale)) * dt_s
    iz = integral[2]
    low = -thrust[2] <= g.thrust_min and error[2] > 0.0
    high = -thrust[2] >= g.thrust_max and error[2] < 0.0
    if not (low or high):
        iz += g.z_vel_i * error[2] * dt_s
    return (ix, iy, max(-_GRAVITY, min(_GRAVITY, iz)))


@inlined
def _sum_given(a: float, b: float) -> float:
    """a + b where NaN counts as absent; NaN when both are."""
    if a != a:
        return b
    return a if b != b else a + b


@inlined
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
    share = (-ab + sqrt(ab * ab + b2 * (limit * limit - size * size))) / b2
    return (ax + share * bx, ay + share * by)
