"""The flight kernel: control, rotors, battery, wind, body and sensors, one step after another, compiled.

`advance(flight, constants, noise, row, count)` moves the record `flight` on by `count` steps. Order of a step: slow processes when they
are due, controllers from the estimate, rotors, body, then the estimate of the new state, so that estimate and truth are of one time.
"""

from math import isfinite
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
from vehicle_sim.battery import top_speed_fraction
from vehicle_sim.compiled import inlined, kernel
from vehicle_sim.dynamics import Body, rest_on_ground, step_free
from vehicle_sim.memory import Engaged, four, put, rotor_model, state_of, three
from vehicle_sim.rotors import Demand, lag_speeds, mix, rotor_wrench, speed_targets
from vehicle_sim.surroundings import believe, draw_slow

_OFF, _IDLE = int(Engaged.OFF), int(Engaged.IDLE)
_ATTITUDE, _POSITION = int(Engaged.ATTITUDE), int(Engaged.POSITION)
_IDLE_THRUST = 0.05
_ACCELERATION_KEEP = 0.75


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
        TrajectorySetpoint(three(s), three(s, 3), three(s, 6), s[9], s[10]),
        Motion(three(e), three(e, 3), three(m.acceleration)),
        three(m.velocity_integral),
        VelocityLimits(m.speed_limits[0], m.speed_limits[1], m.speed_limits[2]),
        gains,
        c.slow_s,
    )
    put(m.thrust_ned, out.thrust_ned)
    put(m.velocity_sp, out.velocity_sp_mps)
    put(m.acceleration_sp, out.acceleration_sp_mps2)
    if m.hold_integral == 0:
        put(m.velocity_integral, out.integral_mps2)
    q_sp, size = attitude_from_thrust(out.thrust_ned, s[9])
    put(m.attitude_sp, q_sp)
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
        put(m.rate_sp, rate_setpoint(four(m.estimate, 6), four(m.attitude_sp), m.rates_ff[2], attitude))
    gains = RateGains(three(c.rate_p), three(c.rate_i), three(c.rate_d), three(c.rate_ff), three(c.rate_integral_limit))
    omega = three(m.estimate, 10)
    out = control_rates(
        three(m.rate_sp), omega, three(m.rate_integral), three(m.smooth_rates), gains, c.rate_keep, c.dt_s
    )
    if m.landed == 0:
        put(m.rate_integral, out.integral)
    put(m.smooth_rates, out.smooth_radps)
    return Demand(m.thrust_sp, out.torque[0], out.torque[1], out.torque[2])


@inlined
def _move(m: Any, c: Any) -> None:
    """Rotors and body."""
    rotors = rotor_model(c)
    limit = rotors.max_speed_radps * top_speed_fraction(m.battery[1], c.pack[0])
    targets = speed_targets(four(m.fractions), rotors.max_speed_radps, limit)
    h = c.motor_health
    targets = (targets[0] * h[0], targets[1] * h[1], targets[2] * h[2], targets[3] * h[3])
    speeds = lag_speeds(four(m.rotors), targets, c.lag_keep_up, c.lag_keep_down)
    put(m.rotors, speeds)
    x = state_of(m.x)
    put(m.before, x)
    across = c.rotor_drag * (speeds[0] + speeds[1] + speeds[2] + speeds[3])
    drag = (c.linear_drag[0] + across, c.linear_drag[1] + across, c.linear_drag[2])
    body = Body(c.mass, three(c.inertia), drag, c.quadratic_drag)
    x = step_free(x, rotor_wrench(speeds, rotors), three(m.wind), body, c.dt_s)
    put(m.x, rest_on_ground(x, c.dt_s))


@kernel
def advance(flight: Any, constants: Any, noise: Any, row: int, count: int) -> None:
    """Move `flight` on by `count` steps; step k uses row `row + k` of `noise`."""
    m, c = flight[0], constants[0]
    for k in range(count):
        n = noise[row + k]
        if m.step % c.slow_every == 0:
            draw_slow(m, c, n)
        demand = _control(m, c)
        put(m.demand, demand)
        put(m.fractions, mix(demand))
        _move(m, c)
        believe(m, c, n)
        m.step += 1
