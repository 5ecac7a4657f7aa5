"""Who the vehicle is and what it is doing: version, protocol, mode, mission."""

from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.vehicle import Vehicle

_RELEASE = 0x011000FF


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
