"""`VehicleView`: what telemetry says about the vehicle, as one frozen value a tick.

State: none. Units and frame: metres, m/s, seconds of vehicle boot time; position and velocity ENU in the world's
frame (z up), attitude as the quaternion that turns body FLU vectors into ENU. The link fills it, the mission and the
run read it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

_NO_PARAMETERS: Mapping[str, float] = MappingProxyType({})


class Autopilot(StrEnum):
    """Which firmware answers; it decides the mode numbers and how a take-off is flown."""

    PX4 = "px4"
    ARDUPILOT = "ardupilot"
    UNKNOWN = "unknown"


class FlightMode(StrEnum):
    """Flight modes by meaning; `OFFBOARD` is ArduPilot's GUIDED, `POSITION` its LOITER flown by sticks."""

    MANUAL = "manual"
    STABILIZED = "stabilized"
    ACRO = "acro"
    ALTITUDE = "altitude"
    POSITION = "position"
    TAKEOFF = "takeoff"
    LOITER = "loiter"
    MISSION = "mission"
    RTL = "rtl"
    LAND = "land"
    OFFBOARD = "offboard"
    OTHER = "other"


class SystemStatus(IntEnum):
    """MAV_STATE of the autopilot's HEARTBEAT."""

    UNINIT = 0
    BOOT = 1
    CALIBRATING = 2
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
    EMERGENCY = 6
    POWEROFF = 7
    FLIGHT_TERMINATION = 8


class AckOf(StrEnum):
    """The command an acknowledgement belongs to."""

    SET_MODE = "set mode"
    ARM = "arm"
    TAKE_OFF = "take-off"
    MESSAGE_INTERVAL = "message interval"
    OTHER = "other"


class AckResult(StrEnum):
    """MAV_RESULT."""

    ACCEPTED = "accepted"
    TEMPORARILY_REJECTED = "temporarily rejected"
    DENIED = "denied"
    UNSUPPORTED = "unsupported"
    FAILED = "failed"
    IN_PROGRESS = "in progress"
    CANCELLED = "cancelled"
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class CommandAck:
    """One COMMAND_ACK meant for this process."""

    command: AckOf
    result: AckResult


@dataclass(frozen=True, slots=True)
class StatusText:
    """One STATUSTEXT with its chunks joined; `severity` as in syslog, 0 emergency to 7 debug."""

    severity: int
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class RangeScan:
    """One sweep of a range sensor, turned into the world's frame by the pose that was known when it was heard.

    `origin_m` (2,) is where the vehicle then was; `bearings_rad` (n,), counter-clockwise from east, are the middles of
    sectors `width_rad` wide; `ranges_m` (n,) the distance of the nearest thing in each, inf where there is nothing
    within reach and nan where nothing is known.
    """

    heard_s: float
    origin_m: Vector
    bearings_rad: Vector
    width_rad: float
    ranges_m: Vector


@dataclass(frozen=True, slots=True, eq=False)
class VehicleView:
    """The vehicle as last heard. Fields that were never heard are None; times are vehicle boot time in seconds."""

    heard: bool = False
    last_heard_s: float = 0.0
    heartbeat_s: float = 0.0  # when the newest HEARTBEAT was heard, run clock
    autopilot: Autopilot = Autopilot.UNKNOWN
    armed: bool = False
    mode: FlightMode = FlightMode.OTHER
    system_status: SystemStatus = SystemStatus.UNINIT
    landed: bool | None = None
    prearm_ok: bool = False
    r_m: Vector | None = None
    v_mps: Vector | None = None
    position_time_s: float | None = None
    q_wxyz: Vector | None = None
    home_known: bool = False
    position_std_m: float | None = None  # of the horizontal position, by the autopilot's own account
    battery_percent: float | None = None
    status_texts: tuple[StatusText, ...] = ()  # since the last tick
    acks: tuple[CommandAck, ...] = ()  # since the last tick
    scans: tuple[RangeScan, ...] = ()  # since the last tick
    scan_problems: tuple[str, ...] = ()  # what was wrong with others, since the last tick
    not_finite: tuple[str, ...] = ()  # names of messages that were not taken in for that, since the last tick
    parameters: Mapping[str, float] = field(default_factory=lambda: _NO_PARAMETERS)

    def is_uncertain(self, limit_m: float) -> bool:
        """Whether the autopilot says that it knows where it is no better than that.

        What it said last stands, however long ago: its silence does not mend a figure that was too large. One that never
        said anything (ArduPilot) is believed.
        """
        return self.position_std_m is not None and self.position_std_m > limit_m

    def uncertainty(self, limit_m: float) -> str:
        """How well it knows where it is, and what is allowed, in words."""
        if self.position_std_m is None:
            return "it does not say how well it knows its position"
        return (
            f"it knows its position to {self.position_std_m:.3g} m (one standard deviation), allowed are {limit_m:.3g} m "
            "(assurance.position_std_m)"
        )

    @property
    def speed_mps(self) -> float:
        """Length of the velocity; 0 while it is unknown."""
        return 0.0 if self.v_mps is None else float(np.linalg.norm(self.v_mps))
