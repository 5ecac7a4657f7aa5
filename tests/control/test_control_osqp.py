"""OSQP's part and the kernel's part of the default solver, each tried without the other."""

from itertools import islice

import numpy as np
import pytest

from sandwich_sitl.bench import ticks
from sandwich_sitl.control.horizon import FAILED, SOLVED, Horizon, HorizonTick, MotionLimits
from sandwich_sitl.control.solvers import osqp_dual, working_set
from sandwich_sitl.control.solvers.active_set import ActiveSetSolver
from sandwich_sitl.control.solvers.osqp_dual import OsqpSolver
from sandwich_sitl.control.solvers.piqp_sparse import PiqpSolver

from .problems import horizon, inside_problem

PIQP_TOLERANCE = 1e-4


def binding(seed: int) -> HorizonTick:
    """A tick whose rows bind: its regions pulled in."""
    tick = inside_problem(seed)
    return HorizonTick(tick.state, tick.desired, tick.normals, 0.6 * tick.offsets)


def first_command_error(hz: Horizon, solver: OsqpSolver, tick: HorizonTick) -> float:
    best = ActiveSetSolver(hz).solve(tick).snap[0]
    return float(np.linalg.norm(solver.solve(tick).snap[0] - best) / max(1.0, np.linalg.norm(best)))


@pytest.mark.parametrize("slots", [(12, 24, 48), (2, 3, 4)], ids=["enough slots", "fewer slots than rows"])
def test_the_first_command_is_within_a_percent_of_the_optimum(
    slots: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(osqp_dual, "_SLOTS", slots)
    hz = horizon()
    solver = OsqpSolver(hz)
    for seed in range(40):
        assert first_command_error(hz, solver, binding(seed)) < 1e-4


def test_without_a_proof_piqp_is_asked_and_without_its_answer_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    hz, tick = horizon(), binding(3)
    solver, least = OsqpSolver(hz), hz.cost(ActiveSetSolver(hz).solve(tick).snap, tick)
    with monkeypatch.context() as patch:
        patch.setattr(working_set, "dual_active_set", lambda *_: (-1, 0))
        assert hz.cost(solver.solve(tick).snap, tick) <= least + PIQP_TOLERANCE * max(1.0, least)
        patch.setattr(PiqpSolver, "solve", lambda *_: hz.failed())
        assert solver.solve(tick).status == FAILED
    assert first_command_error(hz, solver, tick) < 1e-4


def test_ticks_that_no_plan_mends_get_the_least_violation_after_few_rounds() -> None:
    """Pushed 1.5 m out of narrow regions every fourth tick: the kernel would go on for ten rounds a step and more."""
    sequence = ticks.pushed_out(ticks.narrow(ticks.stored()[1]))
    hz = Horizon(20, 0.1, "zoh", 8.0, 2, 8, MotionLimits(12.0, 3.2, 40.0, 600.0))
    solver, exact = OsqpSolver(hz), ActiveSetSolver(hz)
    rounds, longest = [], 0
    for tick in islice(sequence.problems(20, 0.1), 60):
        answer, best = solver.solve(tick), exact.solve(tick)
        rounds.append(answer.iterations)
        longest = max(longest, best.iterations)
        least = hz.cost(best.snap, tick)
        assert hz.cost(answer.snap, tick) <= least + PIQP_TOLERANCE * max(1.0, least)
    assert longest > 4 * 20
    assert max(rounds) <= 2 * 20


@pytest.mark.parametrize("n_tau", range(4, 9))
def test_a_short_horizon_takes_more_rows_in_play_than_six_a_step(n_tau: int) -> None:
    """Fast starts outside of regions that point anywhere: up to nine rows a step are put in, and each tick is answered."""
    hz = Horizon(n_tau, 0.1, "zoh", 8.0, 2, 8, MotionLimits(12.0, 6.0, 40.0, 600.0))
    solver, reference, rng = OsqpSolver(hz), PiqpSolver(hz), np.random.default_rng(0)
    for k in range(400):
        angle = rng.uniform(0, 2 * np.pi, (n_tau, 8))
        state = rng.normal(0, 1, (4, 2)) * np.array([[3.0], [20.0], [15.0], [100.0]])
        tick = HorizonTick(
            state,
            rng.normal(0, 10, (n_tau, 2)),
            np.stack([np.cos(angle), np.sin(angle)], axis=2),
            rng.uniform(-1.0, 0.3, (n_tau, 8)),
        )
        answer = solver.solve(tick)
        assert answer.status == SOLVED
        if k % 10 == 0:
            least = hz.cost(reference.solve(tick).snap, tick)
            assert hz.cost(answer.snap, tick) <= least * (1 + PIQP_TOLERANCE)


def test_the_proof_does_not_depend_on_what_osqp_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Multipliers out of a hat: the answer is the same, it only takes the kernel longer."""
    hz = horizon()
    rng = np.random.default_rng(3)
    solver = OsqpSolver(hz)
    monkeypatch.setattr(solver, "_ask_osqp", lambda _, count: rng.uniform(0.0, 30.0, count))
    for seed in range(40):
        tick = binding(seed)
        best, answer = ActiveSetSolver(hz).solve(tick), solver.solve(tick)
        assert answer.status != FAILED
        assert hz.cost(answer.snap, tick) <= hz.cost(best.snap, tick) + 1e-6


def test_osqp_s_set_is_often_the_right_one() -> None:
    """What OSQP is for: on the second look at a tick its set is proved with no change."""
    hz = horizon()
    solver, proved, seen = OsqpSolver(hz), 0, 0
    for seed in range(40):
        tick = binding(seed)
        for _ in range(4):
            answer = solver.solve(tick)
        seen += answer.status == SOLVED
        proved += answer.status == SOLVED and answer.iterations == 0
    assert seen > 20
    assert proved > 0.5 * seen


def test_a_place_that_nobody_flies_to_is_refused_at_once() -> None:
    hz, tick = horizon(), binding(1)
    far = HorizonTick(tick.state + np.array([[1e5], [0.0], [0.0], [0.0]]), tick.desired, tick.normals, tick.offsets)
    for solver in (OsqpSolver(hz), ActiveSetSolver(hz)):
        assert solver.solve(far).status == FAILED
        assert solver.solve(tick).status != FAILED
