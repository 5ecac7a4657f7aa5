"""Uniform wind: a mean and, on each axis, a first-order gust.

d g / dt = -g / T + sigma sqrt(2 / T) w(t)        exact over a step: g' = a g + sigma sqrt(1 - a^2) n,  a = exp(-dt / T)
"""

from math import exp, sqrt
from typing import NamedTuple

from vehicle_sim.compiled import inlined
from vehicle_sim.config import WindConfig
from vehicle_sim.rotation import Vector


class WindModel(NamedTuple):
    """Mean and gust in NED for one fixed step."""

    mean_ned_mps: Vector
    keep: float
    kick_ned_mps: Vector

    @classmethod
    def of(cls, config: WindConfig, dt_s: float) -> "WindModel":
        """Turn the configuration's east, north, up into NED."""
        east, north, up = config.mean_enu_mps
        gust_e, gust_n, gust_u = config.gust_std_mps
        keep = exp(-dt_s / config.gust_correlation_s)
        spread = sqrt(1.0 - keep * keep)
        return cls((north, east, -up), keep, (gust_n * spread, gust_e * spread, gust_u * spread))


@inlined
def next_value(value: Vector, keep: float, kick: Vector, normal: Vector) -> Vector:
    """A first-order Gauss-Markov triple one step later; `normal` are three standard normal numbers."""
    return (
        keep * value[0] + kick[0] * normal[0],
        keep * value[1] + kick[1] * normal[1],
        keep * value[2] + kick[2] * normal[2],
    )
