"""The `world` section of a run's configuration becomes a `World`; bad shapes end in one `InputError`."""

import math
from pathlib import Path

from shapely import Point, Polygon, box
from shapely.validation import explain_validity

from sandwich_sitl.config import ObstacleConfig, WorldConfig
from sandwich_sitl.errors import InputError
from sandwich_sitl.world.geojson import read_geojson
from sandwich_sitl.world.world import GeoOrigin, Obstacle, World

_CIRCLE_VERTICES = 24


def load_world(config: WorldConfig, config_path: Path) -> World:
    """Build the world that a configuration describes.

    Raises `InputError` naming file, key path and fix: neither or both sources, empty bounds, a polygon that crosses
    itself or has no area, a GeoJSON file that cannot be used.
    """
    if config.geojson is not None:
        if config.obstacles:
            raise InputError(f"{config_path}: world: has both geojson and obstacles; keep one of them")
        origin = GeoOrigin(config.origin.latitude_deg, config.origin.longitude_deg) if config.origin else None
        return read_geojson(config_path.parent / config.geojson, origin, _checked_bounds(config, config_path))
    if config.origin is not None:
        raise InputError(f"{config_path}: world.origin: belongs to a geojson world; remove it")
    bounds = _checked_bounds(config, config_path)
    if bounds is None:
        raise InputError(
            f"{config_path}: world: has neither bounds_m nor geojson; give bounds_m: [x_min, y_min, x_max, y_max]"
        )
    shapes = [
        _obstacle(item, f"{config_path}: world.obstacles[{index}]", index)
        for index, item in enumerate(config.obstacles)
    ]
    return World(bounds, tuple(shape for shape in shapes if shape.polygon.intersects(box(*bounds))))


def _checked_bounds(config: WorldConfig, config_path: Path) -> tuple[float, float, float, float] | None:
    if config.bounds_m is None:
        return None
    x_min, y_min, x_max, y_max = config.bounds_m
    if not (x_max > x_min and y_max > y_min):
        raise InputError(
            f"{config_path}: world.bounds_m: {list(config.bounds_m)} has no area; give [x_min, y_min, x_max, y_max]"
        )
    return config.bounds_m


def _obstacle(item: ObstacleConfig, where: str, index: int) -> Obstacle:
    name = item.name or f"obstacle{index + 1}"
    if (item.polygon_m is None) == (item.circle_m is None):
        raise InputError(f"{where}: needs exactly one of polygon_m and circle_m")
    if item.circle_m is not None:
        x, y, radius = item.circle_m
        # Circumscribed, so that the polygon is never smaller than the circle.
        circumradius = radius / math.cos(math.pi / _CIRCLE_VERTICES)
        polygon = Point(x, y).buffer(circumradius, quad_segs=_CIRCLE_VERTICES // 4)
    else:
        polygon = Polygon(item.polygon_m)
        if not polygon.is_valid:
            reason = explain_validity(polygon)
            raise InputError(
                f"{where}.polygon_m: '{name}' is not a simple polygon ({reason}); list its corners in order"
            )
        if polygon.area <= 0:
            raise InputError(f"{where}.polygon_m: '{name}' has no area; give at least three corners not on one line")
    return Obstacle(name, polygon, item.height_m)
