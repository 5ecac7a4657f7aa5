"""What surrounds the controllers in the flight kernel: battery, wind, sensors and what is believed. Functions of the kernel's records.

`m` is the record FLIGHT, `c` CONSTANTS, `n` this step's row of standard normal numbers, in the columns of `NOISE_COLUMNS`.
"""

from math import sqrt
from typing import Any

from vehicle_sim.battery import BatteryState, Pack, step_battery
from vehicle_sim.compiled import inlined
from vehicle_sim.dynamics import specific_force
from vehicle_sim.estimator import (
    DELAY_TICKS,
    Inertial,
    correct_by_barometer,
    correct_by_gps,
    correct_by_magnetometer,
    dead_reckon,
    remember,
    spread_per_step,
)
from vehicle_sim.memory import four, put, rotor_model, state_of, three
from vehicle_sim.rotation import Vector
from vehicle_sim.rotors import Four
from vehicle_sim.sensors import (
    ErrorModel,
    EstimateError,
    believed,
    magnetic_field,
    next_error,
    noisy,
    pressure_altitude_m,
    pressure_hpa,
)
from vehicle_sim.wind import Pair, frozen_airspeed, gust_of, next_pair, next_u, next_value, turbulence_at

#: Columns of the noise table: (source, width). One row a step; slow sources use the row of their step.
NOISE_COLUMNS = (
    ("gyroscope", 3),
    ("wind", 3),
    ("estimate", 9),
    ("accelerometer", 3),
    ("magnetometer", 3),
    ("barometer", 1),
    ("gps", 3),
    ("gyroscope readings", 3),
    ("turbulence", 5),
    ("gps velocity", 3),
    ("gps wander", 3),
)
_MAG_LOST, _BARO_LOST, _GPS_LOST = 1, 2, 4
_DRIFT_MPS_PER_ROOT_S = 0.1


@inlined
def _turbulence(m: Any, c: Any, n: Any) -> Vector:
    """Dryden gusts along the mean wind, across it and down, one slow step later."""
    t = turbulence_at(-m.x[2], c.w20)
    speed = frozen_airspeed(three(m.x, 3), three(c.wind_mean))
    tuv, tw = t.length_uv_m / speed, t.length_w_m / speed
    m.dryden[0] = next_u(m.dryden[0], tuv, t.sigma_uv_mps, c.slow_s, n[28])
    v = next_pair(Pair(m.dryden[1], m.dryden[2]), tuv, t.sigma_uv_mps, c.slow_s, n[29], n[30])
    w = next_pair(Pair(m.dryden[3], m.dryden[4]), tw, t.sigma_w_mps, c.slow_s, n[31], n[32])
    put(m.dryden, v, 1)
    put(m.dryden, w, 3)
    return (m.dryden[0], gust_of(v), gust_of(w))


@inlined
def _drift(m: Any, c: Any, n: Any) -> None:
    """Dead reckoning without GPS: the velocity's error walks, the position's is its integral."""
    for i in range(3):
        m.error[3 + i] += _DRIFT_MPS_PER_ROOT_S * sqrt(c.slow_s) * n[9 + i]
        m.error[i] += m.error[3 + i] * c.slow_s


@inlined
def _read_sensors(m: Any, c: Any, n: Any) -> None:
    x, std = state_of(m.x), c.sensor_std
    put(m.readings, noisy(specific_force(state_of(m.before), x, c.dt_s), std[0], three(n, 15)))
    put(m.readings, noisy((x.p, x.q, x.r), std[1], three(n, 25)), 3)
    if not c.sensors_lost & _MAG_LOST:
        put(m.readings, noisy(magnetic_field(x), std[2], three(n, 18)), 6)
    if not c.sensors_lost & _BARO_LOST:
        m.readings[9] = pressure_hpa(c.ground_altitude - x.d) + std[3] * n[21]
    if c.sensors_lost & _GPS_LOST:
        return
    m.readings[10] = x.n + std[4] * n[22]
    m.readings[11] = x.e + std[4] * n[23]
    m.readings[12] = x.d + std[5] * n[24]


@inlined
def _correct(m: Any, c: Any, n: Any) -> None:
    """The estimator's slow corrections: magnetometer and barometer at 50 Hz, GPS at its own rate and 120 ms late."""
    for i in range(3):
        kick = spread_per_step(c.gps_wander[i // 2], c.gps_wander_s, c.slow_s)
        m.gps_wander[i] += kick * n[36 + i] - m.gps_wander[i] * c.slow_s / c.gps_wander_s
    remember(m)
    if m.step % c.readings_every == 0:
        if not c.sensors_lost & _MAG_LOST:
            correct_by_magnetometer(m, three(m.readings, 6))
        if not c.sensors_lost & _BARO_LOST:
            correct_by_barometer(m, c.ground_altitude - pressure_altitude_m(m.readings[9]))
    if (m.step // c.slow_every) % c.gps_every == DELAY_TICKS % c.gps_every and not c.sensors_lost & _GPS_LOST:
        correct_by_gps(m, three(m.gps), three(m.gps, 3))
    if (m.step // c.slow_every) % c.gps_every == 0:
        w, std = m.gps_wander, c.sensor_std
        m.gps[0] = m.x[0] + w[0] + 0.1 * std[4] * n[22]
        m.gps[1] = m.x[1] + w[1] + 0.1 * std[4] * n[23]
        m.gps[2] = m.x[2] + w[2] + 0.1 * std[5] * n[24]
        for i in range(3):
            m.gps[3 + i] = m.x[3 + i] + c.gps_speed_std * n[33 + i]


@inlined
def draw_slow(m: Any, c: Any, n: Any) -> None:
    """Battery, wind, errors of the estimate, and every second time the raw sensors."""
    speeds: Four = four(m.rotors)
    pack = Pack(c.pack[0], c.pack[1], c.pack[2], c.pack[3], c.pack[4])
    b = BatteryState(m.battery[0], m.battery[1], m.battery[2], m.battery[3])
    put(m.battery, step_battery(b, speeds, rotor_model(c), pack, c.slow_s))
    gust = next_value(three(m.gust), c.gust_keep, three(c.gust_kick), three(n, 3))
    put(m.gust, gust)
    along, across, down = 0.0, 0.0, 0.0
    if c.w20 > 0.0:
        along, across, down = _turbulence(m, c, n)
    size = sqrt(c.wind_mean[0] * c.wind_mean[0] + c.wind_mean[1] * c.wind_mean[1])
    cosine, sine = (c.wind_mean[0] / size, c.wind_mean[1] / size) if size > 0.0 else (1.0, 0.0)
    m.wind[0] = c.wind_mean[0] + c.discrete_gust[0] + gust[0] + cosine * along - sine * across
    m.wind[1] = c.wind_mean[1] + c.discrete_gust[1] + gust[1] + sine * along + cosine * across
    m.wind[2] = c.wind_mean[2] + c.discrete_gust[2] + gust[2] + down
    model = ErrorModel(c.error_keep, c.error_kick[0], c.error_kick[1], c.error_kick[2])
    error = EstimateError(three(m.error), three(m.error, 3), three(m.error, 6))
    error = next_error(error, model, three(n, 6), three(n, 9), three(n, 12))
    if c.sensors_lost & _GPS_LOST:
        _drift(m, c, n)
    else:
        put(m.error, error.position_m)
        put(m.error, error.velocity_mps, 3)
    put(m.error, error.attitude_rad, 6)
    if m.step % c.readings_every == 0:
        _read_sensors(m, c, n)
    if c.filter:
        _correct(m, c, n)


@inlined
def _reckon(m: Any, c: Any, n: Any, gyro: Vector) -> None:
    """The estimator's fast part: dead reckoning with the inertial sensors and their biases."""
    force = noisy(specific_force(state_of(m.before), state_of(m.x), c.dt_s), c.sensor_std[0], three(n, 15))
    b, e = m.gyro_bias, m.estimate
    omega = (
        gyro[0] + c.gyro_bias[0] - b[0],
        gyro[1] + c.gyro_bias[1] - b[1],
        gyro[2] + c.gyro_bias[2] - b[2],
    )
    felt = (force[0] + c.accel_bias[0], force[1] + c.accel_bias[1], force[2] + c.accel_bias[2])
    new = dead_reckon(Inertial(four(e, 6), three(e, 3), three(e)), omega, felt, c.dt_s)
    put(e, new.position_ned_m)
    put(e, new.velocity_ned_mps, 3)
    put(e, new.q_wb_wxyz, 6)
    put(e, omega, 10)


@inlined
def believe(m: Any, c: Any, n: Any) -> None:
    x = state_of(m.x)
    rates = noisy((x.p, x.q, x.r), c.sensor_std[1], three(n))
    if c.filter:
        _reckon(m, c, n, rates)
        return
    error = EstimateError(three(m.error), three(m.error, 3), three(m.error, 6))
    put(m.estimate, believed(x, error, rates))
