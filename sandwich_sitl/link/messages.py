"""The mission's dataclasses to MAVLink 2 frames.

State: the sequence number of the sender. Input: ENU setpoints and commands. Output: bytes of one frame. A setpoint
that is not finite raises `LinkError` before anything is encoded (a NaN position crashes ArduPilot, PX4 reads it as
"ignore").
"""

from math import isfinite
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.errors import LinkError
from sandwich_sitl.link.codec import Layout
from sandwich_sitl.link.frames import Triple, flip_yaw, ned_from_enu, position_ned_from_enu
from sandwich_sitl.link.modes import mode_parameters
from sandwich_sitl.mission.commands import Arm, Command, ReadParameter, SetMessageInterval, SetMode, TakeOff
from sandwich_sitl.mission.setpoint import Setpoint
from sandwich_sitl.mission.vehicle_view import AckOf, Autopilot

IGNORE_POSITION = 0x007
IGNORE_VELOCITY = 0x038
IGNORE_ACCELERATION = 0x1C0
IGNORE_YAW = 0x400
IGNORE_YAW_RATE = 0x800
IDLE_MASK = IGNORE_POSITION | IGNORE_VELOCITY | IGNORE_ACCELERATION | IGNORE_YAW | IGNORE_YAW_RATE

ACK_OF = {
    mavlink.MAV_CMD_DO_SET_MODE: AckOf.SET_MODE,
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: AckOf.ARM,
    mavlink.MAV_CMD_NAV_TAKEOFF: AckOf.TAKE_OFF,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: AckOf.MESSAGE_INTERVAL,
}

_SETPOINT = Layout(mavlink.MAVLink_set_position_target_local_ned_message)
_TIMESYNC = Layout(mavlink.MAVLink_timesync_message)
_ZERO: Triple = (0.0, 0.0, 0.0)
_FARTHEST = 1e6  # metres; no local frame reaches farther


class Encoder:
    """Encodes for one sender (`system_id`, `component_id`) towards one vehicle, set by `address`."""

    def __init__(self, system_id: int, component_id: int, origin_m: tuple[float, float]) -> None:
        self._mav = mavlink.MAVLink(None, system_id, component_id)
        self._origin_m = origin_m
        self._target = (0, 0)
        self._autopilot = Autopilot.UNKNOWN

    def address(self, system_id: int, component_id: int, autopilot: Autopilot) -> None:
        """Send to this vehicle from now on."""
        self._target = (system_id, component_id)
        self._autopilot = autopilot

    def heartbeat(self) -> bytes:
        """HEARTBEAT of an onboard controller."""
        return self._pack(
            self._mav.heartbeat_encode(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE
            )
        )

    def setpoint(self, setpoint: Setpoint, boot_ms: int) -> bytes:
        """SET_POSITION_TARGET_LOCAL_NED in frame LOCAL_NED. Raises `LinkError` for values that must not be sent."""
        mask = IGNORE_YAW_RATE
        r, v, a = _ZERO, _ZERO, _ZERO
        if setpoint.r_m is None:
            mask |= IGNORE_POSITION
        else:
            r = position_ned_from_enu(setpoint.r_m, self._origin_m)
        if setpoint.v_mps is None:
            mask |= IGNORE_VELOCITY
        else:
            v = ned_from_enu(setpoint.v_mps)
        if setpoint.a_mps2 is None:
            mask |= IGNORE_ACCELERATION
        else:
            a = ned_from_enu(setpoint.a_mps2)
        if mask & IDLE_MASK == IDLE_MASK & ~IGNORE_YAW:
            raise LinkError("a setpoint needs a position, a velocity or an acceleration")
        if not all(isfinite(value) and abs(value) < _FARTHEST for value in (*r, *v, *a, setpoint.yaw_rad)):
            raise LinkError(f"a setpoint must be finite, got position {r}, velocity {v}, acceleration {a} (NED)")
        return self._target_frame(boot_ms, mask, (*r, *v, *a), flip_yaw(setpoint.yaw_rad))

    def idle(self, boot_ms: int) -> bytes:
        """The same message with every axis ignored: a lockstep tick that asks for nothing."""
        return self._target_frame(boot_ms, IDLE_MASK, (0.0,) * 9, 0.0)

    def timesync(self, tc1_ns: int, ts1_ns: int) -> bytes:
        """The answer to a TIMESYNC request."""
        return self._prepared(_TIMESYNC, tc1_ns, ts1_ns)

    def command(self, command: Command, confirmation: int = 0) -> bytes:
        """COMMAND_LONG or PARAM_REQUEST_READ; `confirmation` counts the repetitions."""
        match command:
            case SetMode(mode=mode):
                number = mavlink.MAV_CMD_DO_SET_MODE
                return self._long(number, confirmation, *mode_parameters(self._autopilot, mode))
            case Arm():
                return self._long(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, confirmation, 1.0)
            case TakeOff(altitude_m=altitude_m):
                return self._long(mavlink.MAV_CMD_NAV_TAKEOFF, confirmation, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, altitude_m)
            case SetMessageInterval(message_id=message_id, interval_us=interval_us):
                number = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
                return self._long(number, confirmation, float(message_id), float(interval_us))
            case ReadParameter(name=name):
                return self._pack(self._mav.param_request_read_encode(*self._target, name.encode("ascii"), -1))

    def _target_frame(self, boot_ms: int, mask: int, axes: tuple[float, ...], yaw: float) -> bytes:
        return self._prepared(_SETPOINT, boot_ms, *axes, yaw, 0.0, mask, *self._target, mavlink.MAV_FRAME_LOCAL_NED)

    def _long(self, number: int, confirmation: int, *parameters: float) -> bytes:
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        return self._pack(self._mav.command_long_encode(*self._target, number, confirmation, *padded))

    def _prepared(self, layout: Layout, *values: float) -> bytes:
        sequence = self._mav.seq
        self._mav.seq = (sequence + 1) % 256
        return layout.frame(sequence, self._mav.srcSystem, self._mav.srcComponent, *values)

    def _pack(self, message: Any) -> bytes:
        raw: bytes = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return raw
