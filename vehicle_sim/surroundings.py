"""What surrounds the controllers in the flight kernel: battery, wind, sensors and what is believed. Functions of the kernel's records.

`m` is the record FLIGHT, `c` CONSTANTS, `n` this step's row of standard normal numbers, in the columns of `NOISE_COLUMNS`.
"""

from math import sqrt
from typing import Any

from vehicle_sim.battery import BatteryState, Pack, step_battery
from vehicle_sim.compiled import inlined
from vehicle_sim.estimator import (
    RESET_AFTER_S,
    Inertial,
    begin_again_at,
    correct_by_barometer,
    correct_by_gps,
    correct_by_magnetometer,
    dead_reckon,
)
from vehicle_sim.memory import four, put, rotor_model, state_of, three
from vehicle_sim.noise import NOISE_COLUMNS, first_column
from vehicle_sim.rotation import Vector
from vehicle_sim.rotors import Four
from vehicle_sim.sensing import (
    BARO_LOST,
    GPS_LOST,
    HISTORY,
    MAG_LOST,
    sense_field_and_pressure,
    sense_motion,
    sense_place,
    wander,
)
from vehicle_sim.sensors import ErrorModel, EstimateError, believed, next_error, pressure_altitude_m
from vehicle_sim.wind import Pair, frozen_airspeed, gust_of, next_pair, next_u, next_value, turbulence_at

_WIND, _ESTIMATE = first_column(NOISE_COLUMNS, "wind"), first_column(NOISE_COLUMNS, "estimate")
_TURBULENCE = first_column(NOISE_COLUMNS, "turbulence")
#: How the error model's velocity walks without GPS.
DRIFT_MPS_PER_ROOT_S = 0.1


@inlined
def _turbulence(m: Any, c: Any, n: Any) -> Vector:
    """Dryden gusts along the mean wind, across it and down, one slow step later."""
    t = turbulence_at(-m.x[2], c.w20)
    speed = frozen_airspeed(three(m.x, 3), three(c.wind_mean))
    tuv, tw = t.length_uv_m / speed, t.length_w_m / speed
    m.dryden[0] = next_u(m.dryden[0], tuv, t.sigma_uv_mps, c.slow_s, n[_TURBULENCE])
    v = next_pair(Pair(m.dryden[1], m.dryden[2]), tuv, t.sigma_uv_mps, c.slow_s, n[_TURBULENCE + 1], n[_TURBULENCE + 2])
    w = next_pair(Pair(m.dryden[3], m.dryden[4]), tw, t.sigma_w_mps, c.slow_s, n[_TURBULENCE + 3], n[_TURBULENCE + 4])
    put(m.dryden, v, 1)
    put(m.dryden, w, 3)
    return (m.dryden[0], gust_of(v), gust_of(w))


@inlined
def _drift(m: Any, c: Any, n: Any) -> None:
    """Dead reckoning without GPS: the velocity's error walks, the position's is its integral."""
    for i in range(3):
        m.error[3 + i] += DRIFT_MPS_PER_ROOT_S * sqrt(c.slow_s) * n[_ESTIMATE + 3 + i]
        m.error[i] += m.error[3 + i] * c.slow_s


@inlined
def _correct(m: Any, c: Any, tick: int, has_fix: bool) -> None:
    """The estimator's slow corrections, by the sensors that have something new."""
    put(m.history[tick % HISTORY], three(m.estimate))
    put(m.history[tick % HISTORY], three(m.estimate, 3), 3)
    has_barometer = not c.sensors_lost & BARO_LOST
    if m.step % c.readings_every == 0:
        if not c.sensors_lost & MAG_LOST:
            correct_by_magnetometer(m, three(m.readings, 6))
        if has_barometer:
            correct_by_barometer(m, c.ground_altitude - pressure_altitude_m(m.readings[9]))
    if has_fix:
        then = m.history[(tick - c.gps_delay) % HISTORY]
        if (tick - m.last_fix) * c.slow_s > RESET_AFTER_S:
            begin_again_at(m, m.readings[10:16], then)
        else:
            correct_by_gps(m, m.readings[10:16], then, c.slow_s / c.fixes_per_tick, has_barometer)
        m.last_fix = tick


@inlined
def draw_slow(m: Any, c: Any, n: Any) -> None:
    """Battery, wind, the slow sensors and what they correct."""
    speeds: Four = four(m.rotors)
    pack = Pack(c.pack[0], c.pack[1], c.pack[2], c.pack[3], c.pack[4])
    b = BatteryState(m.battery[0], m.battery[1], m.battery[2], m.battery[3])
    put(m.battery, step_battery(b, speeds, rotor_model(c), pack, c.slow_s))
    gust = next_value(three(m.gust), c.gust_keep, three(c.gust_kick), three(n, _WIND))
    put(m.gust, gust)
    along, across, down = 0.0, 0.0, 0.0
    if c.w20 > 0.0:
        along, across, down = _turbulence(m, c, n)
    size = sqrt(c.wind_mean[0] * c.wind_mean[0] + c.wind_mean[1] * c.wind_mean[1])
    cosine, sine = (c.wind_mean[0] / size, c.wind_mean[1] / size) if size > 0.0 else (1.0, 0.0)
    m.wind[0] = c.wind_mean[0] + c.discrete_gust[0] + gust[0] + cosine * along - sine * across
    m.wind[1] = c.wind_mean[1] + c.discrete_gust[1] + gust[1] + sine * along + cosine * across
    m.wind[2] = c.wind_mean[2] + c.discrete_gust[2] + gust[2] + down
    wander(m, c, n)
    tick = m.step // c.slow_every
    has_fix = sense_place(m, c, n, tick)
    if m.step % c.readings_every == 0:
        sense_field_and_pressure(m, c, n)
    if c.filter:
        _correct(m, c, tick, has_fix)
    else:
        _err(m, c, n)


@inlined
def _err(m: Any, c: Any, n: Any) -> None:
    """The error model's errors, one tick later."""
    model = ErrorModel(c.error_keep, c.error_kick[0], c.error_kick[1], c.error_kick[2])
    error = EstimateError(three(m.error), three(m.error, 3), three(m.error, 6))
    at = _ESTIMATE
    error = next_error(error, model, three(n, at), three(n, at + 3), three(n, at + 6))
    if c.sensors_lost & GPS_LOST:
        _drift(m, c, n)
    else:
        put(m.error, error.position_m)
        put(m.error, error.velocity_mps, 3)
    put(m.error, error.attitude_rad, 6)


@inlined
def _reckon(m: Any, c: Any) -> None:
    """The estimator's fast part: dead reckoning with the inertial sensors and the biases that are believed."""
    r, b, e = m.readings, m.gyro_bias, m.estimate
    omega = (r[3] - b[0], r[4] - b[1], r[5] - b[2])
    felt = (r[0], r[1], r[2] - m.down_bias)
    new = dead_reckon(Inertial(four(e, 6), three(e, 3), three(e)), omega, felt, c.dt_s)
    put(e, new.position_ned_m)
    put(e, new.velocity_ned_mps, 3)
    put(e, new.q_wb_wxyz, 6)
    put(e, omega, 10)


@inlined
def believe(m: Any, c: Any, n: Any) -> None:
    """The estimate of the state that the step has led to."""
    sense_motion(m, c, n)
    if c.filter:
        _reckon(m, c)
        return
    r, b = m.readings, c.gyro_bias
    error = EstimateError(three(m.error), three(m.error, 3), three(m.error, 6))
    put(m.estimate, believed(state_of(m.x), error, (r[3] - b[0], r[4] - b[1], r[5] - b[2])))
