"""Raw sensors with white noise, and the estimate.

There is no estimation filter: the estimate is the truth plus first-order Gauss-Markov errors, which is what a converged
filter leaves over. Raw sensors feed the telemetry (HIGHRES_IMU, GPS_RAW_INT, SCALED_PRESSURE) and the gyroscope the rate loop.

    b' = a b + sigma sqrt(1 - a^2) n,  a = exp(-dt / T)
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, sqrt
from typing import NamedTuple

from vehicle_sim.config import SensorsConfig
from vehicle_sim.dynamics import State
from vehicle_sim.noise import NoiseSource
from vehicle_sim.rotation import Quaternion, Vector, normalize, quaternion_multiply, rotate_back

SENSOR_SOURCES = ("estimate", "gyroscope", "accelerometer", "magnetometer", "barometer", "gps")
#: Earth's field in NED (gauss), mid-European.
MAGNETIC_FIELD_NED_GAUSS: Vector = (0.212, 0.012, 0.427)
_SEA_LEVEL_HPA = 1013.25
TEMPERATURE_C = 25.0


class Estimate(NamedTuple):
    """What the autopilot believes: local NED, q_wb_wxyz, body rates."""

    position_ned_m: Vector
    velocity_ned_mps: Vector
    q_wb_wxyz: Quaternion
    omega_wb_b_radps: Vector


class Readings(NamedTuple):
    """One sample of every raw sensor, body axes where they apply."""

    specific_force_mps2: Vector
    gyroscope_radps: Vector
    magnetometer_gauss: Vector
    pressure_hpa: float
    gps_ned_m: Vector


class EstimateError(NamedTuple):
    """Gauss-Markov errors: position (m), velocity (m/s), small rotation about body axes (rad)."""

    position_m: Vector
    velocity_mps: Vector
    attitude_rad: Vector


@dataclass(frozen=True)
class ErrorModel:
    """The Gauss-Markov recursion for one fixed step."""

    keep: float
    position_kick_m: float
    velocity_kick_mps: float
    attitude_kick_rad: float

    @classmethod
    def of(cls, config: SensorsConfig, dt_s: float) -> "ErrorModel":
        """Standard deviations and correlation time of the configuration."""
        keep = exp(-dt_s / config.estimate_correlation_s)
        spread = sqrt(1.0 - keep * keep)
        return cls(
            keep,
            config.estimate_position_std_m * spread,
            config.estimate_velocity_std_mps * spread,
            config.estimate_attitude_std_rad * spread,
        )

    def next_error(self, error: EstimateError, noise: NoiseSource) -> EstimateError:
        """The errors one step later."""
        return EstimateError(
            self._next(error.position_m, self.position_kick_m, noise.three()),
            self._next(error.velocity_mps, self.velocity_kick_mps, noise.three()),
            self._next(error.attitude_rad, self.attitude_kick_rad, noise.three()),
        )

    def _next(self, value: Vector, kick: float, normal: Vector) -> Vector:
        a = self.keep
        return (a * value[0] + kick * normal[0], a * value[1] + kick * normal[1], a * value[2] + kick * normal[2])


NO_ERROR = EstimateError((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def initial_error(config: SensorsConfig, noise: NoiseSource) -> EstimateError:
    """Errors drawn from their stationary distribution, so that boot is not special."""
    return ErrorModel(
        0.0, config.estimate_position_std_m, config.estimate_velocity_std_mps, config.estimate_attitude_std_rad
    ).next_error(NO_ERROR, noise)


def estimate_of(x: State, error: EstimateError, omega_wb_b_radps: Vector) -> Estimate:
    """Truth plus error; the rates are the gyroscope's."""
    dp, dv, da = error
    tilt = (1.0, 0.5 * da[0], 0.5 * da[1], 0.5 * da[2])
    return Estimate(
        (x.n + dp[0], x.e + dp[1], x.d + dp[2]),
        (x.vn + dv[0], x.ve + dv[1], x.vd + dv[2]),
        normalize(quaternion_multiply(x.q_wb_wxyz, tilt)),
        omega_wb_b_radps,
    )


def noisy(value: Vector, std: float, noise: NoiseSource) -> Vector:
    """A three-axis reading with white noise."""
    a, b, c = noise.three()
    return (value[0] + std * a, value[1] + std * b, value[2] + std * c)


def read_sensors(
    x: State,
    specific_force_mps2: Vector,
    config: SensorsConfig,
    ground_altitude_m: float,
    noise: Mapping[str, NoiseSource],
) -> Readings:
    """Sample every sensor; `ground_altitude_m` is the local origin's, above mean sea level."""
    a, b, c = noise["gps"].three()
    horizontal, vertical = config.gps_horizontal_std_m, config.gps_vertical_std_m
    return Readings(
        noisy(specific_force_mps2, config.accelerometer_std_mps2, noise["accelerometer"]),
        noisy(x.omega_wb_b_radps, config.gyroscope_std_radps, noise["gyroscope"]),
        noisy(magnetic_field(x), config.magnetometer_std_gauss, noise["magnetometer"]),
        pressure_hpa(ground_altitude_m - x.d) + config.barometer_std_hpa * noise["barometer"].one(),
        (x.n + horizontal * a, x.e + horizontal * b, x.d + vertical * c),
    )


def magnetic_field(x: State) -> Vector:
    """Earth's field in body axes, gauss."""
    return rotate_back(x.q_wb_wxyz, MAGNETIC_FIELD_NED_GAUSS)


def pressure_hpa(altitude_m: float) -> float:
    """Standard atmosphere, static pressure at an altitude above mean sea level."""
    return _SEA_LEVEL_HPA * float((1.0 - 2.25577e-5 * altitude_m) ** 5.25588)


def pressure_altitude_m(hpa: float) -> float:
    """Inverse of `pressure_hpa`."""
    return (1.0 - float((hpa / _SEA_LEVEL_HPA) ** (1.0 / 5.25588))) / 2.25577e-5
