"""Arming, modes and failsafes: what PX4's commander decides. No I/O; time is an argument (seconds since boot).

State: the pilot's mode, armed, landed timers, link times. Every answer is a `Result` (MAV_RESULT) and texts in `texts`.
"""

from dataclasses import dataclass
from enum import IntEnum
from math import inf
from typing import NamedTuple

from vehicle_sim.autopilot.failsafe import Conditions, Decision, Policy, Reason, decide
from vehicle_sim.autopilot.modes import MODE_TABLE, Mode, Need, runnable
from vehicle_sim.autopilot.parameters import ParameterStore

#: Boot to a converged estimate, as measured on PX4.
READY_AFTER_S = 4.0
#: PX4 looks for a lost signal ten times a second; on average it acts this much after the time-out.
LOSS_CHECK_S = 0.06
FORCE_MAGIC = 21196.0


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


@dataclass(frozen=True)
class Links:
    """When each was last heard, seconds since boot; -inf for never."""

    offboard_s: float = -inf
    manual_s: float = -inf
    gcs_s: float = -inf


class Commander:
    """Call `update` at 50 Hz; requests may come at any time between."""

    def __init__(self, parameters: ParameterStore) -> None:
        self._parameters = parameters
        self.mode = Mode.LOITER
        self.armed = False
        self.decision = Decision(Mode.LOITER)
        self.texts: list[Text] = []
        self.has_flown = False
        self._armed_s = 0.0
        self._landed_s = 0.0
        self._ready = False
        self._battery_level = 1.0
        self._overridden: frozenset[Reason] = frozenset()

    @property
    def flown_mode(self) -> Mode:
        """The mode that flies the vehicle: the pilot's, or the failsafe's."""
        return self.decision.mode

    def system_status(self) -> SystemStatus:
        """HEARTBEAT system_status."""
        if self.decision.reason is not None:
            return SystemStatus.CRITICAL
        if self.armed:
            return SystemStatus.ACTIVE
        return SystemStatus.STANDBY if self._ready else SystemStatus.UNINIT

    def is_ready(self) -> bool:
        """Pre-arm checks pass, apart from those of the mode."""
        return self._ready

    def present(self, t_s: float, links: Links) -> frozenset[Need]:
        """The needs of modes that are met now."""
        needs = set()
        if t_s >= READY_AFTER_S:
            needs.add(Need.LOCAL_POSITION)
        if t_s - links.offboard_s <= self._parameters["COM_OF_LOSS_T"] + (LOSS_CHECK_S if self.armed else 0.0):
            needs.add(Need.OFFBOARD_SIGNAL)
        if t_s - links.manual_s <= self._parameters["COM_RC_LOSS_T"]:
            needs.add(Need.MANUAL_CONTROL)
        return frozenset(needs)

    def request_mode(self, mode: Mode, t_s: float, links: Links) -> Result:
        """Row 6: disarmed everything is accepted, armed only what can be flown."""
        if self.armed and not runnable(mode, self.present(t_s, links)):
            label = MODE_TABLE[mode].label
            self.say(Severity.CRITICAL, f"Switching to {label} is currently not available")
            return Result.TEMPORARILY_REJECTED
        if self.decision.reason is not None and mode is not self.mode:
            self._overridden |= {self.decision.reason} - {Reason.BATTERY_EMERGENCY}
        self.mode = mode
        self._decide(t_s, links)
        return Result.ACCEPTED

    def arm(self, t_s: float, links: Links, by: str = "external command") -> Result:
        """Row 9. Arming an armed vehicle is accepted."""
        if self.armed:
            return Result.ACCEPTED
        problem = self._arming_problem(t_s, links)
        if problem is not None:
            self.say(Severity.CRITICAL, f"Arming denied: {problem}")
            return Result.TEMPORARILY_REJECTED
        self.armed, self.has_flown = True, False
        self._armed_s = t_s
        self._overridden = frozenset()
        self.say(Severity.INFO, f"Armed by {by}")
        self._decide(t_s, links)
        return Result.ACCEPTED

    def disarm(
        self, t_s: float, links: Links, landed: bool, by: str = "external command", force: bool = False
    ) -> Result:
        """Refused in the air unless forced."""
        if not self.armed:
            return Result.ACCEPTED
        if not landed and not force:
            self.say(Severity.CRITICAL, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        self.armed = False
        self.say(Severity.INFO, f"Disarmed by {by}")
        self._decide(t_s, links)
        return Result.ACCEPTED

    def update(self, t_s: float, links: Links, landed: bool, battery_charge: float) -> None:
        """Timers and failsafes."""
        self._ready = t_s >= READY_AFTER_S
        self._warn_of_battery(battery_charge)
        if self.armed:
            self._disarm_by_itself(t_s, links, landed)
        before = self.decision
        self._decide(t_s, links)
        if self.decision.reason is not None and before.reason is None:
            self.say(Severity.CRITICAL, "Failsafe activated")
        if self.decision.disarm and self.armed:
            self.disarm(t_s, links, landed, by="failsafe", force=True)

    def say(self, severity: Severity, text: str) -> None:
        """Queue a STATUSTEXT."""
        self.texts.append(Text(severity, text))

    def _arming_problem(self, t_s: float, links: Links) -> str | None:
        low = self._battery_level <= self._parameters["BAT_CRIT_THR"]
        row = MODE_TABLE[self.mode]
        if t_s < READY_AFTER_S or low or not row.can_arm or not runnable(self.mode, self.present(t_s, links)):
            return "Resolve system health failures first"
        return None

    def _decide(self, t_s: float, links: Links) -> None:
        if not self.armed:
            self.decision = Decision(self.mode)
            return
        p = self._parameters
        conditions = Conditions(
            self.mode,
            self.present(t_s, links),
            gcs_lost=t_s - links.gcs_s > p["COM_DL_LOSS_T"],
            battery_critical=self._battery_level <= p["BAT_CRIT_THR"],
            battery_emergency=self._battery_level <= p["BAT_EMERGEN_THR"],
            overridden=self._overridden,
        )
        policy = Policy(
            p.integer("COM_OBL_RC_ACT"),
            p.integer("NAV_RCL_ACT"),
            p.integer("NAV_DLL_ACT"),
            p.integer("COM_LOW_BAT_ACT"),
        )
        self.decision = decide(conditions, policy)

    def _disarm_by_itself(self, t_s: float, links: Links, landed: bool) -> None:
        """Row 10: COM_DISARM_LAND after landing, COM_DISARM_PRFLT without take-off; a parameter of 0 or less switches it off."""
        p = self._parameters
        if not landed:
            self.has_flown, self._landed_s = True, t_s
        elif self.has_flown:
            if 0.0 < p["COM_DISARM_LAND"] < t_s - self._landed_s:
                self.disarm(t_s, links, landed, by="landing")
        elif 0.0 < p["COM_DISARM_PRFLT"] < t_s - self._armed_s:
            self.disarm(t_s, links, landed, by="auto preflight disarming")

    def _warn_of_battery(self, charge: float) -> None:
        for name, severity, text in (
            ("BAT_EMERGEN_THR", Severity.EMERGENCY, "Emergency battery level"),
            ("BAT_CRIT_THR", Severity.CRITICAL, "Critical battery"),
            ("BAT_LOW_THR", Severity.WARNING, "Low battery level"),
        ):
            threshold = self._parameters[name]
            if charge <= threshold < self._battery_level:
                self.say(severity, text)
                break
        self._battery_level = charge
