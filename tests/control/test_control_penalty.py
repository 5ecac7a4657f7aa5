"""The penalty at the flight's bandwidth and limits: nothing where a hard answer exists, the least where none does."""

from functools import cache

import numpy as np
import pytest

from sandwich_sitl.bench import ticks
from sandwich_sitl.control.horizon import FREE, SOLVED, Horizon, HorizonAnswer, HorizonTick, MotionLimits
from sandwich_sitl.control.solvers.piqp_sparse import PiqpSolver
from sandwich_sitl.control.solvers.registry import bare_solver

from .problems import FLIGHT, FLIGHT_N, STEP_S, corridor_problem, flight_horizon, least_penalty, room, turned_box

ROOM = 1e-3  # metres and shares of the limits: with less the multipliers grow beyond any penalty
SEEDS = (*range(70), 104, 239, 582, 773, 1209, 1231)  # the last ones push so hard that a rho_1 of 2 would give way
MARGIN = 0.3  # what the least penalty may be passed by for a cheaper plan: 15 mm outside for one step


@cache
def corridor_ticks() -> tuple[tuple[HorizonTick, float], ...]:
    """Ticks with the room that their rows leave."""
    return tuple((tick, room(tick, FLIGHT)) for tick in map(corridor_problem, SEEDS))


def box_at_rest(outside_m: float) -> HorizonTick:
    """Standing in the middle of a box of 1 m to each side, asked to a place `outside_m` beyond its side."""
    n = FLIGHT_N
    sides = np.repeat(turned_box(0.0)[:1], n, axis=0)
    return HorizonTick(np.zeros((4, 2)), np.tile([1.0 + outside_m, 0.0], (n, 1)), sides, np.ones((n, 4)))


def penalty(horizon: Horizon, answer: HorizonAnswer) -> float:
    values = np.stack([answer.slack_m, answer.excess])
    return float((horizon.penalties * np.column_stack([values.sum(axis=1), (values**2).sum(axis=1) / 2])).sum())


@pytest.mark.parametrize("name", ["active_set", "osqp"])
def test_a_tick_in_flight_that_has_a_hard_answer_keeps_every_row(name: str) -> None:
    """Desired positions inside their regions, a start from which another solver finds a millimetre of room."""
    solver, binding = bare_solver(name, flight_horizon()), 0
    for tick, left in corridor_ticks():
        if left < ROOM:
            continue
        answer = solver.solve(tick)
        binding += answer.status != FREE
        assert max(answer.slack_m.max(), answer.excess.max()) < 1e-6
    assert binding > 20


@pytest.mark.parametrize("name", ["active_set", "osqp"])
def test_a_tick_without_a_hard_answer_gets_the_least_penalty(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against the least of the penalties alone, by another solver on another statement of the rows."""
    asked: list[int] = []
    interior_point = PiqpSolver.solve
    monkeypatch.setattr(PiqpSolver, "solve", lambda self, tick: (asked.append(1), interior_point(self, tick))[1])
    horizon = flight_horizon()
    solver = bare_solver(name, horizon)
    pushed = list(ticks.pushed_out(ticks.narrow(ticks.stored()[1])).problems(FLIGHT_N, STEP_S))[:40:4]
    hopeless = [tick for tick, left in corridor_ticks() if left < -ROOM]
    assert len(hopeless) > 20
    for tick in (*hopeless, *pushed):
        answer, least = solver.solve(tick), least_penalty(tick, FLIGHT)
        assert answer.status == SOLVED
        assert least - 1e-3 < penalty(horizon, answer) < least + MARGIN
        weaker = horizon.answer_of_snap(0.8 * answer.snap, tick, SOLVED, 0)
        assert penalty(horizon, weaker) > least + MARGIN
    assert bool(asked) == (name == "osqp")


def test_the_penalty_is_exact_until_the_desired_position_lies_metres_outside() -> None:
    """As the module `horizon` says."""
    solver = bare_solver("active_set", Horizon(FLIGHT_N, STEP_S, "zoh", 8.0, 2, 4, FLIGHT))
    slack = {d: 1e3 * solver.solve(box_at_rest(d)).slack_m.max() for d in (1.0, 2.0, 4.0, 5.0, 10.0, 25.0)}
    assert max(slack[d] for d in (1.0, 2.0, 4.0)) < 1e-3
    assert [slack[d] for d in (5.0, 10.0, 25.0)] == pytest.approx([7, 11, 211], abs=1)


@pytest.mark.parametrize("name", ["active_set", "osqp", "piqp"])
@pytest.mark.parametrize("outside_m", [1.0, 1.5])
def test_the_height_keeps_its_band_at_twenty_times_the_weight(name: str, outside_m: float) -> None:
    n = FLIGHT_N
    horizon = Horizon(n, STEP_S, "zoh", 8.0, 1, 2, MotionLimits(3.0, 6.0, 40.0, 600.0), 20.0)
    up_down = np.tile([[1.0], [-1.0]], (n, 1, 1))
    tick = HorizonTick(np.zeros((4, 1)), np.full((n, 1), 1.0 + outside_m), up_down, np.ones((n, 2)))
    answer = bare_solver(name, horizon).solve(tick)
    assert max(answer.slack_m.max(), answer.excess.max()) < 1e-6
    assert answer.motion[0, -1, 0] == pytest.approx(1.0, abs=1e-3)
