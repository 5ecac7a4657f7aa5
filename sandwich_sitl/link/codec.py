"""Prepared encoders and decoders for the messages of every tick.

pymavlink's dialect says how a message is laid out (struct, field names in wire order, checksum seed); packing and
unpacking with that layout directly leaves out its message objects, which cost about ten times as much. Frames are
MAVLink 2, unsigned, trailing zeros of the payload left out; both versions are read. Tests compare every byte with
pymavlink's own. Rare messages go through pymavlink.
"""

from collections import namedtuple
from collections.abc import Callable
from struct import Struct
from typing import Any

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import common as mavlink

_V2 = mavlink.PROTOCOL_MARKER_V2
_CHECKED = Struct("<BBBBBBHB")
_CRC = Struct("<H")


class Layout:
    """One message without text fields; `kind` is its class in pymavlink's dialect."""

    def __init__(self, kind: Any) -> None:
        self._struct: Struct = kind.unpacker
        self._id_low, self._id_high = kind.id & 0xFFFF, kind.id >> 16
        self._seed = bytes((kind.crc_extra,))
        self._fields: Any = namedtuple(kind.msgname, kind.ordered_fieldnames)  # type: ignore[misc]
        self._slices = _slices(kind.array_lengths)

    def frame(self, sequence: int, system_id: int, component_id: int, *values: float) -> bytes:
        """The frame of a message; fields in wire order (largest types first), the elements of an array one by one."""
        data = self._struct.pack(*values).rstrip(b"\0") or b"\0"
        checked = _CHECKED.pack(len(data), 0, 0, sequence, system_id, component_id, self._id_low, self._id_high) + data
        return b"\xfd" + checked + _CRC.pack(mcrf4xx(checked + self._seed))

    def unpack(self, raw: bytes) -> Any:
        """Named fields of a whole frame whose checksum is known to be right. Fields that were left out are zero, as in pymavlink."""
        start = 10 if raw[0] == _V2 else 6
        size = self._struct.size
        if raw[1] >= size:
            values = self._struct.unpack_from(raw, start)
        else:
            values = self._struct.unpack(raw[start : start + raw[1]].ljust(size, b"\0"))
        if self._slices is None:
            return self._fields._make(values)
        return self._fields._make([values[at] for at in self._slices])


def _slices(array_lengths: list[int]) -> list[int | slice] | None:
    """Where each field stands among the unpacked values; None when every field is one value."""
    if not any(array_lengths):
        return None
    places: list[int | slice] = []
    at = 0
    for length in array_lengths:
        places.append(slice(at, at + length) if length else at)
        at += length or 1
    return places


_OFTEN = (
    mavlink.MAVLink_heartbeat_message,
    mavlink.MAVLink_sys_status_message,
    mavlink.MAVLink_extended_sys_state_message,
    mavlink.MAVLink_system_time_message,
    mavlink.MAVLink_timesync_message,
    mavlink.MAVLink_attitude_message,
    mavlink.MAVLink_attitude_quaternion_message,
    mavlink.MAVLink_local_position_ned_message,
    mavlink.MAVLink_battery_status_message,
)
_DECODER = mavlink.MAVLink(None)
_UNPACK: dict[int, Callable[[bytes], Any]] = {kind.id: Layout(kind).unpack for kind in _OFTEN}


def decode(message_id: int, raw: bytes) -> Any:
    """A frame with a checked checksum as a message with named fields: prepared, or else pymavlink's own object."""
    unpack = _UNPACK.get(message_id)
    return _DECODER.decode(bytearray(raw)) if unpack is None else unpack(raw)
