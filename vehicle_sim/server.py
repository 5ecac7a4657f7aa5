"""The only socket and the only wall clock of the vehicle.

Real time: simulation time = wall time x speed, on an absolute schedule, resynchronised when it is late by more than 0.1 s.
Lockstep: simulation time advances one control period for each setpoint of the peer whose `time_boot_ms` is the vehicle's time;
one datagram in, one out; a retry is answered with the same bytes. A peer that falls silent for 5 s leaves the vehicle in real time.
"""

import select
import socket
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.endpoints import Address, Endpoints
from vehicle_sim.errors import EndpointError
from vehicle_sim.protocol.codec import Codec, Received
from vehicle_sim.protocol.node import Node
from vehicle_sim.protocol.session import Session
from vehicle_sim.recorder import Recorder
from vehicle_sim.telemetry.status import heartbeat, system_time

ANNOUNCE_S = 0.1
PEER_SILENCE_S = 5.0
CLIENT_SILENCE_S = 30.0
MAX_CLIENTS = 16
_LATE_S = 0.1
_WAIT_S = 0.05
_MAX_DATAGRAM = 65535
_REALTIME_BATCH_US = 10_000
_MIN_WALL_BATCH_S = 0.002
_SAFE_DATAGRAM = 1400


@dataclass(frozen=True)
class Pace:
    """How time passes."""

    lockstep: bool
    speed: float
    period_us: int


def open_socket(bind: Address) -> socket.socket:
    """A bound, non-blocking UDP socket. Raises `EndpointError` when the port is taken or the host unknown."""
    sock = None
    try:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind(bind)
    except OSError as error:
        if sock is not None:
            sock.close()
        raise EndpointError(
            f"{bind[0]}:{bind[1]} cannot be bound ({error.strerror or error}); end the program that holds the port or choose "
            "another with --bind"
        ) from error
    sock.setblocking(False)
    return sock


class Server:
    """Carries datagrams between one socket and one `Node`."""

    def __init__(
        self, sock: socket.socket, endpoints: Endpoints, node: Node, pace: Pace, recorder: Recorder | None
    ) -> None:
        self._socket = sock
        self._node = node
        self._pace = pace
        self._recorder = recorder
        self._target = _resolve(endpoints.target) if endpoints.target is not None else None
        self._peer: Address | None = self._target
        self._heard_s: dict[Address, float] = {}
        self._listener = Codec(node.vehicle.config.system_id)
        self._last_datagram = b""
        self._announcement = b""
        if self._target is not None:
            self._welcome(self._target)

    def run(self, stopped: Callable[[], bool]) -> None:
        """Serve until `stopped()`."""
        if self._pace.lockstep:
            self._run_lockstep(stopped)
        self._node.lockstep = False
        for session in self._node.sessions.values():
            session.set_interval(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, 0)
        self._run_realtime(stopped)

    def _run_realtime(self, stopped: Callable[[], bool]) -> None:
        node, speed = self._node, self._pace.speed
        step_us = node.vehicle.step_us
        batch_us = max(_REALTIME_BATCH_US, round(_MIN_WALL_BATCH_S * speed * 1e6))
        batch_us = max(step_us, batch_us // step_us * step_us)
        batch_s = batch_us * 1e-6 / speed
        deadline_s = monotonic() + batch_s
        while not stopped():
            self._receive_until(deadline_s, stopped)
            node.advance_to(node.vehicle.t_us + batch_us)
            self._send_all()
            now_s = monotonic()
            self._forget_silent(now_s)
            self._record()
            deadline_s += batch_s
            if now_s - deadline_s > _LATE_S:
                deadline_s = now_s + batch_s

    def _record(self) -> None:
        if self._recorder is not None:
            self._recorder.write(self._node.journal)
        else:
            self._node.journal.clear()

    def _receive_until(self, deadline_s: float, stopped: Callable[[], bool]) -> None:
        while not stopped():
            for address, datagram in self._receive(max(0.0, deadline_s - monotonic())):
                for received in self._decode(address, datagram):
                    self._node.handle(address, received)
            if monotonic() >= deadline_s:
                return

    def _run_lockstep(self, stopped: Callable[[], bool]) -> None:
        """Returns when the peer has fallen silent after its first tick."""
        self._announcement = self._last_datagram = self._announce()
        announced_s = ticked_s = monotonic()
        ticking = False
        self._send_announcement()
        while not stopped():
            for address, datagram in self._receive(_WAIT_S):
                if self._take_lockstep(address, datagram):
                    ticking, ticked_s = True, monotonic()
            now_s = monotonic()
            if ticking and now_s - ticked_s > PEER_SILENCE_S:
                return
            if not ticking and now_s - announced_s >= ANNOUNCE_S:
                announced_s = now_s
                self._send_announcement()
            self._forget_silent(now_s)
            self._record()

    def _take_lockstep(self, address: Address, datagram: bytes) -> bool:
        """Handle one datagram; true when it was the peer's tick or its retry."""
        messages = self._decode(address, datagram)
        tick_ms = self._tick_of(messages)
        if self._peer is None and tick_ms is not None:
            self._peer = address
        if address != self._peer or tick_ms is None:
            for received in messages:
                self._node.handle(address, received)
            return False
        vehicle = self._node.vehicle
        now_ms = vehicle.t_us // 1000
        if tick_ms > now_ms:
            return False
        if tick_ms < now_ms:
            self._send(address, self._last_datagram)
            return True
        for received in messages:
            self._node.handle(address, received)
        self._node.advance_to(vehicle.t_us + self._pace.period_us)
        session = self._node.session(address)
        session.send(system_time(vehicle))
        self._last_datagram = b"".join(self._node.take(session))
        self._send(address, self._last_datagram)
        self._send_all(except_for=address)
        return True

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
        codec = Codec(vehicle.config.system_id)
        frames = [codec.encode(heartbeat(vehicle)), codec.encode(system_time(vehicle))]
        self._node.journal.sent.extend((vehicle.t_us, frame) for frame in frames)
        return b"".join(frames)

    def _send_announcement(self) -> None:
        for address in [self._target] if self._target is not None else list(self._heard_s):
            self._send(address, self._announcement)

    def _receive(self, wait_s: float) -> list[tuple[Address, bytes]]:
        ready, _, _ = select.select([self._socket], [], [], min(wait_s, _WAIT_S))
        datagrams: list[tuple[Address, bytes]] = []
        while ready and len(datagrams) < 64:
            try:
                datagram, address = self._socket.recvfrom(_MAX_DATAGRAM)
            except BlockingIOError:
                break
            except ConnectionError:
                continue
            datagrams.append((address, datagram))
        return datagrams

    def _decode(self, address: Address, datagram: bytes) -> list[Received]:
        """A datagram's messages. An address becomes a client with its first valid one."""
        messages = self._listener.decode(datagram)
        if messages and (address in self._heard_s or len(self._heard_s) < MAX_CLIENTS):
            self._welcome(address)
            return messages
        return []

    def _welcome(self, address: Address) -> Session:
        self._heard_s[address] = monotonic()
        known = address in self._node.sessions
        session = self._node.session(address)
        if self._node.lockstep and not known:
            session.skip_sequence(2)
            session.set_interval(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, -1)
        return session

    def _forget_silent(self, now_s: float) -> None:
        silent = [address for address, heard_s in self._heard_s.items() if now_s - heard_s > CLIENT_SILENCE_S]
        for address in silent:
            if address not in (self._target, self._peer):
                del self._heard_s[address], self._node.sessions[address]

    def _send_all(self, except_for: Address | None = None) -> None:
        for address in self._heard_s:
            if address != except_for:
                for datagram in _datagrams(self._node.take(self._node.session(address))):
                    self._send(address, datagram)

    def _send(self, address: Address, datagram: bytes) -> None:
        """A client that is gone is no reason to stop: errors of the network stack are the client's silence."""
        try:
            self._socket.sendto(datagram, address)
        except OSError:
            return


def _datagrams(frames: list[bytes]) -> list[bytes]:
    """Frames joined into datagrams that fit an Ethernet frame."""
    joined: list[bytes] = []
    for frame in frames:
        if joined and len(joined[-1]) + len(frame) <= _SAFE_DATAGRAM:
            joined[-1] += frame
        else:
            joined.append(frame)
    return joined


def _resolve(address: Address) -> Address:
    """The address as `recvfrom` will show it."""
    try:
        found = socket.getaddrinfo(*address, family=socket.AF_INET, type=socket.SOCK_DGRAM)
    except OSError as error:
        raise EndpointError(f"{address[0]}:{address[1]}: unknown host ({error.strerror or error})") from error
    host, port = found[0][4][:2]
    return str(host), int(port)
