"""Bytes to MAVLink frames.

State: the bytes of an unfinished frame. Input: datagrams or pieces of a stream. MAVLink 1 and 2, checksum checked for
messages of the common dialect; frames of other dialects are passed on when their length fits what follows. Signatures
are carried, not checked.
"""

from struct import Struct
from typing import NamedTuple

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import common as mavlink

_V1, _V2 = mavlink.PROTOCOL_MARKER_V1, mavlink.PROTOCOL_MARKER_V2
_SIGNED = mavlink.MAVLINK_IFLAG_SIGNED
_MARKERS = (_V1, _V2)
_HEADER_V1, _HEADER_V2 = Struct("<BBBBBB"), Struct("<BBBBBBBHB")
_CRC_EXTRA: dict[int, bytes] = {number: bytes((kind.crc_extra,)) for number, kind in mavlink.mavlink_map.items()}


class Frame(NamedTuple):
    """One whole frame; `raw` is what was on the wire."""

    message_id: int
    system_id: int
    component_id: int
    sequence: int
    raw: bytes


class FrameSplitter:
    """Cuts bytes into frames; `damaged` counts frames with a wrong checksum."""

    def __init__(self) -> None:
        self._rest = b""
        self.damaged = 0

    def feed_datagram(self, data: bytes) -> list[Frame]:
        """Frames of one datagram. Frames do not span datagrams, so nothing is kept."""
        self._rest = b""
        frames = self.feed(data)
        self._rest = b""
        return frames

    def feed(self, data: bytes) -> list[Frame]:
        """Frames that are complete with these bytes of a stream."""
        buffer = self._rest + data if self._rest else data
        frames: list[Frame] = []
        start, end = 0, len(buffer)
        while start < end:
            if buffer[start] not in _MARKERS:
                start += 1
                continue
            length = frame_length(buffer, start)
            if length is None or start + length > end:
                break
            frame = self._frame(buffer, start, start + length)
            if frame is None:
                start += 1
                continue
            frames.append(frame)
            start += length
        self._rest = buffer[start:]
        return frames

    def _frame(self, buffer: bytes, start: int, stop: int) -> Frame | None:
        raw = buffer[start:stop]
        if raw[0] == _V2:
            _, length, flags, _, sequence, system_id, component_id, low, high = _HEADER_V2.unpack_from(raw)
            body, message_id, known = 10 + length, low | high << 16, flags & ~_SIGNED == 0
        else:
            _, length, sequence, system_id, component_id, message_id = _HEADER_V1.unpack_from(raw)
            body, known = 6 + length, True
        extra = _CRC_EXTRA.get(message_id)
        if extra is None:
            fits = stop == len(buffer) or buffer[stop] in _MARKERS
        else:
            fits = mcrf4xx(raw[1:body] + extra) == raw[body] | raw[body + 1] << 8
        if not (known and fits):
            self.damaged += 1
            return None
        return Frame(message_id, system_id, component_id, sequence, raw)


def frame_length(buffer: bytes, start: int) -> int | None:
    """Length of the frame that begins at `start`, or None while its header is incomplete."""
    if len(buffer) - start < 3:
        return None
    payload = buffer[start + 1]
    if buffer[start] == _V1:
        return payload + 8
    return payload + (25 if buffer[start + 2] & _SIGNED else 12)
