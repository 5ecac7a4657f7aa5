"""OBSTACLE_DISTANCE to `RangeScan` (MAVLink common, message 330).

Element i of `distances` (cm) lies at  angle_offset + i * increment  degrees, clockwise: from north in frame GLOBAL (the
default) and LOCAL_NED, from the vehicle's nose in BODY_FRD. `increment_f`, where it is not zero, stands for the whole
degrees of `increment`; a negative one counts counter-clockwise. max_distance + 1 and more: nothing within reach;
65535: not known. Sectors are centred on their angle. The sweep is taken as level: roll and pitch are left out, which
lengthens ranges by 1 / cos(tilt) at most.
"""

from math import atan2, pi, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.errors import InputError
from sandwich_sitl.mission.vehicle_view import RangeScan

Vector = NDArray[np.float64]

_UNKNOWN = 65535
_NORTH_ALIGNED = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_LOCAL_NED)


def scan_of(message: Any, heard_s: float, r_m: Vector, q_wxyz: Vector) -> RangeScan:
    """The sweep seen from position (3,) and attitude (4,), ENU and body to world. Raises `InputError` when malformed."""
    increment_deg = message.increment_f or float(message.increment)
    if not np.isfinite(increment_deg) or not 0.0 < abs(increment_deg) <= 360.0:
        raise InputError(f"OBSTACLE_DISTANCE: increment {increment_deg:g} deg: give one between 0 and 360")
    if not np.isfinite(message.angle_offset):
        raise InputError("OBSTACLE_DISTANCE: angle_offset is not finite")
    if message.frame == mavlink.MAV_FRAME_BODY_FRD:
        ahead_rad = _yaw_rad(q_wxyz)
    elif message.frame in _NORTH_ALIGNED:
        ahead_rad = pi / 2
    else:
        raise InputError(f"OBSTACLE_DISTANCE: frame {message.frame}: give GLOBAL (0), LOCAL_NED (1) or BODY_FRD (12)")
    raw = np.array(message.distances, dtype=np.float64)
    known = np.flatnonzero(raw != _UNKNOWN)
    count = min(int(known[-1]) + 1 if known.size else 0, int(360.0 / abs(increment_deg) + 1e-6))
    raw = raw[:count]
    ranges_m = np.where(raw > message.max_distance, np.inf, raw / 100.0)
    ranges_m[raw == _UNKNOWN] = np.nan
    clockwise_rad = np.radians(message.angle_offset + increment_deg * np.arange(count))
    return RangeScan(heard_s, r_m[:2].copy(), ahead_rad - clockwise_rad, radians(abs(increment_deg)), ranges_m)


def _yaw_rad(q_wxyz: Vector) -> float:
    w, x, y, z = q_wxyz.tolist()
    return atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
