"""Payloads packed without pymavlink's message objects: a prepared `struct` a message, filled in wire order.

pymavlink's message classes give the numbers (id, checksum seed, field layout); packing a payload this way costs a tenth of building and
packing such an object. Tests compare the two byte for byte.
"""

from struct import Struct
from typing import Any

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import common as mavlink

#: A packed message: id, checksum seed, length in MAVLink 1 (which knows no extension fields), data. A plain tuple, since hundreds are made
#: for every simulated second.
Payload = tuple[int, bytes, int, bytes]


class Layout:
    """One message's wire layout."""

    def __init__(self, kind: Any) -> None:
        """`kind` is a message class of pymavlink's dialect."""
        self._struct: Struct = kind.unpacker
        self.message_id: int = kind.id
        self._crc_extra = bytes((kind.crc_extra,))
        self._base_length = base_length(kind)

    def pack(self, *values: Any) -> Payload:
        """Fields in wire order; the elements of an array one by one."""
        return (self.message_id, self._crc_extra, self._base_length, self._struct.pack(*values))


def payload_of(message: Any) -> Payload:
    """A message object's payload, for messages that are rare."""
    kind = type(message)
    values: list[Any] = []
    for name, size in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
        value = getattr(message, name)
        if size and not isinstance(value, bytes | str):
            values.extend(value)
        else:
            values.append(value.encode() if isinstance(value, str) else value)
    return (kind.id, bytes((kind.crc_extra,)), base_length(kind), kind.unpacker.pack(*values))


def base_length(kind: Any) -> int:
    """Payload length without extension fields: as many fields, in wire order, as the checksum seed was made of."""
    known = _BASE_LENGTHS.get(kind.id)
    if known is not None:
        return known
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    text, length = f"{kind.msgname} ".encode(), 0
    for name, size in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
        text += f"{types[name]} {name} ".encode() + (bytes((size,)) if size else b"")
        length += _SIZES[types[name]] * max(1, size)
        crc = mcrf4xx(text)
        if crc & 0xFF ^ crc >> 8 == kind.crc_extra:
            break
    _BASE_LENGTHS[kind.id] = length
    return length


_BASE_LENGTHS: dict[int, int] = {}
_SIZES = {
    "char": 1, "uint8_t": 1, "int8_t": 1, "uint16_t": 2, "int16_t": 2, "uint32_t": 4, "int32_t": 4,
    "float": 4, "uint64_t": 8, "int64_t": 8, "double": 8,
}  # fmt: skip
#: Ids that fit MAVLink 1.
LAST_ID_OF_V1 = 255
MESSAGE_NAMES: dict[int, str] = {number: kind.msgname for number, kind in mavlink.mavlink_map.items()}
