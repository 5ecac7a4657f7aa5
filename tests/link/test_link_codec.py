"""The prepared codec against pymavlink, byte for byte and field for field."""

import math
import re
import struct

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from sandwich_sitl.link.codec import _UNPACK, Layout, decode

_RANGES = {
    "B": (0, 2**8 - 1), "b": (-(2**7), 2**7 - 1), "H": (0, 2**16 - 1), "h": (-(2**15), 2**15 - 1),
    "I": (0, 2**32 - 1), "i": (-(2**31), 2**31 - 1), "Q": (0, 2**64 - 1), "q": (-(2**63), 2**63 - 1),
}  # fmt: skip
_ENCODED = (mavlink.MAVLink_set_position_target_local_ned_message, mavlink.MAVLink_timesync_message)
_DECODED = tuple(mavlink.mavlink_map[number] for number in _UNPACK)


def _value(code):
    if code == "f":
        return st.floats(width=32)
    low, high = _RANGES[code]
    # Small numbers leave zero bytes at the end of the payload, which MAVLink 2 cuts off.
    return st.one_of(st.integers(low, high), st.integers(max(low, -1), 2), st.just(0))


def _codes(kind):
    """One struct code a value, in wire order."""
    counted = re.findall(r"(\d*)([a-zA-Z])", kind.unpacker.format)
    return [code for count, code in counted for _ in range(int(count or 1))]


@st.composite
def messages(draw, kinds):
    """(class, fields as pymavlink's constructor takes them, values in wire order, sequence, system, component)."""
    kind = draw(st.sampled_from(kinds))
    values = [draw(_value(code)) for code in _codes(kind)]
    left, by_name = iter(values), {}
    for name, length in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
        by_name[name] = [next(left) for _ in range(length)] if length else next(left)
    fields = [by_name[name] for name in kind.fieldnames]
    return kind, fields, values, *(draw(st.integers(0, 255)) for _ in range(3))


def _pymavlink_frame(kind, fields, sequence, system, component, version_1=False):
    encoder = mavlink.MAVLink(None, system, component)
    encoder.seq = sequence
    return kind(*fields).pack(encoder, force_mavlink1=version_1)


def _same(ours, theirs):
    """Equal, two numbers that are not numbers included."""
    if isinstance(theirs, list | tuple):
        return len(ours) == len(theirs) and all(map(_same, ours, theirs))
    return ours == theirs or (math.isnan(ours) and math.isnan(theirs))


@given(messages(_ENCODED))
def test_a_prepared_frame_is_pymavlinks_frame(drawn):
    kind, fields, values, sequence, system, component = drawn

    assert Layout(kind).frame(sequence, system, component, *values) == _pymavlink_frame(
        kind, fields, sequence, system, component
    )


@given(messages(_DECODED), st.booleans())
def test_a_prepared_message_has_pymavlinks_fields(drawn, version_1):
    kind, fields, _, *sender = drawn
    raw = _pymavlink_frame(kind, fields, *sender, version_1=version_1)
    theirs = mavlink.MAVLink(None).decode(bytearray(raw))

    ours = decode(kind.id, raw)

    assert type(ours) is not type(theirs)
    assert all(_same(getattr(ours, name), getattr(theirs, name)) for name in kind.fieldnames)


def test_a_payload_longer_than_the_dialect_knows_keeps_its_known_fields():
    raw = mavlink.MAVLink_system_time_message(7, 1234).pack(mavlink.MAVLink(None, 1, 1))
    longer = bytes((raw[0], 14)) + raw[2:10] + struct.pack("<QI", 7, 1234) + b"\x05\x06"

    assert decode(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, longer + b"\0\0").time_boot_ms == 1234


def test_a_rare_message_is_pymavlinks_own():
    message = mavlink.MAVLink_statustext_message(4, b"low battery", 0, 0)

    assert decode(mavlink.MAVLINK_MSG_ID_STATUSTEXT, message.pack(mavlink.MAVLink(None, 1, 1))).text == "low battery"
