"""Telemetry frames to `VehicleView`.

State: the newest value of every field. Input: frames of the vehicle that was heard first and the run clock of their
arrival in seconds. Output: a frozen view in ENU metres of the world's frame.
"""

import struct
from collections.abc import Callable, Mapping
from math import isfinite
from types import MappingProxyType
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.errors import InputError
from sandwich_sitl.link.codec import decode
from sandwich_sitl.link.frames import (
    enu_from_ned,
    position_enu_from_ned,
    quaternion_enu_from_ned,
    quaternion_from_euler,
)
from sandwich_sitl.link.messages import ACK_OF
from sandwich_sitl.link.modes import AUTOPILOTS, mode_of
from sandwich_sitl.link.range_scan import scan_of
from sandwich_sitl.link.wire import Frame
from sandwich_sitl.mission.vehicle_view import (
    AckOf,
    AckResult,
    Autopilot,
    CommandAck,
    RangeScan,
    StatusText,
    SystemStatus,
    VehicleView,
)

_RESULT_CANCELLED = 6  # MAV_RESULT_CANCELLED, which pymavlink's dialect does not name
_RESULTS = {
    mavlink.MAV_RESULT_ACCEPTED: AckResult.ACCEPTED,
    mavlink.MAV_RESULT_TEMPORARILY_REJECTED: AckResult.TEMPORARILY_REJECTED,
    mavlink.MAV_RESULT_DENIED: AckResult.DENIED,
    mavlink.MAV_RESULT_UNSUPPORTED: AckResult.UNSUPPORTED,
    mavlink.MAV_RESULT_FAILED: AckResult.FAILED,
    mavlink.MAV_RESULT_IN_PROGRESS: AckResult.IN_PROGRESS,
    _RESULT_CANCELLED: AckResult.CANCELLED,
}
_LANDED = {
    mavlink.MAV_LANDED_STATE_ON_GROUND: True,
    mavlink.MAV_LANDED_STATE_IN_AIR: False,
    mavlink.MAV_LANDED_STATE_TAKEOFF: False,
    mavlink.MAV_LANDED_STATE_LANDING: False,
}
_INTEGER_CODES = {
    mavlink.MAV_PARAM_TYPE_UINT8: "<B3x",
    mavlink.MAV_PARAM_TYPE_INT8: "<b3x",
    mavlink.MAV_PARAM_TYPE_UINT16: "<H2x",
    mavlink.MAV_PARAM_TYPE_INT16: "<h2x",
    mavlink.MAV_PARAM_TYPE_UINT32: "<I",
    mavlink.MAV_PARAM_TYPE_INT32: "<i",
}
_CHUNK = 50  # characters of a STATUSTEXT; a shorter one is the last of its text


def payload(raw: bytes | bytearray) -> bytes:
    """Payload of one frame (pymavlink's `get_payload` begins within the header of a MAVLink 2 frame)."""
    start = 10 if raw[0] == mavlink.PROTOCOL_MARKER_V2 else 6
    return bytes(raw[start : start + raw[1]])


def is_autopilot_heartbeat(frame: Frame) -> bool:
    """True for the HEARTBEAT of an autopilot, false for a ground station's, a companion's or a camera's."""
    if frame.message_id != mavlink.MAVLINK_MSG_ID_HEARTBEAT:
        return False
    message = decode(frame.message_id, frame.raw)
    return bool(message.autopilot != mavlink.MAV_AUTOPILOT_INVALID and message.type != mavlink.MAV_TYPE_GCS)


def boot_time_s(frame: Frame) -> float | None:
    """The vehicle's boot time in a frame that tells it, in seconds."""
    if frame.message_id not in _TIMED:
        return None
    return float(decode(frame.message_id, frame.raw).time_boot_ms) * 1e-3


_TIMED = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    }
)


class Telemetry:
    """Collects what one vehicle says. `own` is (system, component) of this process: other peers' answers are left out."""

    def __init__(self, origin_m: tuple[float, float], own: tuple[int, int]) -> None:
        self._origin_m = origin_m
        self._own = own
        self._fields: dict[str, Any] = {}
        self._parameters: Mapping[str, float] = MappingProxyType({})
        self._texts: list[StatusText] = []
        self._acks: list[CommandAck] = []
        self._scans: list[RangeScan] = []
        self._problems: list[str] = []
        self._not_finite: list[str] = []
        self._chunks: tuple[int, int, str] | None = None
        self._interval_acks = 0
        self._handlers: dict[int, Callable[[Any, float], None]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_sys_state,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._attitude_quaternion,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self._home_position,
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: self._estimator_status,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery_status,
            mavlink.MAVLINK_MSG_ID_STATUSTEXT: self._statustext,
            mavlink.MAVLINK_MSG_ID_COMMAND_ACK: self._command_ack,
            mavlink.MAVLINK_MSG_ID_PARAM_VALUE: self._param_value,
            mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: self._obstacle_distance,
        }

    @property
    def autopilot(self) -> Autopilot:
        """Kind of autopilot, once its HEARTBEAT was heard."""
        kind: Autopilot = self._fields.get("autopilot", Autopilot.UNKNOWN)
        return kind

    def feed(self, frame: Frame, now_s: float) -> None:
        """Take in one frame of the vehicle, heard at `now_s` of the run clock."""
        self._fields["last_heard_s"] = now_s
        handler = self._handlers.get(frame.message_id)
        if handler is not None:
            handler(decode(frame.message_id, frame.raw), now_s)

    def view(self, heard: bool) -> VehicleView:
        """The view since the last call; texts and acknowledgements are handed out once, and kept until `heard`."""
        if not heard:
            return VehicleView(**self._fields)
        view = VehicleView(
            heard=True,
            status_texts=tuple(self._texts),
            acks=tuple(self._acks),
            scans=tuple(self._scans),
            scan_problems=tuple(self._problems),
            not_finite=tuple(self._not_finite),
            parameters=self._parameters,
            **self._fields,
        )
        self._texts.clear()
        self._acks.clear()
        self._scans.clear()
        self._problems.clear()
        self._not_finite.clear()
        return view

    def take_interval_acks(self) -> int:
        """How many message intervals were answered since the last call (the answer does not say which)."""
        count, self._interval_acks = self._interval_acks, 0
        return count

    def _heartbeat(self, message: Any, now_s: float) -> None:
        autopilot = AUTOPILOTS.get(message.autopilot, Autopilot.UNKNOWN)
        status = message.system_status
        self._fields.update(
            heartbeat_s=now_s,
            autopilot=autopilot,
            armed=bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            mode=mode_of(autopilot, message.custom_mode),
            system_status=SystemStatus(status) if 0 <= status <= max(SystemStatus) else SystemStatus.UNINIT,
        )

    def _sys_status(self, message: Any, _now_s: float) -> None:
        health = message.onboard_control_sensors_health
        self._fields["prearm_ok"] = bool(health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
        self._battery(message.battery_remaining)

    def _extended_sys_state(self, message: Any, _now_s: float) -> None:
        self._fields["landed"] = _LANDED.get(message.landed_state)

    def _local_position(self, message: Any, _now_s: float) -> None:
        if self._takes("LOCAL_POSITION_NED", message.x, message.y, message.z, message.vx, message.vy, message.vz):
            self._fields.update(
                r_m=position_enu_from_ned(message.x, message.y, message.z, self._origin_m),
                v_mps=enu_from_ned(message.vx, message.vy, message.vz),
                position_time_s=message.time_boot_ms * 1e-3,
            )

    def _attitude(self, message: Any, _now_s: float) -> None:
        if self._takes("ATTITUDE", message.roll, message.pitch, message.yaw):
            q = quaternion_from_euler(message.roll, message.pitch, message.yaw)
            self._fields["q_wxyz"] = quaternion_enu_from_ned(*q)

    def _attitude_quaternion(self, message: Any, _now_s: float) -> None:
        self._handlers.pop(mavlink.MAVLINK_MSG_ID_ATTITUDE, None)  # the better answer to the same question
        q = message.q1, message.q2, message.q3, message.q4
        if self._takes("ATTITUDE_QUATERNION", *q):
            self._fields["q_wxyz"] = quaternion_enu_from_ned(*q)

    def _takes(self, name: str, *values: float) -> bool:
        """Whether a message counts; one that is not finite is noted and does not: what was heard before it grows old."""
        finite = all(map(isfinite, values))
        if not finite:
            self._not_finite.append(name)
        return finite

    def _home_position(self, _message: Any, _now_s: float) -> None:
        self._fields["home_known"] = True

    def _estimator_status(self, message: Any, _now_s: float) -> None:
        if message.pos_horiz_accuracy >= 0.0:  # NaN says nothing
            self._fields["position_std_m"] = float(message.pos_horiz_accuracy)

    def _battery_status(self, message: Any, _now_s: float) -> None:
        self._battery(message.battery_remaining)

    def _battery(self, percent: int) -> None:
        if percent >= 0:
            self._fields["battery_percent"] = float(percent)

    def _statustext(self, message: Any, _now_s: float) -> None:
        chunk: str = message.text
        if message.id == 0:
            self._say(message.severity, chunk)
            return
        if self._chunks is not None and self._chunks[0] == message.id:
            chunk = self._chunks[2] + chunk
        elif self._chunks is not None:
            self._say(self._chunks[1], self._chunks[2])
        self._chunks = (message.id, message.severity, chunk)
        if len(message.text) < _CHUNK:
            self._say(message.severity, chunk)
            self._chunks = None

    def _say(self, severity: int, text: str) -> None:
        self._texts.append(StatusText(severity, text))

    def _command_ack(self, message: Any, _now_s: float) -> None:
        if message.target_system not in (0, self._own[0]) or message.target_component not in (0, self._own[1]):
            return
        command = ACK_OF.get(message.command, AckOf.OTHER)
        if command is AckOf.MESSAGE_INTERVAL:
            self._interval_acks += 1
            return
        self._acks.append(CommandAck(command, _RESULTS.get(message.result, AckResult.OTHER)))

    def _obstacle_distance(self, message: Any, now_s: float) -> None:
        r_m, q_wxyz = self._fields.get("r_m"), self._fields.get("q_wxyz")
        if r_m is None or q_wxyz is None:
            return
        try:
            self._scans.append(scan_of(message, now_s, r_m, q_wxyz))
        except InputError as error:
            self._problems.append(str(error))

    def _param_value(self, message: Any, _now_s: float) -> None:
        name = message.param_id
        value = float(message.param_value)
        code = _INTEGER_CODES.get(message.param_type)
        if code is not None and self.autopilot is Autopilot.PX4:
            value = float(struct.unpack(code, payload(message.get_msgbuf()).ljust(4, b"\0")[:4])[0])
        self._parameters = MappingProxyType({**self._parameters, name: value})
