"""The MPC's answer against a second solver in the un-whitened form, and what it does when there is no answer."""

import numpy as np
import osqp
import pytest
import scipy.sparse as sp

from sandwich_sitl.control.model import quadruple_integrator
from sandwich_sitl.control.mpc import Mpc

N, STEP_S, OMEGA, FACES = 12, 0.1, 4.0, 4
BOX = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
FREE = np.full((N, FACES), 1e3)
NORMALS = np.broadcast_to(BOX, (N, FACES, 2))


def mpc() -> Mpc:
    return Mpc(N, STEP_S, "zoh", OMEGA, FACES)


def reference_answer(
    x: np.ndarray, desired: np.ndarray, Lambda: np.ndarray, Gamma: np.ndarray
) -> tuple[np.ndarray, float]:
    """Plane positions (N, 2) and cost of the hard problem with the states kept as unknowns, at high accuracy."""
    model = quadruple_integrator(STEP_S, "zoh")
    states, inputs = 12 * N, 3 * N
    shift = sp.kron(sp.eye(N, k=-1), model.A_p)
    dynamics = sp.hstack([sp.eye(states) - shift, -sp.kron(sp.eye(N), model.B_p)])
    start = np.zeros(states)
    start[:12] = model.A_p @ x
    rows = np.zeros((N * FACES, states + inputs))
    for h in range(N):
        rows[h * FACES : (h + 1) * FACES, 12 * h : 12 * h + 2] = Lambda[h]
    weight = np.zeros(states + inputs)
    target = np.zeros(states + inputs)
    for h in range(N):
        weight[12 * h : 12 * h + 2] = 1.0
        target[12 * h : 12 * h + 2] = desired[h, :2]
    weight[states:] = OMEGA**-8
    solver = osqp.OSQP()
    solver.setup(
        sp.csc_matrix(sp.diags(weight)),
        -weight * target,
        sp.csc_matrix(sp.vstack([dynamics, rows])),
        np.concatenate([start, np.full(N * FACES, -np.inf)]),
        np.concatenate([start, Gamma.ravel()]),
        verbose=False,
        eps_abs=1e-9,
        eps_rel=1e-9,
        max_iter=200000,
        polishing=True,
    )
    result = solver.solve(raise_error=False)
    assert result.info.status_val == 1
    return result.x[:states].reshape(N, 12)[:, :2], float(result.info.obj_val)


def random_problem(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A slow start inside a turned box, a reference that leaves the box."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([rng.uniform(-0.2, 0.2, 3), rng.uniform(-0.3, 0.3, 3), rng.uniform(-0.2, 0.2, 6)])
    angle = rng.uniform(0, 6)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    Lambda = np.broadcast_to(BOX @ turn.T, (N, FACES, 2))
    Gamma = np.broadcast_to(rng.uniform(0.8, 1.2, FACES), (N, FACES))
    desired = np.cumsum(rng.uniform(-0.05, 0.25, (N, 3)), axis=0)
    return x, desired, Lambda, Gamma


@pytest.mark.parametrize("seed", range(8))
def test_answer_is_that_of_another_formulation(seed: int) -> None:
    x, desired, Lambda, Gamma = random_problem(seed)
    expected, _ = reference_answer(x, desired, Lambda, Gamma)
    assert ((Lambda @ expected[..., None])[..., 0] - Gamma).max() < 1e-6
    controller = mpc()
    for _ in range(3):  # a tick is cut off after so many iterations; the next one starts warm and goes on
        solution = controller.solve(x, desired, Lambda, Gamma)
        assert solution.usable
    np.testing.assert_allclose(solution.states[:, :2], expected, atol=2e-3)
    assert solution.slack_m.max() < 5e-4


@pytest.mark.parametrize("seed", range(4))
def test_without_constraints_the_plan_minimises_the_cost(seed: int) -> None:
    """Stationarity: no small change of the snap lowers the sum of squares, z included."""
    x, desired, _, _ = random_problem(seed)
    solution = mpc().solve(x, desired, NORMALS, FREE)
    model = quadruple_integrator(STEP_S, "zoh")

    def cost(U: np.ndarray, axes: list[int], weight: float) -> float:
        state, total = x, float((U[:, axes] ** 2).sum()) * OMEGA**-8
        for u, p in zip(U, desired, strict=True):
            state = model.A_p @ state + model.B_p @ u
            total += weight * float(((state[axes] - p[axes]) ** 2).sum())
        return total

    rng = np.random.default_rng(seed)
    for axes, weight, slack in (([0, 1], 1.0, 1e-5), ([2], 20.0, 1e-9)):
        least = cost(solution.snap, axes, weight)
        for _ in range(20):
            assert cost(solution.snap + rng.normal(0, 5, (N, 3)), axes, weight) > least - slack


def test_predicted_states_are_the_simulation_of_the_snap() -> None:
    x, desired, Lambda, Gamma = random_problem(1)
    solution = mpc().solve(x, desired, Lambda, Gamma)
    model, state = quadruple_integrator(STEP_S, "zoh"), x
    for u, predicted in zip(solution.snap, solution.states, strict=True):
        state = model.A_p @ state + model.B_p @ u
        np.testing.assert_allclose(predicted, state, atol=1e-9)


def test_infeasible_problem_has_a_finite_answer_with_slack() -> None:
    x = np.zeros(12)
    x[:2] = (3.0, 0.0)  # two metres outside a box of one metre
    solution = mpc().solve(x, np.zeros((N, 3)), NORMALS, np.ones((N, FACES)))
    assert solution.usable
    assert np.isfinite(solution.snap).all()
    assert solution.slack_m[0] > 1.5
    outside = np.maximum(np.abs(solution.states[:, :2]).max(axis=1) - 1.0, 0.0)
    assert (solution.slack_m >= outside - 1e-2).all()
    assert solution.slack_m[-1] < solution.slack_m[0]


def test_state_that_is_not_a_number_keeps_the_last_plan() -> None:
    controller = mpc()
    x, desired, Lambda, Gamma = random_problem(2)
    last = controller.solve(x, desired, Lambda, Gamma)
    broken = controller.solve(np.full(12, np.nan), desired, Lambda, Gamma)
    assert not broken.usable
    np.testing.assert_array_equal(broken.snap, last.snap)
    again = controller.solve(x, desired, Lambda, Gamma)
    assert again.usable
    np.testing.assert_allclose(again.states[:, :2], last.states[:, :2], atol=5e-3)


def test_zero_entries_of_axis_aligned_normals_do_not_change_the_pattern() -> None:
    """Turned and axis-aligned boxes in turn on one workspace: each answer is that of a fresh one."""
    controller = mpc()
    for seed in range(6):
        x, desired, Lambda, Gamma = random_problem(seed)
        normals = NORMALS if seed % 2 else Lambda
        expected, _ = reference_answer(x, desired, normals, Gamma)
        solution = controller.solve(x, desired, normals, Gamma)
        np.testing.assert_allclose(solution.states[:, :2], expected, atol=5e-3)


def test_world_turned_by_a_quarter_gives_the_turned_plan() -> None:
    x, desired, Lambda, Gamma = random_problem(3)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    here = mpc().solve(x, desired, Lambda, Gamma)
    there = mpc().solve(np.kron(np.eye(4), quarter) @ x, desired @ quarter.T, Lambda @ quarter[:2, :2].T, Gamma)
    np.testing.assert_allclose(there.states[:, :3], here.states[:, :3] @ quarter.T, atol=5e-3)


def test_paper_mode_uses_the_euler_chain() -> None:
    controller = Mpc(N, STEP_S, "euler", OMEGA, FACES)
    x = np.zeros(12)
    x[3] = 1.0
    states = controller.solve(x, np.zeros((N, 3)), NORMALS, FREE).states
    np.testing.assert_allclose(states[:3, 0], [0.1, 0.2, 0.3], atol=1e-12)
