"""A scripted autopilot on real UDP for the tests of the link and the mission: no dynamics, positions jump to the setpoint.

It speaks the lockstep protocol (announcement, one datagram a tick, retry) and, with `lockstep=False`, streams in real
time. It is written against MAVLink with pymavlink alone and shares no code with the package under test. Local NED,
metres, seconds.
"""

import socket
import struct
import threading
import time
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

OFFBOARD, LOITER, LAND, RTL, POSITION = 6 << 16, 4 << 16 | 3 << 24, 4 << 16 | 6 << 24, 4 << 16 | 5 << 24, 3 << 16


def free_port() -> int:
    """A UDP port that was free a moment ago."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@dataclass
class Behaviour:
    """What the script does differently from a good autopilot."""

    drop_answers: frozenset[int] = frozenset()  # lockstep: answers (by number) that get lost on their first sending
    silent_after_ms: int | None = None
    refuse_arming: bool = False
    pilot_takes_over_ms: int | None = None
    failsafe_ms: int | None = None
    unready_ms: int = 0
    step_ms: int = 20


@dataclass
class FakeAutopilot:
    """Sends to `client`; run it as a context manager. `log` collects the decoded messages it was sent."""

    client: tuple[str, int]
    behaviour: Behaviour = field(default_factory=Behaviour)
    lockstep: bool = True

    def __post_init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.02)
        self.mav = mavlink.MAVLink(None, 1, 1)
        self.parser = mavlink.MAVLink(None, 0, 0)
        self.parser.robust_parsing = True
        self.log: list[Any] = []
        self.received: list[bytes] = []
        self.time_ms = 0
        self.mode, self.armed, self.critical = LOITER, False, False
        self.position = [0.0, 0.0, 0.0]
        self.velocity = [0.0, 0.0, 0.0]
        self.landed_ms: int | None = None
        self.answers = 0
        self.sent_mode: tuple[int, bool] | None = None
        self.frames: list[bytes] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run_lockstep if self.lockstep else self._run_realtime)

    def __enter__(self) -> "FakeAutopilot":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(5.0)
        self.socket.close()

    def say(self, message: Any) -> None:
        self.frames.append(message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256

    def flush(self) -> bytes:
        data, self.frames = b"".join(self.frames), []
        return data

    def _run_lockstep(self) -> None:
        self._heartbeat()
        self.say(self.mav.system_time_encode(0, 0))
        last, announced = self.flush(), -1.0
        while not self._stop.is_set():
            if self.answers == 0 and time.monotonic() - announced > 0.1:
                self.socket.sendto(last, self.client)
                announced = time.monotonic()
            data = self._receive()
            if data is None or self._is_silent():
                continue
            messages = self.parser.parse_buffer(data) or []
            if messages[-1].time_boot_ms != self.time_ms:
                self.socket.sendto(last, self.client)
                continue
            self.received.append(data)
            for message in messages:
                self._apply(message)
            self.time_ms += self.behaviour.step_ms
            self._telemetry()
            self.say(self.mav.system_time_encode(0, self.time_ms))
            last = self.flush()
            self.answers += 1
            if self.answers not in self.behaviour.drop_answers:
                self.socket.sendto(last, self.client)

    def _run_realtime(self) -> None:
        begun = time.monotonic() - 3.0
        while not self._stop.is_set():
            data = self._receive()
            if data is not None:
                for message in self.parser.parse_buffer(data) or []:
                    self._apply(message)
            due = int((time.monotonic() - begun) * 1e3)
            if due - self.time_ms < 20 or self._is_silent():
                continue
            self.time_ms = due - due % 20
            self._telemetry()
            self.socket.sendto(self.flush(), self.client)

    def _receive(self) -> bytes | None:
        try:
            return self.socket.recvfrom(65535)[0]
        except TimeoutError:
            return None

    def _is_silent(self) -> bool:
        limit = self.behaviour.silent_after_ms
        return limit is not None and self.time_ms >= limit

    def _apply(self, message: Any) -> None:
        self.log.append(message)
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            self._command(message)
        elif kind == "PARAM_REQUEST_READ":
            self._parameter(message.param_id)
        elif kind == "SET_POSITION_TARGET_LOCAL_NED" and self.mode == OFFBOARD and self.armed:
            if not message.type_mask & 0x7:
                self.position = [message.x, message.y, message.z]
            if not message.type_mask & 0x38:
                self.velocity = [message.vx, message.vy, message.vz]

    def _command(self, message: Any) -> None:
        result = 0
        if message.command == 176:
            self.mode = int(message.param2) << 16 | int(message.param3) << 24
            self.say(self.mav.command_ack_encode(176, 0))
        elif message.command == 400:
            assert message.param1 == 1.0 or self.position[2] >= -0.01, "disarmed in the air"
            result = 1 if self.behaviour.refuse_arming else 0
            if result:
                text = b"Arming denied: Resolve system health failures first, then try once again please"
                for number in range(0, len(text), 50):
                    self.say(self.mav.statustext_encode(2, text[number : number + 50], 7, number // 50))
            else:
                self.armed = message.param1 == 1.0
        elif message.command != 511:
            result = 3
        self.say(self.mav.command_ack_encode(message.command, result))

    def _parameter(self, name: str) -> None:
        real = {"COM_OF_LOSS_T": 1.0}
        whole = {"COM_OBL_RC_ACT": 0, "NAV_RCL_ACT": 2}
        if name in real:
            self.say(self.mav.param_value_encode(name.encode(), real[name], 9, 3, 0))
        elif name in whole:
            coded = struct.unpack("<f", struct.pack("<i", whole[name]))[0]
            self.say(self.mav.param_value_encode(name.encode(), coded, 6, 3, 0))

    def _heartbeat(self) -> None:
        base = (1 | 16 if self.mode == OFFBOARD else 29) | (128 if self.armed else 0)
        status = 5 if self.critical else 4 if self.armed else 3
        self.say(self.mav.heartbeat_encode(2, 12, base, self.mode, status))
        self.sent_mode = (self.mode, self.armed)

    def _telemetry(self) -> None:
        self._script()
        x, y, z = self.position
        if self.time_ms % 1000 == 0 or self.sent_mode != (self.mode, self.armed):
            self._heartbeat()
        if self.time_ms % 200 == 0:
            healthy = 0x10000000 if self.time_ms >= self.behaviour.unready_ms else 0
            self.say(self.mav.sys_status_encode(0, 0, healthy, 0, 16000, 100, 80, 0, 0, 0, 0, 0, 0))
            self.say(self.mav.extended_sys_state_encode(0, 1 if z > -0.05 else 2))
        if self.time_ms % 100 == 0:
            self.say(self.mav.timesync_encode(0, self.time_ms * 1_000_000 + 1))
        self.say(self.mav.local_position_ned_encode(self.time_ms, x, y, z, *self.velocity))
        self.say(self.mav.attitude_quaternion_encode(self.time_ms, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))

    def _script(self) -> None:
        behaviour = self.behaviour
        if behaviour.pilot_takes_over_ms is not None and self.time_ms == behaviour.pilot_takes_over_ms:
            self.mode = POSITION
        if behaviour.failsafe_ms is not None and self.time_ms == behaviour.failsafe_ms:
            self.mode, self.critical = RTL, True
        if self.mode in (LAND, RTL) and self.armed:
            self.velocity = [0.0, 0.0, 0.5]
            self.position[2] = min(0.0, self.position[2] + 0.05)
            if self.position[2] == 0.0:
                self.velocity = [0.0, 0.0, 0.0]
                self.landed_ms = self.landed_ms if self.landed_ms is not None else self.time_ms
                self.armed = self.time_ms - self.landed_ms < 2000
