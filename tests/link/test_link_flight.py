"""The mission over a real socket against the scripted autopilot: the whole of link and mission, without a plan."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from fake_autopilot import Behaviour, FakeAutopilot, free_port

from sandwich_sitl.config import ClockConfig, LinkConfig, MissionConfig
from sandwich_sitl.errors import LinkError
from sandwich_sitl.link.guard import fence_around
from sandwich_sitl.link.session import LinkSession, LinkStatistics
from sandwich_sitl.mission.brake import BrakeProfile
from sandwich_sitl.mission.machine import Mission
from sandwich_sitl.mission.orders import MissionInputs, Orders, State, Stream
from sandwich_sitl.mission.setpoint import Setpoint
from sandwich_sitl.mission.vehicle_view import FlightMode, VehicleView

START = (5.0, 7.0)
ALTITUDE = 2.0
PERIOD = 0.02


@dataclass
class Flight:
    orders: Orders
    states: list[State]
    frames: list[tuple[float, str, bytes]]
    log: list[str]
    view: VehicleView
    statistics: LinkStatistics
    modes: list[FlightMode] = field(default_factory=list)


def fly(
    behaviour: Behaviour | None = None,
    mode: str = "lockstep",
    climb_s: float = 1.0,
    stop_at_s: float | None = None,
    stale_at_s: float | None = None,
) -> tuple[Flight, FakeAutopilot]:
    port = free_port()
    frames: list[tuple[float, str, bytes]] = []
    states: list[State] = []
    log: list[str] = []
    config = MissionConfig(connect_timeout_s=5.0, ready_timeout_s=5.0, land_timeout_s=10.0)
    mission = Mission(config, START, ALTITUDE, route_s=climb_s)
    fence = fence_around((0.0, 0.0, 10.0, 10.0), ALTITUDE, speed_mps=3.0, acceleration_mps2=3.0)
    ground, up = np.array((*START, 0.0)), np.array((0.0, 0.0, 1.0))
    active_s, hold = None, None
    with (
        LinkSession(
            LinkConfig(uri=f"udpin://127.0.0.1:{port}"),
            ClockConfig(mode=mode),
            PERIOD,
            START,
            lambda t, way, raw: frames.append((t, way, raw)),
            fence=fence,
        ) as session,
        FakeAutopilot(("127.0.0.1", port), behaviour or Behaviour(), mode == "lockstep") as vehicle,
    ):
        for _ in range(5000):
            now = session.next_tick()
            view = session.view
            climbed = active_s is not None and now - active_s >= climb_s
            stale = stale_at_s is not None and now >= stale_at_s
            stops = int(stop_at_s is not None and now >= stop_at_s)
            orders = mission.step(now, view, MissionInputs(stops, climbed, stale))
            if not states or states[-1] is not orders.state:
                states.append(orders.state)
            log += orders.log
            setpoint = None
            if orders.stream is Stream.POSE:
                setpoint = Setpoint(view.r_m, np.zeros(3), None, 0.0)
            elif orders.stream is Stream.TRACK:
                active_s = active_s if active_s is not None else now
                height = min(1.0, (now - active_s) / climb_s) * ALTITUDE
                rate = ALTITUDE / climb_s if height < ALTITUDE else 0.0
                setpoint = Setpoint(ground + height * up, rate * up, np.zeros(3), 0.0)
            elif orders.stream in (Stream.BRAKE, Stream.HOLD):
                hold = hold or (now, BrakeProfile(view.r_m, view.v_mps, config.brake_mps2))
                setpoint = Setpoint(*hold[1].at(now - hold[0]), 0.0)
            assert session.send(setpoint, orders.commands) is None
            if orders.finished is not None:
                break
        return Flight(orders, states, frames, log, view, session.statistics), vehicle


def test_lockstep_flight_lands_and_leaves_no_gap() -> None:
    flight, vehicle = fly()
    assert flight.orders.finished is not None
    assert (flight.orders.finished.outcome, flight.orders.finished.exit_status) == ("landed", 0)
    assert [state.value for state in flight.states] == ["READY", "PRIME", "REQUEST", "ACTIVE", "LAND", "DONE"]
    assert flight.statistics.lost == 0
    assert not vehicle.armed
    assert any(line.startswith("NAV_RCL_ACT = 2 (Return)") for line in flight.log)
    sequence = [raw[4] for _, way, raw in flight.frames if way == "tx"]
    assert all((b - a) % 256 == 1 for a, b in pairwise(sequence))
    stamps = [t for t, _, _ in flight.frames]
    assert stamps == sorted(stamps)


def test_lockstep_bytes_do_not_depend_on_the_wall_clock() -> None:
    first, _ = fly()
    second, _ = fly(Behaviour(drop_answers=frozenset({3, 40})))
    assert first.frames == second.frames
    assert second.statistics.retries >= 2
    assert first.statistics.retries == 0 or first.statistics.retries < second.statistics.retries


def test_timesync_is_answered_with_the_run_clock() -> None:
    _, vehicle = fly()
    answers = [message for message in vehicle.log if message.get_type() == "TIMESYNC"]
    assert answers
    assert all(message.tc1 == message.ts1 - 1 for message in answers)


def test_realtime_flight_lands() -> None:
    flight, _ = fly(Behaviour(), "realtime")
    assert flight.orders.finished is not None
    assert flight.orders.finished.outcome == "landed"
    assert flight.view.position_time_s == pytest.approx(flight.view.last_heard_s, abs=0.1)


def test_pilot_takes_over_and_nothing_is_asked_again() -> None:
    flight, vehicle = fly(Behaviour(pilot_takes_over_ms=2600), climb_s=5.0)
    assert flight.orders.finished is not None
    assert flight.orders.finished.outcome == "taken_over"
    assert "position" in flight.orders.finished.reason
    modes = [m for m in vehicle.log if m.get_type() == "COMMAND_LONG" and m.command == 176]
    assert len(modes) == 1


def test_failsafe_is_watched_until_landed() -> None:
    flight, vehicle = fly(Behaviour(failsafe_ms=2600), climb_s=5.0)
    assert flight.orders.finished is not None
    assert flight.orders.finished.outcome == "failsafe"
    assert flight.states[-2:] == [State.WATCH, State.FAILED]
    assert not vehicle.armed


def test_refused_arming_is_tried_three_times_and_explained() -> None:
    flight, vehicle = fly(Behaviour(refuse_arming=True))
    assert flight.orders.finished is not None
    assert flight.orders.finished.outcome == "refused"
    assert "Arming denied: Resolve system health failures first, then try once again please" in (
        flight.orders.finished.reason
    )
    assert len([m for m in vehicle.log if m.get_type() == "COMMAND_LONG" and m.command == 400]) == 3


def test_never_ready_names_what_is_missing() -> None:
    flight, _ = fly(Behaviour(unready_ms=10**6))
    assert flight.orders.finished is not None
    assert flight.orders.finished.outcome == "refused"
    assert "pre-arm" in flight.orders.finished.reason


def test_stop_brakes_holds_and_lands() -> None:
    flight, _ = fly(stop_at_s=2.6, climb_s=5.0)
    assert flight.orders.finished is not None
    assert flight.orders.finished.outcome == "interrupted"
    assert [state.value for state in flight.states[-5:]] == ["ACTIVE", "BRAKE", "HOLD", "LAND", "DONE"]


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_silent_vehicle_is_lost(mode: str) -> None:
    with pytest.raises(LinkError, match=r"silent for 2 s; last heard at .* mode loiter, disarmed"):
        fly(Behaviour(silent_after_ms=100 if mode == "lockstep" else 3600), mode)


def test_vehicle_with_another_period_is_refused() -> None:
    with pytest.raises(LinkError, match="advanced 10 ms in one lockstep tick instead of 20 ms"):
        fly(Behaviour(step_ms=10))
