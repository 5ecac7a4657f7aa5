"""Who the vehicle is and what it is doing: version, protocol, modes, mission.

CURRENT_MODE, AVAILABLE_MODES and PROTOCOL_VERSION are not in pymavlink's dialect `common`, so they are packed here: (id, checksum seed,
length in MAVLink 1, payload), fields in wire order.
"""

from struct import Struct
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.modes import MODE_TABLE, Mode
from vehicle_sim.protocol.payloads import Payload
from vehicle_sim.vehicle import Vehicle

PROTOCOL_VERSION, AVAILABLE_MODES, CURRENT_MODE = 300, 435, 436
_PROTOCOL_VERSION = Struct("<HHH8s8s")
_AVAILABLE_MODES = Struct("<IIBBB35s")
_CURRENT_MODE = Struct("<IIB")
_RELEASE = 0x011000FF
_ADVANCED = 1
#: In PX4's order, each with its MAV_STANDARD_MODE (0: none, so that it is known by its name).
_STANDARD_MODES = {
    Mode.MANUAL: 0, Mode.ALTCTL: 4, Mode.POSCTL: 1, Mode.MISSION: 6, Mode.LOITER: 0, Mode.RTL: 5, Mode.ACRO: 0,
    Mode.OFFBOARD: 0, Mode.STABILIZED: 0, Mode.TAKEOFF: 8, Mode.LAND: 7, Mode.DESCEND: 0, Mode.TERMINATE: 0, Mode.READY: 0,
}  # fmt: skip
_SELECTABLE = tuple(_STANDARD_MODES)[:11]
_PLAIN_MODES = (Mode.ALTCTL, Mode.POSCTL)


def autopilot_version(v: Vehicle) -> Any:
    """AUTOPILOT_VERSION."""
    capabilities = (
        mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    )
    return mavlink.MAVLink_autopilot_version_message(
        capabilities, _RELEASE, _RELEASE, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, v.config.system_id, [0] * 18
    )


def mission_current(v: Vehicle) -> Any:
    """MISSION_CURRENT: item, how many, and whether it is being flown."""
    mission, commander = v.autopilot.steering.mission, v.autopilot.commander
    if not mission.items:
        state = mavlink.MISSION_STATE_NO_MISSION
    elif mission.finished:
        state = mavlink.MISSION_STATE_COMPLETE
    elif commander.armed and commander.flown_mode is Mode.MISSION:
        state = mavlink.MISSION_STATE_ACTIVE
    else:
        state = mavlink.MISSION_STATE_PAUSED if mission.current else mavlink.MISSION_STATE_NOT_STARTED
    flown = 1 if commander.flown_mode is Mode.MISSION else 2
    return mavlink.MAVLink_mission_current_message(mission.current, len(mission.items), state, flown)


def protocol_version(_v: Vehicle) -> Payload:
    """PROTOCOL_VERSION: MAVLink 1 to 2."""
    return (PROTOCOL_VERSION, bytes((217,)), 22, _PROTOCOL_VERSION.pack(200, 100, 200, bytes(8), bytes(8)))


def current_mode(v: Vehicle) -> Payload:
    """CURRENT_MODE: the mode that flies, and the one that the pilot wants."""
    commander = v.autopilot.commander
    flown = commander.flown_mode
    data = _CURRENT_MODE.pack(flown.custom_mode, commander.mode.custom_mode, _STANDARD_MODES[flown])
    return (CURRENT_MODE, bytes((193,)), 9, data)


def available_modes(index: int) -> list[Payload]:
    """AVAILABLE_MODES: one mode (counted from 1), or all for 0; empty when there is no such mode."""
    numbers = range(1, len(_SELECTABLE) + 1) if index == 0 else [index]
    return [_available_mode(number) for number in numbers if 1 <= number <= len(_SELECTABLE)]


def _available_mode(number: int) -> Payload:
    mode = _SELECTABLE[number - 1]
    standard = _STANDARD_MODES[mode]
    properties = 0 if mode in _PLAIN_MODES else _ADVANCED
    name = b"" if standard else MODE_TABLE[mode].label.encode()
    data = _AVAILABLE_MODES.pack(mode.custom_mode, properties, len(_SELECTABLE), number, standard, name)
    return (AVAILABLE_MODES, bytes((134,)), 46, data)
