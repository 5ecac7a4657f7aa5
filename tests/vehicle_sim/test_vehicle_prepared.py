"""Messages read without pymavlink's objects: the same fields, and nothing read that pymavlink would refuse."""

import math
import re
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.protocol import prepared
from vehicle_sim.protocol.codec import Codec

_KINDS = (
    mavlink.MAVLink_heartbeat_message,
    mavlink.MAVLink_timesync_message,
    mavlink.MAVLink_set_position_target_local_ned_message,
    mavlink.MAVLink_manual_control_message,
)
_BITS = {"B": 8, "H": 16, "I": 32, "Q": 64}


def _value(code: str) -> st.SearchStrategy[float]:
    if code == "f":
        return st.floats(width=32)
    bits = _BITS[code.upper()]
    low, high = (0, 2**bits - 1) if code.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    # Zeros at the end of a payload are cut off in MAVLink 2.
    return st.one_of(st.integers(low, high), st.just(0))


@st.composite
def frames(draw: Any) -> tuple[Any, bytes]:
    """(class, frame) as pymavlink packs it, version 1 or 2."""
    kind = draw(st.sampled_from(_KINDS))
    codes = re.findall("[a-zA-Z]", kind.unpacker.format)
    values = dict(zip(kind.ordered_fieldnames, (draw(_value(code)) for code in codes), strict=True))
    sender = mavlink.MAVLink(None, draw(st.integers(0, 255)), draw(st.integers(0, 255)))
    message = kind(*(values[name] for name in kind.fieldnames))
    return kind, message.pack(sender, force_mavlink1=draw(st.booleans()))


def _same(ours: float, theirs: float) -> bool:
    return ours == theirs or (math.isnan(ours) and math.isnan(theirs))


@given(frames())
def test_the_fields_are_pymavlinks(drawn: tuple[Any, bytes]) -> None:
    kind, frame = drawn
    theirs = mavlink.MAVLink(None).decode(bytearray(frame))

    (received,) = Codec(1).decode(frame)

    assert (received.system_id, received.component_id) == (theirs.get_srcSystem(), theirs.get_srcComponent())
    assert received.message.get_type() == theirs.get_type()
    assert all(_same(getattr(received.message, name), getattr(theirs, name)) for name in kind.fieldnames)
    assert (prepared.read(kind.id, frame) is None) == (frame[0] == 0xFE)


@given(frames(), st.integers(0, 10_000), st.integers(1, 255))
def test_a_damaged_frame_is_read_as_pymavlink_reads_it(drawn: tuple[Any, bytes], place: int, change: int) -> None:
    kind, frame = drawn
    damaged = bytearray(frame)
    damaged[place % len(frame)] ^= change
    try:
        mavlink.MAVLink(None).decode(bytearray(damaged))
        valid = True
    except (mavlink.MAVError, TypeError):
        valid = False

    read = prepared.read(kind.id, bytes(damaged)) if len(damaged) == 12 + damaged[1] else None

    assert valid or read is None
