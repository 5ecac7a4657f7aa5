"""The vehicle as its clients see it: messages in, frames out, and a journal of both. No socket, no wall clock.

`Node` owns the `Vehicle` and one `Session` a client. The server moves its time and carries its datagrams.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.results import Text
from vehicle_sim.protocol.codec import COMPONENT_ID, Codec, Received
from vehicle_sim.protocol.inbound import HANDLERS
from vehicle_sim.protocol.missions import MissionManager
from vehicle_sim.protocol.session import Session
from vehicle_sim.protocol.signing import Signing
from vehicle_sim.vehicle import Vehicle

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
        self,
        vehicle: Vehicle,
        lockstep: bool,
        on_sample: Callable[[Vehicle, bool], None] | None = None,
        signing: Signing | None = None,
    ) -> None:
        self.vehicle = vehicle
        self.signing = signing or Signing()
        self.sessions: dict[Hashable, Session] = {}
        self.missions: MissionManager = MissionManager(vehicle)
        self.journal = Journal()
        self.lockstep = lockstep
        self._on_sample = on_sample
        self._next_sample_us = TRUTH_US

    def session(self, address: Hashable) -> Session:
        """The client's session, begun when it is new."""
        if address not in self.sessions:
            self.sessions[address] = Session(self.vehicle, self.new_codec(len(self.sessions)))
        return self.sessions[address]

    def new_codec(self, link_id: int = 0) -> Codec:
        """A codec with this vehicle's identity and key."""
        return Codec(self.vehicle.config.system_id, self.signing, link_id & 0xFF)

    def advance_to(self, t_us: int) -> None:
        """Step the vehicle up to `t_us`, queueing what falls due on the way."""
        vehicle = self.vehicle
        sessions = list(self.sessions.values())
        texts, reached = vehicle.autopilot.commander.texts, vehicle.autopilot.steering.reached
        while vehicle.t_us < t_us:
            stop_us = min(t_us, self._next_sample_us, self.missions.next_us)
            for session in sessions:
                stop_us = min(stop_us, session.next_us)
            vehicle.advance(max(1, vehicle.steps_until(stop_us)))
            now_us = vehicle.t_us
            if texts:
                self._send_texts()
            if reached:
                self._send_reached()
            self.missions.poll(now_us)
            for session in sessions:
                session.poll(now_us)
            if now_us >= self._next_sample_us:
                self._sample(now_us)
        if self.signing.is_on:
            self.signing.reach_us(vehicle.t_us)

    def handle(self, address: Hashable, received: Received) -> None:
        """Act on one message of a client."""
        self.journal.received.append((self.vehicle.t_us, received.frame))
        session = self.session(address)
        session.hear(received.version)
        handler = HANDLERS.get(received.message.get_type())
        if handler is not None and self.is_addressed(received.message):
            handler(self, session, received)
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

    def _send_reached(self) -> None:
        reached = self.vehicle.autopilot.steering.reached
        for number in reached:
            for session in self.sessions.values():
                session.send(mavlink.MAVLink_mission_item_reached_message(number))
                session.request(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT)
        reached.clear()
