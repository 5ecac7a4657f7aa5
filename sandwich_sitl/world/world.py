"""`World`: a rectangle of motion space with named obstacles, ENU metres."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, box

_BESIDE_M = 10.0  # wider than what a vehicle's middle keeps from an obstacle


@dataclass(frozen=True)
class GeoOrigin:
    """WGS84 position of the point (0, 0) of a world's ENU frame."""

    latitude_deg: float
    longitude_deg: float


@dataclass(frozen=True)
class Obstacle:
    """One obstacle as it was given: a simple polygon, not grown; `height_m` is None where unknown."""

    name: str
    polygon: Polygon
    height_m: float | None = None


@dataclass(frozen=True)
class World:
    """Bounds (x_min, y_min, x_max, y_max) of the vehicle's middle, and the obstacles in them or close beside them."""

    bounds_m: tuple[float, float, float, float]
    obstacles: tuple[Obstacle, ...]
    origin: GeoOrigin | None = None


def matter(
    polygons: Sequence[Polygon], bounds_m: tuple[float, float, float, float], reach_m: float = 0.0
) -> NDArray[np.bool_]:
    """Which polygons a vehicle inside the bounds can come near: a shape beside the border can be hit from inside it."""
    frame = box(*bounds_m).buffer(max(reach_m, _BESIDE_M), join_style="mitre")
    return np.asarray(shapely.intersects(np.array(polygons, dtype=object), frame), dtype=bool)
