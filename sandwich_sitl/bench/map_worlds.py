"""Worlds to measure the channel map on: a town at random from a seed, or the world of a run's configuration.

The town is 1.6 times as wide as high. Its shapes are quadrangles, rounds, L and U, a third of them concave, of one size
that makes them cover about a fifth of the ground, far enough apart for a vehicle to pass between any two.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, affinity, box

from sandwich_sitl.config import load_config
from sandwich_sitl.errors import InputError
from sandwich_sitl.world.grow import GrownWorld, grow
from sandwich_sitl.world.load import load_world
from sandwich_sitl.world.world import Obstacle, World

Array = NDArray[np.float64]

_BLOCK_M = 20.0  # of ground that one obstacle has to itself
_SIZE = 0.55  # of a block: width of an obstacle before it is turned
_REACH_M = 1.0
_DETAIL_M = 0.1
_APART_M = 2 * _REACH_M + 1.5
_MOST_DRAWS = 400  # an obstacle


@dataclass(frozen=True)
class BenchWorld:
    """A grown world, what it is called, and how many obstacles it had before growing."""

    name: str
    grown: GrownWorld
    obstacles: int

    def cell_m(self, nodes: int) -> float:
        """Cell size that gives about `nodes` nodes."""
        return float(np.sqrt(self.grown.free_area_m2 / nodes))

    def free_ground(self) -> Polygon:
        """The largest connected free ground, with the obstacles inside it as holes."""
        solid = shapely.union_all(list(self.grown.polygons))
        parts = shapely.get_parts(box(*self.grown.bounds_m).difference(solid))
        largest: Polygon = max(parts, key=lambda part: part.area)
        return largest


def town(seed: int, obstacles: int) -> BenchWorld:
    """The town of a seed. Raises `InputError` when so many obstacles find no place."""
    rng = np.random.default_rng(seed)
    height = _BLOCK_M * np.sqrt(obstacles / 1.6)
    bounds = (0.0, 0.0, float(1.6 * height), float(height))
    inside = box(*bounds).buffer(-_APART_M / 2, join_style="mitre")
    placed: list[Polygon] = []
    for _ in range(_MOST_DRAWS * obstacles):
        shape = affinity.rotate(_shape(rng, _SIZE * _BLOCK_M * rng.uniform(0.7, 1.3)), rng.uniform(0.0, 360.0))
        x, y = rng.uniform(bounds[0], bounds[2]), rng.uniform(bounds[1], bounds[3])
        shape = affinity.translate(shape, x - shape.centroid.x, y - shape.centroid.y)
        if shape.within(inside) and all(shape.distance(other) > _APART_M for other in placed):
            placed.append(shape)
        if len(placed) == obstacles:
            break
    else:
        raise InputError(f"--obstacles {obstacles}: only {len(placed)} found a place; give another --seed")
    world = World(bounds, tuple(Obstacle(f"o{k}", shape) for k, shape in enumerate(placed)))
    return BenchWorld(f"town of seed {seed}", grow(world, _REACH_M, _DETAIL_M), obstacles)


def world_of(path: Path) -> BenchWorld:
    """The world of a run's configuration, grown as the run grows it."""
    config = load_config(path)
    planner = config.planner
    world = load_world(config.world, path)
    detail = min(0.15 * planner.cell_m, 0.15 * planner.margin_m)
    return BenchWorld(path.name, grow(world, planner.vehicle_radius_m + planner.margin_m, detail), len(world.obstacles))


def _shape(rng: np.random.Generator, size_m: float) -> Polygon:
    """A quadrangle, a round, an L or a U."""
    s = size_m
    kind = int(rng.integers(0, 6))
    if kind == 0:
        return Polygon([(0, 0), (s, 0), (s, 0.4 * s), (0.4 * s, 0.4 * s), (0.4 * s, s), (0, s)])
    if kind == 1:
        return Polygon(
            [(0, 0), (s, 0), (s, s), (0.72 * s, s), (0.72 * s, 0.35 * s), (0.28 * s, 0.35 * s), (0.28 * s, s), (0, s)]
        )
    if kind == 2:
        return shapely.Point(0, 0).buffer(0.55 * s, quad_segs=6)
    width, depth = s * rng.uniform(0.6, 1.4), s * rng.uniform(0.5, 1.0)
    slant = rng.uniform(-0.2, 0.2) * depth
    return Polygon([(0, 0), (width, 0), (width + slant, depth), (slant, depth)])
