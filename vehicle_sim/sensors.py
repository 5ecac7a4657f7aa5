"""What sensors measure, and the error model that may stand in for the estimator.

The error model's estimate is the truth plus first-order Gauss-Markov errors, as a very good estimator's would be (RTK, motion capture):

    b' = a b + sigma sqrt(1 - a^2) n,  a = exp(-dt / T)
"""

from math import exp, hypot, pow, sqrt
from typing import NamedTuple

from vehicle_sim.compiled import inlined
from vehicle_sim.dynamics import State
from vehicle_sim.parts import SensorsConfig
from vehicle_sim.rotation import Quaternion, Vector, normalize, quaternion_multiply, rotate_back
from vehicle_sim.wind import next_value

#: Earth's field in NED (gauss), mid-European.
MAGNETIC_FIELD_NED_GAUSS: Vector = (0.212, 0.012, 0.427)
HORIZONTAL_FIELD_GAUSS = hypot(MAGNETIC_FIELD_NED_GAUSS[0], MAGNETIC_FIELD_NED_GAUSS[1])
#: Share of a GPS position's spread that is white; the rest wanders slowly.
WHITE_OF_GPS = 0.3
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
    gps_velocity_mps: Vector


class ErrorModel(NamedTuple):
    """The Gauss-Markov recursion of the estimate's errors for one fixed step: position, velocity, small rotation about body axes."""

    keep: float
    position_kick_m: float
    velocity_kick_mps: float
    attitude_kick_rad: float

    @classmethod
    def of(cls, config: SensorsConfig, dt_s: float) -> "ErrorModel":
        """Standard deviations and correlation time of the configuration; an endless step gives the stationary spread."""
        keep = exp(-dt_s / config.estimate_correlation_s)
        spread = sqrt(1.0 - keep * keep)
        return cls(
            keep,
            config.estimate_position_std_m * spread,
            config.estimate_velocity_std_mps * spread,
            config.estimate_attitude_std_rad * spread,
        )


class EstimateError(NamedTuple):
    """Gauss-Markov errors: position (m), velocity (m/s), small rotation about body axes (rad)."""

    position_m: Vector
    velocity_mps: Vector
    attitude_rad: Vector


@inlined
def next_error(error: EstimateError, model: ErrorModel, first: Vector, second: Vector, third: Vector) -> EstimateError:
    """The errors one step later, from nine standard normal numbers."""
    a, p, v, r = model.keep, model.position_kick_m, model.velocity_kick_mps, model.attitude_kick_rad
    return EstimateError(
        next_value(error.position_m, a, (p, p, p), first),
        next_value(error.velocity_mps, a, (v, v, v), second),
        next_value(error.attitude_rad, a, (r, r, r), third),
    )


@inlined
def believed(x: State, error: EstimateError, omega_wb_b_radps: Vector) -> State:
    """Truth plus error; the rates are the gyroscope's."""
    dp, dv, da = error.position_m, error.velocity_mps, error.attitude_rad
    w, i, j, k = normalize(quaternion_multiply((x.qw, x.qx, x.qy, x.qz), (1.0, 0.5 * da[0], 0.5 * da[1], 0.5 * da[2])))
    p, q, r = omega_wb_b_radps
    return State(x.n + dp[0], x.e + dp[1], x.d + dp[2], x.vn + dv[0], x.ve + dv[1], x.vd + dv[2], w, i, j, k, p, q, r)


def wander_of_gps(spread_m: float) -> float:
    """The slow part of a GPS position's spread."""
    return spread_m * sqrt(1.0 - WHITE_OF_GPS**2)


@inlined
def noisy(value: Vector, std: float, normal: Vector) -> Vector:
    """A three-axis reading with white noise."""
    return (value[0] + std * normal[0], value[1] + std * normal[1], value[2] + std * normal[2])


@inlined
def magnetic_field(x: State) -> Vector:
    """Earth's field in body axes, gauss."""
    return rotate_back((x.qw, x.qx, x.qy, x.qz), MAGNETIC_FIELD_NED_GAUSS)


@inlined
def pressure_hpa(altitude_m: float) -> float:
    """Standard atmosphere, static pressure at an altitude above mean sea level."""
    return _SEA_LEVEL_HPA * pow(1.0 - 2.25577e-5 * altitude_m, 5.25588)


@inlined
def pressure_altitude_m(hpa: float) -> float:
    """Inverse of `pressure_hpa`."""
    return (1.0 - pow(hpa / _SEA_LEVEL_HPA, 1.0 / 5.25588)) / 2.25577e-5
