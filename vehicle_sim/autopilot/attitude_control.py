"""Thrust vector to attitude, attitude to body rates (quaternion P), body rates to torque (PID), in PX4's structure.

    q_e = q⁻¹ q_sp      w_sp = 2 sgn(q_e,w) q_e,xyz P + yaw rate about the vertical
    tau = K (P (w_sp - w) + I - D w_dot + FF w_sp)

Torques are normalised: 1 is the torque of full differential thrust.
"""

from math import atan2, cos, exp, pi, radians, sin, sqrt
from typing import NamedTuple

from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.compiled import inlined
from vehicle_sim.rotation import Quaternion, Vector, normalize, quaternion_from_axes, quaternion_multiply, rotate_back

_D_CUTOFF_HZ = 40.0


@inlined
def attitude_from_thrust(thrust_ned: Vector, yaw_rad: float) -> tuple[Quaternion, float]:
    """(q_sp, collective): the attitude whose -z body axis points along the thrust, with the given heading."""
    tx, ty, tz = thrust_ned
    size = sqrt(tx * tx + ty * ty + tz * tz)
    if size < 1e-6:
        zx, zy, zz = 0.0, 0.0, 1.0
    else:
        zx, zy, zz = -tx / size, -ty / size, -tz / size
    cx, cy = -sin(yaw_rad), cos(yaw_rad)
    xx, xy, xz = cy * zz, -cx * zz, cx * zy - cy * zx
    norm = sqrt(xx * xx + xy * xy + xz * xz)
    if norm < 1e-6:
        xx, xy, xz, norm = 0.0, 0.0, 1.0, 1.0
    elif zz < 0.0:
        norm = -norm
    xx, xy, xz = xx / norm, xy / norm, xz / norm
    y_b = (zy * xz - zz * xy, zz * xx - zx * xz, zx * xy - zy * xx)
    return quaternion_from_axes((xx, xy, xz), y_b, (zx, zy, zz)), size


class AttitudeGains(NamedTuple):
    """Attitude P (the yaw weight is divided out, as in PX4) and rate limits."""

    gain: Vector
    yaw_weight: float
    limit_radps: Vector

    @classmethod
    def of(cls, parameters: ParameterStore) -> "AttitudeGains":
        """Read the table."""
        weight = parameters["MC_YAW_WEIGHT"]
        yaw = parameters["MC_YAW_P"] / weight if weight > 1e-4 else 0.0
        return cls(
            (parameters["MC_ROLL_P"], parameters["MC_PITCH_P"], yaw),
            weight,
            (
                radians(parameters["MC_ROLLRATE_MAX"]),
                radians(parameters["MC_PITCHRATE_MAX"]),
                radians(parameters["MC_YAWRATE_MAX"]),
            ),
        )


@inlined
def rate_setpoint(q_wb: Quaternion, q_sp: Quaternion, yaw_rate_radps: float, gains: AttitudeGains) -> Vector:
    """Body rates that turn q towards q_sp, tilt before heading (PX4's AttitudeControl).

    The reduced attitude turns the thrust axis the short way; the heading error that is left is weighted.
    """
    q_red = _tilt_between(q_wb, q_sp)
    q_mix = quaternion_multiply((q_red[0], -q_red[1], -q_red[2], -q_red[3]), q_sp)
    sign = 1.0 if q_mix[0] >= 0.0 else -1.0
    half_yaw = _half_angle(sign * q_mix[0], sign * q_mix[3]) * gains.yaw_weight
    q_aim = quaternion_multiply(q_red, (cos(half_yaw), 0.0, 0.0, sin(half_yaw)))
    q_e = quaternion_multiply((q_wb[0], -q_wb[1], -q_wb[2], -q_wb[3]), q_aim)
    scale = 2.0 if q_e[0] >= 0.0 else -2.0
    down = rotate_back(q_wb, (0.0, 0.0, yaw_rate_radps))
    kx, ky, kz = gains.gain
    lx, ly, lz = gains.limit_radps
    return (
        max(-lx, min(lx, scale * q_e[1] * kx + down[0])),
        max(-ly, min(ly, scale * q_e[2] * ky + down[1])),
        max(-lz, min(lz, scale * q_e[3] * kz + down[2])),
    )


@inlined
def _tilt_between(q_wb: Quaternion, q_sp: Quaternion) -> Quaternion:
    """q_red: the attitude with the thrust axis of q_sp that is nearest to q."""
    w, x, y, z = q_wb
    ax, ay, az = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    w, x, y, z = q_sp
    bx, by, bz = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    real = 1.0 + ax * bx + ay * by + az * bz
    if real < 1e-5:
        return q_sp
    turn = normalize((real, ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))
    return quaternion_multiply(turn, q_wb)


@inlined
def _half_angle(w: float, z: float) -> float:
    """Half the turn about z of a quaternion with w >= 0, within +-pi/2."""
    return atan2(z, w)


class RateGains(NamedTuple):
    """Rate PID for roll, pitch, yaw."""

    p: Vector
    i: Vector
    d: Vector
    feed_forward: Vector
    integral_limit: Vector

    @classmethod
    def of(cls, parameters: ParameterStore) -> "RateGains":
        """Read the table; K multiplies P, I and D."""
        axes = ("ROLL", "PITCH", "YAW")

        def read(suffix: str, scaled: bool) -> Vector:
            x, y, z = (
                parameters[f"MC_{axis}RATE_{suffix}"] * (parameters[f"MC_{axis}RATE_K"] if scaled else 1.0)
                for axis in axes
            )
            return (x, y, z)

        return cls(
            read("P", True),
            read("I", True),
            read("D", True),
            read("FF", False),
            (parameters["MC_RR_INT_LIM"], parameters["MC_PR_INT_LIM"], parameters["MC_YR_INT_LIM"]),
        )


class RateOutput(NamedTuple):
    """Normalised torque, the integral, and the low-passed rate whose derivative damps."""

    torque: Vector
    integral: Vector
    smooth_radps: Vector


def derivative_keep(dt_s: float) -> float:
    """Share that the low-pass of the derivative keeps over one step."""
    return exp(-2.0 * pi * _D_CUTOFF_HZ * dt_s)


@inlined
def control_rates(
    omega_sp: Vector, omega: Vector, integral: Vector, smooth: Vector, gains: RateGains, keep: float, dt_s: float
) -> RateOutput:
    """One step of the innermost loop, at a fixed period."""
    g = gains
    ex, ey, ez = omega_sp[0] - omega[0], omega_sp[1] - omega[1], omega_sp[2] - omega[2]
    sx, sy, sz = (
        omega[0] + (smooth[0] - omega[0]) * keep,
        omega[1] + (smooth[1] - omega[1]) * keep,
        omega[2] + (smooth[2] - omega[2]) * keep,
    )
    ix, iy, iz = integral
    torque = (
        g.p[0] * ex + ix - g.d[0] * (sx - smooth[0]) / dt_s + g.feed_forward[0] * omega_sp[0],
        g.p[1] * ey + iy - g.d[1] * (sy - smooth[1]) / dt_s + g.feed_forward[1] * omega_sp[1],
        g.p[2] * ez + iz - g.d[2] * (sz - smooth[2]) / dt_s + g.feed_forward[2] * omega_sp[2],
    )
    lx, ly, lz = g.integral_limit
    grown = (
        max(-lx, min(lx, ix + g.i[0] * ex * dt_s)),
        max(-ly, min(ly, iy + g.i[1] * ey * dt_s)),
        max(-lz, min(lz, iz + g.i[2] * ez * dt_s)),
    )
    return RateOutput(torque, grown, (sx, sy, sz))
