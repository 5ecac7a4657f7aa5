"""Flight modes as PX4 numbers them, and what a mode needs to be flown.

custom_mode = main << 16 | sub << 24. A mode is a row of `MODE_TABLE`; adding one means adding a row.
"""

from dataclasses import dataclass
from enum import Enum


class Mode(Enum):
    """Navigation modes; the value is (main mode, sub mode)."""

    MANUAL = (1, 0)
    ALTCTL = (2, 0)
    POSCTL = (3, 0)
    READY = (4, 1)
    TAKEOFF = (4, 2)
    LOITER = (4, 3)
    MISSION = (4, 4)
    RTL = (4, 5)
    LAND = (4, 6)
    ACRO = (5, 0)
    OFFBOARD = (6, 0)
    STABILIZED = (7, 0)
    TERMINATE = (10, 0)

    @property
    def custom_mode(self) -> int:
        """The HEARTBEAT field."""
        main, sub = self.value
        return int(main << 16 | sub << 24)

    @classmethod
    def from_numbers(cls, main: int, sub: int) -> "Mode | None":
        """The mode that DO_SET_MODE (param2, param3) asks for; None when there is no such mode.

        AUTO without a sub mode is Hold, as in PX4.
        """
        if main == 4 and sub == 0:
            return cls.LOITER
        if main in (4, 10):
            return None if main == 10 else _BY_NUMBERS.get((main, sub))
        return _BY_NUMBERS.get((main, 0))


_BY_NUMBERS: dict[tuple[int, int], Mode] = {mode.value: mode for mode in Mode}


class Need(Enum):
    """A condition without which a mode cannot be flown."""

    LOCAL_POSITION = "local position"
    MANUAL_CONTROL = "manual control"
    OFFBOARD_SIGNAL = "offboard signal"
    MISSION = "mission"


@dataclass(frozen=True)
class ModeRow:
    """`base_mode` bits of HEARTBEAT without the armed bit; whether arming is allowed in this mode."""

    label: str
    base_mode: int
    needs: frozenset[Need]
    can_arm: bool = True


CUSTOM, GUIDED, STABILIZE, MANUAL_INPUT, AUTO, ARMED = 1, 8, 16, 64, 4, 128
_AUTO_BITS = CUSTOM | AUTO | GUIDED | STABILIZE
_POSITION = frozenset({Need.LOCAL_POSITION})
_STICKS = frozenset({Need.MANUAL_CONTROL})

MODE_TABLE: dict[Mode, ModeRow] = {
    Mode.MANUAL: ModeRow("Manual", CUSTOM | MANUAL_INPUT | STABILIZE, _STICKS),
    Mode.ALTCTL: ModeRow("Altitude", CUSTOM | MANUAL_INPUT | STABILIZE, _STICKS | _POSITION),
    Mode.POSCTL: ModeRow("Position", CUSTOM | MANUAL_INPUT | STABILIZE, _STICKS | _POSITION),
    Mode.READY: ModeRow("Ready", _AUTO_BITS, _POSITION, can_arm=False),
    Mode.TAKEOFF: ModeRow("Takeoff", _AUTO_BITS, _POSITION),
    Mode.LOITER: ModeRow("Hold", _AUTO_BITS, _POSITION),
    Mode.MISSION: ModeRow("Mission", _AUTO_BITS, _POSITION | {Need.MISSION}),
    Mode.RTL: ModeRow("Return", _AUTO_BITS, _POSITION, can_arm=False),
    Mode.LAND: ModeRow("Land", _AUTO_BITS, _POSITION, can_arm=False),
    Mode.ACRO: ModeRow("Acro", CUSTOM | MANUAL_INPUT, _STICKS),
    Mode.OFFBOARD: ModeRow("Offboard", CUSTOM | STABILIZE, frozenset({Need.OFFBOARD_SIGNAL}) | _POSITION),
    Mode.STABILIZED: ModeRow("Stabilized", CUSTOM | MANUAL_INPUT | STABILIZE, _STICKS),
    Mode.TERMINATE: ModeRow("Termination", CUSTOM, frozenset(), can_arm=False),
}


def base_mode(mode: Mode, armed: bool, offboard_signal: bool) -> int:
    """HEARTBEAT base_mode; OFFBOARD without a stream, disarmed, shows the custom bit alone (measured)."""
    if mode is Mode.OFFBOARD and not armed and not offboard_signal:
        return CUSTOM
    return MODE_TABLE[mode].base_mode | (ARMED if armed else 0)


def runnable(mode: Mode, present: frozenset[Need]) -> bool:
    """True when every need of the mode is present."""
    return MODE_TABLE[mode].needs <= present
