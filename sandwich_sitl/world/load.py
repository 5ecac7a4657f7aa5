"""The `world` section of a run's configuration becomes a `World`: inline shapes, or a map file that the importers read."""

import math
from pathlib import Path

from shapely import Point, Polygon

from sandwich_sitl.config import ObstacleConfig, WorldConfig
from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers import ImportedWorld, ImportReport, read_world
from sandwich_sitl.world.world import Obstacle, World, matter
from sandwich_sitl.yaml_document import place

_CIRCLE_VERTICES = 24


def load_world(config: WorldConfig, config_path: Path) -> World:
    """Build the world that a configuration describes; `world.file` is relative to the configuration's folder.

    Raises `InputError` naming the map file, the place in it and the fix.
    """
    return import_world(config, config_path).world


def import_world(config: WorldConfig, config_path: Path) -> ImportedWorld:
    """As `load_world`, with the account of what was read, mended and left out."""
    if config.file is not None:
        path = config_path.parent / config.file
        if not path.exists():
            where = place(config_path, ("world", "file"), config.file)
            raise InputError(f"{where}: world.file: there is no {path}; give a path relative to the configuration")
        return read_world(path, config)
    assert config.bounds_m is not None
    obstacles = [_obstacle(item, index) for index, item in enumerate(config.obstacles)]
    near = matter([o.polygon for o in obstacles], config.bounds_m)
    kept = tuple(o for o, keep in zip(obstacles, near, strict=True) if keep)
    outside = [o.name for o, keep in zip(obstacles, near, strict=True) if not keep]
    report = ImportReport(
        source=str(config_path),
        file_format="run configuration",
        read=len(obstacles),
        outside=len(outside),
        outside_names=tuple(outside),
        vertices=sum(len(o.polygon.exterior.coords) - 1 for o in kept),
    )
    return ImportedWorld(World(config.bounds_m, kept), report)


def _obstacle(item: ObstacleConfig, index: int) -> Obstacle:
    name = item.name or f"obstacle{index + 1}"
    if item.circle_m is None:
        return Obstacle(name, Polygon(item.polygon_m), item.height_m)
    x, y, radius = item.circle_m
    # Circumscribed, so that the polygon is never smaller than the circle.
    circumradius = radius / math.cos(math.pi / _CIRCLE_VERTICES)
    return Obstacle(name, Point(x, y).buffer(circumradius, quad_segs=_CIRCLE_VERTICES // 4), item.height_m)
