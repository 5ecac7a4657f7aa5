"""Worlds and questions for `bench plan`: random ones by seed, those of run configurations, those of map files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.affinity import rotate

from sandwich_sitl.config import load_config
from sandwich_sitl.errors import InputError
from sandwich_sitl.planning.map_graph import MapGraph, links
from sandwich_sitl.world.grow import GrownWorld, grow
from sandwich_sitl.world.importers import ImportOptions, read_world
from sandwich_sitl.world.load import load_world
from sandwich_sitl.world.world import Obstacle, World
from sandwich_sitl.yaml_document import is_run_file

Array = NDArray[np.float64]

_RANDOM_M = (200.0, 120.0)
_FILLED = 0.22  # of a random world's area, before growing
_DETAIL_M = 0.1
_NEAREST = 0.25  # of the extent: questions whose ends are nearer say little


@dataclass(frozen=True)
class BenchWorld:
    """A world under a name, and grown by the vehicle's radius and a margin."""

    name: str
    world: World
    radius_m: float
    margin_m: float
    grown: GrownWorld

    @property
    def bodies(self) -> list[Polygon]:
        """The obstacles as they were given."""
        return [obstacle.polygon for obstacle in self.world.obstacles]


def random_world(seed: int, radius_m: float, margin_m: float) -> BenchWorld:
    """The random town of a seed, grown by radius and margin."""
    return _grown(f"random {seed}", random_town(seed), radius_m, margin_m)


def random_town(seed: int) -> World:
    """Buildings turned at will, a third of them angles, over 200 m x 120 m."""
    rng = np.random.default_rng(seed)
    width, height = _RANDOM_M
    shapes: list[Polygon] = []
    while sum(shape.area for shape in shapes) < _FILLED * width * height:
        x, y, a, b = *rng.uniform((0, 0), _RANDOM_M), *rng.uniform(5, 22, 2)
        shape = shapely.box(x, y, x + a, y + b)
        if rng.integers(0, 3) == 0:
            shape = shape.difference(shapely.box(x + 0.4 * a, y + 0.4 * b, x + a, y + b))
        shapes.append(rotate(shape, rng.uniform(0, 360)))
    return World((0.0, 0.0, width, height), tuple(Obstacle(f"o{k}", shape) for k, shape in enumerate(shapes)))


def world_of_file(path: Path, radius_m: float, margin_m: float) -> BenchWorld:
    """The world of a run configuration with its own radius and margin, or that of a map file.

    Raises `InputError` as the readers do, and when growing leaves no ground.
    """
    if is_run_file(path):
        config = load_config(path)
        planner = config.planner
        return _grown(path.stem, load_world(config.world, path), planner.vehicle_radius_m, planner.margin_m)
    return _grown(path.stem, read_world(path, ImportOptions()).world, radius_m, margin_m)


def _grown(name: str, world: World, radius_m: float, margin_m: float) -> BenchWorld:
    grown = grow(world, radius_m + margin_m, _DETAIL_M)
    if grown.free_area_m2 <= 0.0:
        raise InputError(
            f"{name}: nothing is free once obstacles are grown by {radius_m + margin_m:g} m and what they enclose is "
            "filled; give a run's YAML with world.inside_m, or a smaller --radius and --margin"
        )
    return BenchWorld(name, world, radius_m, margin_m, grown)


def questions(grown: GrownWorld, map_graph: MapGraph, count: int, seed: int) -> list[tuple[Array, Array]]:
    """Pairs of points (2,), uniform over the mapped ground, not near each other and joined by it."""
    rng = np.random.default_rng(seed)
    low, high = np.array(grown.bounds_m[:2]), np.array(grown.bounds_m[2:])
    pairs: list[tuple[Array, Array]] = []
    for _ in range(200 * count):
        start, goal = rng.uniform(low, high, (2, 2))
        if len(pairs) == count:
            break
        if np.hypot(*(goal - start)) < _NEAREST * float((high - low).max()):
            continue
        start_links, goal_links = links(map_graph, start), links(map_graph, goal)
        if start_links and goal_links:
            reached = map_graph.graph.reachable([node for node, _ in start_links])
            if reached[[node for node, _ in goal_links]].any():
                pairs.append((start, goal))
    return pairs
