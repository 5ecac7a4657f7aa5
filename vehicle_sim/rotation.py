"""Unit quaternions q_wb_wxyz (body FRD to local NED) on plain tuples of floats, for Python and for the flight kernel alike."""

from math import asin, atan2, copysign, cos, sin, sqrt
from typing import NamedTuple

from vehicle_sim.compiled import inlined

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Euler(NamedTuple):
    """Aerospace angles (yaw about z, then pitch about y, then roll about x), radians."""

    roll_rad: float
    pitch_rad: float
    yaw_rad: float


@inlined
def quaternion_multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product a b."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@inlined
def normalize(q: Quaternion) -> Quaternion:
    """The unit quaternion of the same rotation. Raises `ZeroDivisionError` for the zero quaternion."""
    w, x, y, z = q
    scale = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return (w * scale, x * scale, y * scale, z * scale)


@inlined
def rotate(q: Quaternion, v: Vector) -> Vector:
    """R(q) v: a body vector in world axes for q_wb."""
    w, x, y, z = q
    a, b, c = v
    tx = 2.0 * (y * c - z * b)
    ty = 2.0 * (z * a - x * c)
    tz = 2.0 * (x * b - y * a)
    return (a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx)


@inlined
def rotate_back(q: Quaternion, v: Vector) -> Vector:
    """R(q)ᵀ v: a world vector in body axes for q_wb."""
    w, x, y, z = q
    return rotate((w, -x, -y, -z), v)


@inlined
def quaternion_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """q_wb of yaw, then pitch, then roll."""
    cr, sr = cos(roll_rad / 2), sin(roll_rad / 2)
    cp, sp = cos(pitch_rad / 2), sin(pitch_rad / 2)
    cy, sy = cos(yaw_rad / 2), sin(yaw_rad / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


@inlined
def euler_from_quaternion(q: Quaternion) -> Euler:
    """Inverse of `quaternion_from_euler` for |pitch| < 90 deg."""
    w, x, y, z = q
    return Euler(
        atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


@inlined
def yaw_of(q: Quaternion) -> float:
    """Heading, radians clockwise from north."""
    w, x, y, z = q
    return atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


@inlined
def quaternion_from_axes(x_b: Vector, y_b: Vector, z_b: Vector) -> Quaternion:
    """q_wb of a frame whose axes, in world coordinates, are `x_b, y_b, z_b` (the columns of R_wb)."""
    trace = x_b[0] + y_b[1] + z_b[2]
    w = sqrt(max(0.0, 1 + trace)) / 2
    x = copysign(sqrt(max(0.0, 1 + x_b[0] - y_b[1] - z_b[2])) / 2, y_b[2] - z_b[1])
    y = copysign(sqrt(max(0.0, 1 - x_b[0] + y_b[1] - z_b[2])) / 2, z_b[0] - x_b[2])
    z = copysign(sqrt(max(0.0, 1 - x_b[0] - y_b[1] + z_b[2])) / 2, x_b[1] - y_b[0])
    return normalize((w, x, y, z))


_HALF = sqrt(0.5)


def enu_flu_from_ned_frd(q: Quaternion) -> Quaternion:
    """The same attitude as body FLU to world ENU (w, x, y, z).

    NED to ENU is half a turn about (1, 1, 0)/sqrt(2); FLU to FRD is half a turn about x.
    """
    return normalize(quaternion_multiply(quaternion_multiply((0.0, _HALF, _HALF, 0.0), q), (0.0, 1.0, 0.0, 0.0)))
