"""`Situation`: everything a transition may depend on, and the guards over it.

A guard is a pure predicate. Times are seconds of the run's clock, positions ENU metres.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot

from sandwich_sitl.config import MissionConfig
from sandwich_sitl.control.stop_plan import STEEPEST
from sandwich_sitl.mission.audit import AUDITED
from sandwich_sitl.mission.commands import Arm, Command, SetMode
from sandwich_sitl.mission.orders import MissionInputs, OutcomeName, State
from sandwich_sitl.mission.vehicle_view import Autopilot, FlightMode, StatusText, SystemStatus, VehicleView

TRIES = 3
SILENCE_S = 0.5  # a command without acknowledgement is tried again after this
CONFIRM_S = 1.5  # an acknowledged one has this long to show in the 1 Hz HEARTBEAT
POSITION_AGE_S = 0.5
AUDIT_S = 2.0  # how long READY waits for parameters
REST_MPS = 0.3
_SLOWEST_SINK_MPS = 0.5  # ArduPilot's landing; PX4's is 0.7 near the ground and faster above

_FAILSAFE_MODES = frozenset({FlightMode.RTL, FlightMode.LAND, FlightMode.LOITER})
_PILOT_MODES = frozenset(
    {FlightMode.POSITION, FlightMode.ALTITUDE, FlightMode.MANUAL, FlightMode.STABILIZED, FlightMode.ACRO}
)


@dataclass(frozen=True)
class Task:
    """What this mission is to do. `route_s` is the duration of the reference, `highest_m` its greatest height,
    `position_std_m` how uncertain of its place the vehicle may be.
    """

    config: MissionConfig
    start_m: tuple[float, float]
    altitude_m: float
    route_s: float
    highest_m: float
    position_std_m: float


@dataclass(frozen=True)
class Request:
    """One command under way: how often and when it was sent, and what came back."""

    command: Command
    tries: int
    sent_s: float
    answered: bool = False
    accepted: bool = False

    def due(self, now_s: float) -> bool:
        """True when the last try has had its time."""
        return now_s - self.sent_s >= (CONFIRM_S if self.answered else SILENCE_S)


@dataclass(frozen=True)
class Memory:
    """What the mission remembers from tick to tick."""

    state: State = State.CONNECT
    entered_s: float = 0.0
    entry_speed_mps: float = 0.0
    entry_mode: FlightMode = FlightMode.OTHER
    mode_seen: bool = False  # the mode asked for in this state has shown
    outcome: OutcomeName | None = None
    reason: str = ""
    request: Request | None = None
    texts: tuple[StatusText, ...] = ()  # the last warnings
    refusal: str = ""  # the last command that was not accepted


@dataclass(frozen=True, slots=True)
class Situation:
    """Input of every guard."""

    now_s: float
    view: VehicleView
    inputs: MissionInputs
    task: Task
    memory: Memory

    @property
    def elapsed_s(self) -> float:
        """Time in the present state."""
        return self.now_s - self.memory.entered_s


Guard = Callable[[Situation], bool]


def heard(s: Situation) -> bool:
    """An autopilot has been heard and the clocks are mapped."""
    return s.view.heard


def stop(s: Situation) -> bool:
    """Asked to stop at least once."""
    return s.inputs.stop_requests >= 1


def stop_at_once(s: Situation) -> bool:
    """Asked to stop at least twice."""
    return s.inputs.stop_requests >= 2


def stop_on_the_ground(s: Situation) -> bool:
    """Asked to stop before anything was ordered that could arm the vehicle."""
    request = s.memory.request
    return stop(s) and not s.view.armed and (request is None or not isinstance(request.command, Arm))


def unknown_autopilot(s: Situation) -> bool:
    """The mode numbers of this autopilot are not known."""
    return s.view.autopilot is Autopilot.UNKNOWN


def armed(s: Situation) -> bool:
    """Somebody else has armed the vehicle, or it still flies from an earlier run."""
    return s.view.armed


def missing(s: Situation) -> tuple[str, ...]:
    """What still keeps the vehicle from being ready, in words."""
    lacks = []
    view, (x_m, y_m), tolerance_m = s.view, s.task.start_m, s.task.config.start_tolerance_m
    if not view.prearm_ok:
        lacks.append("its pre-arm checks do not pass")
    if view.r_m is None or view.position_time_s is None or s.now_s - view.position_time_s > POSITION_AGE_S:
        lacks.append("it reports no local position")
    elif (off_m := hypot(view.r_m[0] - x_m, view.r_m[1] - y_m)) > tolerance_m:
        lacks.append(
            f"it stands {off_m:.1f} m from start_m ({x_m:g}, {y_m:g}), allowed are {tolerance_m:g} m: "
            "move it there or correct start_m"
        )
    if uncertain(s):
        lacks.append(view.uncertainty(s.task.position_std_m))
    if view.landed is False:
        lacks.append("it says that it is in the air")
    return tuple(lacks)


def ready(s: Situation) -> bool:
    """Pre-arm checks pass, it stands at the start with a local position, the parameters were read or had their time."""
    read = s.view.autopilot is not Autopilot.PX4 or all(name in s.view.parameters for name in AUDITED)
    return (read or s.elapsed_s >= AUDIT_S) and not missing(s)


def primed(s: Situation) -> bool:
    """The pose was streamed for long enough and the vehicle is still ready."""
    return s.elapsed_s >= s.task.config.prime_s and not missing(s)


def taken_on_the_ground(s: Situation) -> bool:
    """Somebody chose another mode while OFFBOARD was being requested."""
    mode = s.view.mode
    if mode is FlightMode.OFFBOARD:
        return False
    return s.memory.mode_seen or mode is not s.memory.entry_mode


def flying_by_takeoff(s: Situation) -> bool:
    """Armed in GUIDED on an autopilot that ignores setpoints on the ground."""
    return s.view.autopilot is Autopilot.ARDUPILOT and offboard_and_armed(s)


def offboard_and_armed(s: Situation) -> bool:
    """HEARTBEAT shows what was asked for."""
    return s.view.mode is FlightMode.OFFBOARD and s.view.armed


def exhausted(s: Situation) -> bool:
    """The last try has had its time and what it asked for has not come about, whatever was acknowledged."""
    request = s.memory.request
    if request is None or request.tries < TRIES or not request.due(s.now_s):
        return False
    match request.command:
        case SetMode():
            return not s.memory.mode_seen
        case Arm():
            return not s.view.armed
        case _:
            return not request.accepted


def at_altitude(s: Situation) -> bool:
    """ArduPilot's take-off is over."""
    tolerance_m = max(s.task.config.goal_tolerance_m, 0.05 * s.task.altitude_m)
    return s.view.r_m is not None and s.view.r_m[2] >= s.task.altitude_m - tolerance_m and s.view.speed_mps < REST_MPS


def failsafe(s: Situation) -> bool:
    """The autopilot itself has left OFFBOARD: critical, and in a mode that a failsafe chooses."""
    return s.view.system_status >= SystemStatus.CRITICAL and s.view.mode in _FAILSAFE_MODES


def failsafe_in_land(s: Situation) -> bool:
    """The same while landing, where LAND is what was asked for."""
    return failsafe(s) and s.view.mode is not FlightMode.LAND


def taken_over(s: Situation) -> bool:
    """Somebody else has chosen another mode."""
    return s.view.mode is not FlightMode.OFFBOARD


def taken_over_in_land(s: Situation) -> bool:
    """Somebody else has chosen a mode that is neither LAND nor the one before it."""
    if not s.view.armed or s.view.mode is FlightMode.LAND:
        return False
    return s.memory.mode_seen or s.view.mode is not s.memory.entry_mode


def pilot_flies(s: Situation) -> bool:
    """A mode flown by sticks."""
    return s.view.armed and s.view.mode in _PILOT_MODES


def disarmed(s: Situation) -> bool:
    """The vehicle has disarmed without being asked."""
    return not s.view.armed


def plan_stale(s: Situation) -> bool:
    """No fresh plan to send."""
    return s.inputs.plan_stale


def uncertain(s: Situation) -> bool:
    """It no longer knows well enough where it is."""
    return s.view.is_uncertain(s.task.position_std_m)


def stopped_uncertain(s: Situation) -> bool:
    """The last plan has come to its stop, and nobody knows well enough where the vehicle is."""
    return plan_stale(s) and uncertain(s)


def no_way(s: Situation) -> bool:
    """Stopped, or still on the ground, with the way to the goal closed."""
    return s.inputs.no_way


def route_finished(s: Situation) -> bool:
    """Settled at the goal."""
    return s.inputs.route_finished


def at_rest(s: Situation) -> bool:
    """Braked."""
    return s.view.speed_mps < REST_MPS


def asked_to_land(s: Situation) -> bool:
    """Held for want of a plan, and somebody asks for the ground."""
    return s.memory.outcome is OutcomeName.HELD and stop(s)


def hold_over(s: Situation) -> bool:
    """Held for long enough: what was stopped on request lands soon, what lost its plan waits to be asked first."""
    waits_s = s.task.config.hold_s if s.memory.outcome is OutcomeName.HELD else s.task.config.prime_s
    return s.elapsed_s >= min(waits_s, deadline_s(State.HOLD, s.task))


def settled(s: Situation) -> bool:
    """On the ground and disarmed, by a HEARTBEAT newer than the last order."""
    return s.view.landed is True and not s.view.armed and s.view.heartbeat_s > s.memory.entered_s


def hovering(s: Situation) -> bool:
    """Time is up and the autopilot holds the vehicle in the air."""
    return deadline(s) and s.view.armed and s.view.mode in (FlightMode.LOITER, FlightMode.OFFBOARD)


def deadline(s: Situation) -> bool:
    """The state's time is up."""
    return s.elapsed_s >= deadline_s(s.memory.state, s.task, s.memory.entry_speed_mps)


def deadline_s(state: State, task: Task, entry_speed_mps: float = 0.0) -> float:
    """Longest time in a state (run clock), from the mission's configuration. Terminal states have none (inf)."""
    config = task.config
    landing_s = config.land_timeout_s + task.highest_m / _SLOWEST_SINK_MPS
    return {
        State.CONNECT: config.connect_timeout_s,
        State.READY: config.ready_timeout_s,
        State.PRIME: config.prime_s + config.request_timeout_s,
        State.REQUEST: config.request_timeout_s,
        State.TAKEOFF: config.land_timeout_s + task.altitude_m / _SLOWEST_SINK_MPS,
        State.ACTIVE: task.route_s + config.land_timeout_s,
        State.BRAKE: STEEPEST * entry_speed_mps / config.brake_mps2 + 2.0,
        State.HOLD: max(config.prime_s, config.hold_s),
        State.LAND: landing_s,
        State.WATCH: 3.0 * landing_s,  # Return climbs and flies home before it lands
    }.get(state, float("inf"))
