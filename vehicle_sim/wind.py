"""Uniform wind: a mean and, on each axis, a first-order (Dryden-like) gust.

d g / dt = -g / T + sigma sqrt(2 / T) w(t)        exact over a step: g' = a g + sigma sqrt(1 - a^2) n,  a = exp(-dt / T)
"""

from dataclasses import dataclass
from math import exp, sqrt

from vehicle_sim.config import WindConfig
from vehicle_sim.rotation import Vector


@dataclass(frozen=True)
class WindModel:
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

    def next_gust(self, gust_ned_mps: Vector, normal: Vector) -> Vector:
        """The gust one step later; `normal` are three standard normal numbers."""
        a, kick = self.keep, self.kick_ned_mps
        return (
            a * gust_ned_mps[0] + kick[0] * normal[0],
            a * gust_ned_mps[1] + kick[1] * normal[1],
            a * gust_ned_mps[2] + kick[2] * normal[2],
        )

    def velocity(self, gust_ned_mps: Vector) -> Vector:
        """Mean plus gust, NED."""
        mean = self.mean_ned_mps
        return (mean[0] + gust_ned_mps[0], mean[1] + gust_ned_mps[1], mean[2] + gust_ned_mps[2])
