"""COMMAND_LONG and COMMAND_INT: from parameters to the autopilot, with PX4's results (rows 7 to 9, 20).

A handler takes (vehicle, session, parameters) and returns MAV_RESULT. Parameters may be NaN: "not given".
"""

from collections.abc import Callable
from math import isfinite, nan
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.results import Result
from vehicle_sim.geo import Geodetic
from vehicle_sim.protocol.session import Session
from vehicle_sim.rotation import Vector
from vehicle_sim.telemetry.identity import AVAILABLE_MODES, PROTOCOL_VERSION, available_modes
from vehicle_sim.vehicle import Vehicle

_CUSTOM_MODE_FLAG = 1
_FORCE_MAGIC = 21196.0
_FARTHEST_M = 1e6


class Command(NamedTuple):
    """A command's number and parameters. `latitude_deg, longitude_deg` are param5 and param6 in degrees."""

    number: int
    p1: float
    p2: float
    p3: float
    p4: float
    latitude_deg: float
    longitude_deg: float
    p7: float


Handler = Callable[[Vehicle, Session, Command], Result]


def execute(vehicle: Vehicle, session: Session, command: Command) -> list[Result]:
    """Carry a command out. DO_SET_MODE answers twice, every other once."""
    if command.number == mavlink.MAV_CMD_DO_SET_MODE:
        return [Result.ACCEPTED, _set_mode(vehicle, command)]
    handler = HANDLERS.get(command.number)
    return [handler(vehicle, session, command) if handler is not None else Result.UNSUPPORTED]


def _set_mode(v: Vehicle, c: Command) -> Result:
    flags, main, sub = _integer(c.p1), _integer(c.p2), _integer(c.p3) or 0
    if flags is None or main is None or not flags & _CUSTOM_MODE_FLAG:
        return Result.TEMPORARILY_REJECTED
    return v.autopilot.request_mode(Mode.from_numbers(main, sub))


def _arm_or_disarm(v: Vehicle, _session: Session, c: Command) -> Result:
    force = c.p2 == _FORCE_MAGIC
    if c.p1 == 1.0:
        return v.autopilot.request_arm()
    if c.p1 == 0.0:
        return v.autopilot.request_disarm(force)
    return Result.DENIED


def _take_off(v: Vehicle, _session: Session, c: Command) -> Result:
    down_m = v.geo.origin.altitude_m - c.p7
    return v.autopilot.request_takeoff(v.estimate, down_m)


def _land(v: Vehicle, _session: Session, _c: Command) -> Result:
    return v.autopilot.request_mode(Mode.LAND)


def _return(v: Vehicle, _session: Session, _c: Command) -> Result:
    return v.autopilot.request_mode(Mode.RTL)


def _loiter(v: Vehicle, _session: Session, _c: Command) -> Result:
    return v.autopilot.request_mode(Mode.LOITER)


def _reposition(v: Vehicle, _session: Session, c: Command) -> Result:
    target = target_ned(v, c)
    return v.autopilot.request_reposition(v.estimate, target, _finite(c.p4), c.p1)


def _change_speed(v: Vehicle, _session: Session, c: Command) -> Result:
    return v.autopilot.request_speed(c.p2)


def _set_message_interval(_v: Vehicle, session: Session, c: Command) -> Result:
    message_id, interval_us = _integer(c.p1), _integer(c.p2)
    if message_id is None or interval_us is None or not session.set_interval(message_id, max(-1, interval_us)):
        return Result.FAILED
    return Result.ACCEPTED


def _get_message_interval(_v: Vehicle, session: Session, c: Command) -> Result:
    message_id = _integer(c.p1)
    if message_id is None or not 0 <= message_id <= 65535:
        return Result.FAILED
    session.send(mavlink.MAVLink_message_interval_message(message_id, session.interval_us(message_id)))
    return Result.ACCEPTED


def _request_message(_v: Vehicle, session: Session, c: Command) -> Result:
    message_id = _integer(c.p1)
    if message_id == AVAILABLE_MODES:
        modes = available_modes(_integer(c.p2) or 0)
        for mode in modes:
            session.send(mode)
        return Result.ACCEPTED if modes else Result.DENIED
    return Result.ACCEPTED if message_id is not None and session.request(message_id) else Result.DENIED


def _request_protocol(_v: Vehicle, session: Session, _c: Command) -> Result:
    session.request(PROTOCOL_VERSION)
    return Result.ACCEPTED


def _request_version(_v: Vehicle, session: Session, _c: Command) -> Result:
    session.request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    return Result.ACCEPTED


def _get_home(_v: Vehicle, session: Session, _c: Command) -> Result:
    return Result.ACCEPTED if session.request(mavlink.MAVLINK_MSG_ID_HOME_POSITION) else Result.DENIED


def _set_home(v: Vehicle, _session: Session, c: Command) -> Result:
    target = v.estimate.position_ned_m if c.p1 == 1.0 else target_ned(v, c)
    if not all(isfinite(value) for value in target):
        return Result.DENIED
    v.autopilot.home_ned_m = target
    return Result.ACCEPTED


def _run_prearm_checks(v: Vehicle, _session: Session, _c: Command) -> Result:
    return Result.TEMPORARILY_REJECTED if v.autopilot.commander.armed else Result.ACCEPTED


def _terminate(v: Vehicle, _session: Session, c: Command) -> Result:
    return v.autopilot.request_termination() if c.p1 > 0.5 else Result.DENIED


def _start_mission(v: Vehicle, _session: Session, c: Command) -> Result:
    first = _integer(c.p1)
    if first and not v.autopilot.steering.mission.select(first):
        return Result.DENIED
    return v.autopilot.request_mode(Mode.MISSION)


def _pause_or_continue(v: Vehicle, _session: Session, c: Command) -> Result:
    return v.autopilot.request_mode(Mode.LOITER if c.p1 == 0.0 else Mode.MISSION)


def _set_mission_current(v: Vehicle, _session: Session, c: Command) -> Result:
    index = _integer(c.p1)
    return Result.ACCEPTED if index is not None and v.autopilot.steering.mission.select(index) else Result.DENIED


def _inject_failure(v: Vehicle, _session: Session, c: Command) -> Result:
    if not v.autopilot.parameters.integer("SYS_FAILURE_EN"):
        return Result.DENIED
    unit, kind, instance = _integer(c.p1), _integer(c.p2), _integer(c.p3)
    return Result.ACCEPTED if v.inject_failure(unit, kind, instance or 0) else Result.UNSUPPORTED


HANDLERS: dict[int, Handler] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: _arm_or_disarm,
    mavlink.MAV_CMD_NAV_TAKEOFF: _take_off,
    mavlink.MAV_CMD_NAV_LAND: _land,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: _return,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: _loiter,
    mavlink.MAV_CMD_DO_REPOSITION: _reposition,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: _change_speed,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: _set_message_interval,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: _get_message_interval,
    mavlink.MAV_CMD_REQUEST_MESSAGE: _request_message,
    mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION: _request_protocol,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _request_version,
    mavlink.MAV_CMD_GET_HOME_POSITION: _get_home,
    mavlink.MAV_CMD_DO_SET_HOME: _set_home,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: _run_prearm_checks,
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION: _terminate,
    mavlink.MAV_CMD_MISSION_START: _start_mission,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: _pause_or_continue,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: _set_mission_current,
    mavlink.MAV_CMD_INJECT_FAILURE: _inject_failure,
}


def target_ned(v: Vehicle, c: Command) -> Vector:
    """Local position of a command's latitude, longitude and altitude; NaN where not given."""
    n, e, d = v.geo.to_ned(Geodetic(_finite(c.latitude_deg), _finite(c.longitude_deg), _finite(c.p7)))
    return (_near(n), _near(e), _near(d))


def _near(value_m: float) -> float:
    """A place that no vehicle of this kind reaches counts as not given."""
    return value_m if abs(value_m) < _FARTHEST_M else nan


def _integer(value: float) -> int | None:
    return round(value) if isfinite(value) else None


def _finite(value: float) -> float:
    return value if isfinite(value) else nan
