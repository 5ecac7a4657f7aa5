"""The parameter protocol: PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET, PARAM_VALUE.

Values travel bytewise: an INT32's four bytes in the float field. A list begins with _HASH_CHECK (row 19).
"""

import struct
import zlib
from math import isfinite
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from vehicle_sim.autopilot.parameters import TABLE, Number, ParameterStore

HASH_NAME = "_HASH_CHECK"
_NO_INDEX = 65535
_NO_NAN = 0xBFFFFFFF


def parameter_value(store: ParameterStore, name: str) -> Any:
    """PARAM_VALUE of one parameter."""
    index = list(store).index(name)
    return _message(name, wire_value(store.value(name)), TABLE[name].is_integer, len(store), index)


def hash_value(store: ParameterStore) -> Any:
    """PARAM_VALUE of _HASH_CHECK; one bit is cleared, so that the float field never holds a NaN."""
    digest = 0
    for name in store:
        digest = zlib.crc32(name.encode() + struct.pack("<f", wire_value(store.value(name))), digest)
    value = struct.unpack("<f", struct.pack("<I", digest & _NO_NAN))[0]
    return mavlink.MAVLink_param_value_message(
        HASH_NAME.encode(), value, mavlink.MAV_PARAM_TYPE_UINT32, len(store), _NO_INDEX
    )


def parameter_list(store: ParameterStore) -> list[Any]:
    """The whole list, hash first."""
    return [hash_value(store), *(parameter_value(store, name) for name in store)]


def find_parameter(store: ParameterStore, index: int, raw_name: str | bytes) -> Any:
    """PARAM_REQUEST_READ by index, or by name when the index is -1; None when there is no such parameter."""
    name = _text(raw_name)
    if index >= 0:
        names = list(store)
        return parameter_value(store, names[index]) if index < len(names) else None
    if name == HASH_NAME:
        return hash_value(store)
    return parameter_value(store, name) if name in store else None


def set_parameter(store: ParameterStore, raw_name: str | bytes, value: float, kind: int) -> str | None:
    """PARAM_SET; the text says why nothing was stored."""
    name = _text(raw_name)
    if name not in store:
        return f"[pm] unknown param: {name}"
    spec = TABLE[name]
    if kind != (mavlink.MAV_PARAM_TYPE_INT32 if spec.is_integer else mavlink.MAV_PARAM_TYPE_REAL32):
        return f"[pm] param types mismatch param: {name}"
    number: Number = struct.unpack("<i", struct.pack("<f", value))[0] if spec.is_integer else value
    if not isfinite(number) or not spec.low <= number <= spec.high:
        return f"[pm] param {name} must be {spec.low} to {spec.high}"
    store.set(name, number)
    return None


def wire_value(value: Number) -> float:
    """The float field that carries a value."""
    if isinstance(value, int):
        carried: float = struct.unpack("<f", struct.pack("<i", value))[0]
        return carried
    return value


def _message(name: str, value: float, integer: bool, count: int, index: int) -> Any:
    kind = mavlink.MAV_PARAM_TYPE_INT32 if integer else mavlink.MAV_PARAM_TYPE_REAL32
    return mavlink.MAVLink_param_value_message(name.encode(), value, kind, count, index)


def _text(raw: str | bytes) -> str:
    return raw.decode("ascii", "replace") if isinstance(raw, bytes) else raw
