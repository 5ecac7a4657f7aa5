"""What goes out in one tick: commands, requests that are due, answers, HEARTBEAT, setpoint.

State: requests under way, time of the last HEARTBEAT. Times are the run clock in seconds. Requests that may be
repeated without harm (message intervals, parameters) are repeated here, three tries at 0.5 s; changes of mode, arming
and take-off are sent once an order, since only the mission may decide to ask again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sandwich_sitl.link.messages import Encoder
from sandwich_sitl.mission.commands import Command, ReadParameter, SetMessageInterval

RETRY_S = 0.5
TRIES = 3
HEARTBEAT_S = 1.0


@dataclass
class _Pending:
    command: SetMessageInterval | ReadParameter
    tries: int = 0
    sent_s: float = 0.0


class Outbox:
    """Collects the frames of a tick in the order in which the vehicle is to apply them."""

    def __init__(self, encoder: Encoder) -> None:
        self._encoder = encoder
        self._pending: list[_Pending] = []
        self._heartbeat_s: float | None = None
        self.unanswered: list[Command] = []

    def order(self, commands: Sequence[Command]) -> list[bytes]:
        """Frames to send at once; repeatable requests are queued instead."""
        frames = []
        for command in commands:
            if isinstance(command, SetMessageInterval | ReadParameter):
                self._pending.append(_Pending(command))
            else:
                frames.append(self._encoder.command(command))
        return frames

    def answered(self, intervals: int, parameters: Mapping[str, float]) -> None:
        """Strike off what was answered: the oldest `intervals` message intervals and every parameter that is known."""
        if not self._pending:
            return
        kept = []
        for pending in self._pending:
            command = pending.command
            if isinstance(command, ReadParameter):
                done = command.name in parameters
            else:
                done = intervals > 0 and pending.tries > 0
                intervals -= done
            if not done:
                kept.append(pending)
        self._pending = kept

    def due(self, now_s: float) -> list[bytes]:
        """Frames of the queued requests whose time has come."""
        if not self._pending:
            return []
        frames = []
        for pending in tuple(self._pending):
            if pending.tries and abs(now_s - pending.sent_s) < RETRY_S:
                continue
            if pending.tries >= TRIES:
                self._pending.remove(pending)
                self.unanswered.append(pending.command)
                continue
            frames.append(self._encoder.command(pending.command, pending.tries))
            pending.tries += 1
            pending.sent_s = now_s
        return frames

    def heartbeat(self, now_s: float) -> list[bytes]:
        """HEARTBEAT once a second."""
        if self._heartbeat_s is not None and abs(now_s - self._heartbeat_s) < HEARTBEAT_S - 1e-6:
            return []
        self._heartbeat_s = now_s
        return [self._encoder.heartbeat()]
