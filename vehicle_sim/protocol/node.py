"""The vehicle as its clients see it: messages in, frames out, and a journal of both. No socket, no wall clock.

`Node` owns the `Vehicle` and one `Session` a client. The server moves its time and carries its datagrams.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from math import nan
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.commander import Result, Severity, Text
from vehicle_sim.autopilot.guidance import Sticks
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.setpoints import FRAME_LOCAL_NED, SetpointMessage
from vehicle_sim.geo import Geodetic
from vehicle_sim.protocol.codec import COMPONENT_ID, Codec, Received
from vehicle_sim.protocol.commands import Command, execute
from vehicle_sim.protocol.parameters import find_parameter, parameter_list, parameter_value, set_parameter
from vehicle_sim.protocol.session import Session
from vehicle_sim.vehicle import Vehicle

_INT32_NOT_GIVEN = 2**31 - 1
_STICK_NOT_GIVEN = 32767
_COMMAND_INT_FRAMES = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_RELATIVE_FRAMES = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
TRUTH_US = 10_000
TELEMETRY_US = 20_000


@dataclass
class Journal:
    """What is to be recorded, each entry with its simulation time in microseconds."""

    sent: list[tuple[int, bytes]] = field(default_factory=list)
    received: list[tuple[int, bytes]] = field(default_factory=list)
    texts: list[tuple[int, Text]] = field(default_factory=list)

    def clear(self) -> None:
        """Forget everything."""
        self.sent.clear()
        self.received.clear()
        self.texts.clear()


class Node:
    """Clients by address. `on_sample(vehicle, telemetry_too)` is called every 10 ms of simulation time."""

    def __init__(
        self, vehicle: Vehicle, lockstep: bool, on_sample: Callable[[Vehicle, bool], None] | None = None
    ) -> None:
        self.vehicle = vehicle
        self.sessions: dict[Hashable, Session] = {}
        self.journal = Journal()
        self.lockstep = lockstep
        self._on_sample = on_sample
        self._next_sample_us = TRUTH_US
        self._handlers: dict[str, Callable[[Session, Received], None]] = {
            "HEARTBEAT": self._on_heartbeat,
            "SET_POSITION_TARGET_LOCAL_NED": self._on_local_setpoint,
            "SET_POSITION_TARGET_GLOBAL_INT": self._on_global_setpoint,
            "MANUAL_CONTROL": self._on_manual_control,
            "COMMAND_LONG": self._on_command_long,
            "COMMAND_INT": self._on_command_int,
            "SET_MODE": self._on_set_mode,
            "TIMESYNC": self._on_timesync,
            "PING": self._on_ping,
            "PARAM_REQUEST_LIST": self._on_parameter_list,
            "PARAM_REQUEST_READ": self._on_parameter_read,
            "PARAM_SET": self._on_parameter_set,
            "MISSION_REQUEST_LIST": self._on_mission_list,
            "MISSION_COUNT": self._on_mission_count,
            "MISSION_CLEAR_ALL": self._on_mission_clear,
        }

    def session(self, address: Hashable) -> Session:
        """The client's session, begun when it is new."""
        if address not in self.sessions:
            self.sessions[address] = Session(self.vehicle, Codec(self.vehicle.config.system_id))
        return self.sessions[address]

    def advance_to(self, t_us: int) -> None:
        """Step the vehicle up to `t_us`, queueing what falls due on the way."""
        vehicle = self.vehicle
        sessions = list(self.sessions.values())
        texts = vehicle.autopilot.commander.texts
        while vehicle.t_us < t_us:
            stop_us = min(t_us, self._next_sample_us)
            for session in sessions:
                stop_us = min(stop_us, session.next_us)
            vehicle.advance(max(1, vehicle.steps_until(stop_us)))
            now_us = vehicle.t_us
            if texts:
                self._send_texts()
            for session in sessions:
                session.poll(now_us)
            if now_us >= self._next_sample_us:
                self._sample(now_us)

    def handle(self, address: Hashable, received: Received) -> None:
        """Act on one message of a client."""
        self.journal.received.append((self.vehicle.t_us, received.frame))
        handler = self._handlers.get(received.message.get_type())
        if handler is not None and self.is_addressed(received.message):
            handler(self.session(address), received)
        self._send_texts()

    def is_addressed(self, message: Any) -> bool:
        """Row 20: a message for another system or component is met with silence."""
        system = getattr(message, "target_system", getattr(message, "target", 0))
        component = getattr(message, "target_component", 0)
        return system in (0, self.vehicle.config.system_id) and component in (0, COMPONENT_ID)

    def take(self, session: Session) -> list[bytes]:
        """A session's frames, entered into the journal."""
        frames = session.take()
        now_us = self.vehicle.t_us
        self.journal.sent.extend((now_us, frame) for frame in frames)
        return frames

    def _sample(self, now_us: int) -> None:
        if self._on_sample is not None:
            self._on_sample(self.vehicle, now_us // TRUTH_US % (TELEMETRY_US // TRUTH_US) == 0)
        self._next_sample_us = (now_us // TRUTH_US + 1) * TRUTH_US

    def _send_texts(self) -> None:
        texts = self.vehicle.autopilot.commander.texts
        for text in texts:
            self.journal.texts.append((self.vehicle.t_us, text))
            for session in self.sessions.values():
                session.send_text(text)
        texts.clear()

    def _on_heartbeat(self, session: Session, received: Received) -> None:
        if received.message.type == mavlink.MAV_TYPE_GCS:
            session.is_gcs = True
            self.vehicle.autopilot.receive_gcs_heartbeat()

    def _on_local_setpoint(self, _session: Session, received: Received) -> None:
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
        idle = self.lockstep and setpoint.ignores_all_axes
        self.vehicle.autopilot.receive_setpoint(setpoint, self.vehicle.estimate, complain=not idle)

    def _on_global_setpoint(self, _session: Session, received: Received) -> None:
        m, v = received.message, self.vehicle
        altitude_m = m.alt
        if m.coordinate_frame in _RELATIVE_FRAMES:
            altitude_m += v.geo.origin.altitude_m - (v.autopilot.home_ned_m or (0.0, 0.0, 0.0))[2]
        elif m.coordinate_frame not in _COMMAND_INT_FRAMES:
            return
        position = v.geo.to_ned(Geodetic(m.lat_int / 1e7, m.lon_int / 1e7, altitude_m))
        velocity, acceleration = (m.vx, m.vy, m.vz), (m.afx, m.afy, m.afz)
        setpoint = SetpointMessage(FRAME_LOCAL_NED, m.type_mask, position, velocity, acceleration, m.yaw, m.yaw_rate)
        v.autopilot.receive_setpoint(setpoint, v.estimate)

    def _on_manual_control(self, _session: Session, received: Received) -> None:
        m = received.message
        if _STICK_NOT_GIVEN not in (m.x, m.y, m.z, m.r):
            forward, right, up, turn = (
                max(-1.0, min(1.0, value)) for value in (m.x / 1e3, m.y / 1e3, m.z / 500 - 1, m.r / 1e3)
            )
            self.vehicle.autopilot.receive_sticks(Sticks(forward, right, up, turn))

    def _on_command_long(self, session: Session, received: Received) -> None:
        m = received.message
        command = Command(m.command, m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7)
        self._acknowledge(session, received, m.command, execute(self.vehicle, session, command))

    def _on_command_int(self, session: Session, received: Received) -> None:
        m = received.message
        if m.frame not in _COMMAND_INT_FRAMES:
            self._acknowledge(session, received, m.command, [Result.UNSUPPORTED_MAV_FRAME])
            return
        latitude, longitude = (nan if value == _INT32_NOT_GIVEN else value / 1e7 for value in (m.x, m.y))
        command = Command(m.command, m.param1, m.param2, m.param3, m.param4, latitude, longitude, m.z)
        self._acknowledge(session, received, m.command, execute(self.vehicle, session, command))

    def _on_set_mode(self, session: Session, received: Received) -> None:
        m = received.message
        mode = Mode.from_numbers(m.custom_mode >> 16 & 0xFF, m.custom_mode >> 24 & 0xFF)
        result = self.vehicle.autopilot.request_mode(mode) if mode is not None else Result.TEMPORARILY_REJECTED
        self._acknowledge(session, received, mavlink.MAV_CMD_DO_SET_MODE, [result])

    def _acknowledge(self, session: Session, received: Received, command: int, results: list[Result]) -> None:
        for result in results:
            session.send(
                mavlink.MAVLink_command_ack_message(
                    command, int(result), 0, 0, received.system_id, received.component_id
                )
            )

    def _on_timesync(self, session: Session, received: Received) -> None:
        if received.message.tc1 == 0:
            session.send(mavlink.MAVLink_timesync_message(self.vehicle.t_us * 1000, received.message.ts1))

    def _on_ping(self, session: Session, received: Received) -> None:
        m = received.message
        if m.target_system == 0 and m.target_component == 0:
            session.send(mavlink.MAVLink_ping_message(m.time_usec, m.seq, received.system_id, received.component_id))

    def _on_parameter_list(self, session: Session, _received: Received) -> None:
        session.send_parameters(parameter_list(self.vehicle.autopilot.parameters))

    def _on_parameter_read(self, session: Session, received: Received) -> None:
        m = received.message
        value = find_parameter(self.vehicle.autopilot.parameters, m.param_index, m.param_id)
        if value is not None:
            session.send(value)

    def _on_parameter_set(self, session: Session, received: Received) -> None:
        m, store = received.message, self.vehicle.autopilot.parameters
        problem = set_parameter(store, m.param_id, m.param_value, m.param_type)
        name = m.param_id.decode("ascii", "replace") if isinstance(m.param_id, bytes) else m.param_id
        if problem is not None:
            self.vehicle.autopilot.commander.say(Severity.WARNING, problem)
        if name in store:
            for listener in self.sessions.values() if problem is None else (session,):
                listener.send(parameter_value(store, name))

    def _on_mission_list(self, session: Session, received: Received) -> None:
        kind = received.message.mission_type
        session.send(mavlink.MAVLink_mission_count_message(received.system_id, received.component_id, 0, kind))

    def _on_mission_count(self, session: Session, received: Received) -> None:
        m = received.message
        verdict = mavlink.MAV_MISSION_UNSUPPORTED if m.count else mavlink.MAV_MISSION_ACCEPTED
        session.send(
            mavlink.MAVLink_mission_ack_message(received.system_id, received.component_id, verdict, m.mission_type)
        )

    def _on_mission_clear(self, session: Session, received: Received) -> None:
        kind = received.message.mission_type
        session.send(
            mavlink.MAVLink_mission_ack_message(
                received.system_id, received.component_id, mavlink.MAV_MISSION_ACCEPTED, kind
            )
        )
