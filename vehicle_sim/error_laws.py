"""How the estimator's errors move, an axis at a time, as covariances: from tick to tick, and at the corrections of a GPS fix.

Between fixes the errors of one axis move by x' = F x + noise, at each correction x' = (I - K H) x + K noise. Small angles, axes apart, the
GPS's delay left out. Horizontal errors: position, velocity, tilt, gyroscope bias, GPS wander, accelerometer bias (which nothing corrects).
Vertical: position, velocity, accelerometer bias, wander of barometer and GPS. Error model: position, velocity. SI.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.dynamics import GRAVITY_MPS2
from vehicle_sim.estimator import (
    K_BARO,
    K_BARO_BIAS,
    K_BARO_CLIMB,
    K_BIAS,
    K_CLIMB,
    K_HEIGHT,
    K_POSITION,
    K_TILT,
    K_VELOCITY,
)
from vehicle_sim.parts import SensorsConfig
from vehicle_sim.sensors import WHITE_OF_GPS, ErrorModel, wander_of_gps
from vehicle_sim.surroundings import DRIFT_MPS_PER_ROOT_S
from vehicle_sim.wind import keep_of

Array = NDArray[np.float64]
_HPA_PER_M = 0.113
_LONG = 1 << 40  # fixes after which nothing changes any more


class Move(NamedTuple):
    """x' = step x + noise of covariance `noise`."""

    step: Array
    noise: Array

    def then(self, after: "Move") -> "Move":
        """This and then the other."""
        return Move(after.step @ self.step, after.step @ self.noise @ after.step.T + after.noise)

    def spread(self, covariance: Array) -> Array:
        """The covariance of x' from that of x."""
        return np.asarray(self.step @ covariance @ self.step.T + self.noise)


class Repeated:
    """A move many times over; its doublings are kept, so that a covariance is carried on in a few products."""

    def __init__(self, move: Move) -> None:
        self._doubled = [move]

    def spread(self, covariance: Array, count: int) -> Array:
        """The covariance after `count` times."""
        for k in range(count.bit_length()):
            if k == len(self._doubled):
                self._doubled.append(self._doubled[-1].then(self._doubled[-1]))
            if count >> k & 1:
                covariance = self._doubled[k].spread(covariance)
        return covariance


class Phase(NamedTuple):
    """An axis with barometer or without: a tick without GPS; from before one GPS fix to before the next; the same when the
    first fix after a long time without is believed at once.
    """

    coasting: Repeated
    cycle: Repeated
    reset: Move


class Law(NamedTuple):
    """One axis: with barometer and without; the covariance at boot; ticks from one fix to the next, and from a GPS that is there
    (again) to before the first fix that arrives.
    """

    with_barometer: Phase
    without: Phase
    begins: Array
    ticks_per_fix: int
    ticks_to_first: int

    def settled(self) -> Array:
        """The covariance before a fix that does not change any more: P = S P S' + N."""
        return self.with_barometer.cycle.spread(self.begins, _LONG)


def laws_of(config: SensorsConfig, dt_s: float, tick_s: float) -> tuple[Law, Law]:
    """A horizontal axis and the vertical one, with an autopilot that ticks every `tick_s` and is felt every `dt_s`."""
    if config.estimator == "error_model":
        law = _error_model(config, tick_s)
        return law, law
    return _horizontal(config, dt_s, tick_s), _vertical(config, dt_s, tick_s)


def barometer_white_m(config: SensorsConfig) -> float:
    """The barometer's white noise as a height."""
    return config.barometer_std_hpa / _HPA_PER_M


def _ticks(config: SensorsConfig, tick_s: float) -> tuple[int, int]:
    interval = max(1, round(1.0 / (config.gps_rate_hz * tick_s)))
    return interval, interval + round(config.gps_delay_s / tick_s)


def _still(size: int) -> Move:
    """Nothing happens."""
    return Move(np.eye(size), np.zeros((size, size)))


def _phase(coasting: Move, tick: Move, fix: Move, reset: Move, ticks_per_fix: int) -> Phase:
    between = _still(len(tick.step))
    for _ in range(ticks_per_fix):
        between = between.then(tick)
    return Phase(Repeated(coasting), Repeated(fix.then(between)), reset.then(between))


def _horizontal(config: SensorsConfig, dt_s: float, tick_s: float) -> Law:
    keep = keep_of(tick_s, config.gps_correlation_s)
    wander, white = wander_of_gps(config.gps_horizontal_std_m), WHITE_OF_GPS * config.gps_horizontal_std_m
    step = np.eye(6)
    step[0, 1] = step[2, 3] = step[1, 5] = tick_s
    step[1, 2], step[4, 4] = GRAVITY_MPS2 * tick_s, keep
    noise = (
        np.diag([0.0, config.accelerometer_std_mps2**2, config.gyroscope_std_radps**2, 0.0, 0.0, 0.0]) * dt_s * tick_s
    )
    noise[4, 4] = (1.0 - keep**2) * wander**2
    free, h = Move(step, noise), 1.0 / config.gps_rate_hz
    gain = np.array([K_VELOCITY * h, K_TILT * h / GRAVITY_MPS2, K_BIAS * K_TILT * h / GRAVITY_MPS2])
    correct, kick = np.eye(6), np.zeros((6, 2))
    correct[0, 0] -= K_POSITION * h
    correct[0, 4] = kick[0, 0] = K_POSITION * h
    correct[1:4, 1] -= gain
    kick[1:4, 1] = gain
    measured = np.diag([white**2, config.gps_speed_std_mps**2])
    fix = Move(correct, kick @ measured @ kick.T)
    believed, anew = np.eye(6), np.zeros((6, 6))  # position is the fix's, wander and all, and so is velocity
    believed[:2] = 0.0
    believed[0, 4] = 1.0
    anew[:2, :2] = measured
    unknown = [config.gyroscope_bias_std_radps, wander, config.accelerometer_bias_std_mps2]
    begins = np.diag([0.0, 0.0, 0.0, *unknown]) ** 2
    per_fix, to_first = _ticks(config, tick_s)
    phase = _phase(free, free, fix, Move(believed, anew), per_fix)
    return Law(phase, phase, begins, per_fix, to_first)


def _vertical(config: SensorsConfig, dt_s: float, tick_s: float) -> Law:
    keep = keep_of(tick_s, config.gps_correlation_s)
    wander, white = wander_of_gps(config.gps_vertical_std_m), WHITE_OF_GPS * config.gps_vertical_std_m
    step = np.diag([1.0, 1.0, 1.0, keep, keep])
    step[0, 1] = step[1, 2] = tick_s
    noise = np.diag([0.0, config.accelerometer_std_mps2**2 * dt_s * tick_s, 0.0, 0.0, 0.0])
    noise[3, 3] = (1.0 - keep**2) * config.barometer_drift_std_m**2
    noise[4, 4] = (1.0 - keep**2) * wander**2
    baro, kick = np.eye(5), np.array([[K_BARO], [K_BARO_CLIMB], [K_BARO_BIAS], [0.0], [0.0]])
    baro[:3, 0] -= kick[:3, 0]
    baro[:3, 3] = kick[:3, 0]
    # the barometer has something new every second tick: half of its gains and noise in each
    half = Move(0.5 * (baro + np.eye(5)), 0.5 * kick @ kick.T * barometer_white_m(config) ** 2)
    free = Move(step, noise)
    h, measured = 1.0 / config.gps_rate_hz, np.diag([white**2, config.gps_speed_std_mps**2])
    aided, slow = free.then(half), _climb_fix(K_HEIGHT * h, K_CLIMB * h, measured)
    quick = _climb_fix(K_POSITION * h, K_VELOCITY * h, measured)
    begins = np.diag([0.0, 0.0, config.accelerometer_bias_std_mps2, config.barometer_drift_std_m, wander]) ** 2
    per_fix, to_first = _ticks(config, tick_s)
    with_barometer = _phase(aided, aided, slow, _still(5), per_fix)
    return Law(with_barometer, _phase(free, free, quick, _still(5), per_fix), begins, per_fix, to_first)


def _climb_fix(k_height: float, k_climb: float, measured: Array) -> Move:
    fix, kick = np.eye(5), np.zeros((5, 2))
    fix[0, 0] -= k_height
    fix[0, 4] = kick[0, 0] = k_height
    fix[1, 1] -= k_climb
    kick[1, 1] = k_climb
    return Move(fix, kick @ measured @ kick.T)


def _error_model(config: SensorsConfig, tick_s: float) -> Law:
    """Each error keeps to its spread; without GPS the velocity's walks and the position's is its integral."""
    model = ErrorModel.of(config, tick_s)
    kept = Move(model.keep * np.eye(2), np.diag([model.position_kick_m**2, model.velocity_kick_mps**2]))
    walk = DRIFT_MPS_PER_ROOT_S * sqrt(tick_s) * np.array([[tick_s], [1.0]])
    coasting = Move(np.array([[1.0, tick_s], [0.0, 1.0]]), walk @ walk.T)
    begins = np.diag([config.estimate_position_std_m**2, config.estimate_velocity_std_mps**2])
    phase = _phase(coasting, kept, _still(2), _still(2), 1)
    return Law(phase, phase, begins, 1, 0)
