"""`LinkSession`: the vehicle as the run sees it, one view in and one order out a tick.

State: socket, clock, telemetry, requests under way. Input: the run's configuration, ENU setpoints and commands.
Output: `VehicleView` in ENU metres of the world's frame, the run clock in seconds of vehicle boot time, every frame
to `on_frame`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.config import ClockConfig, LinkConfig
from sandwich_sitl.errors import InputError
from sandwich_sitl.link.frames import boot_ms
from sandwich_sitl.link.guard import Fence, objection
from sandwich_sitl.link.inbox import Inbox, OnFrame
from sandwich_sitl.link.messages import Encoder
from sandwich_sitl.link.outbox import Outbox
from sandwich_sitl.link.pacing import LockstepPacer, Pacer, RealtimePacer
from sandwich_sitl.link.telemetry import Telemetry
from sandwich_sitl.link.transport import Transport, check_openable, open_transport
from sandwich_sitl.link_uri import parse_uri
from sandwich_sitl.mission.commands import Command, SetMessageInterval
from sandwich_sitl.mission.setpoint import Setpoint
from sandwich_sitl.mission.vehicle_view import VehicleView

_SLOW_US = {
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 200_000,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 200_000,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 200_000,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 1_000_000,
}


@dataclass(frozen=True)
class LinkStatistics:
    """Frames sent to and received from the vehicle, frames missing in its sequence; ticks that began more than half a period
    late and the worst lateness (wall seconds), lockstep datagrams that were sent again, setpoints that the fence refused.
    """

    sent: int
    received: int
    lost: int
    late_ticks: int
    worst_late_s: float
    retries: int
    refused: int


def check_link(link: LinkConfig, clock: ClockConfig) -> None:
    """Raise `InputError` when a session could not open this link to a vehicle that is already there."""
    _check_clock(link, clock)
    if parse_uri(link.uri).number == 0:
        raise InputError(f"link.uri '{link.uri}': a vehicle cannot know which port that is; give its number")
    check_openable(link.uri)


def _check_clock(link: LinkConfig, clock: ClockConfig) -> None:
    if clock.mode == "lockstep" and parse_uri(link.uri).kind not in ("udpin", "udpout"):
        raise InputError(f"clock.mode lockstep needs a UDP link, not '{link.uri}'; set clock.mode to realtime")


class LinkSession:
    """Context manager around one link.

    `period_s` is the control period, `origin_m` (x, y) the ENU position of the vehicle's local origin, `on_frame(t_s, "rx" |
    "tx", frame)` is called for every frame taken in or sent, in order. `fence` bounds the setpoints. `stop_requested`
    ends the wait for a lockstep vehicle that has not announced itself; `connect_timeout_s` (wall) bounds that wait.

    Raises `InputError` for a URI that cannot be used, `LinkError` when the link does not open.
    """

    def __init__(
        self,
        link: LinkConfig,
        clock: ClockConfig,
        period_s: float,
        origin_m: tuple[float, float],
        on_frame: OnFrame,
        *,
        fence: Fence | None = None,
        connect_timeout_s: float = 20.0,
        stop_requested: Callable[[], bool] = lambda: False,
    ) -> None:
        self._on_frame = on_frame
        self._fence = fence
        self._period_s = period_s
        self._lockstep = clock.mode == "lockstep"
        self._encoder = Encoder(link.system_id, link.component_id, origin_m)
        self._outbox = Outbox(self._encoder)
        self._inbox = Inbox(Telemetry(origin_m, (link.system_id, link.component_id)), on_frame)
        _check_clock(link, clock)
        self._transport: Transport = open_transport(link.uri)
        self._pacer: Pacer = (
            LockstepPacer(
                self._transport,
                self._inbox,
                period_s,
                link.loss_timeout_s,
                connect_timeout_s,
                Encoder(link.system_id, link.component_id, origin_m).heartbeat(),
                stop_requested,
            )
            if self._lockstep
            else RealtimePacer(
                self._transport, self._inbox, period_s, clock.speed, link.loss_timeout_s, self._answer_timesync
            )
        )
        self._contacted = False
        self._now_s = 0.0
        self._view = VehicleView()
        self._previous: Setpoint | None = None
        self._previous_s = 0.0
        self._sent = 0
        self._refused = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the port back."""
        self._transport.close()

    def next_tick(self) -> float:
        """Wait for the next control tick and return the run clock in seconds.

        In real time the clock is this process's own, from 0, until the vehicle's boot time is known (`view.heard`); there it
        jumps once and is fixed afterwards. Raises `LinkError` when the vehicle is silent for longer than
        `link.loss_timeout_s`.
        """
        self._now_s = self._pacer.next_tick()
        if not self._contacted and self._inbox.vehicle is not None:
            self._contact(*self._inbox.vehicle)
        self._view = self._inbox.telemetry.view(self._pacer.heard)
        return self._now_s

    def late_s(self, wall_s: float) -> float:
        """By how many wall seconds this tick's period was over at `time.monotonic()` `wall_s`; 0 before its end, and in
        lockstep, where the vehicle waits.
        """
        return self._pacer.late_s(wall_s)

    @property
    def view(self) -> VehicleView:
        """The vehicle as of the last `next_tick`."""
        return self._view

    @property
    def statistics(self) -> LinkStatistics:
        """Counts so far."""
        lateness = self._pacer.lateness
        return LinkStatistics(
            self._sent,
            self._inbox.received,
            self._inbox.lost,
            lateness.late_ticks,
            lateness.worst_late_s,
            lateness.retries,
            self._refused,
        )

    @property
    def unanswered(self) -> tuple[Command, ...]:
        """Message intervals and parameters that the vehicle did not answer in three tries."""
        return tuple(self._outbox.unanswered)

    def send(self, setpoint: Setpoint | None, commands: Sequence[Command]) -> str | None:
        """Send this tick's commands and setpoint as one datagram; once a tick.

        Returns why the setpoint was refused by the fence, else None. Without a fence a setpoint that is not finite raises
        `LinkError` and nothing is sent.
        """
        reason = self._object(setpoint)
        if reason is not None:
            setpoint = None
            self._refused += 1
        now_s, boot = self._now_s, boot_ms(self._now_s)
        frames = self._outbox.order(commands)
        self._outbox.answered(self._inbox.telemetry.take_interval_acks(), self._view.parameters)
        frames += self._outbox.due(now_s)
        frames += self._timesync_answers(now_s)
        frames += self._outbox.heartbeat(now_s)
        if setpoint is not None:
            frames.append(self._encoder.setpoint(setpoint, boot))
        elif self._lockstep:
            frames.append(self._encoder.idle(boot))
        self._note_sent(frames, now_s)
        self._pacer.sent(b"".join(frames))
        if reason is None:
            self._previous, self._previous_s = setpoint, now_s
        return reason

    def _object(self, setpoint: Setpoint | None) -> str | None:
        if setpoint is None or self._fence is None:
            return None
        since_s = max(self._now_s - self._previous_s, self._period_s)
        return objection(setpoint, self._previous, since_s, self._view.r_m, self._fence)

    def _contact(self, system_id: int, component_id: int) -> None:
        self._contacted = True
        self._encoder.address(system_id, component_id, self._inbox.telemetry.autopilot)
        control_us = round(self._period_s * 1e6)
        wanted = {
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: control_us,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: control_us,
            **_SLOW_US,
        }
        self._outbox.order([SetMessageInterval(number, interval_us) for number, interval_us in wanted.items()])

    def _answer_timesync(self, now_s: float) -> None:
        frames = self._timesync_answers(now_s)
        if frames:
            self._note_sent(frames, now_s)
            self._transport.send(b"".join(frames))

    def _timesync_answers(self, now_s: float) -> list[bytes]:
        requests = self._inbox.take_timesync() if self._pacer.heard else ()
        return [self._encoder.timesync(round(now_s * 1e9), ts1) for ts1 in requests]

    def _note_sent(self, frames: Sequence[bytes], now_s: float) -> None:
        self._sent += len(frames)
        for frame in frames:
            self._on_frame(now_s, "tx", frame)
