"""`Mission`: runs the transition table and says each tick what to stream and what to order.

State: `Memory`. Input: run clock in seconds (vehicle boot time), `VehicleView`, `MissionInputs`. Output: `Orders`.
A mode or arming request is tried at most three times, is confirmed by HEARTBEAT, and never made again once it
has shown.
"""

from dataclasses import replace
from math import inf

from sandwich_sitl.config import MissionConfig
from sandwich_sitl.mission.audit import AUDITED, audit
from sandwich_sitl.mission.commands import Arm, Command, ReadParameter, SetMode, TakeOff
from sandwich_sitl.mission.orders import (
    EXIT_STATUS,
    TERMINAL,
    MissionInputs,
    Orders,
    Outcome,
    OutcomeName,
    State,
    Stream,
)
from sandwich_sitl.mission.situation import REST_MPS, TRIES, Memory, Request, Situation, Task, deadline_s, missing
from sandwich_sitl.mission.table import ROWS_OF, Row
from sandwich_sitl.mission.vehicle_view import AckOf, AckResult, Autopilot, FlightMode, VehicleView

_TEXTS_KEPT = 3
_WARNING = 4  # syslog severity
_ASKED_MODE = {State.REQUEST: FlightMode.OFFBOARD, State.LAND: FlightMode.LAND}
_STREAM = {
    State.PRIME: Stream.POSE,
    State.REQUEST: Stream.POSE,
    State.ACTIVE: Stream.TRACK,
    State.BRAKE: Stream.BRAKE,
    State.HOLD: Stream.HOLD,
    State.TAKEOFF: Stream.NONE,
    State.WATCH: Stream.NONE,
    State.DONE: Stream.NONE,
    State.FAILED: Stream.NONE,
}


class Mission:
    """One flight from CONNECT to DONE or FAILED.

    `start_m` (x, y) ENU is where the vehicle must stand, `altitude_m` the flight altitude above it. `route_s`, the
    duration of the reference, bounds the time in ACTIVE, and its greatest height `highest_m` that of the landing. A vehicle that
    knows its place less well than `position_std_m` does not take off, and lands.
    """

    def __init__(
        self,
        config: MissionConfig,
        start_m: tuple[float, float],
        altitude_m: float,
        route_s: float = 600.0,
        highest_m: float | None = None,
        position_std_m: float = inf,
    ) -> None:
        highest_m = altitude_m if highest_m is None else highest_m
        self._task = Task(config, start_m, altitude_m, route_s, highest_m, position_std_m)
        self._memory = Memory()

    @property
    def state(self) -> State:
        """The present state."""
        return self._memory.state

    def rerouted(self, route_s: float) -> None:
        """The reference now lasts this long, which bounds the time in ACTIVE."""
        self._task = replace(self._task, route_s=route_s)

    def step(self, now_s: float, view: VehicleView, inputs: MissionInputs) -> Orders:
        """Advance to `now_s`; at most one transition a tick."""
        log: list[str] = []
        self._remember(view)
        situation = Situation(now_s, view, inputs, self._task, self._memory)
        row = next((row for row in ROWS_OF[self.state] if row.guard(situation)), None)
        if row is not None:
            self._memory = entered(row, situation)
        commands = self._commands(now_s, view, row is not None, log)
        return Orders(self.state, self._stream(), commands, tuple(log), self._finished())

    def _remember(self, view: VehicleView) -> None:
        memory = self._memory
        asked = _ASKED_MODE.get(memory.state)
        if asked is not None and view.mode is asked and not memory.mode_seen:
            memory = replace(memory, mode_seen=True)
        if view.status_texts:
            warnings = tuple(text for text in view.status_texts if text.severity <= _WARNING)
            memory = replace(memory, texts=(memory.texts + warnings)[-_TEXTS_KEPT:])
        if view.acks:
            memory = with_acks(memory, view)
        self._memory = memory

    def _commands(self, now_s: float, view: VehicleView, just_entered: bool, log: list[str]) -> tuple[Command, ...]:
        memory = self._memory
        if memory.state is State.READY and just_entered:
            px4 = view.autopilot is Autopilot.PX4
            return tuple(ReadParameter(name) for name in AUDITED) if px4 else ()
        if memory.state is State.PRIME and just_entered and view.autopilot is Autopilot.PX4:
            log.extend(audit(view.parameters))
        wanted = wanted_command(memory, view, self._task)
        if wanted is None:
            return ()
        tries = 0
        if memory.request is not None and memory.request.command == wanted:
            tries = memory.request.tries
            if tries >= TRIES or not memory.request.due(now_s):
                return ()
        self._memory = replace(memory, request=Request(wanted, tries + 1, now_s))
        log.append(f"{describe(wanted)} requested, try {tries + 1} of {TRIES}")
        return (wanted,)

    def _stream(self) -> Stream:
        memory = self._memory
        if memory.state is State.LAND:
            if memory.mode_seen:
                return Stream.NONE
            return Stream.BRAKE if memory.entry_speed_mps > REST_MPS else Stream.HOLD
        return _STREAM.get(memory.state, Stream.IDLE)

    def _finished(self) -> Outcome | None:
        memory = self._memory
        if memory.state not in TERMINAL:
            return None
        outcome = memory.outcome if memory.outcome is not None else OutcomeName.TIMEOUT
        return Outcome(outcome, EXIT_STATUS[outcome], memory.reason)


def entered(row: Row, situation: Situation) -> Memory:
    """The memory after taking `row`."""
    memory, view = situation.memory, situation.view
    if row.outcome is not None:
        reason = row.why.format(
            missing=", ".join(missing(situation)) or "nothing, it became ready too late",
            mode=view.mode.value,
            said=said(memory),
            uncertainty=view.uncertainty(situation.task.position_std_m),
            limit=deadline_s(memory.state, situation.task, memory.entry_speed_mps),
        )
        memory = replace(memory, outcome=row.outcome, reason=reason)
    return replace(
        memory,
        state=row.next,
        entered_s=situation.now_s,
        entry_speed_mps=view.speed_mps,
        entry_mode=view.mode,
        mode_seen=view.mode is _ASKED_MODE.get(row.next),
        request=None,
    )


def wanted_command(memory: Memory, view: VehicleView, task: Task) -> Command | None:
    """What the state still has to bring about."""
    if memory.state is State.REQUEST:
        if view.mode is not FlightMode.OFFBOARD:
            return None if memory.mode_seen else SetMode(FlightMode.OFFBOARD)
        return None if view.armed else Arm()
    if memory.state is State.TAKEOFF:
        accepted = memory.request is not None and memory.request.accepted
        return None if accepted else TakeOff(task.altitude_m)
    if memory.state is State.LAND and not memory.mode_seen:
        return SetMode(FlightMode.LAND)
    return None


def with_acks(memory: Memory, view: VehicleView) -> Memory:
    """Enter acknowledgements; PX4 acknowledges a mode twice, so a later refusal overrules an earlier acceptance."""
    for ack in view.acks:
        accepted = ack.result in (AckResult.ACCEPTED, AckResult.IN_PROGRESS)
        if not accepted and ack.command is not AckOf.OTHER:
            memory = replace(memory, refusal=f"{ack.command.value} {ack.result.value}")
        if memory.request is not None and ack.command is _ack_of(memory.request.command):
            memory = replace(memory, request=replace(memory.request, answered=True, accepted=accepted))
    return memory


def said(memory: Memory) -> str:
    """What the autopilot last answered and wrote, for a reason."""
    parts = [memory.refusal] if memory.refusal else []
    parts += [text.text for text in memory.texts]
    return f"; the autopilot said: {' | '.join(parts)}" if parts else ""


def describe(command: Command) -> str:
    """A command in words."""
    match command:
        case SetMode(mode=mode):
            return f"mode {mode.value}"
        case Arm():
            return "arming"
        case TakeOff(altitude_m=altitude_m):
            return f"take-off to {altitude_m:g} m"
        case _:
            return type(command).__name__


def _ack_of(command: Command) -> AckOf:
    match command:
        case SetMode():
            return AckOf.SET_MODE
        case Arm():
            return AckOf.ARM
        case TakeOff():
            return AckOf.TAKE_OFF
        case _:
            return AckOf.OTHER
