"""From sensors to an estimate: inertial dead reckoning with gyroscope and accelerometer, corrected with fixed gains.

    q' = q exp((w - b) dt)        v' = v + (R f + g) dt        p' = p + v dt
    GPS:  p += k_p h (p_gps - p_then)    v += k_v h (v_gps - v_then)    tilt by k_t h z x (v_gps - v_then) / g    b by K_b times that turn
    magnetometer: turn about the vertical by K_m times the heading error
    barometer: height, climb and the accelerometer's bias downwards

"then" is the estimate at the moment the GPS measured; h is the time between two fixes, so that the gains do not depend on the GPS's rate.
Without a barometer the height follows GPS as the other axes do. State in `flight.estimate` (layout of `State`), `gyro_bias`, `history`.
"""

from math import atan2
from typing import Any, NamedTuple

from vehicle_sim.compiled import inlined
from vehicle_sim.dynamics import GRAVITY_MPS2
from vehicle_sim.rotation import Quaternion, Vector, normalize, quaternion_multiply, rotate, rotate_back
from vehicle_sim.sensors import MAGNETIC_FIELD_NED_GAUSS

#: GPS, per second: position, velocity, tilt; height and climb beside a barometer.
K_POSITION, K_VELOCITY, K_TILT = 1.0, 1.5, 0.4
K_HEIGHT, K_CLIMB = 0.1, 0.15
#: Barometer and magnetometer, per reading; gyroscope bias, share of every turn.
K_BARO, K_BARO_CLIMB, K_BARO_BIAS = 0.02, 0.01, 0.001
K_MAG = 0.02
K_BIAS = 0.1
#: Without GPS for longer than this, its first fix is believed at once (PX4's reset time-out).
RESET_AFTER_S = 7.0
_DECLINATION = atan2(MAGNETIC_FIELD_NED_GAUSS[1], MAGNETIC_FIELD_NED_GAUSS[0])


class Inertial(NamedTuple):
    """Attitude, velocity and position, dead reckoned."""

    q_wb_wxyz: Quaternion
    velocity_ned_mps: Vector
    position_ned_m: Vector


@inlined
def turned(q_wb_wxyz: Quaternion, turn_rad: Vector) -> Quaternion:
    """q after a small turn about body axes."""
    return normalize(quaternion_multiply(q_wb_wxyz, (1.0, 0.5 * turn_rad[0], 0.5 * turn_rad[1], 0.5 * turn_rad[2])))


@inlined
def dead_reckon(before: Inertial, omega_radps: Vector, specific_force_mps2: Vector, dt_s: float) -> Inertial:
    """One step from the inertial sensors alone."""
    q = turned(before.q_wb_wxyz, (omega_radps[0] * dt_s, omega_radps[1] * dt_s, omega_radps[2] * dt_s))
    a = rotate(q, specific_force_mps2)
    v, p = before.velocity_ned_mps, before.position_ned_m
    new = (v[0] + a[0] * dt_s, v[1] + a[1] * dt_s, v[2] + (a[2] + GRAVITY_MPS2) * dt_s)
    half = 0.5 * dt_s
    moved = (p[0] + (v[0] + new[0]) * half, p[1] + (v[1] + new[1]) * half, p[2] + (v[2] + new[2]) * half)
    return Inertial(q, new, moved)


@inlined
def correct_by_gps(m: Any, fix: Any, then: Any, interval_s: float, has_barometer: bool) -> None:
    """`fix` is position and velocity as measured at the time of which `then` is the estimate."""
    e, z = m.estimate, m.innovation
    for i in range(6):
        z[i] = fix[i] - then[i]
    k_height, k_climb = (K_HEIGHT, K_CLIMB) if has_barometer else (K_POSITION, K_VELOCITY)
    e[0] += K_POSITION * interval_s * z[0]
    e[1] += K_POSITION * interval_s * z[1]
    e[2] += k_height * interval_s * z[2]
    e[3] += K_VELOCITY * interval_s * z[3]
    e[4] += K_VELOCITY * interval_s * z[4]
    e[5] += k_climb * interval_s * z[5]
    k = K_TILT * interval_s / GRAVITY_MPS2
    _turn(m, rotate_back((e[6], e[7], e[8], e[9]), (k * z[4], -k * z[3], 0.0)))


@inlined
def begin_again_at(m: Any, fix: Any, then: Any) -> None:
    """After a long time without GPS: believe its horizontal position and velocity at once, as PX4's estimator resets to them."""
    for i in (0, 1, 3, 4):
        m.innovation[i] = 0.0
        m.estimate[i] += fix[i] - then[i]


@inlined
def correct_by_magnetometer(m: Any, field_b: Vector) -> None:
    """Heading alone; tilt is the accelerometer's and GPS's business."""
    e = m.estimate
    q = (e[6], e[7], e[8], e[9])
    north, east, _ = rotate(q, field_b)
    m.innovation[7] = _DECLINATION - atan2(east, north)
    _turn(m, rotate_back(q, (0.0, 0.0, K_MAG * m.innovation[7])))


@inlined
def correct_by_barometer(m: Any, d_m: float) -> None:
    """Height above the origin, downwards."""
    error = d_m - m.estimate[2]
    m.innovation[6] = error
    m.estimate[2] += K_BARO * error
    m.estimate[5] += K_BARO_CLIMB * error
    m.down_bias -= K_BARO_BIAS * error


@inlined
def _turn(m: Any, turn_rad: Vector) -> None:
    e = m.estimate
    q = turned((e[6], e[7], e[8], e[9]), turn_rad)
    for i in range(4):
        e[6 + i] = q[i]
    for i in range(3):
        m.gyro_bias[i] -= K_BIAS * turn_rad[i]
