"""The flight kernel: control, rotors, battery, wind, body and sensors, one step after another, compiled.

`advance(flight, constants, noise, row, count)` moves the record `flight` on by `count` steps. Order of a step: slow processes when they
are due, controllers from the estimate, rotors, body, then the estimate of the new state, so that estimate and truth are of one time.
"""

from math import isfinite, sqrt
from typing import Any

from vehicle_sim.autopilot.attitude_control import (
    AttitudeGains,
    RateGains,
    attitude_from_thrust,
    control_rates,
    rate_setpoint,
)
from vehicle_sim.autopilot.position_control import Motion, PositionGains, VelocityLimits, control_position
from vehicle_sim.autopilot.setpoints import TrajectorySetpoint
from vehicle_sim.battery import BatteryState, Pack, step_battery, top_speed_fraction
from vehicle_sim.compiled import inlined, kernel
from vehicle_sim.dynamics import Body, State, rest_on_ground, specific_force, step_free
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
from vehicle_sim.memory import Engaged
from vehicle_sim.rotation import Quaternion, Vector
from vehicle_sim.rotors import Demand, Four, RotorModel, lag_speeds, mix, rotor_wrench, speed_targets
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
_OFF, _IDLE = int(Engaged.OFF), int(Engaged.IDLE)
_ATTITUDE, _POSITION = int(Engaged.ATTITUDE), int(Engaged.POSITION)
_IDLE_THRUST = 0.05
_MAG_LOST, _BARO_LOST, _GPS_LOST = 1, 2, 4
_DRIFT_MPS_PER_ROOT_S = 0.1
_ACCELERATION_KEEP = 0.75


@inlined
def _three(a: Any, at: int = 0) -> Vector:
    return (a[at], a[at + 1], a[at + 2])


@inlined
def _four(a: Any, at: int = 0) -> Quaternion:
    return (a[at], a[at + 1], a[at + 2], a[at + 3])


@inlined
def _state(a: Any) -> State:
    return State(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11], a[12])


@inlined
def _put(a: Any, values: Any, at: int = 0) -> None:
    for i in range(len(values)):
        a[at + i] = values[i]


@inlined
def _rotor_model(c: Any) -> RotorModel:
    return RotorModel(c.rotor[0], c.rotor[1], c.rotor[2], c.rotor[3], c.rotor[4])


@inlined
def _draw(m: Any, c: Any, n: Any) -> None:
    """Battery, wind, errors of the estimate, and every second time the raw sensors."""
    speeds: Four = _four(m.rotors)
    pack = Pack(c.pack[0], c.pack[1], c.pack[2], c.pack[3], c.pack[4])
    b = BatteryState(m.battery[0], m.battery[1], m.battery[2], m.battery[3])
    _put(m.battery, step_battery(b, speeds, _rotor_model(c), pack, c.slow_s))
    gust = next_value(_three(m.gust), c.gust_keep, _three(c.gust_kick), _three(n, 3))
    _put(m.gust, gust)
    along, across, down = 0.0, 0.0, 0.0
    if c.w20 > 0.0:
        along, across, down = _turbulence(m, c, n)
    size = sqrt(c.wind_mean[0] * c.wind_mean[0] + c.wind_mean[1] * c.wind_mean[1])
    cosine, sine = (c.wind_mean[0] / size, c.wind_mean[1] / size) if size > 0.0 else (1.0, 0.0)
    m.wind[0] = c.wind_mean[0] + c.discrete_gust[0] + gust[0] + cosine * along - sine * across
    m.wind[1] = c.wind_mean[1] + c.discrete_gust[1] + gust[1] + sine * along + cosine * across
    m.wind[2] = c.wind_mean[2] + c.discrete_gust[2] + gust[2] + down
    model = ErrorModel(c.error_keep, c.error_kick[0], c.error_kick[1], c.error_kick[2])
    error = EstimateError(_three(m.error), _three(m.error, 3), _three(m.error, 6))
    error = next_error(error, model, _three(n, 6), _three(n, 9), _three(n, 12))
    if c.sensors_lost & _GPS_LOST:
        _drift(m, c, n)
    else:
        _put(m.error, error.position_m)
        _put(m.error, error.velocity_mps, 3)
    _put(m.error, error.attitude_rad, 6)
    if m.step % c.readings_every == 0:
        _read_sensors(m, c, n)
    if c.filter:
        _correct(m, c, n)


@inlined
def _correct(m: Any, c: Any, n: Any) -> None:
    """The estimator's slow corrections: magnetometer and barometer at 50 Hz, GPS at its own rate and 120 ms late."""
    for i in range(3):
        kick = spread_per_step(c.gps_wander[i // 2], c.gps_wander_s, c.slow_s)
        m.gps_wander[i] += kick * n[36 + i] - m.gps_wander[i] * c.slow_s / c.gps_wander_s
    remember(m)
    if m.step % c.readings_every == 0:
        if not c.sensors_lost & _MAG_LOST:
            correct_by_magnetometer(m, _three(m.readings, 6))
        if not c.sensors_lost & _BARO_LOST:
            correct_by_barometer(m, c.ground_altitude - pressure_altitude_m(m.readings[9]))
    if (m.step // c.slow_every) % c.gps_every == DELAY_TICKS % c.gps_every and not c.sensors_lost & _GPS_LOST:
        correct_by_gps(m, _three(m.gps), _three(m.gps, 3))
    if (m.step // c.slow_every) % c.gps_every == 0:
        w, std = m.gps_wander, c.sensor_std
        m.gps[0] = m.x[0] + w[0] + 0.1 * std[4] * n[22]
        m.gps[1] = m.x[1] + w[1] + 0.1 * std[4] * n[23]
        m.gps[2] = m.x[2] + w[2] + 0.1 * std[5] * n[24]
        for i in range(3):
            m.gps[3 + i] = m.x[3 + i] + c.gps_speed_std * n[33 + i]


@inlined
def _turbulence(m: Any, c: Any, n: Any) -> Vector:
    """Dryden gusts along the mean wind, across it and down, one slow step later."""
    t = turbulence_at(-m.x[2], c.w20)
    speed = frozen_airspeed(_three(m.x, 3), _three(c.wind_mean))
    tuv, tw = t.length_uv_m / speed, t.length_w_m / speed
    m.dryden[0] = next_u(m.dryden[0], tuv, t.sigma_uv_mps, c.slow_s, n[28])
    v = next_pair(Pair(m.dryden[1], m.dryden[2]), tuv, t.sigma_uv_mps, c.slow_s, n[29], n[30])
    w = next_pair(Pair(m.dryden[3], m.dryden[4]), tw, t.sigma_w_mps, c.slow_s, n[31], n[32])
    _put(m.dryden, v, 1)
    _put(m.dryden, w, 3)
    return (m.dryden[0], gust_of(v), gust_of(w))


@inlined
def _drift(m: Any, c: Any, n: Any) -> None:
    """Dead reckoning without GPS: the velocity's error walks, the position's is its integral."""
    for i in range(3):
        m.error[3 + i] += _DRIFT_MPS_PER_ROOT_S * sqrt(c.slow_s) * n[9 + i]
        m.error[i] += m.error[3 + i] * c.slow_s


@inlined
def _read_sensors(m: Any, c: Any, n: Any) -> None:
    x, std = _state(m.x), c.sensor_std
    _put(m.readings, noisy(specific_force(_state(m.before), x, c.dt_s), std[0], _three(n, 15)))
    _put(m.readings, noisy((x.p, x.q, x.r), std[1], _three(n, 25)), 3)
    if not c.sensors_lost & _MAG_LOST:
        _put(m.readings, noisy(magnetic_field(x), std[2], _three(n, 18)), 6)
    if not c.sensors_lost & _BARO_LOST:
        m.readings[9] = pressure_hpa(c.ground_altitude - x.d) + std[3] * n[21]
    if c.sensors_lost & _GPS_LOST:
        return
    m.readings[10] = x.n + std[4] * n[22]
    m.readings[11] = x.e + std[4] * n[23]
    m.readings[12] = x.d + std[5] * n[24]


@inlined
def _track_acceleration(m: Any, c: Any) -> None:
    """Low-passed derivative of the estimated velocity."""
    k = _ACCELERATION_KEEP
    for i in range(3):
        m.acceleration[i] = k * m.acceleration[i] + (1.0 - k) * (m.estimate[3 + i] - m.old_velocity[i]) / c.slow_s
        m.old_velocity[i] = m.estimate[3 + i]


@inlined
def _control_position(m: Any, c: Any) -> None:
    """Setpoint to attitude and thrust."""
    s, e, g = m.setpoint, m.estimate, c.position_gains
    gains = PositionGains(
        g[0], g[1], g[2], g[3], g[4], g[5], g[6], g[7], g[8], g[9], g[10], g[11], m.tilt_tangent
    )  # fmt: skip
    out = control_position(
        TrajectorySetpoint(_three(s), _three(s, 3), _three(s, 6), s[9], s[10]),
        Motion(_three(e), _three(e, 3), _three(m.acceleration)),
        _three(m.velocity_integral),
        VelocityLimits(m.speed_limits[0], m.speed_limits[1], m.speed_limits[2]),
        gains,
        c.slow_s,
    )
    _put(m.thrust_ned, out.thrust_ned)
    _put(m.velocity_sp, out.velocity_sp_mps)
    _put(m.acceleration_sp, out.acceleration_sp_mps2)
    if m.hold_integral == 0:
        _put(m.velocity_integral, out.integral_mps2)
    q_sp, size = attitude_from_thrust(out.thrust_ned, s[9])
    _put(m.attitude_sp, q_sp)
    m.thrust_sp = size
    m.rates_ff[2] = s[10] if isfinite(s[10]) else 0.0


@inlined
def _control(m: Any, c: Any) -> Demand:
    """The loops that are engaged, from the outermost in."""
    if m.step % c.slow_every == 0:
        _track_acceleration(m, c)
        if m.engaged == _POSITION:
            _control_position(m, c)
    if m.engaged == _OFF:
        return Demand(0.0, 0.0, 0.0, 0.0)
    if m.engaged == _IDLE:
        return Demand(_IDLE_THRUST, 0.0, 0.0, 0.0)
    if m.engaged >= _ATTITUDE and m.step % c.attitude_every == 0:
        a = c.attitude_gains
        attitude = AttitudeGains((a[0], a[1], a[2]), a[3], (a[4], a[5], a[6]))
        _put(m.rate_sp, rate_setpoint(_four(m.estimate, 6), _four(m.attitude_sp), m.rates_ff[2], attitude))
    gains = RateGains(
        _three(c.rate_p), _three(c.rate_i), _three(c.rate_d), _three(c.rate_ff), _three(c.rate_integral_limit)
    )
    omega = _three(m.estimate, 10)
    out = control_rates(
        _three(m.rate_sp), omega, _three(m.rate_integral), _three(m.smooth_rates), gains, c.rate_keep, c.dt_s
    )
    if m.landed == 0:
        _put(m.rate_integral, out.integral)
    _put(m.smooth_rates, out.smooth_radps)
    return Demand(m.thrust_sp, out.torque[0], out.torque[1], out.torque[2])


@inlined
def _move(m: Any, c: Any) -> None:
    """Rotors and body."""
    rotors = _rotor_model(c)
    limit = rotors.max_speed_radps * top_speed_fraction(m.battery[1], c.pack[0])
    targets = speed_targets(_four(m.fractions), rotors.max_speed_radps, limit)
    h = c.motor_health
    targets = (targets[0] * h[0], targets[1] * h[1], targets[2] * h[2], targets[3] * h[3])
    speeds = lag_speeds(_four(m.rotors), targets, c.lag_keep_up, c.lag_keep_down)
    _put(m.rotors, speeds)
    x = _state(m.x)
    _put(m.before, x)
    across = c.rotor_drag * (speeds[0] + speeds[1] + speeds[2] + speeds[3])
    drag = (c.linear_drag[0] + across, c.linear_drag[1] + across, c.linear_drag[2])
    body = Body(c.mass, _three(c.inertia), drag, c.quadratic_drag)
    x = step_free(x, rotor_wrench(speeds, rotors), _three(m.wind), body, c.dt_s)
    _put(m.x, rest_on_ground(x, c.dt_s))


@inlined
def believe(m: Any, c: Any, n: Any) -> None:
    x = _state(m.x)
    rates = noisy((x.p, x.q, x.r), c.sensor_std[1], _three(n))
    if c.filter:
        _reckon(m, c, n, rates)
        return
    error = EstimateError(_three(m.error), _three(m.error, 3), _three(m.error, 6))
    _put(m.estimate, believed(x, error, rates))


@inlined
def _reckon(m: Any, c: Any, n: Any, gyro: Vector) -> None:
    """The estimator's fast part: dead reckoning with the inertial sensors and their biases."""
    force = noisy(specific_force(_state(m.before), _state(m.x), c.dt_s), c.sensor_std[0], _three(n, 15))
    b, e = m.gyro_bias, m.estimate
    omega = (
        gyro[0] + c.gyro_bias[0] - b[0],
        gyro[1] + c.gyro_bias[1] - b[1],
        gyro[2] + c.gyro_bias[2] - b[2],
    )
    felt = (force[0] + c.accel_bias[0], force[1] + c.accel_bias[1], force[2] + c.accel_bias[2])
    new = dead_reckon(Inertial(_four(e, 6), _three(e, 3), _three(e)), omega, felt, c.dt_s)
    _put(e, new.position_ned_m)
    _put(e, new.velocity_ned_mps, 3)
    _put(e, new.q_wb_wxyz, 6)
    _put(e, omega, 10)


@kernel
def advance(flight: Any, constants: Any, noise: Any, row: int, count: int) -> None:
    """Move `flight` on by `count` steps; step k uses row `row + k` of `noise`."""
    m, c = flight[0], constants[0]
    for k in range(count):
        n = noise[row + k]
        if m.step % c.slow_every == 0:
            _draw(m, c, n)
        demand = _control(m, c)
        _put(m.demand, demand)
        _put(m.fractions, mix(demand))
        _move(m, c)
        believe(m, c, n)
        m.step += 1
