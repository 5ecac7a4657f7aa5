"""The tracking problem: exact penalty, limits, closed form, symmetry; its exact solver against independent answers."""

import numpy as np
import pytest

from sandwich_sitl.control.horizon import FAILED, FREE, Horizon, HorizonTick, MotionLimits
from sandwich_sitl.control.model import quadruple_integrator
from sandwich_sitl.control.solvers.active_set import ActiveSetSolver
from sandwich_sitl.control.solvers.clarabel_sparse import ClarabelSolver

from .problems import (
    BOX,
    FACES,
    LIMITS,
    OMEGA,
    STEP_S,
    N,
    hard_answer,
    horizon,
    inside_problem,
    turned_box,
    wild_problem,
)

FAR = np.full((N, FACES), 1e3)


@pytest.mark.parametrize("seed", range(12))
def test_a_feasible_problem_is_solved_hard_with_no_slack(seed: int) -> None:
    """The penalty is exact: the soft problem's answer is that of the hard one, stated and solved in another way."""
    tick = inside_problem(seed)
    expected, _ = hard_answer(tick)
    answer = ActiveSetSolver(horizon(MotionLimits())).solve(tick)
    np.testing.assert_allclose(answer.motion[0], expected, atol=2e-5)
    assert answer.slack_m.max() < 1e-7


@pytest.mark.parametrize("seed", range(60))
def test_the_exact_solver_agrees_with_an_interior_point_method(seed: int) -> None:
    """Also where no hard answer exists: equal cost, and no point near the answer is cheaper."""
    hz, tick = horizon(), wild_problem(seed)
    answer, reference = ActiveSetSolver(hz).solve(tick), ClarabelSolver(hz, 1e-11).solve(tick)
    cost = hz.cost(answer.snap, tick)
    assert cost <= hz.cost(reference.snap, tick) * (1 + 1e-6) + 1e-9
    np.testing.assert_allclose(answer.motion[0], reference.motion[0], atol=2e-4)
    rng = np.random.default_rng(seed)
    for size in (1e-3, 1e-1, 10.0):
        nearby = answer.snap + rng.normal(0, size, (N, 2))
        if np.abs(nearby).max() <= hz.units[4]:
            assert hz.cost(nearby, tick) >= cost - 1e-9


def test_one_workspace_for_many_ticks_gives_what_a_fresh_one_gives() -> None:
    hz = horizon()
    kept = ActiveSetSolver(hz)
    for seed in range(80):
        tick = wild_problem(seed) if seed % 3 else inside_problem(seed)
        warm, cold = kept.solve(tick), ActiveSetSolver(hz).solve(tick)
        np.testing.assert_allclose(warm.motion[0], cold.motion[0], atol=1e-6)
        again = kept.solve(tick)
        assert again.iterations <= 3
        np.testing.assert_allclose(again.snap, warm.snap, atol=1e-4)


@pytest.mark.parametrize("seed", range(20))
def test_the_plan_keeps_its_limits_where_it_can(seed: int) -> None:
    """A reference that leaps aside: norms of v, a, j and u stay within the limits."""
    rng = np.random.default_rng(seed)
    heading = rng.uniform(0, 2 * np.pi)
    leap = rng.uniform(1.5, 2.5) * np.array([np.cos(heading), np.sin(heading)])
    tick = HorizonTick(np.zeros((4, 2)), np.tile(leap, (N, 1)), turned_box(0.0), FAR)
    answer = ActiveSetSolver(horizon()).solve(tick)
    assert answer.excess.max() < 1e-7
    limits = (LIMITS.speed_mps, LIMITS.acceleration_mps2, LIMITS.jerk_mps3)
    for k, limit in enumerate(limits, start=1):
        assert np.hypot(*answer.motion[k].T).max() <= limit * (1 + 1e-6)
    assert np.hypot(*answer.snap.T).max() <= LIMITS.snap_mps4 * (1 + 1e-6)
    assert np.hypot(*answer.motion[2].T).max() > 0.9 * LIMITS.acceleration_mps2  # and the limit is what holds it


def test_without_rows_the_answer_is_the_closed_form_and_stationary() -> None:
    hz, solver = horizon(MotionLimits()), ActiveSetSolver(horizon(MotionLimits()))
    tick = HorizonTick(inside_problem(1).state, inside_problem(1).desired, turned_box(0.0), FAR)
    answer = solver.solve(tick)
    assert (answer.status, answer.iterations) == (FREE, 0)
    base = hz.cost(answer.snap, tick)
    for h in range(N):
        for axis in range(2):
            for sign in (-1.0, 1.0):
                moved = answer.snap.copy()
                moved[h, axis] += sign
                assert hz.cost(moved, tick) > base


@pytest.mark.parametrize("kind", ["zoh", "euler"])
def test_motion_is_the_simulation_of_the_snap(kind: str) -> None:
    model = quadruple_integrator(STEP_S, "zoh" if kind == "zoh" else "euler")
    tick = inside_problem(4)
    answer = ActiveSetSolver(horizon(MotionLimits(), kind)).solve(tick)
    x = np.zeros((4, 3))
    x[:, :2] = tick.state
    state = x.ravel()
    for h in range(N):
        state = model.A_p @ state + model.B_p @ np.append(answer.snap[h], 0.0)
        np.testing.assert_allclose(answer.motion[:, h], state.reshape(4, 3)[:, :2], atol=1e-8)


def test_a_world_turned_by_any_angle_gives_the_turned_plan() -> None:
    tick, solver = inside_problem(3), ActiveSetSolver(horizon(MotionLimits()))
    here = solver.solve(tick)
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    there = solver.solve(
        HorizonTick(
            tick.state @ turn.T, tick.desired @ turn.T, np.ascontiguousarray(tick.normals @ turn.T), tick.offsets
        )
    )
    np.testing.assert_allclose(there.motion[0], here.motion[0] @ turn.T, atol=1e-6)


def test_rows_given_twice_change_nothing() -> None:
    """Corridors repeat their last row where a region has fewer sides."""
    tick = inside_problem(5)
    doubled = HorizonTick(
        tick.state, tick.desired,
        np.concatenate([tick.normals, tick.normals[:, -1:].repeat(4, axis=1)], axis=1),
        np.concatenate([tick.offsets, tick.offsets[:, -1:].repeat(4, axis=1)], axis=1),
    )  # fmt: skip
    np.testing.assert_allclose(
        ActiveSetSolver(horizon()).solve(doubled).snap, ActiveSetSolver(horizon()).solve(tick).snap, atol=1e-5
    )


@pytest.mark.parametrize("broken", ["state", "desired", "normals", "offsets"])
def test_what_is_not_a_number_fails_and_does_not_spoil_the_next_tick(broken: str) -> None:
    solver, tick = ActiveSetSolver(horizon()), inside_problem(2)
    first = solver.solve(tick)
    parts = {name: getattr(tick, name).copy() for name in ("state", "desired", "normals", "offsets")}
    parts[broken].flat[3] = np.nan
    assert solver.solve(HorizonTick(**parts)).status == FAILED
    np.testing.assert_allclose(solver.solve(tick).snap, first.snap, atol=1e-6)


def test_bandwidth_is_the_bandwidth_of_the_closed_loop() -> None:
    """Stepping the first input without rows follows a step of the reference with the poles of radius omega: settled
    to 5 % after the time that an eighth-order Butterworth filter's slowest pair needs.
    """
    hz, solver = horizon(MotionLimits()), ActiveSetSolver(horizon(MotionLimits()))
    state, positions = np.zeros((4, 2)), []
    for _ in range(60):
        tick = HorizonTick(state, np.ones((N, 2)), turned_box(0.0), FAR)
        state = solver.solve(tick).motion[:, 0]
        positions.append(state[0, 0])
    slowest = OMEGA * np.sin(np.pi / 8 / 2 * 1.0)
    settled = round(3.0 / slowest / STEP_S)
    assert settled < 60
    assert np.abs(np.array(positions[settled:]) - 1.0).max() < 0.05
    assert hz.beta == OMEGA**8


@pytest.mark.parametrize(
    ("steps", "step_s", "period_s", "settles"),
    [
        (20, 0.1, 0.02, True),
        (20, 0.1, 0.1, True),
        (20, 0.03, 0.1, True),
        (5, 0.1, 0.02, True),
        (20, 0.02, 0.05, True),
        (10, 0.02, 0.02, False),
        (20, 0.01, 0.02, False),
        (4, 0.02, 0.1, False),
    ],
)
def test_a_horizon_settles_where_its_plans_flown_one_after_the_other_do(
    steps: int, step_s: float, period_s: float, settles: bool
) -> None:
    """Second way: plan, fly the plan's snap for a period by small steps, plan again."""
    hz = Horizon(steps, step_s, "zoh", 8.0, 1, 2, MotionLimits())
    assert (hz.settling(period_s) < 1.0) == settles
    fine, state, lengths = quadruple_integrator(1e-3, "zoh"), np.array([[1.0], [0.0], [0.0], [0.0]]), []
    for _ in range(round(12.0 / period_s)):
        tick = HorizonTick(state, np.zeros((steps, 1)), np.zeros((steps, 2, 1)), np.full((steps, 2), 1e3))
        snap = hz.free_answer(hz.free(tick)).snap
        for k in range(round(period_s / 1e-3)):
            u = snap[min(int(k * 1e-3 / step_s + 1e-9), steps - 1)]
            state = fine.A_p[::3, ::3] @ state + np.outer(fine.B_p[::3, 0], u)
        lengths.append(float(np.linalg.norm(state[:, 0] / hz.scales[:4])))
    assert (lengths[-1] < 1e-2 * lengths[0]) == settles


def test_polygons_are_inscribed() -> None:
    """A vector of the limit's length is never within the polygon's outside: keeping the rows keeps the norm."""
    hz = horizon()
    for k, (normals, limit) in enumerate(
        zip(hz.edges, (LIMITS.speed_mps, LIMITS.acceleration_mps2, LIMITS.jerk_mps3, LIMITS.snap_mps4), strict=True)
    ):
        angle = np.linspace(0, 2 * np.pi, 720)
        circle = 1.0001 * limit * np.column_stack([np.cos(angle), np.sin(angle)])
        assert ((circle / hz.units[k + 1]) @ normals.T).max(axis=1).min() > 1.0
    assert len(BOX) == FACES
