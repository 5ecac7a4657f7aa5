"""Uniform wind: a mean, a first-order gust, Dryden turbulence and discrete gusts. NED, SI.

First order:  d g / dt = -g / T + sigma sqrt(2 / T) w(t)

Dryden, MIL-F-8785C, low altitude (h in feet, 10 to 1000; W20 the wind at 20 ft; V the airspeed; u along the mean wind, v across, w down):
    L_w = h    L_u = L_v = h / (0.177 + 0.000823 h)^1.2    sigma_w = 0.1 W20    sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4
    PSD, two-sided, with T = L / V:   u: 2 sigma^2 T / (1 + T^2 w^2)        v, w: sigma^2 T (1 + 3 T^2 w^2) / (1 + T^2 w^2)^2
The v and w filters are two first-order lags p, q of the same noise, y = sqrt(3) p + (1 - sqrt(3)) q; all steps are exact for held T.
"""

from math import cos, exp, pi, sqrt
from typing import NamedTuple

from vehicle_sim.compiled import inlined
from vehicle_sim.parts import GustConfig, WindConfig
from vehicle_sim.rotation import Vector

_FEET = 1.0 / 0.3048
_ROOT3 = sqrt(3.0)
_LEAST_AIRSPEED_MPS = 1.0


def keep_of(dt_s: float, correlation_s: float) -> float:
    """What a first-order process keeps of its value in one step."""
    return exp(-dt_s / correlation_s)


class WindModel(NamedTuple):
    """Mean and first-order gust in NED for one fixed step."""

    mean_ned_mps: Vector
    keep: float
    kick_ned_mps: Vector

    @classmethod
    def of(cls, config: WindConfig, dt_s: float) -> "WindModel":
        """Turn the configuration's east, north, up into NED."""
        gust_e, gust_n, gust_u = config.gust_std_mps
        keep = keep_of(dt_s, config.gust_correlation_s)
        spread = sqrt(1.0 - keep * keep)
        return cls(ned(config.mean_enu_mps), keep, (gust_n * spread, gust_e * spread, gust_u * spread))


class Turbulence(NamedTuple):
    """Scale lengths (m) and standard deviations (m/s): horizontal, vertical."""

    length_uv_m: float
    length_w_m: float
    sigma_uv_mps: float
    sigma_w_mps: float


class Pair(NamedTuple):
    """The two lags of the v or w filter."""

    p: float
    q: float


def ned(enu: Vector) -> Vector:
    """East, north, up as north, east, down."""
    return (enu[1], enu[0], -enu[2])


def discrete_gust(gusts: tuple[GustConfig, ...], t_s: float) -> Vector:
    """The sum of the discrete gusts now, NED."""
    total = (0.0, 0.0, 0.0)
    for gust in gusts:
        since = (t_s - gust.at_s) / gust.duration_s
        if 0.0 < since < 1.0:
            share = (1.0 - cos(2.0 * pi * since)) / 2.0
            n, e, d = ned(gust.peak_enu_mps)
            total = (total[0] + share * n, total[1] + share * e, total[2] + share * d)
    return total


@inlined
def next_value(value: Vector, keep: float, kick: Vector, normal: Vector) -> Vector:
    """A first-order Gauss-Markov triple one step later; `normal` are three standard normal numbers."""
    return (
        keep * value[0] + kick[0] * normal[0],
        keep * value[1] + kick[1] * normal[1],
        keep * value[2] + kick[2] * normal[2],
    )


@inlined
def turbulence_at(height_m: float, w20_mps: float) -> Turbulence:
    """MIL-F-8785C at low altitude."""
    h = max(10.0, min(1000.0, height_m * _FEET))
    base = 0.177 + 0.000823 * h
    return Turbulence(h / pow(base, 1.2) / _FEET, h / _FEET, 0.1 * w20_mps / pow(base, 0.4), 0.1 * w20_mps)


@inlined
def next_u(u: float, t_s: float, sigma: float, dt_s: float, normal: float) -> float:
    """The longitudinal gust one step later; `t_s` is L / V."""
    keep = exp(-dt_s / t_s)
    return keep * u + sigma * sqrt(1.0 - keep * keep) * normal


@inlined
def next_pair(pair: Pair, t_s: float, sigma: float, dt_s: float, first: float, second: float) -> Pair:
    """The lags of a transverse gust one step later: exact mean and covariance for held `t_s`."""
    r = dt_s / t_s
    keep, fall = exp(-r), exp(-2.0 * r)
    var_p = (1.0 - fall) / 2.0
    cov = (1.0 - fall * (1.0 + 2.0 * r)) / 4.0
    var_q = (1.0 - fall * (1.0 + 2.0 * r + 2.0 * r * r)) / 4.0
    root_p = sqrt(var_p)
    along = cov / root_p
    across = sqrt(max(0.0, var_q - along * along))
    return Pair(
        keep * pair.p + sigma * root_p * first,
        keep * pair.q + keep * r * pair.p + sigma * (along * first + across * second),
    )


@inlined
def gust_of(pair: Pair) -> float:
    """The gust that the lags make."""
    return _ROOT3 * pair.p + (1.0 - _ROOT3) * pair.q


@inlined
def frozen_airspeed(velocity: Vector, wind: Vector) -> float:
    """Speed at which the frozen field of gusts is passed through."""
    n, e, d = velocity[0] - wind[0], velocity[1] - wind[1], velocity[2] - wind[2]
    return max(_LEAST_AIRSPEED_MPS, sqrt(n * n + e * e + d * d))
