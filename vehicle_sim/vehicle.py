"""The vehicle: physics, sensors and autopilot advanced together, one fixed step at a time. No I/O.

Units SI, NED/FRD, time in integer microseconds since boot (the only clock of the whole process).
"""

from math import ceil, exp, radians

from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.battery import fresh_battery, step_battery, top_speed_fraction
from vehicle_sim.config import VehicleConfig
from vehicle_sim.dynamics import GRAVITY_MPS2, Body, rest_on_ground, specific_force, state_at_rest, step_free
from vehicle_sim.geo import GeoFrame
from vehicle_sim.noise import spawn_sources
from vehicle_sim.rotors import Four, RotorModel, Wrench, lag_speeds, mix
from vehicle_sim.sensors import SENSOR_SOURCES, ErrorModel, Readings, estimate_of, initial_error, noisy, read_sensors
from vehicle_sim.wind import WindModel

_MAX_STEP_US = 2500
_SLOW_US = 10_000


def step_for_period_us(period_us: int) -> int:
    """The longest physics step of at most 2.5 ms that divides the control period."""
    count = ceil(period_us / _MAX_STEP_US)
    while period_us % count:
        count += 1
    return period_us // count


class Vehicle:
    """Truth, estimate and autopilot of one quadcopter."""

    def __init__(self, config: VehicleConfig, seed: int, period_us: int = 20_000) -> None:
        self.config = config
        self.step_us = step_for_period_us(period_us)
        self.t_us = 0
        self._dt_s = self.step_us * 1e-6
        self._slow_every = max(1, _SLOW_US // self.step_us)
        self._steps = 0
        self.noise = spawn_sources(seed, ("wind", *SENSOR_SOURCES))
        slow_s = self._slow_every * self._dt_s
        self._slow_s = slow_s
        self.body = Body.of(config.airframe)
        self.rotors = RotorModel.of(config.airframe)
        self.geo = GeoFrame.at(config.home)
        self._wind = WindModel.of(config.wind, slow_s)
        self._gust = (0.0, 0.0, 0.0)
        self._windless = config.wind.gust_std_mps == (0.0, 0.0, 0.0)
        self.wind_ned_mps = self._wind.velocity(self._gust)
        self._lag_keep = exp(-self._dt_s / self.rotors.time_constant_s)
        self._errors = ErrorModel.of(config.sensors, slow_s)
        self._error = initial_error(config.sensors, self.noise["estimate"])
        self._gyroscope = self.noise["gyroscope"]
        self.state = state_at_rest(radians(config.initial_yaw_deg))
        self.previous = self.state
        self.speeds_radps: Four = (0.0, 0.0, 0.0, 0.0)
        self.fractions: Four = (0.0, 0.0, 0.0, 0.0)
        self.wrench = Wrench(0.0, 0.0, 0.0, 0.0)
        self.battery = fresh_battery(config.battery)
        hover = config.airframe.mass_kg * GRAVITY_MPS2 / (4.0 * config.airframe.max_thrust_n)
        self.autopilot = Autopilot(ParameterStore(config.parameters, hover), self._dt_s)
        self.estimate = estimate_of(self.state, self._error, (0.0, 0.0, 0.0))
        self.readings: Readings = self._read_sensors()

    @property
    def t_s(self) -> float:
        """Seconds since boot."""
        return self.t_us * 1e-6

    def step(self) -> None:
        """Advance by `step_us`: estimate, autopilot, rotors, body."""
        if self._steps % self._slow_every == 0:
            self._advance_slow()
        self._steps += 1
        x = self.state
        rates = noisy(x.omega_wb_b_radps, self.config.sensors.gyroscope_std_radps, self._gyroscope)
        self.estimate = estimate_of(x, self._error, rates)
        self.fractions = mix(self.autopilot.update(self.t_us * 1e-6, self.estimate, self.battery.charge))
        limit = self.rotors.max_speed_radps * top_speed_fraction(self.battery, self.config.battery)
        targets = self.rotors.speed_targets(self.fractions, limit)
        self.speeds_radps = lag_speeds(self.speeds_radps, targets, self._lag_keep)
        self.wrench = self.rotors.wrench(self.speeds_radps)
        self.previous = x
        self.state = rest_on_ground(step_free(x, self.wrench, self.wind_ned_mps, self.body, self._dt_s), self._dt_s)
        self.t_us += self.step_us

    def specific_force_mps2(self) -> tuple[float, float, float]:
        """What the accelerometer feels, without noise, body axes."""
        return specific_force(self.previous, self.state, self._dt_s)

    def _advance_slow(self) -> None:
        self._error = self._errors.next_error(self._error, self.noise["estimate"])
        if self._steps % (2 * self._slow_every) == 0:
            self.readings = self._read_sensors()
        self.battery = step_battery(self.battery, self.speeds_radps, self.rotors, self.config.battery, self._slow_s)
        if not self._windless:
            self._gust = self._wind.next_gust(self._gust, self.noise["wind"].three())
            self.wind_ned_mps = self._wind.velocity(self._gust)

    def _read_sensors(self) -> Readings:
        """On a schedule of its own, so that who listens changes nothing."""
        force = self.specific_force_mps2()
        return read_sensors(self.state, force, self.config.sensors, self.config.home.altitude_m, self.noise)
