"""GeoJSON (RFC 7946): features with Polygon and MultiPolygon geometry, degrees longitude and latitude on WGS84.

Other geometries are dropped and reported. A `crs` member (GeoJSON 2008) is accepted when it names WGS84 in that order.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry import shape

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers.limits import read_text
from sandwich_sitl.world.importers.shapes import ShapeList
from sandwich_sitl.world.importers.tags import height_m, matches
from sandwich_sitl.world_config import ImportOptions

_WGS84 = ("crs84", "epsg:4326", "epsg::4326")


def read_geojson(path: Path, options: ImportOptions, found: ShapeList) -> None:
    """Add the file's areas to `found`. Raises `InputError` naming the file, the feature and the fix."""
    text = read_text(path)
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not JSON ({error}); give a GeoJSON FeatureCollection") from error
    if isinstance(data, dict) and data.get("type") == "Feature":
        data = {"type": "FeatureCollection", "features": [data]}
    if (
        not isinstance(data, dict)
        or data.get("type") != "FeatureCollection"
        or not isinstance(data.get("features"), list)
    ):
        raise InputError(f"{path}: is not a GeoJSON FeatureCollection; export the map as one")
    _check_crs(data.get("crs"), path)
    for index, feature in enumerate(data["features"]):
        _read_feature(feature, f"{path}: features[{index}]", index, options, found)


def _check_crs(crs: Any, path: Path) -> None:
    if crs is None:
        return
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not str(name).lower().endswith(_WGS84):
        raise InputError(
            f"{path}: crs: is {str(name)[:60]!r}, not longitude, latitude on WGS84; convert the map to EPSG:4326"
        )


def _read_feature(feature: Any, where: str, index: int, options: ImportOptions, found: ShapeList) -> None:
    if not isinstance(feature, dict) or not isinstance(feature.get("geometry"), dict | None):
        raise InputError(f"{where}: has no geometry; give a Feature with a Polygon or MultiPolygon")
    properties = feature.get("properties") or {}
    if not isinstance(properties, dict):
        raise InputError(f"{where}.properties: must be a mapping such as {{'name': 'hall', 'height': 12}}")
    name = str(properties.get("name") or feature.get("id") or f"feature{index + 1}")
    if not matches(properties, options.where):
        found.read += 1
        found.filtered += 1
        return
    if feature.get("geometry") is None:
        found.read += 1
        found.drop(name, "has no geometry")
        return
    try:
        with np.errstate(invalid="ignore", over="ignore"):
            geometry = shape(feature["geometry"])
    except (shapely.errors.ShapelyError, AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise InputError(f"{where}.geometry: cannot be read ({error}); give a Polygon or MultiPolygon") from error
    height, remark = height_m(properties, options.storey_m)
    if remark:
        found.remark(name, remark)
    found.add(name, where, geometry, height)
