"""MISSION_ITEM_INT to mission items and fence zones, and back. Degrees and metres above sea level or home at the edge, NED inside."""

from math import isfinite, nan
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.geofence import Zone
from vehicle_sim.autopilot.mission import KNOWN, PASSED_OVER, PLACES, MissionItem
from vehicle_sim.geo import Geodetic
from vehicle_sim.vehicle import Vehicle

_GLOBAL = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_RELATIVE = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_NO_PLACE = (mavlink.MAV_FRAME_MISSION,)
_NOT_GIVEN = (0, 2**31 - 1, -(2**31))
_INCLUSION_POLYGON, _EXCLUSION_POLYGON = 5001, 5002
_INCLUSION_CIRCLE, _EXCLUSION_CIRCLE = 5003, 5004
_FENCE = (_INCLUSION_POLYGON, _EXCLUSION_POLYGON, _INCLUSION_CIRCLE, _EXCLUSION_CIRCLE, 5000)


class WireItem(NamedTuple):
    """An item as it came, so that a download gives back what was uploaded."""

    frame: int
    command: int
    autocontinue: int
    parameters: tuple[float, float, float, float]
    x: int
    y: int
    z: float


def wire_item(message: Any) -> WireItem:
    """MISSION_ITEM_INT, or MISSION_ITEM with its degrees in floats."""
    m = message
    scale = 1 if m.get_type() == "MISSION_ITEM_INT" or m.frame in _NO_PLACE else 1e7
    x, y = (round(value * scale) if isfinite(value) and abs(value * scale) < 2**31 else 0 for value in (m.x, m.y))
    return WireItem(m.frame, m.command, m.autocontinue, (m.param1, m.param2, m.param3, m.param4), x, y, m.z)


def find_problem(item: WireItem, fence: bool) -> int:
    """MAV_MISSION_RESULT: accepted, or why the item is not."""
    if fence:
        return int(mavlink.MAV_MISSION_ACCEPTED if item.command in _FENCE else mavlink.MAV_MISSION_UNSUPPORTED)
    if item.command not in KNOWN | PASSED_OVER:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    if item.command in PLACES and item.frame not in _GLOBAL + _RELATIVE:
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if not (abs(item.x) <= 900_000_000 and abs(item.y) <= 1_800_000_000):
        return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
    return int(mavlink.MAV_MISSION_ACCEPTED)


def mission_item(vehicle: Vehicle, item: WireItem) -> MissionItem:
    """What the autopilot flies. Relative heights count from home."""
    place = (nan, nan, nan)
    if item.command in PLACES:
        known = item.x not in _NOT_GIVEN or item.y not in _NOT_GIVEN
        altitude_m = item.z
        if item.frame in _RELATIVE:
            home = vehicle.autopilot.home_ned_m or (0.0, 0.0, 0.0)
            altitude_m += vehicle.geo.origin.altitude_m - home[2]
        n, e, d = vehicle.geo.to_ned(Geodetic(item.x / 1e7, item.y / 1e7, altitude_m))
        place = (n if known else nan, e if known else nan, d)
    return MissionItem(item.command, item.parameters, place)


def fence_zones(vehicle: Vehicle, items: list[WireItem]) -> tuple[Zone, ...] | None:
    """Polygons are runs of vertices, each naming how many there are; None when the counts do not add up."""
    zones: list[Zone] = []
    at = 0
    while at < len(items):
        item = items[at]
        inclusion = item.command in (_INCLUSION_POLYGON, _INCLUSION_CIRCLE)
        if item.command in (_INCLUSION_CIRCLE, _EXCLUSION_CIRCLE):
            zones.append(Zone((_corner(vehicle, item),), inclusion, item.parameters[0]))
            at += 1
        elif item.command in (_INCLUSION_POLYGON, _EXCLUSION_POLYGON):
            count = int(item.parameters[0]) if 3 <= item.parameters[0] <= len(items) else 0
            run = items[at : at + count]
            if count == 0 or len(run) < count or any(other.command != item.command for other in run):
                return None
            zones.append(Zone(tuple(_corner(vehicle, corner) for corner in run), inclusion))
            at += count
        else:
            at += 1
    return tuple(zones)


def _corner(vehicle: Vehicle, item: WireItem) -> tuple[float, float]:
    n, e, _ = vehicle.geo.to_ned(Geodetic(item.x / 1e7, item.y / 1e7, 0.0))
    return (n, e)
