"""The transition table: every row can be taken, every wait ends, and what must never be ordered is never ordered."""

import random
from dataclasses import replace
from math import inf, isfinite

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandwich_sitl.config import MissionConfig
from sandwich_sitl.mission.audit import AUDITED, audit
from sandwich_sitl.mission.commands import Arm, ReadParameter, SetMode, TakeOff
from sandwich_sitl.mission.machine import Mission
from sandwich_sitl.mission.orders import EXIT_STATUS, TERMINAL, MissionInputs, Orders, OutcomeName, State, Stream
from sandwich_sitl.mission.situation import TRIES, Memory, Request, Situation, Task, deadline_s
from sandwich_sitl.mission.table import ROWS, ROWS_OF
from sandwich_sitl.mission.vehicle_view import (
    AckOf,
    AckResult,
    Autopilot,
    CommandAck,
    FlightMode,
    StatusText,
    SystemStatus,
    VehicleView,
)

START, ALTITUDE, ROUTE_S = (1.0, 2.0), 10.0, 30.0
CONFIG = MissionConfig()
STD_M = 0.45
TASK = Task(CONFIG, START, ALTITUDE, ROUTE_S, ALTITUDE, STD_M)
WAITING = [state for state in State if state not in TERMINAL]
READ = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0.0, "NAV_RCL_ACT": 2.0}


def standing(now_s: float = 0.0, **changes: object) -> VehicleView:
    """A PX4 that is ready, on the ground at the start."""
    view = VehicleView(
        heard=True,
        last_heard_s=now_s,
        heartbeat_s=now_s,
        autopilot=Autopilot.PX4,
        mode=FlightMode.LOITER,
        system_status=SystemStatus.STANDBY,
        landed=True,
        prearm_ok=True,
        r_m=np.array((*START, 0.0)),
        v_mps=np.zeros(3),
        position_time_s=now_s,
        parameters=READ,
    )
    return replace(view, **changes)


def flying(now_s: float, **changes: object) -> VehicleView:
    """The same in armed OFFBOARD at the flight altitude, at 3 m/s."""
    defaults = {
        "armed": True,
        "mode": FlightMode.OFFBOARD,
        "landed": False,
        "system_status": SystemStatus.ACTIVE,
        "r_m": np.array((*START, ALTITUDE)),
        "v_mps": np.array((3.0, 0.0, 0.0)),
    }
    return standing(now_s, **(defaults | changes))


class Run:
    """Steps one mission at 50 Hz of the run clock and keeps what it ordered."""

    def __init__(self) -> None:
        self.mission = Mission(CONFIG, START, ALTITUDE, ROUTE_S, position_std_m=STD_M)
        self.now_s = 0.0
        self.orders: list[Orders] = []

    def step(self, view: VehicleView, inputs: MissionInputs | None = None) -> Orders:
        self.orders.append(self.mission.step(self.now_s, view, inputs or MissionInputs()))
        self.now_s += 0.02
        return self.orders[-1]

    def until(self, state: State, view: object, inputs: MissionInputs | None = None, limit_s: float = 400.0) -> Orders:
        """Step with `view(now_s)` until `state`, at most `limit_s`."""
        for _ in range(round(limit_s / 0.02)):
            orders = self.step(view(self.now_s), inputs)  # type: ignore[operator]
            if orders.state is state:
                return orders
        raise AssertionError(f"never came to {state}, is in {self.mission.state}")

    @property
    def commands(self) -> list[object]:
        return [command for orders in self.orders for command in orders.commands]


def active(autopilot: Autopilot = Autopilot.PX4) -> Run:
    """A run that has just come to ACTIVE."""
    run = Run()
    run.until(State.REQUEST, lambda now: standing(now, autopilot=autopilot))
    if autopilot is Autopilot.ARDUPILOT:
        run.until(State.TAKEOFF, lambda now: flying(now, autopilot=autopilot, landed=True, r_m=np.array((*START, 0.0))))
        run.until(State.ACTIVE, lambda now: flying(now, autopilot=autopilot, v_mps=np.zeros(3)))
    else:
        run.until(State.ACTIVE, flying)
    return run


def random_situation(state: State, dice: random.Random) -> Situation:
    """Any situation of a state, likely or not."""
    now_s = dice.choice((0.1, 1.2, 3.0, 6.0, 21.0, 61.0, 95.0, 300.0))
    command = dice.choice((None, SetMode(FlightMode.OFFBOARD), SetMode(FlightMode.LAND), Arm(), TakeOff(ALTITUDE)))
    request = None
    if command is not None:
        request = Request(command, dice.randint(1, TRIES), now_s - dice.choice((0.1, 2.0)), True, dice.random() < 0.3)
    memory = Memory(
        state,
        entered_s=0.0,
        entry_speed_mps=3.0,
        entry_mode=dice.choice((FlightMode.LOITER, FlightMode.OFFBOARD)),
        mode_seen=dice.random() < 0.5,
        outcome=dice.choice((None, OutcomeName.FAILSAFE, OutcomeName.INTERRUPTED, OutcomeName.HELD)),
        request=request,
    )
    view = standing(
        now_s,
        heard=dice.random() < 0.7,
        autopilot=dice.choice(tuple(Autopilot)),
        armed=dice.random() < 0.6,
        mode=dice.choice((FlightMode.OFFBOARD, *FlightMode)),
        system_status=dice.choice((SystemStatus.ACTIVE, SystemStatus.CRITICAL)),
        landed=dice.choice((True, False, None)),
        prearm_ok=dice.random() < 0.7,
        r_m=np.array((*START, dice.choice((0.0, ALTITUDE)))),
        v_mps=np.array((dice.choice((0.0, 3.0)), 0.0, 0.0)),
        position_std_m=dice.choice((None, 0.4, 0.6)),
    )
    inputs = MissionInputs(dice.choice((0, 0, 0, 1, 2)), *(dice.random() < 0.2 for _ in range(3)))
    return Situation(now_s, view, inputs, TASK, memory)


def test_every_row_can_be_taken() -> None:
    dice = random.Random(1)
    taken = set()
    for _ in range(4000):
        for state in WAITING:
            situation = random_situation(state, dice)
            row = next((row for row in ROWS_OF[state] if row.guard(situation)), None)
            taken.add(row)
    assert [row for row in ROWS if row not in taken] == []


@pytest.mark.parametrize("state", WAITING)
def test_every_waiting_state_has_a_deadline_that_leads_out(state: State) -> None:
    limit_s = deadline_s(state, TASK, 3.0)
    assert isfinite(limit_s)
    dice = random.Random(2)
    for _ in range(300):
        situation = replace(random_situation(state, dice), now_s=limit_s + 1e-6)
        assert any(row.guard(situation) for row in ROWS_OF[state])


@pytest.mark.parametrize("height_m", [10.0, 120.0, 500.0])
def test_there_is_time_to_sink_from_any_height(height_m: float) -> None:
    """PX4's landing: 1.5 m/s down to 10 m, then slowing down to 0.7 m/s from 5 m on."""
    task = replace(TASK, altitude_m=10.0, highest_m=height_m)
    sinking_s = max(height_m - 10.0, 0.0) / 1.5 + 10.0 / 0.7
    assert deadline_s(State.LAND, task) > sinking_s + 0.5 * CONFIG.land_timeout_s
    assert deadline_s(State.WATCH, task) >= 3 * deadline_s(State.LAND, task)


def test_ends_are_ends() -> None:
    for state in TERMINAL:
        assert ROWS_OF[state] == ()
        assert deadline_s(state, TASK) == inf
    assert {row.next for row in ROWS} | {State.CONNECT} == set(State)
    assert [name for name, status in EXIT_STATUS.items() if status == 0] == [OutcomeName.LANDED]


modes = st.sampled_from([FlightMode.LOITER, FlightMode.OFFBOARD, FlightMode.OFFBOARD, *FlightMode])
scripts = st.lists(
    st.tuples(
        st.integers(1, 150),
        modes,
        st.booleans(),
        st.sampled_from((True, False, None)),
        st.sampled_from((SystemStatus.ACTIVE, SystemStatus.CRITICAL)),
        st.sampled_from((0.0, 3.0)),
        st.sampled_from((0, 0, 0, 1, 2)),
        st.booleans(),
        st.booleans(),
        st.sampled_from(tuple(AckResult)),
    ),
    max_size=12,
)


@settings(max_examples=150, deadline=None)
@given(scripts, st.sampled_from((Autopilot.PX4, Autopilot.ARDUPILOT)))
def test_nothing_forbidden_is_ever_ordered(script: list[tuple[object, ...]], autopilot: Autopilot) -> None:
    """Whatever the vehicle says: three tries at most, no mode asked again once shown, no plan sent but in armed OFFBOARD."""
    run = Run()
    run.until(State.REQUEST, lambda now: standing(now, autopilot=autopilot))
    stops = 0
    foreign = False
    seen_offboard = False
    for ticks, mode, armed, landed, status, speed, stop, finished, stale, result in script:
        stops = max(stops, int(stop))  # type: ignore[call-overload]
        for _ in range(int(ticks)):  # type: ignore[call-overload]
            view = standing(
                run.now_s,
                autopilot=autopilot,
                mode=mode,
                armed=armed,
                landed=landed,
                system_status=status,
                v_mps=np.array((speed, 0.0, 0.0)),
                acks=(CommandAck(AckOf.SET_MODE, result), CommandAck(AckOf.ARM, result)),
            )
            orders = run.step(view, MissionInputs(stops, bool(finished), bool(stale)))
            seen_offboard = seen_offboard or mode is FlightMode.OFFBOARD
            foreign = foreign or (mode is not FlightMode.OFFBOARD and (seen_offboard or mode is not FlightMode.LOITER))
            if foreign:
                assert SetMode(FlightMode.OFFBOARD) not in orders.commands
                assert not any(isinstance(command, Arm) for command in orders.commands)
            if orders.stream is Stream.TRACK:
                assert armed
                assert mode is FlightMode.OFFBOARD
            if orders.finished is not None:
                assert orders.stream is Stream.NONE
                assert orders.commands == ()
                assert orders.finished.reason
    for command in set(run.commands):
        assert isinstance(command, SetMode | Arm | TakeOff | ReadParameter)
        assert run.commands.count(command) <= TRIES


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_every_mission_ends(seed: int) -> None:
    """With a vehicle that does anything at all, changing its mind every 5 s, the deadlines add up to an end."""
    dice = random.Random(seed)
    mission = Mission(CONFIG, START, ALTITUDE, ROUTE_S, position_std_m=STD_M)
    longest_s = sum(deadline_s(state, TASK, 3.0) for state in WAITING) + 1.0
    now_s = 0.0
    while now_s < longest_s:
        if int(now_s / 0.1) % 50 == 0:
            choice = random_situation(State.ACTIVE, dice).view
        view = replace(choice, heard=True, heartbeat_s=now_s, position_time_s=now_s, last_heard_s=now_s)
        if mission.step(now_s, view, MissionInputs()).finished is not None:
            return
        now_s += 0.1
    raise AssertionError(f"still in {mission.state}")


def test_a_good_flight_asks_once_for_each_thing() -> None:
    run = active()
    orders = run.step(flying(run.now_s), MissionInputs(route_finished=True))
    assert (orders.state, orders.stream) == (State.LAND, Stream.BRAKE)
    down = {"mode": FlightMode.LAND, "v_mps": np.zeros(3)}
    assert run.step(flying(run.now_s, **down)).stream is Stream.NONE
    run.step(flying(run.now_s, **down, landed=True))
    done = run.until(State.DONE, lambda now: standing(now, mode=FlightMode.LAND))
    assert done.finished is not None
    assert (done.finished.outcome, done.finished.exit_status) == ("landed", 0)
    assert run.commands == [
        *(ReadParameter(name) for name in AUDITED),
        SetMode(FlightMode.OFFBOARD),
        SetMode(FlightMode.LAND),
    ]


def test_arming_waits_for_offboard_to_show() -> None:
    run = Run()
    run.until(State.REQUEST, standing)
    for _ in range(20):
        assert not any(isinstance(command, Arm) for command in run.step(standing(run.now_s)).commands)
    orders = run.step(standing(run.now_s, mode=FlightMode.OFFBOARD))
    assert orders.commands == (Arm(),)
    assert orders.stream is Stream.POSE


def test_prime_streams_the_pose_for_as_long_as_configured() -> None:
    run = Run()
    run.until(State.PRIME, standing)
    begun_s = run.now_s
    run.until(State.REQUEST, standing)
    assert run.now_s - begun_s == pytest.approx(CONFIG.prime_s, abs=0.03)
    assert {orders.stream for orders in run.orders if orders.state is State.PRIME} == {Stream.POSE}


def test_a_vehicle_elsewhere_is_refused_with_the_distance() -> None:
    run = Run()
    end = run.until(State.FAILED, lambda now: standing(now, r_m=np.array((START[0] + 7.0, START[1], 0.0))))
    assert end.finished is not None
    assert end.finished.outcome == "refused"
    assert "7.0 m from start_m" in end.finished.reason


def test_an_armed_vehicle_is_left_alone() -> None:
    run = Run()
    end = run.until(State.FAILED, flying)
    assert end.finished is not None
    assert end.finished.outcome == "refused"
    assert "armed already" in end.finished.reason


def test_no_vehicle_is_lost_after_the_connect_timeout() -> None:
    run = Run()
    end = run.until(State.FAILED, lambda _now: VehicleView())
    assert end.finished is not None
    assert (end.finished.outcome, end.finished.exit_status) == ("lost", 5)
    assert run.now_s == pytest.approx(CONFIG.connect_timeout_s, abs=0.1)


@pytest.mark.parametrize("autopilot", [Autopilot.PX4, Autopilot.ARDUPILOT])
def test_a_lost_plan_brakes_holds_and_lands_on_request(autopilot: Autopilot) -> None:
    run = active(autopilot)
    assert run.step(flying(run.now_s, autopilot=autopilot), MissionInputs(plan_stale=True)).stream is Stream.BRAKE
    still = {"autopilot": autopilot, "v_mps": np.zeros(3)}
    run.until(State.HOLD, lambda now: flying(now, **still))
    held_s = run.now_s
    while run.now_s - held_s < 0.8 * CONFIG.hold_s:
        assert run.step(flying(run.now_s, **still)).stream is Stream.HOLD
    orders = run.step(flying(run.now_s, **still), MissionInputs(stop_requests=1))
    assert (orders.state, orders.commands) == (State.LAND, (SetMode(FlightMode.LAND),))
    run.step(flying(run.now_s, **still, mode=FlightMode.LAND))
    end = run.until(State.DONE, lambda now: standing(now, autopilot=autopilot, mode=FlightMode.LAND))
    assert end.finished is not None
    assert (end.finished.outcome, end.finished.exit_status) == ("held", 6)
    assert "no checked plan" in end.finished.reason


def test_a_lost_plan_that_nobody_asks_about_lands_when_the_hold_is_over() -> None:
    run = active()
    run.step(flying(run.now_s), MissionInputs(plan_stale=True))
    run.until(State.HOLD, lambda now: flying(now, v_mps=np.zeros(3)))
    held_s = run.now_s
    run.until(State.LAND, lambda now: flying(now, v_mps=np.zeros(3)))
    assert run.now_s - held_s == pytest.approx(CONFIG.hold_s, abs=0.1)


def test_a_vehicle_that_is_lost_lands_as_soon_as_it_has_stopped() -> None:
    """It would drift while it waits; what said nothing of its accuracy, or says better, waits as ever."""
    run = active()
    run.step(flying(run.now_s, position_std_m=0.7))
    assert run.mission.state is State.ACTIVE  # slowing down is the tracker's
    run.step(flying(run.now_s, position_std_m=0.7), MissionInputs(plan_stale=True))
    assert run.mission.state is State.BRAKE
    still = {"v_mps": np.zeros(3), "position_std_m": 0.8}
    run.until(State.HOLD, lambda now: flying(now, **still))
    orders = run.step(flying(run.now_s, **still))
    assert (orders.state, orders.commands) == (State.LAND, (SetMode(FlightMode.LAND),))
    end = run.until(State.DONE, lambda now: standing(now, mode=FlightMode.LAND, position_std_m=5.0))
    assert end.finished is not None
    assert (end.finished.outcome, end.finished.exit_status) == ("held", 6)
    assert "0.7 m (one standard deviation), allowed are 0.45 m (assurance.position_std_m)" in end.finished.reason


def test_a_held_vehicle_that_gets_lost_waits_no_longer() -> None:
    run = active()
    run.step(flying(run.now_s), MissionInputs(plan_stale=True))
    run.until(State.HOLD, lambda now: flying(now, v_mps=np.zeros(3), position_std_m=0.4))
    for _ in range(50):
        run.step(flying(run.now_s, v_mps=np.zeros(3), position_std_m=0.4))
    assert run.mission.state is State.HOLD
    assert run.step(flying(run.now_s, v_mps=np.zeros(3), position_std_m=0.46)).state is State.LAND


def test_a_vehicle_that_does_not_know_where_it_stands_does_not_arm() -> None:
    run = Run()
    orders = run.until(State.FAILED, lambda now: standing(now, position_std_m=1.25))
    assert orders.finished is not None
    assert orders.finished.outcome == "refused"
    assert "1.25 m (one standard deviation), allowed are 0.45 m (assurance.position_std_m)" in orders.finished.reason
    waiting = Run()
    waiting.until(State.REQUEST, lambda now: standing(now, position_std_m=1.25 if now < 10.0 else 0.45))
    assert waiting.now_s > 10.0


def test_a_stop_on_request_holds_only_for_as_long_as_it_primes() -> None:
    run = active()
    run.step(flying(run.now_s), MissionInputs(stop_requests=1))
    asked = MissionInputs(stop_requests=1)
    run.until(State.HOLD, lambda now: flying(now, v_mps=np.zeros(3)), asked)
    held_s = run.now_s
    run.until(State.LAND, lambda now: flying(now, v_mps=np.zeros(3)), asked)
    assert run.now_s - held_s == pytest.approx(CONFIG.prime_s, abs=0.1)


def test_ardupilot_takes_off_by_command_and_sees_no_setpoint_meanwhile() -> None:
    run = active(Autopilot.ARDUPILOT)
    climbing = [orders for orders in run.orders if orders.state is State.TAKEOFF]
    assert {orders.stream for orders in climbing} == {Stream.NONE}
    assert TakeOff(ALTITUDE) in run.commands
    assert not any(isinstance(command, ReadParameter) for command in run.commands)


def test_a_second_stop_lands_at_once() -> None:
    run = active()
    assert run.step(flying(run.now_s), MissionInputs(stop_requests=1)).state is State.BRAKE
    orders = run.step(flying(run.now_s), MissionInputs(stop_requests=2))
    assert (orders.state, orders.commands) == (State.LAND, (SetMode(FlightMode.LAND),))


def test_a_failsafe_that_hovers_is_reported_as_held() -> None:
    run = active()
    hover = {"mode": FlightMode.LOITER, "v_mps": np.zeros(3)}
    run.step(flying(run.now_s, **hover, system_status=SystemStatus.CRITICAL))
    end = run.until(State.FAILED, lambda now: flying(now, **hover))
    assert end.finished is not None
    assert end.finished.outcome == "held"


def test_a_reason_carries_what_the_autopilot_said() -> None:
    run = Run()
    run.until(State.REQUEST, standing)
    offboard = {"mode": FlightMode.OFFBOARD, "parameters": READ}
    run.step(standing(run.now_s, **offboard))
    refused = CommandAck(AckOf.ARM, AckResult.TEMPORARILY_REJECTED)
    text = StatusText(2, "Arming denied: compass")
    end = run.until(State.FAILED, lambda now: standing(now, **offboard, acks=(refused,), status_texts=(text,)))
    assert end.finished is not None
    assert end.finished.outcome == "refused"
    assert "arm temporarily rejected" in end.finished.reason
    assert "Arming denied: compass" in end.finished.reason
    assert run.commands.count(Arm()) == TRIES


def test_audit_warns_of_parameters_that_let_the_vehicle_fall() -> None:
    assert audit(READ) == ("COM_OF_LOSS_T = 1 s", "COM_OBL_RC_ACT = 0 (Position)", "NAV_RCL_ACT = 2 (Return)")
    lines = audit({"COM_OF_LOSS_T": 60.0, "COM_OBL_RC_ACT": 7.0})
    assert "set it between" in lines[0]
    assert "would fall" in lines[1]
    assert "was not answered" in lines[2]
