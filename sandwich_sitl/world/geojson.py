"""GeoJSON (RFC 7946: longitude, latitude on WGS84) to a `World` in local ENU metres.

The projection is the ENU tangent plane at the origin (pymap3d), height 0; over a kilometre it bends by 8 cm in height
and less than a millimetre in plan.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pymap3d
import shapely
from shapely import MultiPolygon, Polygon, box
from shapely.geometry import shape
from shapely.validation import explain_validity

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.world import GeoOrigin, Obstacle, World

_BORDER_SHARE = 0.05  # free ground added on each side when no bounds are given


def read_geojson(path: Path, origin: GeoOrigin | None, bounds_m: tuple[float, float, float, float] | None) -> World:
    """Every Polygon and MultiPolygon of the file becomes an obstacle; other geometries are refused.

    `origin` defaults to the middle of the features' extent, `bounds_m` to their extent and 5 % on each side.
    Raises `InputError` naming the file, the feature and the fix.
    """
    features = list(_features(path))
    if not features and (origin is None or bounds_m is None):
        raise InputError(f"{path}: has no polygon; add features, or give world.origin and world.bounds_m")
    origin = origin or _middle(features)
    obstacles = tuple(
        Obstacle(name, _to_enu(polygon, origin, f"{path}: feature '{name}'"), height)
        for name, polygon, height in features
    )
    bounds = bounds_m or _extent(obstacles)
    return World(bounds, tuple(o for o in obstacles if o.polygon.intersects(box(*bounds))), origin)


def _features(path: Path) -> Iterator[tuple[str, Polygon, float | None]]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); world.geojson is relative to the configuration"
        ) from error
    except ValueError as error:
        raise InputError(f"{path}: is not JSON ({error}); give a GeoJSON FeatureCollection") from error
    if (
        not isinstance(data, dict)
        or data.get("type") != "FeatureCollection"
        or not isinstance(data.get("features"), list)
    ):
        raise InputError(f"{path}: is not a GeoJSON FeatureCollection")
    for index, feature in enumerate(data["features"]):
        yield from _polygons(feature, f"{path}: features[{index}]", index)


def _polygons(feature: Any, where: str, index: int) -> Iterator[tuple[str, Polygon, float | None]]:
    if not isinstance(feature, dict) or not isinstance(feature.get("geometry"), dict):
        raise InputError(f"{where}: has no geometry")
    properties = feature.get("properties") or {}
    if not isinstance(properties, dict):
        raise InputError(f"{where}.properties: must be a mapping such as {{'name': 'hall', 'height': 12}}")
    name = str(properties.get("name") or feature.get("id") or f"feature{index + 1}")
    height = properties.get("height")
    if height is not None and (type(height) not in (int, float) or not math.isfinite(height) or height <= 0):
        raise InputError(f"{where}.properties.height: must be a positive number of metres, got {height!r}")
    try:
        geometry = shape(feature["geometry"])
    except (shapely.errors.ShapelyError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{where}.geometry: cannot be read ({error})") from error
    parts = list(geometry.geoms) if isinstance(geometry, MultiPolygon) else [geometry]
    for number, part in enumerate(parts):
        if not isinstance(part, Polygon):
            raise InputError(f"{where}: is a {geometry.geom_type}; obstacles are Polygon or MultiPolygon")
        if part.is_empty:
            raise InputError(f"{where}: has no corners; remove it, or list them")
        lon_lat = shapely.get_coordinates(part)
        if not np.isfinite(lon_lat).all() or (np.abs(lon_lat) > (180, 90)).any():
            raise InputError(f"{where}: coordinates must be longitude, latitude in degrees (WGS84)")
        yield (name if len(parts) == 1 else f"{name}.{number + 1}"), part, height


def _middle(features: list[tuple[str, Polygon, float | None]]) -> GeoOrigin:
    west, south, east, north = shapely.total_bounds([polygon for _, polygon, _ in features])
    return GeoOrigin(float((south + north) / 2), float((west + east) / 2))


def _to_enu(polygon: Polygon, origin: GeoOrigin, where: str) -> Polygon:
    def project(lon_lat: np.ndarray) -> np.ndarray:
        east, north, _ = pymap3d.geodetic2enu(
            lon_lat[:, 1], lon_lat[:, 0], 0.0, origin.latitude_deg, origin.longitude_deg, 0.0
        )
        return np.column_stack([east, north])

    projected = shapely.transform(polygon, project)
    if not projected.is_valid or projected.area <= 0:
        raise InputError(f"{where}: is not a simple polygon ({explain_validity(projected)}); list its corners in order")
    assert isinstance(projected, Polygon)
    return projected


def _extent(obstacles: tuple[Obstacle, ...]) -> tuple[float, float, float, float]:
    x_min, y_min, x_max, y_max = (float(value) for value in shapely.total_bounds([o.polygon for o in obstacles]))
    dx, dy = _BORDER_SHARE * (x_max - x_min), _BORDER_SHARE * (y_max - y_min)
    return (x_min - dx, y_min - dy, x_max + dx, y_max + dy)
