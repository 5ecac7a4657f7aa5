"""What overrides the pilot's mode: a pure function of the conditions, so that a failsafe ends when its cause does.

Source: PX4's failsafe table. The most severe action wins; an action that cannot be flown gives way to the next in
Hold, Return, Land, Terminate.
"""

from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import NamedTuple

from vehicle_sim.autopilot.modes import Mode, Need, runnable


class Action(IntEnum):
    """In order of severity."""

    NONE = 0
    HOLD = 1
    RETURN = 2
    LAND = 3
    DISARM = 4
    TERMINATE = 5


class Reason(Enum):
    """Why a failsafe acts."""

    OFFBOARD_LOST = "Offboard signal lost"
    MANUAL_LOST = "Manual control lost"
    GCS_LOST = "Ground station lost"
    BATTERY_CRITICAL = "Critical battery"
    BATTERY_EMERGENCY = "Emergency battery level"


@dataclass(frozen=True)
class Policy:
    """The parameters that choose the actions."""

    offboard_loss: int  # COM_OBL_RC_ACT
    manual_loss: int  # NAV_RCL_ACT
    gcs_loss: int  # NAV_DLL_ACT
    low_battery: int  # COM_LOW_BAT_ACT


@dataclass(frozen=True)
class Conditions:
    """What is known now. `present` are the needs of modes that are met."""

    mode: Mode
    present: frozenset[Need]
    gcs_lost: bool
    battery_critical: bool
    battery_emergency: bool
    overridden: frozenset[Reason] = frozenset()


class Decision(NamedTuple):
    """The mode to fly, and the reason when it is not the pilot's."""

    mode: Mode
    reason: Reason | None = None
    disarm: bool = False


_LINK_LOSS = {1: Action.HOLD, 2: Action.RETURN, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.DISARM}
_OFFBOARD_FALLBACK = {0: Mode.POSCTL, 1: Mode.ALTCTL, 2: Mode.STABILIZED}
_OFFBOARD_LOSS = {3: Action.RETURN, 4: Action.LAND, 5: Action.HOLD, 6: Action.TERMINATE, 7: Action.DISARM}
_ACTION_MODE = {
    Action.HOLD: Mode.LOITER,
    Action.RETURN: Mode.RTL,
    Action.LAND: Mode.LAND,
    Action.TERMINATE: Mode.TERMINATE,
}
_STICK_MODES = frozenset({Mode.MANUAL, Mode.STABILIZED, Mode.ALTCTL, Mode.POSCTL, Mode.ACRO})


def decide(conditions: Conditions, policy: Policy) -> Decision:
    """The mode to fly while armed."""
    mode = conditions.mode
    causes: list[tuple[Action, Reason]] = []
    if mode is Mode.OFFBOARD and Need.OFFBOARD_SIGNAL not in conditions.present:
        fallback = _OFFBOARD_FALLBACK.get(policy.offboard_loss)
        if fallback is not None and runnable(fallback, conditions.present):
            return Decision(fallback, Reason.OFFBOARD_LOST)
        action = _OFFBOARD_LOSS.get(policy.offboard_loss) or _LINK_LOSS.get(policy.manual_loss, Action.RETURN)
        causes.append((action, Reason.OFFBOARD_LOST))
    if mode in _STICK_MODES and Need.MANUAL_CONTROL not in conditions.present:
        causes.append((_LINK_LOSS.get(policy.manual_loss, Action.RETURN), Reason.MANUAL_LOST))
    if conditions.gcs_lost and policy.gcs_loss in _LINK_LOSS:
        causes.append((_LINK_LOSS[policy.gcs_loss], Reason.GCS_LOST))
    if conditions.battery_emergency and policy.low_battery in (2, 3):
        causes.append((Action.LAND, Reason.BATTERY_EMERGENCY))
    elif conditions.battery_critical and policy.low_battery in (2, 3):
        causes.append((Action.LAND if policy.low_battery == 2 else Action.RETURN, Reason.BATTERY_CRITICAL))
    causes = [cause for cause in causes if cause[1] not in conditions.overridden]
    if not causes:
        return Decision(mode)
    action, reason = max(causes, key=lambda cause: cause[0])
    return _carry_out(action, reason, conditions)


def _carry_out(action: Action, reason: Reason, conditions: Conditions) -> Decision:
    if action is Action.DISARM:
        return Decision(conditions.mode, reason, disarm=True)
    if action is Action.RETURN and conditions.mode is Mode.LAND:
        return Decision(Mode.LAND)
    if action is Action.HOLD and conditions.mode in (Mode.RTL, Mode.LAND):
        return Decision(conditions.mode)
    for candidate in (Action.HOLD, Action.RETURN, Action.LAND):
        if candidate >= action and runnable(_ACTION_MODE[candidate], conditions.present):
            return Decision(_ACTION_MODE[candidate], reason)
    return Decision(Mode.TERMINATE, reason)
