"""The vehicle: physics, sensors and autopilot advanced together, one fixed step at a time. No I/O.

The fast part (400 steps a second) is the compiled kernel of `flight`; between its calls the autopilot ticks at 100 Hz. Units SI, NED/FRD,
time in integer microseconds since boot (the only clock of the whole process).
"""

from math import ceil, inf, radians

import numpy as np

from vehicle_sim.accuracy import AccuracyInFlight, accuracy_of
from vehicle_sim.autopilot.autopilot import Autopilot
from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.battery import BatteryState, fresh_battery
from vehicle_sim.compiled import is_cached, plain
from vehicle_sim.config import VehicleConfig
from vehicle_sim.constants import write_constants
from vehicle_sim.dynamics import GRAVITY_MPS2, State, specific_force, state_at_rest
from vehicle_sim.failures import Failure, Failures
from vehicle_sim.flight import advance
from vehicle_sim.geo import GeoFrame
from vehicle_sim.memory import FLIGHT, Fields
from vehicle_sim.noise import NOISE_COLUMNS, NoiseTable
from vehicle_sim.obstacles import RangeSensor
from vehicle_sim.parts import SensorsConfig
from vehicle_sim.rotation import Vector
from vehicle_sim.rotors import Four
from vehicle_sim.sensors import ErrorModel, Estimate, Readings, pressure_hpa
from vehicle_sim.surroundings import believe
from vehicle_sim.wind import discrete_gust

_MAX_STEP_US = 2500
_SLOW_US = 10_000
_NOISE_ROWS = 1024


def step_for_period_us(period_us: int) -> int:
    """The longest physics step of at most 2.5 ms that divides the control period."""
    count = ceil(period_us / _MAX_STEP_US)
    while period_us % count:
        count += 1
    return period_us // count


class Vehicle:
    """Truth, estimate and autopilot of one quadcopter."""

    def __init__(
        self, config: VehicleConfig, seed: int, period_us: int = 20_000, range_sensor: RangeSensor | None = None
    ) -> None:
        self.config = config
        self.range_sensor = range_sensor
        self.step_us = step_for_period_us(period_us)
        self.t_us = 0
        self._slow_every = max(1, _SLOW_US // self.step_us)
        self._steps = 0
        self._noise = NoiseTable(seed, NOISE_COLUMNS, _NOISE_ROWS)
        self._row = 0
        dt_s = self.step_us * 1e-6
        self.flight, self.constants = Fields(FLIGHT), write_constants(config, dt_s, self._slow_every)
        self.accuracy = accuracy_of(config.sensors, dt_s, self._slow_every * dt_s)
        self._accuracy = AccuracyInFlight(config.sensors, dt_s, self._slow_every * dt_s)
        self._set_at_rest(seed)
        self.geo = GeoFrame.at(config.home)
        hover = config.airframe.mass_kg * GRAVITY_MPS2 / (4.0 * config.airframe.max_thrust_n)
        self.autopilot = Autopilot(_parameters(config, hover), self.flight, self.constants)
        self.failures = Failures(tuple(Failure(**vars(f)) for f in config.failures), self.flight, self.constants)
        self._estimate: Estimate | None = None
        self._aided_us = 0
        self._advance = advance

    @property
    def t_s(self) -> float:
        """Seconds since boot."""
        return self.t_us * 1e-6

    @property
    def state(self) -> State:
        """Truth."""
        return State(*self.flight.x.tolist())

    @state.setter
    def state(self, state: State) -> None:
        self.flight.x[:] = state
        self.flight.before[:] = state
        believe(self.flight.record[0], self.constants.record[0], self._noise.values[self._row])
        self._estimate = None

    @property
    def estimate(self) -> Estimate:
        """What the autopilot believes; built once an instant."""
        if self._estimate is None:
            n, e, d, vn, ve, vd, w, i, j, k, p, q, r = self.flight.estimate.tolist()
            self._estimate = Estimate((n, e, d), (vn, ve, vd), (w, i, j, k), (p, q, r))
        return self._estimate

    def accuracy_now(self) -> tuple[float, float]:
        """Standard deviations of the estimate on each horizontal axis and of its height, m; `accuracy` is what they settle to."""
        return self._accuracy.at(self.t_s, self.failures.history)

    @property
    def readings(self) -> Readings:
        """The raw sensors' last sample."""
        r = self.flight.readings.tolist()
        field, place, velocity = (r[6], r[7], r[8]), (r[10], r[11], r[12]), (r[13], r[14], r[15])
        return Readings((r[0], r[1], r[2]), (r[3], r[4], r[5]), field, r[9], place, velocity)

    @property
    def battery(self) -> BatteryState:
        """The pack."""
        return BatteryState(*self.flight.battery.tolist())

    @property
    def fractions(self) -> Four:
        """Shares of full thrust asked of the rotors."""
        a, b, c, d = self.flight.fractions.tolist()
        return (a, b, c, d)

    @property
    def speeds_radps(self) -> Four:
        """Rotor speeds."""
        a, b, c, d = self.flight.rotors.tolist()
        return (a, b, c, d)

    @property
    def wind_ned_mps(self) -> Vector:
        """Mean and gust."""
        n, e, d = self.flight.wind.tolist()
        return (n, e, d)

    @property
    def is_quick_to_start(self) -> bool:
        """The kernel has been compiled by an earlier run; else `warm_up` takes seconds."""
        return is_cached(advance)

    def warm_up(self) -> None:
        """Load the kernel, or compile it, so that the first step takes no longer than others. Touches nothing that flies."""
        advance(self.flight.record.copy(), self.constants.record.copy(), self._noise.values[:1].copy(), 0, 0)

    def fly_compiled(self, compiled: bool) -> None:
        """By machine code, or by the same code as plain Python while the compiler works: both give the same bits."""
        self._advance = advance if compiled else plain(advance)

    def step(self) -> None:
        """Advance by one step."""
        self.advance(1)

    def steps_until(self, t_us: int) -> int:
        """Steps until the time is reached or passed."""
        return -((self.t_us - t_us) // self.step_us)

    def advance(self, count: int) -> None:
        """Advance by `count` steps; the autopilot ticks every 10 ms."""
        while count > 0:
            phase = self._steps % self._slow_every
            if phase == 0:
                self.failures.update(self.t_us * 1e-6)
                if self.config.wind.discrete_gusts:
                    self.constants.discrete_gust[:] = discrete_gust(self.config.wind.discrete_gusts, self.t_us * 1e-6)
                self.autopilot.commander.health.estimate_good = self._is_position_known()
                self.autopilot.tick(self.t_us * 1e-6, self.estimate, float(self.flight.battery[0]))
            if self._row == _NOISE_ROWS:
                self._noise.refill()
                self._row = 0
            batch = min(count, self._slow_every - phase, _NOISE_ROWS - self._row)
            self._advance(self.flight.record, self.constants.record, self._noise.values, self._row, batch)
            self._row += batch
            self._steps += batch
            self.t_us += batch * self.step_us
            self._estimate = None
            count -= batch

    def _is_position_known(self) -> bool:
        """GPS is there, or was so short a time ago that dead reckoning will do."""
        if not self.failures.gps_lost:
            self._aided_us = self.t_us
        return self.t_us - self._aided_us <= self.autopilot.parameters.integer("EKF2_NOAID_TOUT")

    def inject_failure(self, unit: int | None, kind: int | None, instance: int) -> bool:
        """MAV_CMD_INJECT_FAILURE; false when this vehicle cannot fail so."""
        return self.failures.inject(unit, kind, instance)

    def specific_force_mps2(self) -> Vector:
        """What the accelerometer feels, without noise, body axes."""
        return specific_force(State(*self.flight.before.tolist()), self.state, self.step_us * 1e-6)

    def _set_at_rest(self, seed: int) -> None:
        """Standing at the origin; errors drawn from their stationary distribution, so that boot is not special."""
        f, c, sensors = self.flight, self.constants, self.config.sensors
        x = state_at_rest(radians(self.config.initial_yaw_deg))
        f.x[:] = x
        f.before[:] = x
        f.wind[:] = c.wind_mean
        f.battery[:] = fresh_battery(self.config.battery)
        first = self._noise.values[0]
        f.error[:] = first[6:15] * _error_spread(sensors)
        f.readings[9] = pressure_hpa(self.config.home.altitude_m)
        biases = np.random.default_rng(np.random.SeedSequence(seed).spawn(len(NOISE_COLUMNS) + 1)[-1])
        c.gyro_bias[:] = sensors.gyroscope_bias_std_radps * biases.standard_normal(3)
        c.accel_bias[:] = sensors.accelerometer_bias_std_mps2 * biases.standard_normal(3)
        c.field_bias[:] = sensors.magnetometer_bias_std_gauss * biases.standard_normal(3)
        f.estimate[:] = x
        believe(f.record[0], c.record[0], first)
        self._row = 1


def _parameters(config: VehicleConfig, hover_thrust: float) -> ParameterStore:
    """The table with what the configuration says of the vehicle."""
    described = {
        "MAV_SYS_ID": config.system_id,
        "BAT1_N_CELLS": config.battery.cells,
        "BAT1_CAPACITY": 1e3 * config.battery.capacity_ah,
    }
    return ParameterStore({**described, **config.parameters}, hover_thrust)


def _error_spread(sensors: SensorsConfig) -> list[float]:
    stationary = ErrorModel.of(sensors, inf)
    return [kick for kick in stationary[1:] for _ in range(3)]
