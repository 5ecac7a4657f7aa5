"""Flight modes as PX4 numbers them, and what a mode needs to be flown.

custom_mode = main << 16 | sub << 24. A mode is a row of `MODE_TABLE`; adding one means adding a row.
"""

from dataclasses import dataclass
from enum import Enum, IntFlag, auto


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
    DESCEND = (4, 6, "descend")
    ACRO = (5, 0)
    OFFBOARD = (6, 0)
    STABILIZED = (7, 0)
    TERMINATE = (10, 0)

    @property
    def custom_mode(self) -> int:
        """The HEARTBEAT field."""
        main, sub = self.value[:2]
        return int(main) << 16 | int(sub) << 24

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


_BY_NUMBERS: dict[tuple[int, ...], Mode] = {mode.value: mode for mode in Mode if len(mode.value) == 2}


class Need(IntFlag):
    """Conditions without which a mode cannot be flown."""

    LOCAL_POSITION = auto()
    MANUAL_CONTROL = auto()
    OFFBOARD_SIGNAL = auto()
    MISSION = auto()
    OFFBOARD_POSITION = auto()  # the newest offboard set-point can be flown with what is known of the position


@dataclass(frozen=True)
class ModeRow:
    """`base_mode` bits of HEARTBEAT without the armed bit; whether arming is allowed in this mode.

    `severity`: a failsafe action up to this one (numbers of `failsafe.Action`) leaves the mode alone.
    """

    label: str
    base_mode: int
    needs: Need
    can_arm: bool = True
    severity: int = 0


CUSTOM, GUIDED, STABILIZE, MANUAL_INPUT, AUTO, ARMED = 1, 8, 16, 64, 4, 128
_AUTO_BITS = CUSTOM | AUTO | GUIDED | STABILIZE
_NOTHING = Need(0)
_POSITION = Need.LOCAL_POSITION
_STICKS = Need.MANUAL_CONTROL

MODE_TABLE: dict[Mode, ModeRow] = {
    Mode.MANUAL: ModeRow("Manual", CUSTOM | MANUAL_INPUT | STABILIZE, _STICKS),
    Mode.ALTCTL: ModeRow("Altitude", CUSTOM | MANUAL_INPUT | STABILIZE, _STICKS),
    Mode.POSCTL: ModeRow("Position", CUSTOM | MANUAL_INPUT | STABILIZE, _STICKS | _POSITION),
    Mode.READY: ModeRow("Ready", _AUTO_BITS, _POSITION, can_arm=False),
    Mode.TAKEOFF: ModeRow("Takeoff", _AUTO_BITS, _POSITION),
    Mode.LOITER: ModeRow("Hold", _AUTO_BITS, _POSITION, severity=2),
    Mode.MISSION: ModeRow("Mission", _AUTO_BITS, _POSITION | Need.MISSION),
    Mode.RTL: ModeRow("Return", _AUTO_BITS, _POSITION, can_arm=False, severity=3),
    Mode.LAND: ModeRow("Land", _AUTO_BITS, _POSITION, can_arm=False, severity=4),
    Mode.DESCEND: ModeRow("Descend", _AUTO_BITS, _NOTHING, can_arm=False, severity=5),
    Mode.ACRO: ModeRow("Acro", CUSTOM | MANUAL_INPUT, _STICKS),
    Mode.OFFBOARD: ModeRow("Offboard", CUSTOM | STABILIZE, Need.OFFBOARD_SIGNAL | Need.OFFBOARD_POSITION),
    Mode.STABILIZED: ModeRow("Stabilized", CUSTOM | MANUAL_INPUT | STABILIZE, _STICKS),
    Mode.TERMINATE: ModeRow("Termination", CUSTOM, _NOTHING, can_arm=False, severity=7),
}
_NEEDS = {mode: int(row.needs) for mode, row in MODE_TABLE.items()}
STICK_MODES = frozenset({Mode.MANUAL, Mode.STABILIZED, Mode.ALTCTL, Mode.POSCTL, Mode.ACRO})


def base_mode(mode: Mode, armed: bool, offboard_signal: bool) -> int:
    """HEARTBEAT base_mode; OFFBOARD without a stream, disarmed, shows the custom bit alone (measured)."""
    if mode is Mode.OFFBOARD and not armed and not offboard_signal:
        return CUSTOM
    return MODE_TABLE[mode].base_mode | (ARMED if armed else 0)


def runnable(mode: Mode, present: int) -> bool:
    """True when every need of the mode is present (bits of `Need`)."""
    needs = _NEEDS[mode]
    return needs & present == needs
