"""The messages that clients send many times a second, unpacked without pymavlink's message objects.

Only the plain case is read here: MAVLink 2, unsigned, a payload no longer than the dialect knows, a right checksum. All
else is left to pymavlink, which decides what is valid. Tests compare the fields of both.
"""

from collections import namedtuple
from struct import Struct
from typing import Any

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import common as mavlink

_STX_V2 = 0xFD
_HEADER = 10


class _Reader:
    """One message without arrays; `kind` is its class in pymavlink's dialect."""

    def __init__(self, kind: Any) -> None:
        self._struct: Struct = kind.unpacker
        self._seed = bytes((kind.crc_extra,))
        fields: Any = namedtuple(kind.msgname, kind.ordered_fieldnames)  # type: ignore[misc]
        # `get_type` is the one method of pymavlink's messages that their readers call.
        members = {"__slots__": (), "get_type": staticmethod(lambda: kind.msgname)}
        self._make = type(kind.msgname, (fields,), members)._make  # type: ignore[attr-defined]

    def read(self, frame: bytes) -> Any | None:
        """Named fields, as pymavlink's message has them, or None."""
        body, size = _HEADER + frame[1], self._struct.size
        if frame[1] > size or mcrf4xx(frame[1:body] + self._seed) != frame[body] | frame[body + 1] << 8:
            return None
        return self._make(self._struct.unpack(frame[_HEADER:body].ljust(size, b"\0")))


_READERS = {
    kind.id: _Reader(kind)
    for kind in (
        mavlink.MAVLink_heartbeat_message,
        mavlink.MAVLink_timesync_message,
        mavlink.MAVLink_set_position_target_local_ned_message,
        mavlink.MAVLink_manual_control_message,
    )
}


def read(number: int, frame: bytes) -> Any | None:
    """The message in a whole frame with that id, or None when it is for pymavlink to read."""
    reader = _READERS.get(number)
    return reader.read(frame) if reader is not None and frame[0] == _STX_V2 and not frame[2] else None
