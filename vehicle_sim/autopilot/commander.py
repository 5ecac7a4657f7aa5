"""Arming, modes and failsafes: gathers facts, looks the contract's table up, carries the row out. No I/O; time is an argument (s).

State: the pilot's mode, armed, landed timers, link times. Every answer is a `Result` (MAV_RESULT) and texts in `texts`.
"""

from dataclasses import dataclass
from math import inf

from vehicle_sim.autopilot.contract import Effect, Event, fact_bits, find_row
from vehicle_sim.autopilot.failsafe import POLICY, Decision, Reason, decide
from vehicle_sim.autopilot.modes import MODE_TABLE, Mode, Need, runnable
from vehicle_sim.autopilot.parameters import ParameterStore
from vehicle_sim.autopilot.results import Result, Severity, SystemStatus, Text

#: Boot to a converged estimate, as measured on PX4.
READY_AFTER_S = 4.0
#: PX4 looks for a lost signal ten times a second; on average it acts this much after the time-out.
LOSS_CHECK_S = 0.06
_NEVER_OVERRIDDEN = frozenset({Reason.BATTERY_EMERGENCY})


@dataclass(frozen=True)
class Links:
    """When each was last heard, seconds since boot; -inf for never."""

    offboard_s: float = -inf
    manual_s: float = -inf
    gcs_s: float = -inf


@dataclass
class Health:
    """What the rest of the vehicle knows and the commander decides by. Written by the autopilot before every update."""

    estimate_good: bool = True
    landed: bool = True
    battery: float = 1.0
    geofence_broken: bool = False
    mission_ready: bool = False
    offboard_needs_position: bool = True


class Commander:
    """Call `update` at 50 Hz; requests may come at any time between."""

    def __init__(self, parameters: ParameterStore) -> None:
        self._parameters = parameters
        self.health = Health()
        self.mode = Mode.LOITER
        self.armed = False
        self.has_flown = False
        self.decision = Decision(Mode.LOITER)
        self.texts: list[Text] = []
        self._armed_s = 0.0
        self._landed_s = 0.0
        self._ready = False
        self._manual_at_arming = False
        self._warned_battery = 1.0
        self._warned_fence = False
        self._overridden: frozenset[Reason] = frozenset()
        self._revision = -1
        self._policy: tuple[int, ...] = ()

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

    def present(self, t_s: float, links: Links) -> int:
        """The needs of modes that are met now, as bits of `Need` (plain numbers: enum arithmetic is slow)."""
        p, health, needs = self._parameters, self.health, 0
        position = t_s >= READY_AFTER_S and health.estimate_good
        if position:
            needs |= _LOCAL_POSITION
        if position or (t_s >= READY_AFTER_S and not health.offboard_needs_position):
            needs |= _OFFBOARD_POSITION
        if t_s - links.offboard_s <= p["COM_OF_LOSS_T"] + (LOSS_CHECK_S if self.armed else 0.0):
            needs |= _OFFBOARD_SIGNAL
        if t_s - links.manual_s <= p["COM_RC_LOSS_T"]:
            needs |= _MANUAL_CONTROL
        if health.mission_ready:
            needs |= _MISSION
        return needs

    def facts(self, t_s: float, links: Links, asked: Mode | None = None) -> int:
        """What is known now, for the table: bits of `Fact`."""
        p, present, health = self._parameters, self.present(t_s, links), self.health
        row = MODE_TABLE[self.mode]
        healthy = t_s >= READY_AFTER_S and health.estimate_good and health.battery > p["BAT_CRIT_THR"]
        return fact_bits(
            self.armed,
            health.landed,
            self.has_flown,
            healthy,
            row.can_arm,
            runnable(self.mode, present),
            asked is not None,
            asked is not None and runnable(asked, present),
            0.0 < p["COM_DISARM_LAND"] < t_s - self._landed_s,
            0.0 < p["COM_DISARM_PRFLT"] < t_s - self._armed_s,
            self.decision.reason is not None,
            self.decision.disarm,
        )

    def request(self, event: Event, t_s: float, links: Links, asked: Mode | None = None) -> Result:
        """Answer what somebody asked for. Rows 6 and 9 of PX4's behaviour are rows of the table."""
        row = find_row(event, self.facts(t_s, links, asked))
        if row.severity is not None:
            label = MODE_TABLE[asked].label if asked is not None else ""
            self.say(row.severity, row.text.format(mode=label))
        self._carry_out(row.effect, t_s, links, asked)
        return Result.ACCEPTED if row.result is None else row.result

    def update(self, t_s: float, links: Links) -> None:
        """Timers and failsafes."""
        self._ready = t_s >= READY_AFTER_S and self.health.estimate_good
        self._warn()
        if self.armed:
            if not self.health.landed:
                self.has_flown, self._landed_s = True, t_s
            if self.health.landed or self.decision.disarm:  # no row of the table acts on a tick otherwise
                self.request(Event.TICK, t_s, links)
        before = self.decision
        self._decide(t_s, links)
        if self.decision.reason is not None and before.reason is None:
            self.say(Severity.CRITICAL, "Failsafe activated")

    def say(self, severity: Severity, text: str) -> None:
        """Queue a STATUSTEXT."""
        self.texts.append(Text(severity, text))

    def _carry_out(self, effect: Effect, t_s: float, links: Links, asked: Mode | None) -> None:
        if effect is Effect.NOTHING:
            return
        if effect is Effect.ARM:
            self.armed, self.has_flown, self._armed_s = True, False, t_s
            self._overridden = frozenset()
            self._manual_at_arming = bool(self.present(t_s, links) & _MANUAL_CONTROL)
        elif effect is Effect.DISARM:
            self.armed = False
        elif effect is Effect.TERMINATE:
            self.mode = Mode.TERMINATE
        elif asked is not None:
            if effect is Effect.OVERRIDE and asked is not self.mode and self.decision.reason is not None:
                self._overridden |= {self.decision.reason} - _NEVER_OVERRIDDEN
            self.mode = asked
        self._decide(t_s, links)

    def _decide(self, t_s: float, links: Links) -> None:
        if not self.armed:
            self.decision = Decision(self.mode)
            return
        if self._revision != self._parameters.revision:
            self._revision = self._parameters.revision
            self._policy = tuple(self._parameters.integer(name) for name in POLICY)
        self.decision = decide(self.mode, self.present(t_s, links), self._causes(t_s, links), self._policy)

    def _causes(self, t_s: float, links: Links) -> frozenset[Reason]:
        p, health = self._parameters, self.health
        causes: list[Reason] = []
        if t_s - links.gcs_s > p["COM_DL_LOSS_T"]:
            causes.append(Reason.GCS_LOST)
        if health.geofence_broken:
            causes.append(Reason.GEOFENCE)
        if health.battery <= p["BAT_EMERGEN_THR"]:
            causes.append(Reason.BATTERY_EMERGENCY)
        elif health.battery <= p["BAT_CRIT_THR"]:
            causes.append(Reason.BATTERY_CRITICAL)
        if self._manual_lost_matters(t_s, links):
            causes.append(Reason.MANUAL_LOST)
        return frozenset(causes) - self._overridden if causes else _NO_CAUSE

    def _manual_lost_matters(self, t_s: float, links: Links) -> bool:
        """Sticks that were there at arming and are gone, unless COM_RCL_EXCEPT excepts the mode."""
        p = self._parameters
        if not self._manual_at_arming or p.integer("COM_RC_IN_MODE") == _STICKS_OFF:
            return False
        excepted = _EXCEPTIONS.get(self.mode, 0) & p.integer("COM_RCL_EXCEPT")
        return not excepted and t_s - links.manual_s > p["COM_RC_LOSS_T"]

    def _warn(self) -> None:
        charge, p = self.health.battery, self._parameters
        for name, severity, reason in _BATTERY_WARNINGS:
            if charge <= p[name] < self._warned_battery:
                self.say(severity, reason.value)
                break
        self._warned_battery = charge
        broken = self.health.geofence_broken and p.integer("GF_ACTION") > 0
        if broken and not self._warned_fence:
            self.say(Severity.CRITICAL, Reason.GEOFENCE.value)
        self._warned_fence = broken


_NO_CAUSE: frozenset[Reason] = frozenset()
_LOCAL_POSITION, _MANUAL_CONTROL, _MISSION = int(Need.LOCAL_POSITION), int(Need.MANUAL_CONTROL), int(Need.MISSION)
_OFFBOARD_SIGNAL, _OFFBOARD_POSITION = int(Need.OFFBOARD_SIGNAL), int(Need.OFFBOARD_POSITION)
_STICKS_OFF = 4
_EXCEPTIONS = {Mode.MISSION: 1, Mode.LOITER: 2, Mode.TAKEOFF: 2, Mode.LAND: 2, Mode.RTL: 2, Mode.OFFBOARD: 4}
_BATTERY_WARNINGS = (
    ("BAT_EMERGEN_THR", Severity.EMERGENCY, Reason.BATTERY_EMERGENCY),
    ("BAT_CRIT_THR", Severity.CRITICAL, Reason.BATTERY_CRITICAL),
    ("BAT_LOW_THR", Severity.WARNING, Reason.BATTERY_LOW),
)
