"""One client of the vehicle: its sequence numbers, its streams, what waits to be sent to it. No socket.

Like an instance of PX4's mavlink module: intervals, parameter lists and status texts are a client's own.
"""

from collections import deque
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.commander import Text
from vehicle_sim.mavlink_codec import Codec
from vehicle_sim.telemetry import STREAMS
from vehicle_sim.vehicle import Vehicle

_CHUNK = 50
_PARAMETERS_PER_POLL = 4
_PARAMETERS_EVERY_US = 10_000
_MIN_INTERVAL_US = 5000


class Session:
    """Streams and replies to one client. `outbox` holds encoded frames in order."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.codec = Codec(vehicle.config.system_id)
        self.is_gcs = False
        self.outbox: list[bytes] = []
        self.parameter_queue: deque[Any] = deque()
        self._interval_us: dict[int, int] = {}
        self._due_us: dict[int, int] = {}
        self._next_us = 0
        self._next_parameters_us = 0
        self._text_id = 0
        for message_id in STREAMS:
            self.set_interval(message_id, 0)

    def skip_sequence(self, count: int) -> None:
        """Leave sequence numbers to frames that were sent outside the session."""
        self.codec.skip(count)

    def send(self, message: Any) -> None:
        """Queue one message."""
        self.outbox.append(self.codec.encode(message))

    def send_text(self, text: Text) -> None:
        """STATUSTEXT in chunks of 50 bytes, to ground stations only."""
        if not self.is_gcs:
            return
        raw = text.text.encode()
        chunks = [raw[i : i + _CHUNK] for i in range(0, len(raw), _CHUNK)] or [b""]
        self._text_id = self._text_id % 65535 + 1
        for number, chunk in enumerate(chunks):
            number_of_text = self._text_id if len(chunks) > 1 else 0
            self.send(mavlink.MAVLink_statustext_message(int(text.severity), chunk, number_of_text, number))

    def interval_us(self, message_id: int) -> int:
        """Current interval; -1 when the message is not streamed."""
        return self._interval_us.get(message_id, -1)

    def set_interval(self, message_id: int, interval_us: int) -> bool:
        """0 restores the default, -1 stops. False when the message cannot be sent at all."""
        if message_id not in STREAMS:
            return False
        interval_us = interval_us or STREAMS[message_id][1]
        self._due_us.pop(message_id, None)
        self._interval_us.pop(message_id, None)
        if interval_us > 0:
            interval_us = max(_MIN_INTERVAL_US, interval_us)
            self._interval_us[message_id] = interval_us
            self._due_us[message_id] = (self._vehicle.t_us // interval_us + 1) * interval_us
        self._next_us = min(self._due_us.values(), default=2**63)
        return True

    def request(self, message_id: int) -> bool:
        """Send one message now; False when it cannot be."""
        if message_id not in STREAMS:
            return False
        message = STREAMS[message_id][0](self._vehicle)
        if message is None:
            return False
        self.send(message)
        return True

    def poll(self, t_us: int) -> None:
        """Queue every stream message that is due, and a few parameters of a list under way."""
        if self.parameter_queue and t_us >= self._next_parameters_us:
            self._next_parameters_us = t_us + _PARAMETERS_EVERY_US
            for _ in range(min(_PARAMETERS_PER_POLL, len(self.parameter_queue))):
                self.send(self.parameter_queue.popleft())
        if t_us < self._next_us:
            return
        for message_id, due_us in self._due_us.items():
            if due_us <= t_us:
                message = STREAMS[message_id][0](self._vehicle)
                if message is not None:
                    self.send(message)
                interval_us = self._interval_us[message_id]
                self._due_us[message_id] = (t_us // interval_us + 1) * interval_us
        self._next_us = min(self._due_us.values(), default=2**63)

    def take(self) -> list[bytes]:
        """Everything queued, in order; the outbox is empty afterwards."""
        frames, self.outbox = self.outbox, []
        return frames
