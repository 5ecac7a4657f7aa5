"""Local NED metres to WGS84 and back, to first order about the home location (off by about d^2 / 2R: 4 mm at 200 m).

    lat = lat0 + n / (M + h0)      lon = lon0 + e / ((N + h0) cos lat0)      alt = alt0 - d

M and N are the radii of curvature of the meridian and the prime vertical at lat0.
"""

from dataclasses import dataclass
from math import cos, degrees, radians, sin, sqrt
from typing import NamedTuple

from vehicle_sim.parts import HomeConfig
from vehicle_sim.rotation import Vector

_SEMI_MAJOR_M = 6378137.0
_ECCENTRICITY2 = 6.69437999014e-3


class Geodetic(NamedTuple):
    """WGS84 position; the altitude is above mean sea level, taken as the ellipsoid."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


@dataclass(frozen=True)
class GeoFrame:
    """The local frame's origin and its scales."""

    origin: Geodetic
    north_m_per_rad: float
    east_m_per_rad: float

    @classmethod
    def at(cls, home: HomeConfig) -> "GeoFrame":
        """The frame whose origin is the configured home."""
        latitude = radians(home.latitude_deg)
        shrink = 1.0 - _ECCENTRICITY2 * sin(latitude) ** 2
        meridian_m = _SEMI_MAJOR_M * (1.0 - _ECCENTRICITY2) / shrink**1.5
        normal_m = _SEMI_MAJOR_M / sqrt(shrink)
        return cls(
            Geodetic(home.latitude_deg, home.longitude_deg, home.altitude_m),
            meridian_m + home.altitude_m,
            (normal_m + home.altitude_m) * cos(latitude),
        )

    def to_geodetic(self, ned_m: Vector) -> Geodetic:
        """WGS84 of a local position."""
        return Geodetic(
            self.origin.latitude_deg + degrees(ned_m[0] / self.north_m_per_rad),
            self.origin.longitude_deg + degrees(ned_m[1] / self.east_m_per_rad),
            self.origin.altitude_m - ned_m[2],
        )

    def to_ned(self, place: Geodetic) -> Vector:
        """Local position of a WGS84 one; NaN stays NaN."""
        return (
            radians(place.latitude_deg - self.origin.latitude_deg) * self.north_m_per_rad,
            radians(place.longitude_deg - self.origin.longitude_deg) * self.east_m_per_rad,
            self.origin.altitude_m - place.altitude_m,
        )
