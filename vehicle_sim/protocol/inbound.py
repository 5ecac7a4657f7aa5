"""What clients send, message by message: set-points, sticks, commands, modes, time, parameters. One function a message.

A handler takes (node, session, received); it reads the message, asks the autopilot and answers through the session.
"""

from collections.abc import Callable
from math import nan
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.guidance import Sticks
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.results import Result, Severity
from vehicle_sim.autopilot.setpoints import FRAME_LOCAL_NED, SetpointMessage, interpret_attitude
from vehicle_sim.geo import Geodetic
from vehicle_sim.protocol.codec import Received
from vehicle_sim.protocol.commands import Command, execute
from vehicle_sim.protocol.parameters import find_parameter, parameter_list, parameter_value, set_parameter
from vehicle_sim.protocol.session import Session

if TYPE_CHECKING:
    from vehicle_sim.protocol.node import Node

Handler = Callable[["Node", Session, Received], None]
_INT32_NOT_GIVEN = 2**31 - 1
_STICK_NOT_GIVEN = 32767
_COMMAND_INT_FRAMES = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_RELATIVE_FRAMES = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_FTP_NAK, _FTP_UNKNOWN_COMMAND = 129, 7


def _heartbeat(node: "Node", session: Session, received: Received) -> None:
    if received.message.type == mavlink.MAV_TYPE_GCS:
        session.is_gcs = True
        node.vehicle.autopilot.receive_gcs_heartbeat()


def _local_setpoint(node: "Node", _session: Session, received: Received) -> None:
    m = received.message
    setpoint = SetpointMessage(
        m.coordinate_frame,
        m.type_mask,
        (m.x, m.y, m.z),
        (m.vx, m.vy, m.vz),
        (m.afx, m.afy, m.afz),
        m.yaw,
        m.yaw_rate,
    )
    idle = node.lockstep and setpoint.ignores_all_axes
    node.vehicle.autopilot.receive_setpoint(setpoint, node.vehicle.estimate, complain=not idle)


def _global_setpoint(node: "Node", _session: Session, received: Received) -> None:
    m, v = received.message, node.vehicle
    altitude_m = m.alt
    if m.coordinate_frame in _RELATIVE_FRAMES:
        altitude_m += v.geo.origin.altitude_m - (v.autopilot.home_ned_m or (0.0, 0.0, 0.0))[2]
    elif m.coordinate_frame not in _COMMAND_INT_FRAMES:
        text = f"SET_POSITION_TARGET_GLOBAL_INT coordinate frame {m.coordinate_frame} unsupported"
        v.autopilot.commander.say(Severity.CRITICAL, text)
        return
    position = v.geo.to_ned(Geodetic(m.lat_int / 1e7, m.lon_int / 1e7, altitude_m))
    velocity, acceleration = (m.vx, m.vy, m.vz), (m.afx, m.afy, m.afz)
    setpoint = SetpointMessage(FRAME_LOCAL_NED, m.type_mask, position, velocity, acceleration, m.yaw, m.yaw_rate)
    v.autopilot.receive_setpoint(setpoint, v.estimate)


def _attitude_setpoint(node: "Node", _session: Session, received: Received) -> None:
    m = received.message
    rates = (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate)
    setpoint = interpret_attitude(m.type_mask, tuple(m.q), rates, m.thrust)
    if setpoint is not None:
        node.vehicle.autopilot.receive_attitude(setpoint)


def _manual_control(node: "Node", _session: Session, received: Received) -> None:
    m = received.message
    if _STICK_NOT_GIVEN not in (m.x, m.y, m.z, m.r):
        forward, right, up, turn = (
            max(-1.0, min(1.0, value)) for value in (m.x / 1e3, m.y / 1e3, m.z / 500 - 1, m.r / 1e3)
        )
        node.vehicle.autopilot.receive_sticks(Sticks(forward, right, up, turn))


def _command_long(node: "Node", session: Session, received: Received) -> None:
    m = received.message
    command = Command(m.command, m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
    _acknowledge(session, received, m.command, execute(node.vehicle, session, command))


def _command_int(node: "Node", session: Session, received: Received) -> None:
    m = received.message
    if m.frame not in _COMMAND_INT_FRAMES:
        _acknowledge(session, received, m.command, [Result.UNSUPPORTED_MAV_FRAME])
        return
    latitude, longitude = (nan if value == _INT32_NOT_GIVEN else value / 1e7 for value in (m.x, m.y))
    command = Command(m.command, m.param1, m.param2, m.param3, m.param4, latitude, longitude, m.z)
    _acknowledge(session, received, m.command, execute(node.vehicle, session, command))


def _set_mode(node: "Node", session: Session, received: Received) -> None:
    m = received.message
    mode = Mode.from_numbers(m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24 & 0xFF)
    _acknowledge(session, received, mavlink.MAV_CMD_DO_SET_MODE, [node.vehicle.autopilot.request_mode(mode)])


def _acknowledge(session: Session, received: Received, command: int, results: list[Result]) -> None:
    for result in results:
        session.send(
            mavlink.MAVLink_command_ack_message(command, int(result), 0, 0, received.system_id, received.component_id)
        )


def _timesync(node: "Node", session: Session, received: Received) -> None:
    if received.message.tc1 == 0:
        session.send(mavlink.MAVLink_timesync_message(node.vehicle.t_us * 1000, received.message.ts1))


def _ping(_node: "Node", session: Session, received: Received) -> None:
    m = received.message
    if m.target_system == 0 and m.target_component == 0:
        session.send(mavlink.MAVLink_ping_message(m.time_usec, m.seq, received.system_id, received.component_id))


def _parameter_list(node: "Node", session: Session, _received: Received) -> None:
    session.send_parameters(parameter_list(node.vehicle.autopilot.parameters))


def _parameter_read(node: "Node", session: Session, received: Received) -> None:
    m = received.message
    value = find_parameter(node.vehicle.autopilot.parameters, m.param_index, m.param_id)
    if value is not None:
        session.send(value)


def _parameter_set(node: "Node", session: Session, received: Received) -> None:
    m, store = received.message, node.vehicle.autopilot.parameters
    problem = set_parameter(store, m.param_id, m.param_value, m.param_type)
    name = m.param_id.decode("ascii", "replace") if isinstance(m.param_id, bytes) else m.param_id
    if problem is not None:
        node.vehicle.autopilot.commander.say(Severity.WARNING, problem)
    if name in store:
        for listener in node.sessions.values() if problem is None else (session,):
            listener.send(parameter_value(store, name))


def _file_transfer(_node: "Node", session: Session, received: Received) -> None:
    """There is no file system: every request is refused as an unknown command, so that nobody waits."""
    asked = bytes(received.message.payload)
    sequence = (int.from_bytes(asked[0:2], "little") + 1) & 0xFFFF
    answer = sequence.to_bytes(2, "little") + bytes((asked[2], _FTP_NAK, 1, asked[3], 0, 0, 0, 0, 0, 0))
    body = list(answer + bytes((_FTP_UNKNOWN_COMMAND,))) + [0] * (251 - 13)
    if asked[3] != _FTP_NAK:
        session.send(mavlink.MAVLink_file_transfer_protocol_message(0, received.system_id, received.component_id, body))


def _setup_signing(node: "Node", _session: Session, received: Received) -> None:
    """A new key, or none; not in flight. With a key in force only a message signed with it comes this far."""
    if node.vehicle.autopilot.commander.armed:
        node.vehicle.autopilot.commander.say(Severity.WARNING, "Signing not changed: vehicle is armed")
        return
    node.signing.set_up(bytes(received.message.secret_key), received.message.initial_timestamp)


def _log_list(_node: "Node", session: Session, _received: Received) -> None:
    session.send(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))


HANDLERS: dict[str, Handler] = {
    "HEARTBEAT": _heartbeat,
    "SET_POSITION_TARGET_LOCAL_NED": _local_setpoint,
    "SET_POSITION_TARGET_GLOBAL_INT": _global_setpoint,
    "SET_ATTITUDE_TARGET": _attitude_setpoint,
    "MANUAL_CONTROL": _manual_control,
    "COMMAND_LONG": _command_long,
    "COMMAND_INT": _command_int,
    "SET_MODE": _set_mode,
    "TIMESYNC": _timesync,
    "PING": _ping,
    "PARAM_REQUEST_LIST": _parameter_list,
    "PARAM_REQUEST_READ": _parameter_read,
    "PARAM_SET": _parameter_set,
    "FILE_TRANSFER_PROTOCOL": _file_transfer,
    "SETUP_SIGNING": _setup_signing,
    "LOG_REQUEST_LIST": _log_list,
    "MISSION_REQUEST_LIST": lambda node, session, received: node.missions.on_list(session, received),
    "MISSION_REQUEST_INT": lambda node, session, received: node.missions.on_request(session, received),
    "MISSION_REQUEST": lambda node, session, received: node.missions.on_request(session, received),
    "MISSION_COUNT": lambda node, session, received: node.missions.on_count(session, received),
    "MISSION_ITEM_INT": lambda node, session, received: node.missions.on_item(session, received),
    "MISSION_ITEM": lambda node, session, received: node.missions.on_item(session, received),
    "MISSION_CLEAR_ALL": lambda node, session, received: node.missions.on_clear(session, received),
    "MISSION_ACK": lambda node, session, received: node.missions.on_acknowledgement(session, received),
    "MISSION_SET_CURRENT": lambda node, session, received: node.missions.on_set_current(session, received),
}
