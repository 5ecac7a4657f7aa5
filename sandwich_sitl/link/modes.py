"""Flight modes of PX4 and ArduCopter as numbers on the wire.

PX4: custom_mode = main << 16 | sub << 24, DO_SET_MODE takes main and sub apart (px4_custom_mode.h). ArduCopter:
custom_mode is the mode's number, in DO_SET_MODE's param2.
"""

from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.errors import LinkError
from sandwich_sitl.mission.vehicle_view import Autopilot, FlightMode

AUTOPILOTS = {
    mavlink.MAV_AUTOPILOT_PX4: Autopilot.PX4,
    mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: Autopilot.ARDUPILOT,
}

_PX4 = {
    FlightMode.MANUAL: (1, 0),
    FlightMode.ALTITUDE: (2, 0),
    FlightMode.POSITION: (3, 0),
    FlightMode.TAKEOFF: (4, 2),
    FlightMode.LOITER: (4, 3),
    FlightMode.MISSION: (4, 4),
    FlightMode.RTL: (4, 5),
    FlightMode.LAND: (4, 6),
    FlightMode.ACRO: (5, 0),
    FlightMode.OFFBOARD: (6, 0),
    FlightMode.STABILIZED: (7, 0),
}
_PX4_BY_NUMBER = {main << 16 | sub << 24: mode for mode, (main, sub) in _PX4.items()}

_ARDUCOPTER = {
    0: FlightMode.STABILIZED,
    1: FlightMode.ACRO,
    2: FlightMode.ALTITUDE,
    3: FlightMode.MISSION,
    4: FlightMode.OFFBOARD,
    5: FlightMode.POSITION,
    6: FlightMode.RTL,
    9: FlightMode.LAND,
    16: FlightMode.POSITION,
    17: FlightMode.LOITER,
    21: FlightMode.RTL,
}
_ARDUCOPTER_NUMBER = {FlightMode.OFFBOARD: 4, FlightMode.LAND: 9, FlightMode.RTL: 6, FlightMode.LOITER: 17}


def mode_of(autopilot: Autopilot, custom_mode: int) -> FlightMode:
    """The mode a HEARTBEAT shows; `OTHER` for numbers this program has no use for."""
    table = {Autopilot.PX4: _PX4_BY_NUMBER, Autopilot.ARDUPILOT: _ARDUCOPTER}.get(autopilot, {})
    return table.get(custom_mode, FlightMode.OTHER)


def mode_parameters(autopilot: Autopilot, mode: FlightMode) -> tuple[float, float, float]:
    """param1 to param3 of MAV_CMD_DO_SET_MODE. Raises `LinkError` for a mode the autopilot does not have."""
    base = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    if autopilot is Autopilot.PX4 and mode in _PX4:
        main, sub = _PX4[mode]
        return base, float(main), float(sub)
    if autopilot is Autopilot.ARDUPILOT and mode in _ARDUCOPTER_NUMBER:
        return base, float(_ARDUCOPTER_NUMBER[mode]), 0.0
    raise LinkError(f"mode {mode.value} has no number on autopilot '{autopilot.value}'; use PX4 or ArduPilot")
