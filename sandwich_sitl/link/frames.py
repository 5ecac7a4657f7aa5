"""Every conversion between the world's ENU/FLU and MAVLink's NED/FRD, and between their number formats.

State: none. The vehicle's local NED frame has its origin at `origin_m` (x east, y north) of the world at ground
level: east = y_ned + x0, north = x_ned + y0, up = -z_ned. The turn of axes is its own inverse. Yaw: NED counts
clockwise from north, ENU counter-clockwise from east, yaw_enu = pi/2 - yaw_ned. Metres, radians, seconds; MAVLink
times in milliseconds.
"""

from math import cos, pi, remainder, sin, sqrt

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Triple = tuple[float, float, float]

_HALF = sqrt(0.5)


def enu_from_ned(x: float, y: float, z: float) -> Vector:
    """A free vector (velocity, acceleration), (3,)."""
    return np.array((y, x, -z))


def ned_from_enu(vector: Vector) -> Triple:
    """The inverse of `enu_from_ned`, as floats for a message."""
    east, north, up = vector.tolist()
    return north, east, -up


def position_enu_from_ned(x: float, y: float, z: float, origin_m: tuple[float, float]) -> Vector:
    """A position (3,) in the world."""
    return np.array((y + origin_m[0], x + origin_m[1], -z))


def position_ned_from_enu(r_m: Vector, origin_m: tuple[float, float]) -> Triple:
    """The inverse of `position_enu_from_ned`, as floats for a message."""
    east, north, up = r_m.tolist()
    return north - origin_m[1], east - origin_m[0], -up


def flip_yaw(yaw_rad: float) -> float:
    """Yaw of one convention in the other, within (-pi, pi]; its own inverse."""
    return remainder(0.5 * pi - yaw_rad, 2.0 * pi)


def quaternion_enu_from_ned(w: float, x: float, y: float, z: float) -> Vector:
    """Attitude body FLU to ENU (4,) wxyz from body FRD to NED: q_enu_ned * q * q_frd_flu, with w >= 0.

    q_enu_ned = (0, 1, 1, 0) / sqrt 2 exchanges x and y and turns z over, q_frd_flu = (0, 1, 0, 0) turns y and z over.
    """
    sign = _HALF if w + z >= 0.0 else -_HALF
    return np.array((sign * (w + z), sign * (x + y), sign * (x - y), sign * (w - z)))


def quaternion_from_euler(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Quaternion wxyz of yaw, then pitch, then roll (aerospace order) in radians, in the frame the angles are given in."""
    cr, sr = cos(0.5 * roll), sin(0.5 * roll)
    cp, sp = cos(0.5 * pitch), sin(0.5 * pitch)
    cy, sy = cos(0.5 * yaw), sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def boot_ms(now_s: float) -> int:
    """Vehicle boot time of a message's `time_boot_ms`, modulo 2^32."""
    return round(now_s * 1e3) & 0xFFFFFFFF
