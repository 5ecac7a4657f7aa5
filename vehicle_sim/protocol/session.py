"""One client of the vehicle: its sequence numbers, its streams, what waits to be sent to it. No socket.

Like an instance of PX4's mavlink module: intervals, parameter lists and status texts are a client's own.
"""

from collections import deque
from collections.abc import Mapping
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.results import Text
from vehicle_sim.protocol.codec import Codec
from vehicle_sim.telemetry.streams import DEFAULT_INTERVALS_US, SILENT, STREAMS
from vehicle_sim.vehicle import Vehicle

_CHUNK = 50
_PARAMETERS_PER_POLL = 4
_PARAMETERS_EVERY_US = 10_000
_MIN_INTERVAL_US = 5000
_NEVER_US = 2**63


class Session:
    """Streams and replies to one client. `outbox` holds encoded frames in order; `next_us` is when `poll` has something to do."""

    def __init__(self, vehicle: Vehicle, codec: Codec, intervals_us: Mapping[int, int] = DEFAULT_INTERVALS_US) -> None:
        self._vehicle = vehicle
        self.codec = codec
        self.is_gcs = False
        self.speaks_v2 = False
        self.outbox: list[bytes] = []
        self._parameter_queue: deque[Any] = deque()
        self._by_id: dict[int, list[Any]] = {}  # [due, interval (us), builder]
        self._streams: list[list[Any]] = []
        self._next_parameters_us = _NEVER_US
        self.next_us = _NEVER_US
        self._text_id = 0
        self._default_us = intervals_us
        for message_id in intervals_us:
            self.set_interval(message_id, 0)
        if vehicle.range_sensor is not None and mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE in intervals_us:
            interval_us = round(1e6 / vehicle.range_sensor.config.rate_hz)
            self.set_interval(mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, interval_us)

    def skip_sequence(self, count: int) -> None:
        """Leave sequence numbers to frames that were sent outside the session."""
        self.codec.skip(count)

    def hear(self, version: int) -> None:
        """Answer in the version that is spoken: 1 until the client has shown that it knows 2."""
        self.speaks_v2 = self.speaks_v2 or version == 2
        self.codec.version = 2 if self.speaks_v2 else 1

    def send(self, message: Any) -> None:
        """Queue one message or payload."""
        frame = self.codec.encode(message)
        if frame:
            self.outbox.append(frame)

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

    def send_parameters(self, values: list[Any]) -> None:
        """Begin a list: a few values at a time, in place of a list that is still under way."""
        self._parameter_queue = deque(values)
        self._next_parameters_us = self._vehicle.t_us
        self._schedule()

    def interval_us(self, message_id: int) -> int:
        """Current interval; -1 when the message is not streamed."""
        return int(self._by_id[message_id][1]) if message_id in self._by_id else -1

    def set_interval(self, message_id: int, interval_us: int) -> bool:
        """0 restores the default, -1 stops. False when the message cannot be sent at all."""
        if message_id not in STREAMS:
            return message_id in SILENT
        interval_us = interval_us or self._default_us.get(message_id, 0)
        self._by_id.pop(message_id, None)
        if interval_us > 0:
            interval_us = max(_MIN_INTERVAL_US, interval_us)
            due_us = (self._vehicle.t_us // interval_us + 1) * interval_us
            self._by_id[message_id] = [due_us, interval_us, STREAMS[message_id][0]]
        self._streams = list(self._by_id.values())
        self._schedule()
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
        if t_us < self.next_us:
            return
        if t_us >= self._next_parameters_us:
            self._send_some_parameters(t_us)
        vehicle, encode, outbox, soonest_us = self._vehicle, self.codec.encode, self.outbox, self._next_parameters_us
        for stream in self._streams:
            due_us = stream[0]
            if due_us <= t_us:
                interval_us = stream[1]
                stream[0] = due_us = (t_us // interval_us + 1) * interval_us
                message = stream[2](vehicle)
                if message is not None:
                    frame = encode(message)
                    if frame:
                        outbox.append(frame)
            if due_us < soonest_us:
                soonest_us = due_us
        self.next_us = soonest_us

    def take(self) -> list[bytes]:
        """Everything queued, in order; the outbox is empty afterwards."""
        frames, self.outbox = self.outbox, []
        return frames

    def _send_some_parameters(self, t_us: int) -> None:
        for _ in range(min(_PARAMETERS_PER_POLL, len(self._parameter_queue))):
            self.send(self._parameter_queue.popleft())
        self._next_parameters_us = t_us + _PARAMETERS_EVERY_US if self._parameter_queue else _NEVER_US

    def _schedule(self) -> None:
        self.next_us = min([self._next_parameters_us, *(stream[0] for stream in self._streams)])
