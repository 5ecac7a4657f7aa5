"""The loop that moves the vehicle's time and carries its datagrams. The only wall clock besides the recorder's.

Real time: see `pacing`. Lockstep: simulation time advances one control period for each setpoint of the peer whose `time_boot_ms` is the
vehicle's time; one datagram in, one out; a retry is answered with the same bytes. A peer that falls silent for 5 s leaves the vehicle in
real time.
"""

import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.pacing import Control, Schedule
from vehicle_sim.protocol.codec import Received
from vehicle_sim.protocol.node import Node
from vehicle_sim.protocol.session import Session
from vehicle_sim.recorder import Recorder
from vehicle_sim.telemetry.status import heartbeat, system_time
from vehicle_sim.telemetry.streams import TRUTH_STREAMS
from vehicle_sim.transport import Client, Transport
from vehicle_sim.vehicle import Vehicle

ANNOUNCE_S = 0.1
PEER_SILENCE_S = 5.0
CLIENT_SILENCE_S = 30.0
MAX_CLIENTS = 16
_WAIT_S = 0.05
_COMPILE_S = 120.0


@dataclass(frozen=True)
class Pace:
    """How time passes."""

    lockstep: bool
    speed: float
    period_us: int


class Server:
    """Carries datagrams between the sockets and one `Node`. `truth` is a client that gets the true state and nothing else."""

    def __init__(
        self,
        transport: Transport,
        node: Node,
        pace: Pace,
        recorder: Recorder | None,
        control: Control | None = None,
        truth: Client | None = None,
    ) -> None:
        self._transport = transport
        self._node = node
        self._pace = pace
        self._recorder = recorder
        self._control = control or Control()
        self._targets = [client for client in transport.targets if client != truth]
        self._peer: Client | None = self._targets[0] if self._targets else None
        self._heard_s: dict[Client, float] = {}
        self._listener = node.new_codec()
        self._last_datagram = b""
        self._announcement = b""
        self.schedule = Schedule(pace.speed, node.vehicle.step_us)
        for target in self._targets:
            self._welcome(target)
        if truth is not None:
            self._targets.append(truth)
            self._heard_s[truth] = monotonic()
            node.sessions[truth] = Session(node.vehicle, node.new_codec(), TRUTH_STREAMS)

    def start(self) -> None:
        """Say hello, then load the kernel. One that must be compiled first is replaced by plain Python until it has been."""
        vehicle = self._node.vehicle
        if self._pace.lockstep:
            self._announcement = self._last_datagram = self._announce()
            self._send_announcement()
        else:
            for target in self._targets:
                self._node.session(target).send(heartbeat(vehicle))
            self._send_all()
        if vehicle.is_quick_to_start:
            vehicle.warm_up()
        else:
            vehicle.fly_compiled(False)
            threading.Thread(target=_compile, args=(vehicle,), daemon=True).start()

    def run(self, stopped: Callable[[], bool]) -> None:
        """Serve until `stopped()`."""
        if self._pace.lockstep:
            self._run_lockstep(stopped)
        self._node.lockstep = False
        for session in self._node.sessions.values():
            session.set_interval(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, 0)
        self._run_realtime(stopped)

    def _run_realtime(self, stopped: Callable[[], bool]) -> None:
        node, schedule, control = self._node, self.schedule, self._control
        schedule.start(monotonic())
        while not stopped():
            self._receive_until(schedule.deadline_s, stopped)
            now_s = monotonic()
            if control.paused and control.steps == 0:
                schedule.start(now_s)
            else:
                control.steps -= control.steps > 0
                schedule.passed(now_s)
                node.advance_to(node.vehicle.t_us + schedule.batch_us)
            self._send_all()
            self._forget_silent(now_s)
            self._record()

    def _record(self) -> None:
        if self._recorder is not None:
            self._recorder.write(self._node.journal)
        else:
            self._node.journal.clear()

    def _receive_until(self, deadline_s: float, stopped: Callable[[], bool]) -> None:
        while not stopped():
            for client, datagram in self._transport.receive(min(_WAIT_S, max(0.0, deadline_s - monotonic()))):
                for received in self._decode(client, datagram):
                    self._node.handle(client, received)
            if monotonic() >= deadline_s:
                return

    def _run_lockstep(self, stopped: Callable[[], bool]) -> None:
        """Returns when the peer has fallen silent after its first tick."""
        announced_s = ticked_s = monotonic()
        ticking = False
        while not stopped():
            for client, datagram in self._transport.receive(_WAIT_S):
                if self._take_lockstep(client, datagram):
                    ticking, ticked_s = True, monotonic()
            now_s = monotonic()
            if ticking and now_s - ticked_s > PEER_SILENCE_S:
                return
            if not ticking and now_s - announced_s >= ANNOUNCE_S:
                announced_s = now_s
                self._send_announcement()
            self._forget_silent(now_s)
            self._record()

    def _take_lockstep(self, client: Client, datagram: bytes) -> bool:
        """Handle one datagram; true when it was the peer's tick or its retry."""
        messages = self._decode(client, datagram)
        tick_ms = self._tick_of(messages)
        if self._peer is None and tick_ms is not None:
            self._peer = client
        if client != self._peer or tick_ms is None:
            for received in messages:
                self._node.handle(client, received)
            return False
        vehicle = self._node.vehicle
        now_ms = vehicle.t_us // 1000
        if tick_ms > now_ms:
            return False
        if tick_ms < now_ms:
            self._send_to_peer(client, self._last_datagram)
            return True
        for received in messages:
            self._node.handle(client, received)
        self._node.advance_to(vehicle.t_us + self._pace.period_us)
        session = self._node.session(client)
        session.send(system_time(vehicle))
        self._last_datagram = b"".join(self._node.take(session))
        self._send_to_peer(client, self._last_datagram)
        self._send_all(except_for=client)
        return True

    def _send_to_peer(self, client: Client, datagram: bytes) -> None:
        """One datagram, however long: the last frame is what the peer waits for."""
        if self._transport.is_datagram(client):
            self._transport.send_datagram(client, datagram)
        else:
            self._transport.send(client, [datagram])

    def _tick_of(self, messages: list[Received]) -> int | None:
        """`time_boot_ms` of the last setpoint addressed to this vehicle."""
        ticks = [
            received.message.time_boot_ms
            for received in messages
            if received.message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
            and self._node.is_addressed(received.message)
        ]
        return int(ticks[-1]) if ticks else None

    def _announce(self) -> bytes:
        """HEARTBEAT and SYSTEM_TIME(0) with the first two sequence numbers of the peer's session; journalled once."""
        vehicle = self._node.vehicle
        codec = self._node.new_codec()
        frames = [codec.encode(heartbeat(vehicle)), codec.encode(system_time(vehicle))]
        self._node.journal.sent.extend((vehicle.t_us, frame) for frame in frames)
        return b"".join(frames)

    def _send_announcement(self) -> None:
        for client in self._targets or list(self._heard_s):
            self._send_to_peer(client, self._announcement)

    def _decode(self, client: Client, datagram: bytes) -> list[Received]:
        """A datagram's messages. An address becomes a client with its first valid one."""
        messages = self._listener.decode(datagram)
        if messages and (client in self._heard_s or len(self._heard_s) < MAX_CLIENTS):
            self._welcome(client)
            return messages
        return []

    def _welcome(self, client: Client) -> Session:
        self._heard_s[client] = monotonic()
        known = client in self._node.sessions
        session = self._node.session(client)
        if self._node.lockstep and not known:
            session.skip_sequence(2)
            session.set_interval(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, -1)
        return session

    def _forget_silent(self, now_s: float) -> None:
        for client, heard_s in list(self._heard_s.items()):
            kept = client in self._targets or client == self._peer
            if not self._transport.is_open(client) or (now_s - heard_s > CLIENT_SILENCE_S and not kept):
                del self._heard_s[client], self._node.sessions[client]

    def _send_all(self, except_for: Client | None = None) -> None:
        for client in self._heard_s:
            if client != except_for:
                self._transport.send(client, self._node.take(self._node.session(client)))


def _compile(vehicle: Vehicle) -> None:
    """In a process of its own: the compiler's memory and its hold on the interpreter are not the vehicle's. Should that fail, here."""
    command = [sys.executable, "-m", "vehicle_sim.warm_up"]
    quiet = subprocess.DEVNULL  # our own output's reader must not have to wait for the compiler
    with suppress(OSError, subprocess.TimeoutExpired):
        subprocess.run(command, stdin=quiet, stdout=quiet, stderr=quiet, timeout=_COMPILE_S, check=False)
    vehicle.warm_up()
    vehicle.fly_compiled(True)
