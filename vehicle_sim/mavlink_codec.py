"""MAVLink 2 frames and messages: splitting datagrams, decoding, encoding. Malformed input never raises.

pymavlink's generated dialect does the field work; this module finds the frames and checks what the dialect does not.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

COMPONENT_ID = 1
_STX_V2 = 0xFD
_STX_V1 = 0xFE
_SIGNED = 0x01
_SIGNATURE_BYTES = 13


class Received(NamedTuple):
    """A message and the frame it came in."""

    message: Any
    frame: bytes
    system_id: int
    component_id: int


class Codec:
    """One link's encoder (with its own sequence numbers) and decoder."""

    def __init__(self, system_id: int) -> None:
        self._mavlink = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=COMPONENT_ID)

    def encode(self, message: Any) -> bytes:
        """The frame of a message, with the next sequence number."""
        frame: bytes = message.pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return frame

    def skip(self, count: int) -> None:
        """Leave out sequence numbers."""
        self._mavlink.seq = (self._mavlink.seq + count) % 256

    def decode(self, datagram: bytes) -> list[Received]:
        """All valid messages of known type in a datagram, in order."""
        found = []
        for frame in split_frames(datagram):
            try:
                message = self._mavlink.decode(bytearray(frame))
            except mavlink.MAVError:
                continue
            if message.get_type() != "UNKNOWN" and not message.get_type().startswith("UNKNOWN_"):
                found.append(Received(message, frame, message.get_srcSystem(), message.get_srcComponent()))
        return found


def split_frames(datagram: bytes) -> Iterator[bytes]:
    """Byte ranges that look like MAVLink 1 or 2 frames. Rubbish between them is skipped a byte at a time."""
    at, end = 0, len(datagram)
    while at < end - 7:
        start = datagram[at]
        if start == _STX_V2 and at + 12 <= end and not datagram[at + 2] & ~_SIGNED:
            size = 12 + datagram[at + 1] + (_SIGNATURE_BYTES if datagram[at + 2] & _SIGNED else 0)
        elif start == _STX_V1:
            size = 8 + datagram[at + 1]
        else:
            size = 0
        if size and at + size <= end:
            yield datagram[at : at + size]
            at += size
        else:
            at += 1
