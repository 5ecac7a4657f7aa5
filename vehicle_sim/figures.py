"""What the physics and the loops do in flight, as a table of figures beside what they should be: `vehicle-sim --physics`.

Flights are without wind and with a perfect estimate, so that every figure is of the body, the rotors and the loops alone. "PX4's gains"
are its generic defaults; the bundled vehicle's own are tuned to its airframe. SI, NED.
"""

import dataclasses
from collections.abc import Callable, Sequence
from math import hypot, inf, nan, radians, sqrt
from typing import NamedTuple

import numpy as np

from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.setpoints import AttitudeSetpoint, SetpointMessage
from vehicle_sim.config import VehicleConfig
from vehicle_sim.dynamics import GRAVITY_MPS2
from vehicle_sim.linear_loops import StepResponse, linear_step
from vehicle_sim.listing import table
from vehicle_sim.parts import SensorsConfig, WindConfig
from vehicle_sim.rotation import Vector, euler_from_quaternion, quaternion_from_euler
from vehicle_sim.vehicle import Vehicle

PERFECT = SensorsConfig(
    estimator="error_model",
    estimate_position_std_m=0.0,
    estimate_velocity_std_mps=0.0,
    estimate_attitude_std_rad=0.0,
    gyroscope_std_radps=0.0,
)
#: PX4's generic gains, where the bundled vehicle's differ.
PX4_GAINS: dict[str, float | int] = {
    "MPC_XY_P": 0.95,
    "MPC_XY_VEL_P_ACC": 1.8,
    "MPC_XY_VEL_I_ACC": 0.4,
    "MPC_XY_VEL_D_ACC": 0.2,
    "MPC_Z_P": 1.0,
    "MPC_Z_VEL_P_ACC": 4.0,
    "MC_ROLL_P": 6.5,
    "MC_PITCH_P": 6.5,
}
_STILL: Vector = (0.0, 0.0, 0.0)
_TICK_S = 0.02
_HIGH_M = 30.0


class Figure(NamedTuple):
    """A row: what the simulation gives and what it should be, both as text."""

    name: str
    simulated: str
    expected: str
    by: str


def in_the_air(config: VehicleConfig, seed: int = 1) -> Vehicle:
    """At rest under OFFBOARD, `_HIGH_M` up, without wind or errors."""
    calm = dataclasses.replace(config, sensors=PERFECT, wind=WindConfig(), failures=())
    vehicle = Vehicle(calm, seed)
    for k in range(round(30.0 / _TICK_S)):
        ask(vehicle, place=(0.0, 0.0, -_HIGH_M))
        if k == 230:
            vehicle.autopilot.request_mode(Mode.OFFBOARD)
            vehicle.autopilot.request_arm()
        _tick(vehicle)
    return vehicle


def ask(vehicle: Vehicle, place: Vector = (nan, nan, nan), velocity: Vector = (nan, nan, nan)) -> None:
    """One OFFBOARD set-point; NaN leaves an axis alone."""
    message = SetpointMessage(1, 0b111 << 6, place, velocity, _STILL, 0.0, 0.0)
    vehicle.autopilot.receive_setpoint(message, vehicle.estimate)


def rate_step(vehicle: Vehicle, rate_radps: float = 1.0) -> StepResponse:
    """Roll rate, from rest."""
    thrust = float(vehicle.flight.get("thrust_sp"))

    def give() -> None:
        vehicle.autopilot.receive_attitude(AttitudeSetpoint(None, (rate_radps, 0.0, 0.0), thrust))

    return _step(vehicle, give, lambda: vehicle.state.p / rate_radps, 0.4)


def attitude_step(vehicle: Vehicle, roll_rad: float = radians(10.0)) -> StepResponse:
    """Roll, from level."""
    thrust = float(vehicle.flight.get("thrust_sp"))

    def give() -> None:
        q_sp = quaternion_from_euler(roll_rad, 0.0, 0.0)
        vehicle.autopilot.receive_attitude(AttitudeSetpoint(q_sp, _STILL, thrust))

    return _step(vehicle, give, lambda: euler_from_quaternion(vehicle.state.q_wb_wxyz).roll_rad / roll_rad, 1.5)


def velocity_step(vehicle: Vehicle, speed_mps: float = 1.0) -> StepResponse:
    """Velocity north, from hover."""

    def give() -> None:
        ask(vehicle, (nan, nan, -_HIGH_M), (speed_mps, 0.0, nan))

    return _step(vehicle, give, lambda: vehicle.state.vn / speed_mps, 8.0)


def leg_lag_m(vehicle: Vehicle, length_m: float = 10.0, duration_s: float = 6.0) -> tuple[float, float]:
    """A minimum-jerk leg by position and velocity: rms and largest distance behind."""
    lags = []
    for k in range(round(duration_s / _TICK_S)):
        s = k * _TICK_S / duration_s
        place = length_m * (10 * s**3 - 15 * s**4 + 6 * s**5)
        speed = length_m / duration_s * (30 * s**2 - 60 * s**3 + 30 * s**4)
        ask(vehicle, (place, 0.0, -_HIGH_M), (speed, 0.0, 0.0))
        _tick(vehicle)
        lags.append(abs(place - vehicle.state.n))
    return sqrt(sum(lag * lag for lag in lags) / len(lags)), max(lags)


def fall(vehicle: Vehicle, seconds: float) -> float:
    """Downward speed so long after all motors stopped, m/s."""
    vehicle.constants.motor_health[:] = 0.0
    vehicle.flight.rotors[:] = 0.0
    vehicle.advance(round(seconds * 1e6) // vehicle.step_us)
    return vehicle.state.vd


def touchdown_mps(vehicle: Vehicle) -> float:
    """Speed at which Land meets the ground."""
    vehicle.autopilot.request_mode(Mode.LAND)
    speed = 0.0
    while vehicle.state.d < -0.01:
        speed = vehicle.state.vd
        _tick(vehicle)
    return speed


def physics_figures(config: VehicleConfig) -> list[Figure]:
    """All of them, for this airframe."""
    a, hovering = config.airframe, in_the_air(config)
    weight_n = a.mass_kg * GRAVITY_MPS2
    speed = sum(hovering.speeds_radps) / 4.0
    hover = sqrt(weight_n / 4.0 / a.thrust_coefficient_n_per_radps2)
    rows = [
        Figure("hover, rotor speed", f"{speed:.0f} rad/s", f"{hover:.0f} rad/s", "weight = 4 k w^2"),
        Figure(
            "fall after 1 s",
            f"{fall(in_the_air(config), 1.0):.2f} m/s",
            f"< {GRAVITY_MPS2:.2f} m/s",
            "free fall less drag",
        ),
    ]
    high = in_the_air(config)
    high.flight.x[2] = high.flight.before[2] = -5000.0
    terminal = fall(high, 40.0)
    rows.append(Figure("terminal speed", f"{terminal:.1f} m/s", f"{_terminal_mps(config):.1f} m/s", "drag = weight"))
    rows.append(
        Figure(
            "touch-down of Land",
            f"{touchdown_mps(in_the_air(config)):.2f} m/s",
            f"{hovering.autopilot.parameters['MPC_LAND_SPEED']:.2f} m/s",
            "MPC_LAND_SPEED",
        )
    )
    px4 = dataclasses.replace(config, parameters={**config.parameters, **PX4_GAINS})
    for gains, chosen in (("own gains", config), ("PX4's gains", px4)):
        for loop, step in STEPS.items():
            vehicle = in_the_air(chosen)
            linear = linear_step(loop, vehicle.autopilot.parameters, a)
            rows.append(
                Figure(
                    f"step of {loop}, {gains}", _text(step(vehicle)), _text(linear), "linear model of the same loops"
                )
            )
    rms, worst = leg_lag_m(in_the_air(px4))
    rows.append(
        Figure(
            "10 m leg in 6 s, PX4's gains",
            f"lag {rms:.2f} m rms, {worst:.2f} m",
            "0.85 m rms, 1.4 m",
            "measured on PX4",
        )
    )
    rows.append(_estimate_figure(config))
    return rows


def _estimate_figure(config: VehicleConfig) -> Figure:
    """Horizontal error of the estimate with this configuration's sensors, standing: eight seeds of two minutes."""
    errors: list[float] = []
    for seed in range(1, 9):
        vehicle = Vehicle(config, seed)
        for _ in range(120):
            vehicle.advance(round(1e6) // vehicle.step_us)
            (n, e, _), x = vehicle.estimate.position_ned_m, vehicle.state
            errors.append(hypot(n - x.n, e - x.e))
    text = f"{sorted(errors)[len(errors) // 2]:.2f} m median, {max(errors):.2f} m"
    return Figure(f"estimate ({config.sensors.estimator}), horizontal", text, "0.3 m median, 0.7 m", "measured on PX4")


STEPS: dict[str, Callable[[Vehicle], StepResponse]] = {
    "rate": rate_step,
    "attitude": attitude_step,
    "velocity": velocity_step,
}


def _text(r: StepResponse) -> str:
    return f"rise {r.rise_s:.3f} s, overshoot {100 * r.overshoot:.0f} %"


def describe(rows: Sequence[Figure]) -> str:
    """The table that is printed."""
    return table(("figure", "simulated", "expected", "by"), rows)


def _terminal_mps(config: VehicleConfig) -> float:
    """c1 v + c2 v^2 = m g, with the axes level."""
    a = config.airframe
    linear, square = a.linear_drag_n_per_mps[2], a.quadratic_drag_n_per_mps2
    weight_n = a.mass_kg * GRAVITY_MPS2
    if square == 0.0:
        return weight_n / linear if linear > 0.0 else inf
    return (sqrt(linear**2 + 4.0 * square * weight_n) - linear) / (2.0 * square)


def _step(vehicle: Vehicle, give: Callable[[], None], share: Callable[[], float], seconds: float) -> StepResponse:
    """`share` is how much of the step there is; the set-point is given anew every 20 ms."""
    dt_s, seen = vehicle.step_us * 1e-6, []
    for k in range(round(seconds / dt_s)):
        if k % 8 == 0:
            give()
        vehicle.advance(1)
        seen.append(share())
    return StepResponse.of(np.array(seen), dt_s)


def _tick(vehicle: Vehicle) -> None:
    vehicle.advance(round(_TICK_S * 1e6) // vehicle.step_us)
