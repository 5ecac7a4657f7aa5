"""`World`: a rectangle of motion space with named obstacles, ENU metres."""

from dataclasses import dataclass

from shapely import Polygon


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
    """Bounds (x_min, y_min, x_max, y_max) and the obstacles that reach into them."""

    bounds_m: tuple[float, float, float, float]
    obstacles: tuple[Obstacle, ...]
    origin: GeoOrigin | None = None
