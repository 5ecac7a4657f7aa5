"""What overrides the pilot's mode: a pure function of the conditions, so that a failsafe ends when its cause does.

Source: PX4's failsafe table. A row names a cause, the value of the parameter that chooses, and the action. The most severe action wins; one
that cannot be flown gives way to the next of Hold, Return, Land, Descend.
"""

from enum import Enum, IntEnum
from functools import lru_cache
from typing import NamedTuple

from vehicle_sim.autopilot.modes import MODE_TABLE, STICK_MODES, Mode, Need, runnable


class Action(IntEnum):
    """In order of severity."""

    NONE = 0
    WARN = 1
    HOLD = 2
    RETURN = 3
    LAND = 4
    DESCEND = 5
    DISARM = 6
    TERMINATE = 7


class Reason(Enum):
    """Why a failsafe acts. The value is what the operator reads."""

    OFFBOARD_LOST = "Offboard signal lost"
    MANUAL_LOST = "Manual control lost"
    GCS_LOST = "Ground station lost"
    GEOFENCE = "Geofence violated"
    BATTERY_LOW = "Low battery level"
    BATTERY_CRITICAL = "Critical battery"
    BATTERY_EMERGENCY = "Emergency battery level"
    MODE_UNAVAILABLE = "Mode not available"


class FailsafeRow(NamedTuple):
    """`fallback` is a mode flown by sticks that is taken instead of the action when sticks are there."""

    reason: Reason
    parameter: str
    value: int
    action: Action
    fallback: Mode | None = None


_A = Action


def _rows(reason: Reason, parameter: str, actions: dict[int, Action]) -> tuple[FailsafeRow, ...]:
    return tuple(FailsafeRow(reason, parameter, value, action) for value, action in actions.items())


_LINK = {1: _A.HOLD, 2: _A.RETURN, 3: _A.LAND, 5: _A.TERMINATE, 6: _A.DISARM}
FAILSAFES: tuple[FailsafeRow, ...] = (
    FailsafeRow(Reason.OFFBOARD_LOST, "COM_OBL_RC_ACT", 0, _A.NONE, Mode.POSCTL),
    FailsafeRow(Reason.OFFBOARD_LOST, "COM_OBL_RC_ACT", 1, _A.NONE, Mode.ALTCTL),
    FailsafeRow(Reason.OFFBOARD_LOST, "COM_OBL_RC_ACT", 2, _A.NONE, Mode.STABILIZED),
    *_rows(
        Reason.OFFBOARD_LOST,
        "COM_OBL_RC_ACT",
        {3: _A.RETURN, 4: _A.LAND, 5: _A.HOLD, 6: _A.TERMINATE, 7: _A.DISARM},
    ),
    *_rows(Reason.MANUAL_LOST, "NAV_RCL_ACT", _LINK),
    *_rows(Reason.GCS_LOST, "NAV_DLL_ACT", {0: _A.NONE, **_LINK}),
    *_rows(
        Reason.GEOFENCE,
        "GF_ACTION",
        {0: _A.NONE, 1: _A.WARN, 2: _A.HOLD, 3: _A.RETURN, 4: _A.TERMINATE, 5: _A.LAND},
    ),
    *_rows(Reason.BATTERY_CRITICAL, "COM_LOW_BAT_ACT", {0: _A.WARN, 2: _A.LAND, 3: _A.RETURN}),
    *_rows(Reason.BATTERY_EMERGENCY, "COM_LOW_BAT_ACT", {0: _A.WARN, 2: _A.LAND, 3: _A.LAND}),
)
#: The parameters that choose, in the order in which `decide` takes their values.
POLICY = tuple(dict.fromkeys(row.parameter for row in FAILSAFES))
_ACTIONS = {(row.reason, row.value): row for row in FAILSAFES}
_PARAMETER = {row.reason: POLICY.index(row.parameter) for row in FAILSAFES}
_LADDER = (
    (_A.HOLD, Mode.LOITER),
    (_A.RETURN, Mode.RTL),
    (_A.LAND, Mode.LAND),
    (_A.DESCEND, Mode.DESCEND),
)


class Decision(NamedTuple):
    """The mode to fly, and the reason when it is not the pilot's."""

    mode: Mode
    reason: Reason | None = None
    disarm: bool = False


@lru_cache(maxsize=4096)
def decide(mode: Mode, present: int, causes: frozenset[Reason], policy: tuple[int, ...]) -> Decision:
    """The mode to fly while armed. `causes` are the reasons that hold now; loss of OFFBOARD and of sticks is found here."""
    found: list[tuple[Action, Reason]] = []
    if mode is Mode.OFFBOARD and not present & Need.OFFBOARD_SIGNAL:
        row = _row_for(Reason.OFFBOARD_LOST, policy)
        if row.fallback is not None and runnable(row.fallback, present):
            return Decision(row.fallback, Reason.OFFBOARD_LOST)
        action = row.action if row.fallback is None else _row_for(Reason.MANUAL_LOST, policy).action
        found.append((action, Reason.OFFBOARD_LOST))
    elif mode in STICK_MODES and not present & Need.MANUAL_CONTROL:
        found.append((_row_for(Reason.MANUAL_LOST, policy).action, Reason.MANUAL_LOST))
    elif not runnable(mode, present):
        found.append((Action.HOLD, Reason.MODE_UNAVAILABLE))
    found += [(_row_for(reason, policy).action, reason) for reason in causes]
    action, reason = max(found, key=lambda cause: (cause[0], cause[1].value), default=(Action.NONE, None))
    return Decision(mode) if reason is None or action <= Action.WARN else _carry_out(action, reason, mode, present)


def _row_for(reason: Reason, policy: tuple[int, ...]) -> FailsafeRow:
    value = policy[_PARAMETER[reason]]
    return _ACTIONS.get((reason, value), FailsafeRow(reason, POLICY[_PARAMETER[reason]], value, Action.RETURN))


def _carry_out(action: Action, reason: Reason, mode: Mode, present: int) -> Decision:
    if action is Action.DISARM:
        return Decision(mode, reason, disarm=True)
    if action is Action.TERMINATE:
        return Decision(Mode.TERMINATE, reason)
    if runnable(mode, present) and MODE_TABLE[mode].severity >= action:
        return Decision(mode)
    for rung, candidate in _LADDER:
        if rung >= action and runnable(candidate, present):
            return Decision(candidate, reason)
    return Decision(Mode.TERMINATE, reason)
