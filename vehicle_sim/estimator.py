"""From sensors to an estimate: inertial dead reckoning with gyroscope and accelerometer, corrected with fixed gains.

    q' = q exp((w - b) dt)        v' = v + (R f + g) dt        p' = p + v dt
    GPS:  p += K_p (p_gps - p_then)    v += K_v (v_gps - v_then)    tilt by K_t z x (v_gps - v_then) / g    b by K_b times that turn
    magnetometer: turn about the vertical by K_m times the heading error        barometer: height and climb

"then" is the estimate at the moment the GPS measured, `DELAY_TICKS` slow ticks ago. Errors of the result are PX4's in size: GPS wander
makes 0.3 m, and tilt follows horizontal acceleration a little. State in `flight.estimate` (layout of `State`), `gyro_bias`, `history`.
"""

from math import atan2, sqrt
from typing import Any, NamedTuple

from vehicle_sim.compiled import inlined
from vehicle_sim.dynamics import GRAVITY_MPS2
from vehicle_sim.rotation import Quaternion, Vector, normalize, quaternion_multiply, rotate, rotate_back
from vehicle_sim.sensors import MAGNETIC_FIELD_NED_GAUSS

#: 120 ms at 100 Hz, and how much history is kept.
DELAY_TICKS = 12
HISTORY = 16
_K_P, _K_V, _K_TILT, _K_BIAS = 0.2, 0.3, 0.08, 0.02
_K_PZ, _K_VZ = 0.02, 0.03
_K_BARO, _K_BARO_V = 0.02, 0.01
_K_MAG = 0.02
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
def correct_by_gps(m: Any, position: Vector, velocity: Vector) -> None:
    """`position` and `velocity` are what GPS measured `DELAY_TICKS` ago."""
    then = m.history[(m.tick + HISTORY - DELAY_TICKS) % HISTORY]
    e = m.estimate
    en, ee = velocity[0] - then[3], velocity[1] - then[4]
    e[0] += _K_P * (position[0] - then[0])
    e[1] += _K_P * (position[1] - then[1])
    e[2] += _K_PZ * (position[2] - then[2])
    e[3] += _K_V * en
    e[4] += _K_V * ee
    e[5] += _K_VZ * (velocity[2] - then[5])
    q = (e[6], e[7], e[8], e[9])
    turn = rotate_back(q, (_K_TILT * ee / GRAVITY_MPS2, -_K_TILT * en / GRAVITY_MPS2, 0.0))
    _turn(m, turn)
    for i in range(3):
        m.gyro_bias[i] -= _K_BIAS * turn[i]


@inlined
def correct_by_magnetometer(m: Any, field_b: Vector) -> None:
    """Heading alone; tilt is the accelerometer's and GPS's business."""
    e = m.estimate
    q = (e[6], e[7], e[8], e[9])
    north, east, _ = rotate(q, field_b)
    error = atan2(east, north) - _DECLINATION
    turn = rotate_back(q, (0.0, 0.0, -_K_MAG * error))
    _turn(m, turn)
    for i in range(3):
        m.gyro_bias[i] -= _K_BIAS * turn[i]


@inlined
def correct_by_barometer(m: Any, d_m: float) -> None:
    """Height above the origin, downwards."""
    error = d_m - m.estimate[2]
    m.estimate[2] += _K_BARO * error
    m.estimate[5] += _K_BARO_V * error


@inlined
def remember(m: Any) -> None:
    """Keep position and velocity of this slow tick for measurements that come late."""
    m.tick = (m.tick + 1) % HISTORY
    for i in range(6):
        m.history[m.tick, i] = m.estimate[i]


@inlined
def _turn(m: Any, turn_rad: Vector) -> None:
    e = m.estimate
    q = turned((e[6], e[7], e[8], e[9]), turn_rad)
    for i in range(4):
        e[6 + i] = q[i]


@inlined
def spread_per_step(spread: float, correlation_s: float, dt_s: float) -> float:
    """Kick of a first-order wander that keeps `spread`: sigma sqrt(2 dt / T)."""
    return spread * sqrt(2.0 * dt_s / correlation_s)
