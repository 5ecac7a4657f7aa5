"""MAVLink frames and messages: splitting datagrams, decoding, encoding. Malformed input never raises.

Version 2 out, unless a client has only ever spoken version 1. pymavlink's dialect decodes what `prepared` does not; frames are assembled
here.
"""

from collections.abc import Iterator
from struct import Struct
from typing import Any, NamedTuple

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.protocol import prepared
from vehicle_sim.protocol.payloads import LAST_ID_OF_V1, MESSAGE_NAMES, Payload, payload_of
from vehicle_sim.protocol.signing import SIGNATURE_BYTES, SIGNED_FLAG, Signing

COMPONENT_ID = 1
_STX_V2 = 0xFD
_STX_V1 = 0xFE
_CHECKED_V2 = Struct("<BBBBBBHB")
_HEADER_V1 = Struct("<BBBBBB")
_CRC = Struct("<H")
_MAX_REST = 300


class Received(NamedTuple):
    """A message and the frame it came in."""

    message: Any
    frame: bytes
    system_id: int
    component_id: int

    @property
    def version(self) -> int:
        """1 or 2."""
        return 2 if self.frame[0] == _STX_V2 else 1


class Codec:
    """One link's encoder (with its own sequence numbers) and decoder."""

    def __init__(self, system_id: int, signing: Signing | None = None, link_id: int = 0) -> None:
        self._mavlink = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=COMPONENT_ID)
        self._system_id = system_id
        self._signing = signing
        self._link_id = link_id
        self._sequence = 0
        self.version = 2

    def encode(self, message: Any) -> bytes:
        """The frame of a message or payload, with the next sequence number; empty when version 1 cannot carry it."""
        payload = message if type(message) is tuple else payload_of(message)
        if self.version == 1:
            return self._encode_v1(payload)
        number, seed, _, data = payload
        data = data.rstrip(b"\0") or b"\0"
        sequence = self._sequence
        self._sequence = (sequence + 1) & 0xFF
        signing = self._signing if self._signing is not None and self._signing.is_on else None
        flags = SIGNED_FLAG if signing is not None else 0
        checked = _CHECKED_V2.pack(
            len(data), flags, 0, sequence, self._system_id, COMPONENT_ID, number & 0xFFFF, number >> 16
        )
        checked += data
        frame = b"\xfd" + checked + _CRC.pack(mcrf4xx(checked + seed))
        return frame if signing is None else signing.sign(frame, self._link_id)

    def skip(self, count: int) -> None:
        """Leave out sequence numbers."""
        self._sequence = (self._sequence + count) & 0xFF

    def decode(self, datagram: bytes) -> list[Received]:
        """All valid messages of known type in a datagram, in order."""
        found = []
        for frame in split_frames(datagram):
            message = self._message(frame)
            if message is not None and (self._signing is None or self._signing.problem(frame) is None):
                sender = frame[3:5] if frame[0] == _STX_V1 else frame[5:7]
                found.append(Received(message, frame, sender[0], sender[1]))
        return found

    def _message(self, frame: bytes) -> Any | None:
        """A frame's message, or None when its type is unknown or it is damaged."""
        number = frame[5] if frame[0] == _STX_V1 else frame[7] | frame[8] << 8 | frame[9] << 16
        message = prepared.read(number, frame)
        if message is not None or number not in MESSAGE_NAMES:
            return message
        try:
            return self._mavlink.decode(bytearray(frame))
        except mavlink.MAVError:
            return None

    def _encode_v1(self, payload: Payload) -> bytes:
        number, seed, length, data = payload
        if number > LAST_ID_OF_V1:
            return b""
        data = data[:length]
        frame = _HEADER_V1.pack(_STX_V1, len(data), self._sequence, self._system_id, COMPONENT_ID, number) + data
        self._sequence = (self._sequence + 1) & 0xFF
        return frame + _CRC.pack(mcrf4xx(frame[1:] + seed))


class StreamSplitter:
    """Cuts a byte stream (TCP) at frame borders; `rest` is the unfinished frame, never longer than one frame."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> bytes:
        """What is complete with these bytes."""
        buffer = self._rest + data
        cut = _unfinished_at(buffer)
        self._rest = buffer[cut:]
        return buffer[:cut]


def split_frames(datagram: bytes) -> Iterator[bytes]:
    """Byte ranges that look like MAVLink 1 or 2 frames. Rubbish between them is skipped a byte at a time."""
    at, end = 0, len(datagram)
    while at < end - 7:
        size = frame_size(datagram, at)
        if size and at + size <= end:
            yield datagram[at : at + size]
            at += size
        else:
            at += 1


def frame_size(buffer: bytes, at: int) -> int:
    """Length of the frame that begins at `at`; 0 when none does."""
    start = buffer[at]
    if start == _STX_V2 and at + 12 <= len(buffer) and not buffer[at + 2] & ~SIGNED_FLAG:
        return 12 + buffer[at + 1] + (SIGNATURE_BYTES if buffer[at + 2] & SIGNED_FLAG else 0)
    return 8 + buffer[at + 1] if start == _STX_V1 and at + 8 <= len(buffer) else 0


def _unfinished_at(buffer: bytes) -> int:
    """Where the last frame that is not whole begins."""
    at, end = 0, len(buffer)
    while at < end:
        if buffer[at] in (_STX_V1, _STX_V2):
            size = frame_size(buffer, at)
            if at + size > end or (size == 0 and end - at < 12):
                return max(at, end - _MAX_REST)
            at += size or 1
        else:
            at += 1
    return end
