"""The geofence: a cylinder round home (GF_MAX_HOR_DIST, GF_MAX_VER_DIST) and uploaded polygons and circles. NED metres."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.rotation import Vector

Point = tuple[float, float]


@dataclass(frozen=True)
class Zone:
    """A polygon (at least three corners), or a circle (one point and a radius), to stay inside or outside of."""

    corners: tuple[Point, ...]
    inclusion: bool
    radius_m: float = 0.0

    def contains(self, n_m: float, e_m: float) -> bool:
        """Is the place within the outline?"""
        if len(self.corners) == 1:
            return hypot(n_m - self.corners[0][0], e_m - self.corners[0][1]) <= self.radius_m
        inside = False
        for (an, ae), (bn, be) in zip(self.corners, self.corners[1:] + self.corners[:1], strict=True):
            if (ae > e_m) != (be > e_m) and n_m < an + (e_m - ae) / (be - ae) * (bn - an):
                inside = not inside
        return inside


def is_outside(position_ned_m: Vector, home_ned_m: Vector, zones: Sequence[Zone], parameters: ParameterStore) -> bool:
    """True when the fence is violated. A distance of 0 switches that limit off."""
    far, high = parameters["GF_MAX_HOR_DIST"], parameters["GF_MAX_VER_DIST"]
    if not zones and far <= 0.0 and high <= 0.0:
        return False
    n, e, d = position_ned_m
    if far > 0.0 and hypot(n - home_ned_m[0], e - home_ned_m[1]) > far:
        return True
    if high > 0.0 and home_ned_m[2] - d > high:
        return True
    return any(zone.contains(n, e) is not zone.inclusion for zone in zones)
