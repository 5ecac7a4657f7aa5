"""What a request is answered with: MAV_RESULT, MAV_SEVERITY and texts. Numbers are MAVLink's, the room knows nothing else of it."""

from enum import IntEnum
from typing import NamedTuple


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    UNSUPPORTED_MAV_FRAME = 9


class Severity(IntEnum):
    """MAV_SEVERITY."""

    EMERGENCY = 0
    CRITICAL = 2
    WARNING = 4
    INFO = 6


class Text(NamedTuple):
    """One STATUSTEXT."""

    severity: Severity
    text: str


class SystemStatus(IntEnum):
    """MAV_STATE."""

    UNINIT = 0
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
