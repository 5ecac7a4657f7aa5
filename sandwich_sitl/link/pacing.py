"""When the next control tick begins, in lockstep and in real time.

Input: the transport and `Inbox`. Output: the run clock of the tick in seconds of vehicle boot time. In lockstep that
is the time in the vehicle's last SYSTEM_TIME and nothing depends on the wall clock but when to give up. In real time
it is the wall clock times `speed` plus an offset: run = speed * wall + max_i(boot_i - speed * wall_i) over the first
messages i, since a delay on the way can only make a message's boot time look older.

Pauses. A host may take the processor away from this process, from the vehicle's or from both, and a simulated vehicle
that was paused has lost that time: its clock then lags behind the offset for good, and each measurement would pass for
old. So after a pause of this process the offset starts anew as if the vehicle had paused too, and the first message
that is younger puts it right; after a silence of the vehicle the largest offset of the next 0.2 s counts, and the run
clock goes at half its rate until it has come down to that. The run clock never goes back.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.errors import LinkError
from sandwich_sitl.link.codec import decode
from sandwich_sitl.link.inbox import Inbox
from sandwich_sitl.link.telemetry import boot_time_s, is_autopilot_heartbeat
from sandwich_sitl.link.transport import Transport
from sandwich_sitl.link.wire import Frame, FrameSplitter

RETRY_S = 0.2
HELLO_S = 1.0
SPIN_S = 0.3e-3
LEAST_LOSS_S = 2.0
MAP_SAMPLES = 20
MAP_S = 1.0
PAUSE_S = 0.1  # wall time without a sign of life that counts as a pause; simulated vehicles make up for less
_LAG_S = 0.2  # wall time in which a vehicle's lag is measured
_YOUNGER_S = 0.02  # boot time ahead of the run clock that is no jitter any more
_SLOWER = 0.5  # of the run clock's rate, while it comes down to a vehicle that has lost time
_FLOOD = 256  # datagrams read after a deadline has passed


@dataclass
class Lateness:
    """How the ticks kept time, wall seconds; retries of lockstep datagrams."""

    late_ticks: int = 0
    worst_late_s: float = 0.0
    retries: int = 0


class Pacer(Protocol):
    """One of the two clocks of a run."""

    heard: bool
    lateness: Lateness

    def next_tick(self) -> float:
        """Wait for the next tick; the run clock in seconds. Raises `LinkError` when the vehicle is silent for too long."""

    def sent(self, datagram: bytes) -> None:
        """Send what belongs to this tick."""

    def late_s(self, wall_s: float) -> float:
        """By how many wall seconds the tick's period was over at `time.monotonic()` `wall_s`; 0 before its end."""


class LockstepPacer:
    """The vehicle's time advances one period for each datagram of this side."""

    def __init__(
        self,
        transport: Transport,
        inbox: Inbox,
        period_s: float,
        loss_timeout_s: float,
        connect_timeout_s: float,
        hello: bytes,
        stop_requested: Callable[[], bool],
    ) -> None:
        self.heard = False
        self.lateness = Lateness()
        self._transport = transport
        self._inbox = inbox
        self._period_ms = round(period_s * 1e3)
        self._loss_s = max(loss_timeout_s, LEAST_LOSS_S)
        self._connect_s = connect_timeout_s
        self._datagram = hello
        self._stop_requested = stop_requested
        self._splitter = FrameSplitter()
        self._time_ms = -1

    def next_tick(self) -> float:
        """The vehicle's answer to the last datagram, or at first its announcement. Before that a request to stop returns 0."""
        begun = time.monotonic()
        retry_s, give_up_s = (RETRY_S, self._loss_s) if self.heard else (HELLO_S, self._connect_s)
        retry = begun + (retry_s if self.heard else 0.0)
        while True:
            data = self._transport.receive(min(retry, time.monotonic() + RETRY_S))
            if data is not None and self._accept(self._splitter.feed_datagram(data)):
                return self._time_ms * 1e-3
            now = time.monotonic()
            if not self.heard and self._stop_requested():
                return 0.0
            if now - begun >= give_up_s:
                raise LinkError(self._silence(give_up_s))
            if now >= retry:
                self._transport.send(self._datagram)
                self.lateness.retries += self.heard
                retry = now + retry_s

    def sent(self, datagram: bytes) -> None:
        """Send, and keep for a retry."""
        self._datagram = datagram
        self._transport.send(datagram)

    def late_s(self, wall_s: float) -> float:
        """Always 0: the vehicle's time stands still until it is answered."""
        del wall_s
        return 0.0

    def _accept(self, frames: Sequence[Frame]) -> bool:
        if not frames or frames[-1].message_id != mavlink.MAVLINK_MSG_ID_SYSTEM_TIME:
            return False
        time_ms = int(decode(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, frames[-1].raw).time_boot_ms)
        if time_ms <= self._time_ms:
            return False
        sender = (frames[-1].system_id, frames[-1].component_id)
        if not self.heard and not any(is_autopilot_heartbeat(frame) for frame in frames):
            return False
        if self.heard and sender != self._inbox.vehicle:
            return False
        if self.heard and time_ms != self._time_ms + self._period_ms:
            raise LinkError(
                f"the vehicle advanced {time_ms - self._time_ms} ms in one lockstep tick instead of {self._period_ms} ms; "
                "start both sides with the same mpc.rate_hz and clock, and do not suspend this process"
            )
        self._time_ms = time_ms
        if self._inbox.take(frames, time_ms * 1e-3):
            self._transport.keep_peer()
        self.heard = True
        return True

    def _silence(self, give_up_s: float) -> str:
        if not self.heard:
            return (
                f"no lockstep vehicle announced itself within {give_up_s:g} s; start vehicle-sim with clock.mode lockstep "
                "and let it connect to link.uri"
            )
        return f"the vehicle is silent for {give_up_s:g} s; {self._inbox.last_heard()}; is its process still running?"


class RealtimePacer:
    """Absolute deadlines on the wall clock, one period of `period_s / speed` apart."""

    def __init__(
        self,
        transport: Transport,
        inbox: Inbox,
        period_s: float,
        speed: float,
        loss_timeout_s: float,
        after_receive: Callable[[float], None],
    ) -> None:
        self.heard = False
        self.lateness = Lateness()
        self._transport = transport
        self._inbox = inbox
        self._wall_period_s = period_s / speed
        self._speed = speed
        self._loss_s = loss_timeout_s / min(speed, 1.0)
        self._after_receive = after_receive
        self._splitter = FrameSplitter()
        self._wall0 = time.monotonic()
        self._deadline = self._period_end = self._wall0
        self._offset_s = 0.0
        self._samples: list[float] = []
        self._first_sample = 0.0
        self._last_heard = 0.0
        self._last_awake = self._wall0
        self._lag = VehicleLag(speed)

    def next_tick(self) -> float:
        """Read until the deadline; a tick that comes more than a period late starts a new schedule."""
        deadline = self._deadline
        self._note_awake(time.monotonic())
        extra = _FLOOD
        while extra:
            data = self._transport.receive(deadline - SPIN_S)
            if data is None:
                break
            self._take(data)
            extra -= time.monotonic() >= deadline - SPIN_S
        while (now := time.monotonic()) < deadline:
            pass
        self._note_awake(now)
        self._offset_s -= self._lag.taken(now)
        late_s = now - deadline
        self.lateness.worst_late_s = max(self.lateness.worst_late_s, late_s)
        self.lateness.late_ticks += late_s > 0.5 * self._wall_period_s
        self._period_end = deadline + self._wall_period_s
        self._deadline = (now if late_s > self._wall_period_s else deadline) + self._wall_period_s
        if self._inbox.vehicle is not None and now - self._last_heard > self._loss_s:
            raise LinkError(
                f"the vehicle is silent for {self._loss_s:g} s; {self._inbox.last_heard()}; "
                "is its process still running and the line up?"
            )
        return self._run_s(now)

    def sent(self, datagram: bytes) -> None:
        """Send, if there is anything to send."""
        if datagram:
            self._transport.send(datagram)

    def late_s(self, wall_s: float) -> float:
        """Against the end of the period as it was due, however late the tick began."""
        return max(0.0, wall_s - self._period_end)

    def _run_s(self, wall: float) -> float:
        return self._speed * (wall - self._wall0) + self._offset_s

    def _note_awake(self, wall: float) -> None:
        """After a pause of this process: whatever was longer than it should be did not happen to the vehicle either."""
        paused_s = wall - self._last_awake - self._wall_period_s
        self._last_awake = wall
        if self.heard and paused_s > PAUSE_S:
            self._offset_s -= self._speed * paused_s
            self._last_heard += paused_s
            self._lag.restart(wall)

    def _take(self, data: bytes) -> None:
        wall = time.monotonic()
        self._note_awake(wall)
        silent_s = wall - self._last_heard
        frames = self._splitter.feed_datagram(data) if self._transport.datagrams else self._splitter.feed(data)
        received = self._inbox.received
        if self._inbox.take(frames, self._run_s(wall)):
            self._transport.keep_peer()
        if self._inbox.received > received:
            self._last_heard = wall
        if self._inbox.vehicle is not None:
            (self._follow if self.heard else self._map)(frames, wall, silent_s)
        self._after_receive(self._run_s(wall))

    def _map(self, frames: Sequence[Frame], wall: float, _: float) -> None:
        for boot_s in self._boot_times(frames):
            self._first_sample = self._first_sample if self._samples else wall
            self._samples.append(boot_s - self._speed * (wall - self._wall0))
        if self._samples and (len(self._samples) >= MAP_SAMPLES or wall - self._first_sample >= MAP_S):
            self._offset_s = max(self._samples)
            self.heard = True

    def _follow(self, frames: Sequence[Frame], wall: float, silent_s: float) -> None:
        """A message from the future proves the offset too small; one after a silence begins to measure the vehicle's lag."""
        if silent_s > PAUSE_S:
            self._lag.restart(wall)
        for boot_s in self._boot_times(frames):
            ahead_s = boot_s - self._run_s(wall)
            if ahead_s > (0.0 if self._lag.measuring else _YOUNGER_S):
                self._offset_s += ahead_s
            if self._lag.measuring:
                self._lag.heard(wall, ahead_s)

    def _boot_times(self, frames: Sequence[Frame]) -> list[float]:
        vehicle = self._inbox.vehicle
        times = (boot_time_s(frame) for frame in frames if (frame.system_id, frame.component_id) == vehicle)
        return [time_s for time_s in times if time_s is not None]


class VehicleLag:
    """How far a vehicle that was silent has fallen behind the run clock, and how that is taken out bit by bit."""

    def __init__(self, speed: float) -> None:
        self.measuring = False
        self._speed, self._since, self._least_s = speed, 0.0, 0.0
        self._left_s, self._last = 0.0, 0.0

    def restart(self, wall: float) -> None:
        """There was a pause: measure for a while."""
        self.measuring, self._since, self._least_s = True, wall, math.inf

    def heard(self, wall: float, ahead_s: float) -> None:
        """A message of boot time `ahead_s` (mostly negative) past the run clock; the youngest tells the lag."""
        self._least_s = min(self._least_s, max(0.0, -ahead_s))
        if wall - self._since >= _LAG_S:
            self.measuring = False
            self._left_s = self._least_s if self._least_s > PAUSE_S / 2 else 0.0

    def taken(self, wall: float) -> float:
        """Seconds to take off the run clock's offset at this tick."""
        most = _SLOWER * self._speed * (wall - self._last)
        self._last = wall
        step = min(self._left_s, most)
        self._left_s -= step
        return step
