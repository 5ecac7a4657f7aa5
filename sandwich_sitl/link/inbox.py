"""What has come in: the one vehicle, its telemetry, the count of its frames.

State: the vehicle's address, telemetry, sequence numbers. Input: frames and the run clock of their arrival. The
vehicle is the first autopilot whose HEARTBEAT is heard; frames of others are logged and otherwise left alone.
"""

from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.link.codec import decode
from sandwich_sitl.link.telemetry import Telemetry, is_autopilot_heartbeat
from sandwich_sitl.link.wire import Frame

OnFrame = Callable[[float, str, bytes], None]

_REORDERED = 128  # a step back by less than this in the sequence is an old frame, not a loss


class Inbox:
    """Takes in frames. `vehicle` is (system, component) once heard, `received` and `lost` count its frames."""

    def __init__(self, telemetry: Telemetry, on_frame: OnFrame) -> None:
        self.telemetry = telemetry
        self.vehicle: tuple[int, int] | None = None
        self.received = 0
        self.lost = 0
        self._on_frame = on_frame
        self._sequence: int | None = None
        self._timesync: list[int] = []
        self._last = ""

    def take(self, frames: Sequence[Frame], now_s: float) -> bool:
        """Take in frames; True when an autopilot HEARTBEAT of the vehicle was among them."""
        heartbeat = False
        for frame in frames:
            self._on_frame(now_s, "rx", frame.raw)
            sender = (frame.system_id, frame.component_id)
            if frame.message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT and is_autopilot_heartbeat(frame):
                if self.vehicle is None:
                    self.vehicle = sender
                heartbeat = heartbeat or self.vehicle == sender
            if self.vehicle == sender:
                self._take_own(frame, now_s)
        return heartbeat

    def take_timesync(self) -> list[int]:
        """The ts1 of TIMESYNC requests that still want an answer."""
        requests, self._timesync = self._timesync, []
        return requests

    def last_heard(self) -> str:
        """What the vehicle last said, for an error message."""
        view = self.telemetry.view(heard=False)
        place = "at an unknown place"
        if view.r_m is not None:
            place = "at ({:.1f}, {:.1f}, {:.1f}) m".format(*view.r_m)
        armed = "armed" if view.armed else "disarmed"
        return f"last heard at {view.last_heard_s:.2f} s: mode {view.mode.value}, {armed}, {place}"

    def _take_own(self, frame: Frame, now_s: float) -> None:
        self.received += 1
        if self._sequence is None:
            self._sequence = frame.sequence
        else:
            ahead = (frame.sequence - self._sequence) % 256
            if 0 < ahead <= _REORDERED:
                self.lost += ahead - 1
                self._sequence = frame.sequence
        if frame.message_id == mavlink.MAVLINK_MSG_ID_TIMESYNC:
            message = decode(frame.message_id, frame.raw)
            if message.tc1 == 0:
                self._timesync.append(message.ts1)
        self.telemetry.feed(frame, now_s)
