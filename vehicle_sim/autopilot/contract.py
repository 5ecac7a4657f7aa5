"""The state machine of arming and modes as one table without I/O: the first row whose facts hold answers an event.

`Commander` does nothing but gather facts, look a row up and carry out its effect; `vehicle-sim --contract` prints the table, and the
conformance tests walk it row by row. Source: PX4's Commander, and what was measured on it.
"""

from enum import Enum, IntFlag, auto
from typing import NamedTuple

from vehicle_sim.autopilot.results import Result, Severity

_HEALTH = "Arming denied: Resolve system health failures first"


class Fact(IntFlag):
    """What is known when an event comes."""

    ARMED = auto()
    LANDED = auto()
    HAS_FLOWN = auto()
    HEALTHY = auto()
    MODE_CAN_ARM = auto()
    MODE_RUNNABLE = auto()
    ASKED_KNOWN = auto()
    ASKED_RUNNABLE = auto()
    LANDED_LONG_ENOUGH = auto()
    IDLE_TOO_LONG = auto()
    FAILSAFE = auto()
    FAILSAFE_DISARMS = auto()


class Event(Enum):
    """What can happen."""

    ARM = "arm"
    DISARM = "disarm"
    FORCE_DISARM = "force disarm"
    MODE = "mode asked for"
    TERMINATE = "flight termination"
    TICK = "time passes"


class Effect(Enum):
    """What a row does."""

    NOTHING = "-"
    ARM = "arm"
    DISARM = "disarm"
    SET_MODE = "set the mode"
    OVERRIDE = "set the mode, the failsafe gives way"
    TERMINATE = "stop the motors for good"


class Row(NamedTuple):
    """`needs` must hold and `without` must not; `result` None where nobody asked."""

    event: Event
    needs: Fact
    without: Fact
    result: Result | None
    effect: Effect
    severity: Severity | None = None
    text: str = ""


_NONE = Fact(0)
_OK, _LATER, _NO = Result.ACCEPTED, Result.TEMPORARILY_REJECTED, Result.DENIED

TABLE: tuple[Row, ...] = (
    Row(Event.ARM, Fact.ARMED, _NONE, _OK, Effect.NOTHING),
    Row(Event.ARM, _NONE, Fact.HEALTHY, _LATER, Effect.NOTHING, Severity.CRITICAL, _HEALTH),
    Row(Event.ARM, _NONE, Fact.MODE_CAN_ARM, _LATER, Effect.NOTHING, Severity.CRITICAL, _HEALTH),
    Row(Event.ARM, _NONE, Fact.MODE_RUNNABLE, _LATER, Effect.NOTHING, Severity.CRITICAL, _HEALTH),
    Row(Event.ARM, _NONE, _NONE, _OK, Effect.ARM, Severity.INFO, "Armed by external command"),
    Row(Event.DISARM, _NONE, Fact.ARMED, _OK, Effect.NOTHING),
    Row(Event.DISARM, _NONE, Fact.LANDED, _LATER, Effect.NOTHING, Severity.CRITICAL, "Disarming denied: not landed"),
    Row(Event.DISARM, _NONE, _NONE, _OK, Effect.DISARM, Severity.INFO, "Disarmed by external command"),
    Row(Event.FORCE_DISARM, _NONE, Fact.ARMED, _OK, Effect.NOTHING),
    Row(Event.FORCE_DISARM, _NONE, _NONE, _OK, Effect.DISARM, Severity.INFO, "Disarmed by external command"),
    Row(Event.MODE, _NONE, Fact.ASKED_KNOWN, _LATER, Effect.NOTHING),
    Row(Event.MODE, _NONE, Fact.ARMED, _OK, Effect.SET_MODE),
    Row(
        Event.MODE,
        _NONE,
        Fact.ASKED_RUNNABLE,
        _LATER,
        Effect.NOTHING,
        Severity.CRITICAL,
        "Switching to {mode} is currently not available",
    ),
    Row(Event.MODE, Fact.FAILSAFE, _NONE, _OK, Effect.OVERRIDE),
    Row(Event.MODE, _NONE, _NONE, _OK, Effect.SET_MODE),
    Row(Event.TERMINATE, _NONE, Fact.ARMED, _NO, Effect.NOTHING),
    Row(Event.TERMINATE, _NONE, _NONE, _OK, Effect.TERMINATE, Severity.CRITICAL, "Flight termination active"),
    Row(Event.TICK, _NONE, Fact.ARMED, None, Effect.NOTHING),
    Row(
        Event.TICK,
        Fact.LANDED | Fact.HAS_FLOWN | Fact.LANDED_LONG_ENOUGH,
        _NONE,
        None,
        Effect.DISARM,
        Severity.INFO,
        "Disarmed by landing",
    ),
    Row(
        Event.TICK,
        Fact.LANDED | Fact.IDLE_TOO_LONG,
        Fact.HAS_FLOWN,
        None,
        Effect.DISARM,
        Severity.INFO,
        "Disarmed by auto preflight disarming",
    ),
    Row(Event.TICK, Fact.FAILSAFE_DISARMS, _NONE, None, Effect.DISARM, Severity.INFO, "Disarmed by failsafe"),
    Row(Event.TICK, _NONE, _NONE, None, Effect.NOTHING),
)


def fact_bits(*holds: bool) -> int:
    """Bits of `Fact`, in its order; all of them must be given."""
    return sum(weight for weight, holding in zip(_WEIGHTS, holds, strict=True) if holding)


def find_row(event: Event, facts: int) -> Row:
    """The first row of the event that fits. The last row of each event asks for nothing, so there always is one."""
    for needs, without, row in _BY_EVENT[event]:
        if facts & needs == needs and not facts & without:
            return row
    raise AssertionError(f"no row of the table answers {event}")


_WEIGHTS = tuple(int(fact) for fact in Fact)
_BY_EVENT: dict[Event, tuple[tuple[int, int, Row], ...]] = {
    event: tuple((int(row.needs), int(row.without), row) for row in TABLE if row.event is event) for event in Event
}
