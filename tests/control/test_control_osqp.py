"""OSQP's part and the kernel's part of the default solver, each tried without the other."""

import numpy as np
import pytest

from sandwich_sitl.control.horizon import FAILED, SOLVED, Horizon, HorizonTick
from sandwich_sitl.control.solvers import osqp_dual, working_set
from sandwich_sitl.control.solvers.active_set import ActiveSetSolver
from sandwich_sitl.control.solvers.osqp_dual import OsqpSolver

from .problems import horizon, inside_problem


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


def test_what_is_not_proved_is_no_answer_and_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    hz = horizon()
    solver = OsqpSolver(hz)
    with monkeypatch.context() as patch:
        patch.setattr(working_set, "dual_active_set", lambda *_: (-1, 0))
        assert solver.solve(binding(3)).status == FAILED
    assert first_command_error(hz, solver, binding(3)) < 1e-4


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
