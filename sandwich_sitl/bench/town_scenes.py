"""A town, a start and a goal by seed, as overrides of a run configuration: flights that differ even without noise."""

from typing import Any

import numpy as np
import shapely

from sandwich_sitl.bench.plan_worlds import random_town

_KEPT_M = 1.5  # between a start or goal and any wall: more than the configurations' radius and margin
_NEAREST_M = 60.0


def town_scene(seed: int) -> dict[str, Any]:
    """`world`, `start_m` and `goal_m`: both ends in the largest part of the town's free ground, 60 m apart or more."""
    town = random_town(seed)
    walls = shapely.union_all([obstacle.polygon for obstacle in town.obstacles])
    free = shapely.box(*town.bounds_m).buffer(-_KEPT_M).difference(walls.buffer(_KEPT_M))
    ground = max(shapely.get_parts(free), key=lambda part: float(part.area))
    rng = np.random.default_rng(seed)
    while True:
        ends = rng.uniform(town.bounds_m[:2], town.bounds_m[2:], (2, 2))
        if np.hypot(*(ends[1] - ends[0])) > _NEAREST_M and shapely.contains_xy(ground, *ends.T).all():
            break
    rings = (shapely.get_coordinates(obstacle.polygon.exterior)[:-1] for obstacle in town.obstacles)
    return {
        "world": {"bounds_m": list(town.bounds_m), "obstacles": [{"polygon_m": ring.tolist()} for ring in rings]},
        "start_m": ends[0].tolist(),
        "goal_m": ends[1].tolist(),
    }
