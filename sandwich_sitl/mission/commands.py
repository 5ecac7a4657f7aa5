"""What the mission may order of an autopilot, as frozen values. The link turns them into MAVLink.

There is no command to disarm: an autopilot disarms by itself after landing, so none can be sent in the air.
"""

from dataclasses import dataclass

from sandwich_sitl.mission.vehicle_view import FlightMode


@dataclass(frozen=True, slots=True)
class SetMode:
    """Change the flight mode. Sent once an order; the mission confirms it by HEARTBEAT and decides on another try."""

    mode: FlightMode


@dataclass(frozen=True, slots=True)
class Arm:
    """Arm with all of the autopilot's checks. Sent once an order."""


@dataclass(frozen=True, slots=True)
class TakeOff:
    """MAV_CMD_NAV_TAKEOFF to a height above home in metres (ArduPilot in GUIDED). Sent once an order."""

    altitude_m: float


@dataclass(frozen=True, slots=True)
class SetMessageInterval:
    """Ask for a message at a rate. The link repeats it until acknowledged, at most three tries."""

    message_id: int
    interval_us: int


@dataclass(frozen=True, slots=True)
class ReadParameter:
    """Ask for a parameter's value. The link repeats it until answered, at most three tries."""

    name: str


Command = SetMode | Arm | TakeOff | SetMessageInterval | ReadParameter
