"""Degrees to metres: the ENU tangent plane at an origin on WGS84 (pymap3d), height 0."""

import math

import numpy as np
import pymap3d
from numpy.typing import NDArray

from sandwich_sitl.errors import InputError
from sandwich_sitl.world.importers.limits import MAX_SPAN_M
from sandwich_sitl.world.world import GeoOrigin
from sandwich_sitl.world_config import Box, ImportOptions

Array = NDArray[np.float64]

_METRES_PER_DEGREE = 111_320.0


def origin_of(source: str, extent_deg: Box, options: ImportOptions) -> GeoOrigin:
    """The configured origin, else the middle of (west, south, east, north). Raises `InputError` when that is no map."""
    west, south, east, north = extent_deg
    span_m = _METRES_PER_DEGREE * max(north - south, (east - west) * math.cos(math.radians((south + north) / 2)))
    if span_m > MAX_SPAN_M:
        raise InputError(
            f"{source}: spans {span_m / 1000:.0f} km, more than {MAX_SPAN_M / 1000:.0f}; give window_deg, or "
            "convert the map to degrees (EPSG:4326) if it is in metres"
        )
    return configured_origin(options) or GeoOrigin((south + north) / 2, (west + east) / 2)


def configured_origin(options: ImportOptions) -> GeoOrigin | None:
    """The origin that the options name."""
    return GeoOrigin(options.origin.latitude_deg, options.origin.longitude_deg) if options.origin else None


def to_enu(lon_lat: Array, origin: GeoOrigin) -> Array:
    """East and north (n, 2) in metres of longitudes and latitudes (n, 2) on the ellipsoid."""
    east, north, _ = pymap3d.geodetic2enu(
        lon_lat[:, 1], lon_lat[:, 0], 0.0, origin.latitude_deg, origin.longitude_deg, 0.0
    )
    return np.column_stack([east, north])


def window_m(window_deg: Box, origin: GeoOrigin) -> Box:
    """Largest rectangle between the window's four edges, in metres."""
    west, south, east, north = window_deg
    sw, se, ne, nw = to_enu(np.array([[west, south], [east, south], [east, north], [west, north]]), origin)
    return (
        float(max(sw[0], nw[0])),
        float(max(sw[1], se[1])),
        float(min(se[0], ne[0])),
        float(min(nw[1], ne[1])),
    )
