"""What goes into the mission each tick and what comes out of it. Frozen values, no behaviour."""

from dataclasses import dataclass
from enum import StrEnum

from sandwich_sitl.errors import LinkError, MissionError
from sandwich_sitl.mission.commands import Command


class State(StrEnum):
    """States of the mission; `TAKEOFF` is ArduPilot's, `WATCH` looks on while the autopilot brings the vehicle down."""

    CONNECT = "CONNECT"
    READY = "READY"
    PRIME = "PRIME"
    REQUEST = "REQUEST"
    TAKEOFF = "TAKEOFF"
    ACTIVE = "ACTIVE"
    BRAKE = "BRAKE"
    HOLD = "HOLD"
    LAND = "LAND"
    WATCH = "WATCH"
    DONE = "DONE"
    FAILED = "FAILED"


TERMINAL = frozenset({State.DONE, State.FAILED})


class Stream(StrEnum):
    """Which setpoints the run sends: none yet, the measured pose, the plan, braking, rest, none any more."""

    IDLE = "IDLE"
    POSE = "POSE"
    TRACK = "TRACK"
    BRAKE = "BRAKE"
    HOLD = "HOLD"
    NONE = "NONE"


class OutcomeName(StrEnum):
    """How a mission ended."""

    LANDED = "landed"
    INTERRUPTED = "interrupted"
    HELD = "held"
    TAKEN_OVER = "taken_over"
    REFUSED = "refused"
    LOST = "lost"
    FAILSAFE = "failsafe"
    TIMEOUT = "timeout"


EXIT_STATUS = dict.fromkeys(OutcomeName, MissionError.exit_status) | {
    OutcomeName.LANDED: 0,
    OutcomeName.INTERRUPTED: 130,  # the shell's 128 + SIGINT
    OutcomeName.LOST: LinkError.exit_status,
}


@dataclass(frozen=True, slots=True)
class Outcome:
    """The end of a mission: its name, the process's exit status, and what happened and what to do about it."""

    outcome: OutcomeName
    exit_status: int
    reason: str


@dataclass(frozen=True, slots=True)
class MissionInputs:
    """`stop_requests`: Ctrl-C or SIGTERM so far. `route_finished`: the reference ended and the vehicle has settled at
    the goal. `plan_stale`: the newest plan is too old to be sent. `no_way`: an obstacle has closed the way to the goal,
    and the vehicle rests where it was stopped before it, or has not left the ground.
    """

    stop_requests: int = 0
    route_finished: bool = False
    plan_stale: bool = False
    no_way: bool = False


@dataclass(frozen=True, slots=True)
class Orders:
    """What the run does this tick; `log` are lines for people."""

    state: State
    stream: Stream
    commands: tuple[Command, ...] = ()
    log: tuple[str, ...] = ()
    finished: Outcome | None = None
