"""How far off the estimate is expected to be: the stationary spread of the estimator's errors, from its gains and the sensors' noise.

Between fixes the errors of one axis move by x' = F x + noise, at each correction x' = (I - K H) x + K noise; over the time between two
GPS fixes that is x' = S x + noise of covariance N, and the covariance P that does not change is P = S P S' + N. Small angles, axes apart,
the GPS's delay left out. Horizontal errors: position, velocity, tilt, gyroscope bias, GPS wander. Vertical: position, velocity,
accelerometer bias, wander of barometer and GPS. A horizontal accelerometer bias adds the constant error that it leads to. SI.
"""

from dataclasses import dataclass
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
from vehicle_sim.sensors import HORIZONTAL_FIELD_GAUSS, WHITE_OF_GPS, wander_of_gps
from vehicle_sim.wind import keep_of

Array = NDArray[np.float64]
_HPA_PER_M = 0.113
_DOUBLINGS = 40


@dataclass(frozen=True)
class Accuracy:
    """Standard deviations: of the estimate on each horizontal axis and of its height; of the innovations of GPS, barometer, compass."""

    position_m: float
    height_m: float
    gps_position_m: float = 0.0
    gps_velocity_mps: float = 0.0
    barometer_m: float = 0.0
    compass_rad: float = 0.0


class _Move(NamedTuple):
    """x' = step x + noise of covariance `noise`."""

    step: Array
    noise: Array

    def then(self, after: "_Move") -> "_Move":
        """This and then the other."""
        return _Move(after.step @ self.step, after.step @ self.noise @ after.step.T + after.noise)


def accuracy_of(config: SensorsConfig, dt_s: float, tick_s: float) -> Accuracy:
    """Of the estimator fed by these sensors; of the error model, what it was told."""
    if config.estimator == "error_model":
        return Accuracy(config.estimate_position_std_m, config.estimate_position_std_m)
    across, down = _horizontal(config, dt_s, tick_s), _vertical(config, dt_s, tick_s)
    white_m = WHITE_OF_GPS * config.gps_horizontal_std_m
    return Accuracy(
        sqrt(across[0, 0]),
        sqrt(down[0, 0]),
        sqrt(across[0, 0] + across[4, 4] - 2.0 * across[0, 4] + white_m**2),
        sqrt(across[1, 1] + config.gps_speed_std_mps**2),
        sqrt(down[0, 0] + down[3, 3] - 2.0 * down[0, 3] + _barometer_white_m(config) ** 2),
        config.magnetometer_std_gauss / HORIZONTAL_FIELD_GAUSS,
    )


def _horizontal(config: SensorsConfig, dt_s: float, tick_s: float) -> Array:
    keep = keep_of(tick_s, config.gps_correlation_s)
    wander = wander_of_gps(config.gps_horizontal_std_m)
    step = np.eye(5)
    step[0, 1] = step[2, 3] = tick_s
    step[1, 2], step[4, 4] = GRAVITY_MPS2 * tick_s, keep
    noise = np.diag([0.0, config.accelerometer_std_mps2**2, config.gyroscope_std_radps**2, 0.0, 0.0]) * dt_s * tick_s
    noise[4, 4] = (1.0 - keep**2) * wander**2
    h, white, speed = 1.0 / config.gps_rate_hz, WHITE_OF_GPS * config.gps_horizontal_std_m, config.gps_speed_std_mps
    gain = np.array([K_VELOCITY * h, K_TILT * h / GRAVITY_MPS2, K_BIAS * K_TILT * h / GRAVITY_MPS2])
    fix, kick = np.eye(5), np.zeros((5, 2))
    fix[0, 0] -= K_POSITION * h
    fix[0, 4] = kick[0, 0] = K_POSITION * h
    fix[1:4, 1] -= gain
    kick[1:4, 1] = gain
    correction = _Move(fix, kick @ np.diag([white**2, speed**2]) @ kick.T)
    push = np.array([0.0, config.accelerometer_bias_std_mps2 * tick_s, 0.0, 0.0, 0.0])
    return _stationary(_Move(step, noise), correction, round(h / tick_s), push)


def _vertical(config: SensorsConfig, dt_s: float, tick_s: float) -> Array:
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
    half = _Move(0.5 * (baro + np.eye(5)), 0.5 * kick @ kick.T * _barometer_white_m(config) ** 2)
    h = 1.0 / config.gps_rate_hz
    fix, gps = np.eye(5), np.zeros((5, 2))
    fix[0, 0] -= K_HEIGHT * h
    fix[0, 4] = gps[0, 0] = K_HEIGHT * h
    fix[1, 1] -= K_CLIMB * h
    gps[1, 1] = K_CLIMB * h
    correction = _Move(fix, gps @ np.diag([white**2, config.gps_speed_std_mps**2]) @ gps.T)
    return _stationary(_Move(step, noise).then(half), correction, round(h / tick_s), np.zeros(5))


def _stationary(free: _Move, correction: _Move, ticks: int, push: Array) -> Array:
    """The covariance before a correction that does not change from one to the next; `push` is a constant change a tick."""
    between, pushed = _Move(np.eye(len(push)), np.zeros((len(push), len(push)))), np.zeros_like(push)
    for _ in range(max(1, ticks)):
        between, pushed = between.then(free), free.step @ pushed + push
    whole = correction.then(between)
    offset = np.linalg.solve(np.eye(len(push)) - whole.step, pushed)
    for _ in range(_DOUBLINGS):
        whole = whole.then(whole)
    return np.asarray(whole.noise + np.outer(offset, offset))


def _barometer_white_m(config: SensorsConfig) -> float:
    return config.barometer_std_hpa / _HPA_PER_M
