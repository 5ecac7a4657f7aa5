"""The transition table of the mission.

Rows of a state are tried from top to bottom, the first whose guard holds is taken. `outcome` and `why` are remembered
when the row is taken and stand in the final report unless a later row replaces them. `why` may name {missing}, {mode},
{said} (what the autopilot last said), {limit} (the state's deadline in seconds) and {uncertainty} (how well it knows its place).

A vehicle that rests for want of a plan waits in the air for `mission.hold_s`, so that somebody may decide. One that no longer knows
where it is lands at once: it drifts while it waits, further with every second, and soon the autopilot would not hold it either.
"""

from dataclasses import dataclass

from sandwich_sitl.mission import situation as when
from sandwich_sitl.mission.orders import OutcomeName as End
from sandwich_sitl.mission.orders import State
from sandwich_sitl.mission.situation import Guard


@dataclass(frozen=True)
class Row:
    """In `state`, when `guard` holds, go to `next`."""

    state: State
    guard: Guard
    next: State
    outcome: End | None = None
    why: str = ""


_STOPPED = "stopped on request"
_TAKEN = (
    "somebody else chose mode {mode}; setpoints have stopped and OFFBOARD is not asked for again: "
    "that pilot has the vehicle{said}"
)
_FAILSAFE = "the autopilot's failsafe took over ({mode}); setpoints have stopped{said}"
_DISARMED = "the vehicle disarmed by itself; look into its own log{said}"
_UNCERTAIN = "the autopilot no longer knows its position well enough, {uncertainty}: stopped and landed{said}"
_CLOSED = "obstacles reported before take-off close the way to the goal; the log says which"
_NOT_READY = "the vehicle is not ready after {limit:g} s: {missing}{said}"
_REFUSED = "the autopilot does not go into armed OFFBOARD{said}"


def _in_flight(state: State) -> tuple[Row, ...]:
    return (
        Row(state, when.failsafe, State.WATCH, End.FAILSAFE, _FAILSAFE),
        Row(state, when.taken_over, State.FAILED, End.TAKEN_OVER, _TAKEN),
        Row(state, when.disarmed, State.FAILED, End.FAILSAFE, _DISARMED),
        Row(state, when.stop_at_once, State.LAND, End.INTERRUPTED, _STOPPED),
    )


ROWS: tuple[Row, ...] = (
    Row(State.CONNECT, when.stop, State.FAILED, End.INTERRUPTED, _STOPPED),
    Row(State.CONNECT, when.heard, State.READY),
    Row(
        State.CONNECT,
        when.deadline,
        State.FAILED,
        End.LOST,
        "no HEARTBEAT of an autopilot within {limit:g} s; start the vehicle and check that it sends to link.uri",
    ),
    Row(State.READY, when.stop, State.FAILED, End.INTERRUPTED, _STOPPED),
    Row(
        State.READY,
        when.unknown_autopilot,
        State.FAILED,
        End.REFUSED,
        "the autopilot is neither PX4 nor ArduPilot, so its mode numbers are unknown; connect one of these",
    ),
    Row(
        State.READY,
        when.armed,
        State.FAILED,
        End.REFUSED,
        "the vehicle is armed already (mode {mode}); let it land and disarm, then start again",
    ),
    Row(State.READY, when.no_way, State.FAILED, End.REFUSED, _CLOSED),
    Row(State.READY, when.ready, State.PRIME),
    Row(State.READY, when.deadline, State.FAILED, End.REFUSED, _NOT_READY),
    Row(State.PRIME, when.stop, State.FAILED, End.INTERRUPTED, _STOPPED),
    Row(State.PRIME, when.no_way, State.FAILED, End.REFUSED, _CLOSED),
    Row(State.PRIME, when.primed, State.REQUEST),
    Row(State.PRIME, when.deadline, State.FAILED, End.REFUSED, _NOT_READY),
    Row(State.REQUEST, when.taken_on_the_ground, State.FAILED, End.TAKEN_OVER, _TAKEN),
    Row(State.REQUEST, when.stop_on_the_ground, State.FAILED, End.INTERRUPTED, _STOPPED),
    Row(State.REQUEST, when.stop, State.LAND, End.INTERRUPTED, _STOPPED),
    Row(State.REQUEST, when.flying_by_takeoff, State.TAKEOFF),
    Row(State.REQUEST, when.offboard_and_armed, State.ACTIVE),
    Row(State.REQUEST, when.exhausted, State.FAILED, End.REFUSED, _REFUSED + " after three tries"),
    Row(State.REQUEST, when.deadline, State.FAILED, End.REFUSED, _REFUSED + " within {limit:g} s"),
    *_in_flight(State.TAKEOFF),
    Row(State.TAKEOFF, when.stop, State.LAND, End.INTERRUPTED, _STOPPED),
    Row(State.TAKEOFF, when.at_altitude, State.ACTIVE),
    Row(State.TAKEOFF, when.exhausted, State.LAND, End.REFUSED, "the autopilot refuses the take-off{said}"),
    Row(State.TAKEOFF, when.deadline, State.LAND, End.TIMEOUT, "the take-off takes longer than {limit:g} s{said}"),
    *_in_flight(State.ACTIVE),
    Row(State.ACTIVE, when.stop, State.BRAKE, End.INTERRUPTED, _STOPPED),
    Row(State.ACTIVE, when.stopped_uncertain, State.BRAKE, End.HELD, _UNCERTAIN),
    Row(
        State.ACTIVE,
        when.plan_stale,
        State.BRAKE,
        End.HELD,
        "no checked plan to fly on: stopped there and held; the log has the faults",
    ),
    Row(
        State.ACTIVE,
        when.no_way,
        State.BRAKE,
        End.HELD,
        "an obstacle has closed the way to the goal: stopped before it and held; the log says which",
    ),
    Row(State.ACTIVE, when.route_finished, State.LAND, End.LANDED, "reached the goal, landed and disarmed"),
    Row(State.ACTIVE, when.deadline, State.BRAKE, End.TIMEOUT, "the goal was not reached within {limit:g} s"),
    *_in_flight(State.BRAKE),
    Row(State.BRAKE, when.at_rest, State.HOLD),
    Row(State.BRAKE, when.deadline, State.HOLD),
    *_in_flight(State.HOLD),
    Row(State.HOLD, when.asked_to_land, State.LAND),
    Row(State.HOLD, when.uncertain, State.LAND),
    Row(State.HOLD, when.hold_over, State.LAND),
    Row(State.LAND, when.settled, State.DONE),
    Row(State.LAND, when.failsafe_in_land, State.WATCH, End.FAILSAFE, _FAILSAFE),
    Row(State.LAND, when.taken_over_in_land, State.FAILED, End.TAKEN_OVER, _TAKEN),
    Row(
        State.LAND,
        when.exhausted,
        State.WATCH,
        End.REFUSED,
        "the autopilot does not go into LAND; setpoints have stopped so that its failsafe acts{said}",
    ),
    Row(
        State.LAND,
        when.deadline,
        State.FAILED,
        End.TIMEOUT,
        "not landed and disarmed within {limit:g} s; land it by hand{said}",
    ),
    Row(State.WATCH, when.settled, State.FAILED),
    Row(State.WATCH, when.pilot_flies, State.FAILED, End.TAKEN_OVER, _TAKEN),
    Row(
        State.WATCH,
        when.hovering,
        State.FAILED,
        End.HELD,
        "the autopilot holds the vehicle in the air ({mode}); land it by hand{said}",
    ),
    Row(
        State.WATCH,
        when.deadline,
        State.FAILED,
        End.TIMEOUT,
        "the autopilot has not landed the vehicle within {limit:g} s; land it by hand{said}",
    ),
)

ROWS_OF: dict[State, tuple[Row, ...]] = {state: tuple(row for row in ROWS if row.state is state) for state in State}
