"""The ladder: what a stop is, what is refused, and that there is always something safe to fly on."""

import numpy as np
import pytest

from sandwich_sitl.control.assurance import GRID_S, Bounds, Fault, Rung, comes_back, describe, examine, outside
from sandwich_sitl.control.horizon import Horizon, HorizonAnswer, HorizonTick
from sandwich_sitl.control.mpc import Mpc
from sandwich_sitl.control.solvers.active_set import ActiveSetSolver
from sandwich_sitl.control.stop_plan import StopPlan, stop_along
from sandwich_sitl.control.tracker import Tick, Tracker
from sandwich_sitl.planning.corridor import FACES

from .flights import DT, boxes, failing_when, flight, mpc_of, run_config

RNG = np.random.default_rng(4)
STEP_S = 0.1


def random_plan(n: int = 20, speed: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    """Knots (n + 1, 12) and snap (n, 3) of a motion of the plant model."""
    x = np.concatenate([RNG.normal(0, 1, 3), RNG.normal(0, speed, 3), RNG.normal(0, 1, 6)])
    snap, knots = RNG.normal(0, 10, (n, 3)), [x]
    for u in snap:
        r, v, a, j = knots[-1].reshape(4, 3)
        h = STEP_S
        knots.append(
            np.concatenate([
                r + h * v + h**2 / 2 * a + h**3 / 6 * j + h**4 / 24 * u,
                v + h * a + h**2 / 2 * j + h**3 / 6 * u,
                a + h * j + h**2 / 2 * u,
                j + h * u,
            ])
        )  # fmt: skip
    return np.array(knots), snap


def test_a_stop_begins_as_the_plan_and_ends_at_rest_on_its_path() -> None:
    for _ in range(20):
        knots, snap = random_plan()
        start = 0.02
        stop = StopPlan(knots, snap, STEP_S, start, 1.5)
        begin, end = stop.states(np.array([0.0, 1.5]))
        plan = StopPlan(knots, snap, STEP_S, 0.0, 1e9)  # never slows down
        np.testing.assert_allclose(begin, plan.states(np.array([start]))[0], atol=1e-6)
        np.testing.assert_allclose(end[3:], 0.0, atol=1e-9)
        np.testing.assert_allclose(stop.states(np.array([99.0]))[0], end, atol=1e-12)
        # Every place of the stop is a place of the plan, at the time that `progress` says.
        times = np.linspace(0, 1.5, 40)
        np.testing.assert_allclose(
            stop.states(times)[:, :3], plan.states(start + stop.progress(times)[0])[:, :3], atol=1e-6
        )


def test_derivatives_of_a_stop_are_those_of_its_positions() -> None:
    knots, snap = random_plan()
    stop, h = StopPlan(knots, snap, STEP_S, 0.02, 1.7), 1e-5
    times = RNG.uniform(0.01, 1.69, 50)
    early, here, late = (stop.states(times + shift) for shift in (-h, 0.0, h))
    slope = (late - early) / (2 * h)
    np.testing.assert_allclose(slope[:, :9], here[:, 3:], rtol=1e-4, atol=2e-3)
    rate = (stop.progress(times + h)[0] - stop.progress(times - h)[0]) / (2 * h)
    np.testing.assert_allclose(stop.progress(times)[1], rate, atol=1e-6)


def test_a_stop_takes_the_time_that_braking_needs_and_no_more_than_the_plan_has() -> None:
    knots, snap = np.zeros((21, 12)), np.zeros((20, 3))
    knots[:, 3] = 3.0
    knots[:, 0] = 0.3 * np.arange(21)
    stop = stop_along(knots, snap, STEP_S, 0.02, 3.0)
    states = stop.states(np.linspace(0, stop.stop_s, 2000))
    assert np.abs(states[:, 6]).max() == pytest.approx(3.0, rel=1e-3)
    knots[:, 3] = 30.0
    assert stop_along(knots, snap, STEP_S, 0.02, 3.0).stop_s == pytest.approx(2 * (2.0 - 0.02))


BOUNDS = Bounds(np.array([10.0, 3.5, 10.0, 7.0, 75.0]), 1.0, 0.02)


def straight(speed: float = 1.0, m: int = 60) -> np.ndarray:
    states = np.zeros((m, 12))
    states[:, 0] = speed * GRID_S * np.arange(m)
    states[:, 3] = speed
    return states


def test_each_fault_is_found_and_a_good_plan_has_none() -> None:
    xyz = np.column_stack([np.linspace(-0.5, 2.0, 50), np.zeros((50, 2))])
    corridor = boxes(xyz, np.zeros(50, np.int64), 0.3)
    region, still = np.zeros(60, np.int64), np.zeros(3)

    def verdict(states: np.ndarray, offset: np.ndarray = still) -> Fault:
        return examine(states, offset, np.zeros(60), corridor.Lambda, corridor.Gamma, region, BOUNDS)

    assert verdict(straight()) is Fault.NONE
    broken = straight()
    broken[7, 10] = np.nan
    assert verdict(broken) is Fault.NOT_FINITE
    for axis in range(3):
        assert verdict(straight(), np.where(np.arange(3) == axis, np.nan, 0.0)) is Fault.NOT_FINITE
    for unknown in (np.nan, np.inf, -np.inf):
        Gamma = np.full_like(corridor.Gamma, unknown)
        said = examine(straight(), still, np.zeros(60), corridor.Lambda, Gamma, region, BOUNDS)
        assert said is Fault.NOT_FINITE
    for column, value in ((3, 11.0), (5, 4.0), (7, 11.0), (8, 8.0), (9, 80.0)):
        fast = straight()
        fast[30, column] = value
        assert verdict(fast) is Fault.LIMITS
    assert verdict(straight(3.0)) is Fault.REGION
    leaving = straight()
    leaving[:, 1] = np.linspace(0.29, 0.35, 60)
    assert verdict(leaving) is Fault.REGION
    sinking = straight()
    sinking[:, 2] = np.linspace(0.0, -1.1, 60)
    assert verdict(sinking) is Fault.REGION


@pytest.mark.parametrize(
    ("outside_m", "accepted"),
    [
        (np.full(60, 0.015), True),
        (np.linspace(0.3, 0.0, 60), True),
        (np.linspace(0.3, 0.14, 60), True),
        (np.linspace(0.3, 0.16, 60), False),  # it would rest there
        (np.full(60, 1.0), False),
        (np.concatenate([np.linspace(0.3, -0.1, 30), np.linspace(-0.1, 0.1, 30)]), False),  # in and out again
        (np.concatenate([np.linspace(0.3, 0.35, 5), np.linspace(0.35, 0.0, 55)]), False),  # further out first
        (np.linspace(-0.1, 0.1, 60), False),
    ],
)
def test_what_begins_outside_may_only_come_back(outside_m: np.ndarray, accepted: bool) -> None:
    assert comes_back(outside_m, 0.02) is accepted


def test_altitudes_of_regions_are_kept_too() -> None:
    """Rising from a region of 4 m to 6 m into one of 5 m to 8 m: the change must lie where both are."""
    xyz = np.column_stack([np.linspace(-1.0, 3.0, 50), np.zeros((50, 2))])
    corridor = boxes(xyz, np.repeat([0, 1], 25), 0.5)
    z_m = np.array([[4.0, 6.0], [5.0, 8.0]])
    states, region = straight(m=80), np.repeat([0, 1], 40)

    def verdict(heights: np.ndarray) -> Fault:
        states[:, 2] = heights
        return examine(states, np.zeros(3), heights, corridor.Lambda, corridor.Gamma, region, BOUNDS, z_m)

    assert verdict(np.linspace(5.2, 7.0, 80)) is Fault.REGION  # 6.1 m at the change
    assert verdict(np.linspace(4.1, 6.9, 80)) is Fault.NONE
    assert verdict(np.linspace(4.1, 5.4, 80)) is Fault.REGION  # 4.7 m at the change
    assert verdict(np.linspace(5.5, 8.1, 80)) is Fault.REGION
    assert verdict(np.linspace(3.9, 6.1, 80)) is Fault.NONE  # from below
    assert verdict(np.where(np.arange(80) == 20, 3.9, 5.5)) is Fault.REGION


def test_a_corner_cut_between_two_grid_points_is_seen() -> None:
    """Two regions that touch in an L: each end of a chord lies in its own region, the chord in neither."""
    Lambda = np.tile(np.array([[1.0, 0], [0, 1.0], [-1.0, 0], [0, -1.0]]), (2, 1, 1))
    Gamma = np.array([[1.0, 0.2, 0.0, 0.0], [1.2, 1.0, -1.0, 0.0]])  # [0, 1] x [0, 0.2] and [1, 1.2] x [0, 1]
    points = np.array([[0.8, 0.1], [1.1, 0.6]])
    kept = np.array([[0.8, 0.1], [1.0, 0.1], [1.1, 0.6]])
    assert outside(points, Lambda, Gamma, np.array([0, 1])).max() > 0.1
    assert outside(kept, Lambda, Gamma, np.array([0, 1, 1])).max() < 1e-9


def ladder(broken: object, ticks: int) -> tuple[list[Tick], Tracker]:
    """Ticks of a tracker with an exact plant and a solver that fails when `broken(k)`."""
    reference, corridor = flight()
    config = run_config()
    mpc = Mpc(config.mpc, config.mode, FACES, failing_when(broken))  # type: ignore[arg-type]
    tracker = Tracker(config, mpc, reference, corridor, reference.xyz_m[0])
    state, flown = np.concatenate([reference.xyz_m[0], np.zeros(9)]), []
    for k in range(ticks):
        flown.append(tracker.tick(k * DT, state[:3], state[3:6], 0.0))
        state = flown[-1].setpoint
    return flown, tracker


def test_a_solver_that_fails_for_good_ends_in_a_stop_inside_the_regions_and_then_in_braking() -> None:
    k_fail = 300
    ticks, tracker = ladder(lambda k: k >= k_fail, 600)
    rungs = np.array([tick.rung for tick in ticks])
    assert (rungs[:k_fail] == Rung.PLAN).all()
    brake_from = int(np.argmax(rungs == Rung.BRAKE))
    assert brake_from > k_fail
    assert (rungs[k_fail:brake_from] == Rung.SHIFTED).all()
    assert (rungs[brake_from:] == Rung.BRAKE).all()
    assert {tick.fault for tick in ticks[k_fail:]} == {Fault.SOLVER}
    states = np.array([tick.setpoint for tick in ticks])
    assert np.linalg.norm(states[k_fail - 1, 3:6]) > 2.0
    np.testing.assert_allclose(states[brake_from, 3:], 0.0, atol=1e-9)
    jumps = states[1:, :3] - states[:-1, :3] - DT * states[:-1, 3:6] - DT**2 / 2 * states[:-1, 6:9]
    assert np.abs(jumps).max() < 1e-4  # one smooth motion through every rung
    braking = np.linalg.norm(states[k_fail:brake_from, 6:8], axis=1)
    assert braking.max() < 1.3 * run_config().mission.brake_mps2
    reference, corridor = flight()
    for tick in ticks:
        excess = corridor.Lambda[tick.region] @ tick.setpoint[:2] - corridor.Gamma[tick.region]
        assert excess.max() < BOUNDS.region_tolerance_m
    assert tracker.clock.t_s < reference.t_s[-1]


class Raising:
    """A solver that raises in the middle of a flight."""

    def __init__(self, error: Exception, horizon: Horizon) -> None:
        self._solver, self._error, self._asked = ActiveSetSolver(horizon), error, 0

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        self._asked += 1
        if self._asked > 250:
            raise self._error
        return self._solver.solve(tick)


@pytest.mark.parametrize("error", [ValueError("arrays do not fit"), IndexError("arrays do not fit"), Exception("no")])
def test_a_solver_that_raises_is_a_fault_like_any_other_and_its_words_are_kept(error: Exception) -> None:
    reference, corridor = flight()
    config = run_config()
    raising = Mpc(config.mpc, config.mode, FACES, lambda _, horizon: Raising(error, horizon))
    tracker = Tracker(config, raising, reference, corridor, reference.xyz_m[0])
    state, ticks = np.concatenate([reference.xyz_m[0], np.zeros(9)]), []
    for k in range(500):
        ticks.append(tracker.tick(k * DT, state[:3], state[3:6], 0.0))
        state = ticks[-1].setpoint
    assert {tick.fault for tick in ticks[:250]} == {Fault.NONE}
    assert {tick.fault for tick in ticks[250:]} == {Fault.RAISED}
    assert ticks[250].rung is Rung.SHIFTED
    assert ticks[-1].rung is Rung.BRAKE
    assert f"{type(error).__name__}: {error}" in describe(ticks[250].rung, ticks[250].fault, ticks[250].error)
    assert np.linalg.norm(state[3:6]) < 1e-9


def test_a_solver_that_comes_back_is_flown_again_and_the_route_is_finished() -> None:
    ticks, tracker = ladder(lambda k: 200 <= k < 260 or k % 97 == 5 or 400 <= k < 470, 1200)
    rungs = [tick.rung for tick in ticks]
    assert Rung.BRAKE not in rungs
    assert rungs.count(Rung.SHIFTED) >= 130
    assert rungs[-1] is Rung.PLAN
    assert tracker.finished
    states = np.array([tick.setpoint for tick in ticks])
    np.testing.assert_allclose(states[-1, :3], flight()[0].xyz_m[-1], atol=0.01)
    rates = np.array([tick.rate for tick in ticks])
    assert rates.min() < 0.7
    assert rates[-1] == 1.0
    jumps = states[1:, :3] - states[:-1, :3] - DT * states[:-1, 3:6] - DT**2 / 2 * states[:-1, 6:9]
    assert np.abs(jumps).max() < 1e-4


@pytest.mark.parametrize("outage", [60, 80, 95])
def test_the_first_plan_after_an_outage_is_accepted_however_slow_the_vehicle_has_become(outage: int) -> None:
    """The stop takes 98 ticks. The reference goes on from rest no faster than a plan can follow it."""
    ticks, tracker = ladder(lambda k: 250 <= k < 250 + outage, 1100)
    rungs = np.array([tick.rung for tick in ticks])
    assert (rungs[250 : 250 + outage] == Rung.SHIFTED).all()
    assert (rungs[:250] == Rung.PLAN).all()
    assert (rungs[250 + outage :] == Rung.PLAN).all()
    assert tracker.finished
    aside = [np.linalg.norm(tick.setpoint[:3] - tick.desired_m) for tick in ticks]
    assert max(aside) < 0.3


def test_without_any_plan_the_vehicle_stands_still_and_then_brakes() -> None:
    """Before the first plan the plan in force is to stay; it is not stayed with for ever."""
    ticks, _ = ladder(lambda _: True, 60)
    rungs = [tick.rung for tick in ticks]
    last = rungs.index(Rung.BRAKE)
    assert set(rungs[:last]) == {Rung.SHIFTED}
    assert set(rungs[last:]) == {Rung.BRAKE}
    assert 0.7 < last * DT < 1.0
    for tick in ticks[:last]:
        np.testing.assert_array_equal(tick.setpoint, ticks[0].setpoint)


def test_a_blind_tracker_slows_down() -> None:
    reference, corridor = flight()
    config = run_config()
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    state = np.concatenate([reference.xyz_m[0], np.zeros(9)])
    for k in range(400):
        seen = state[:3] if k < 250 else np.full(3, np.nan)
        tick = tracker.tick(k * DT, seen, state[3:6], 0.0)
        state = tick.setpoint
        assert (tick.rung, tick.fault) == ((Rung.PLAN, Fault.NONE) if k < 250 else (tick.rung, Fault.BLIND))
        assert (tick.rung is Rung.PLAN) == (k < 250)
    assert np.linalg.norm(state[3:]) < 1e-9


def test_a_vehicle_that_does_not_know_where_it_is_stops_along_its_plan_and_goes_on_when_it_does() -> None:
    reference, corridor = flight()
    config = run_config()
    for back, ends_at_rest in ((270, False), (10**6, True)):
        tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
        state, ticks = np.concatenate([reference.xyz_m[0], np.zeros(9)]), []
        for k in range(500):
            tracker.is_uncertain = 250 <= k < back
            ticks.append(tracker.tick(k * DT, state[:3], state[3:6], 0.0))
            state = ticks[-1].setpoint
        faults = {tick.fault for tick in ticks[250 : min(back, 500)]}
        assert faults == {Fault.UNCERTAIN}
        assert ticks[250].rung is Rung.SHIFTED
        assert "no longer knows its position" in describe(Rung.SHIFTED, Fault.UNCERTAIN)
        assert ticks[-1].rung is (Rung.BRAKE if ends_at_rest else Rung.PLAN)
        assert (np.linalg.norm(state[3:6]) < 1e-9) == ends_at_rest
        states = np.array([tick.setpoint for tick in ticks])
        jumps = states[1:, :3] - states[:-1, :3] - DT * states[:-1, 3:6] - DT**2 / 2 * states[:-1, 6:9]
        assert np.abs(jumps).max() < 1e-4
    tracker.is_uncertain = tracker.stops = True
    assert tracker.tick(500 * DT, state[:3], state[3:6], 0.0).fault is Fault.STOP


def test_a_region_that_closes_stops_the_vehicle_before_it() -> None:
    """Regions after the sixth are walled off: no plan through them is accepted, and the command rests before the wall."""
    reference, corridor = flight()
    wall = float(reference.xyz_m[np.argmax(reference.region == 6), 0])
    corridor.Gamma[6:, 0] = wall  # x <= wall, in every later region
    config = run_config()
    tracker = Tracker(config, mpc_of(config), reference, corridor, reference.xyz_m[0])
    state, faults = np.concatenate([reference.xyz_m[0], np.zeros(9)]), set()
    for k in range(900):
        tick = tracker.tick(k * DT, state[:3], state[3:6], 0.0)
        state = tick.setpoint
        faults.add(tick.fault)
        assert state[0] <= wall + config.assurance.region_tolerance_m
    assert Fault.REGION in faults or Fault.LIMITS in faults
    assert np.linalg.norm(state[3:6]) < 0.05
