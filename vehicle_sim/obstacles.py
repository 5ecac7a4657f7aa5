"""The obstacles of the true world, and the range sensor that sees them (pure; numpy alone).

State: outlines as edges (E, 4) in local NED metres (north, east of both ends), with the time since boot from which each
is there and its height. Input: position and yaw of the truth. Rays are cast against edges: a ray from p along d meets
the edge from a to b at range t where  p + t d = a + s (b - a), 0 <= s <= 1, t >= 0.

A sector reports the nearest thing in it: rays through its middle, its borders and between. The sensor is level.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, inf, radians

import numpy as np
from numpy.typing import NDArray

from vehicle_sim.parts import ObstacleConfig, RangeSensorConfig

Array = NDArray[np.float64]

_RAYS_A_SECTOR = 5  # odd, so that one goes through the middle


@dataclass(frozen=True)
class Scene:
    """Obstacles of one world. `edges` (E, 4), `owner` (E,) the obstacle of each edge, `appears_s` and `height_m` (n,)."""

    names: tuple[str, ...]
    edges: Array
    owner: NDArray[np.int64]
    appears_s: Array
    height_m: Array

    @classmethod
    def of(cls, obstacles: Sequence[ObstacleConfig], start_m: tuple[float, float]) -> "Scene":
        """Obstacles given in the world's ENU frame, where the vehicle starts at `start_m`."""
        rings = [np.array(o.polygon_m)[:, ::-1] - np.array(start_m)[::-1] for o in obstacles]
        edges = [np.hstack([ring, np.roll(ring, -1, axis=0)]) for ring in rings]
        return cls(
            tuple(o.name for o in obstacles),
            np.concatenate([np.empty((0, 4)), *edges]),
            np.repeat(np.arange(len(rings)), [len(ring) for ring in rings]),
            np.array([o.appears_s for o in obstacles], dtype=float),
            np.array([inf if o.height_m is None else o.height_m for o in obstacles], dtype=float),
        )

    def there(self, t_s: float, height_m: float) -> Array:
        """Edges (e, 4) of what stands at a time and reaches a height."""
        stands = (self.appears_s <= t_s) & (self.height_m >= height_m)
        return self.edges[stands[self.owner]]

    def hit(self, t_s: float, north_m: float, east_m: float, height_m: float) -> str | None:
        """Name of an obstacle that holds a point, by the parity of the edges that a ray to the east crosses."""
        stands = (self.appears_s <= t_s) & (self.height_m >= height_m)
        a_n, a_e, b_n, b_e = self.edges.T
        straddles = (a_n > north_m) != (b_n > north_m)
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing_e = a_e + (north_m - a_n) / (b_n - a_n) * (b_e - a_e)
        crossed = np.bincount(self.owner, straddles & (crossing_e > east_m), len(self.names)) % 2 == 1
        found = np.flatnonzero(crossed & stands)
        return self.names[int(found[0])] if found.size else None


def cast(edges: Array, origin_ne: Array, bearings_rad: Array) -> Array:
    """Ranges (n,) from a point along bearings (n,), clockwise from north, to the nearest edge; inf where there is none."""
    if not len(edges):
        return np.full(len(bearings_rad), inf)
    direction = np.column_stack([np.cos(bearings_rad), np.sin(bearings_rad)])[:, None]
    a, side = edges[:, :2] - origin_ne, edges[:, 2:] - edges[:, :2]
    across = direction[..., 0] * side[:, 1] - direction[..., 1] * side[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (a[:, 0] * side[:, 1] - a[:, 1] * side[:, 0]) / across
        s = (a[:, 0] * direction[..., 1] - a[:, 1] * direction[..., 0]) / across
    met = (across != 0.0) & (t >= 0.0) & (s >= 0.0) & (s <= 1.0)
    return np.asarray(np.where(met, t, inf).min(axis=1))


@dataclass(frozen=True)
class Sweep:
    """What OBSTACLE_DISTANCE carries: ranges (n,) in metres, inf where nothing is within reach; bearings from the nose."""

    ranges_m: Array
    first_deg: float
    increment_deg: float


class RangeSensor:
    """Looks round from the middle of the vehicle, `field_deg` wide, centred on the nose."""

    def __init__(self, config: RangeSensorConfig, scene: Scene, seed: int) -> None:
        self.config = config
        self._scene, self._seed = scene, seed
        self._increment_deg = config.field_deg / config.sectors
        whole = config.field_deg == 360.0
        self._first_deg = 0.0 if whole else (self._increment_deg - config.field_deg) / 2
        middles = radians(self._first_deg) + radians(self._increment_deg) * np.arange(config.sectors)
        spread = np.linspace(-0.5, 0.5, _RAYS_A_SECTOR) * radians(self._increment_deg)
        self._rays_rad = (middles[:, None] + spread).ravel()

    def sweep(self, t_us: int, position_ned_m: Sequence[float], q_wb_wxyz: Sequence[float]) -> Sweep:
        """What it sees from a pose. Noise depends on seed and time alone, however often it is asked."""
        north, east, down = position_ned_m
        edges = self._scene.there(t_us * 1e-6, -down)
        rays = cast(edges, np.array([north, east]), _yaw_rad(q_wb_wxyz) + self._rays_rad)
        ranges = rays.reshape(self.config.sectors, _RAYS_A_SECTOR).min(axis=1)
        noise = np.random.default_rng([self._seed, t_us]).standard_normal(len(ranges))
        ranges = np.maximum(ranges + self.config.noise_std_m * noise, self.config.least_m)
        return Sweep(np.where(ranges <= self.config.reach_m, ranges, inf), self._first_deg, self._increment_deg)


def _yaw_rad(q_wb_wxyz: Sequence[float]) -> float:
    w, x, y, z = q_wb_wxyz
    return atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
