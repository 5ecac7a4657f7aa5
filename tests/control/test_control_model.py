"""Model, stacking and condensed cost against the matrix exponential, simulation and a sum written out step by step."""

import numpy as np
import pytest
from scipy.linalg import expm

from sandwich_sitl.control.model import quadruple_integrator
from sandwich_sitl.control.stacking import cost_matrix, cost_vector, selector, stack

RNG = np.random.default_rng(5)


def continuous() -> tuple[np.ndarray, np.ndarray]:
    """x' = A x + B u with x = [r, v, a, j]."""
    A, B = np.zeros((12, 12)), np.zeros((12, 3))
    for k in range(9):
        A[k, k + 3] = 1.0
    B[9:] = np.eye(3)
    return A, B


@pytest.mark.parametrize("step_s", [0.02, 0.1, 0.5])
def test_zero_order_hold_is_the_matrix_exponential(step_s: float) -> None:
    A, B = continuous()
    augmented = np.zeros((15, 15))
    augmented[:12, :12], augmented[:12, 12:] = A, B
    exact = expm(augmented * step_s)
    model = quadruple_integrator(step_s, "zoh")
    np.testing.assert_allclose(model.A_p, exact[:12, :12], atol=1e-14)
    np.testing.assert_allclose(model.B_p, exact[:12, 12:], atol=1e-14)


def test_euler_is_as_the_paper_prints() -> None:
    A, B = continuous()
    model = quadruple_integrator(0.1, "euler")
    np.testing.assert_array_equal(model.A_p, np.eye(12) + 0.1 * A)
    np.testing.assert_array_equal(model.B_p, 0.1 * B)


def test_euler_moves_the_position_four_steps_later() -> None:
    model = quadruple_integrator(0.1, "euler")
    x = model.B_p @ np.ones(3)
    for _ in range(2):
        assert (x[:3] == 0).all()
        x = model.A_p @ x
    assert (x[:3] == 0).all()
    assert (model.A_p @ x)[0] == pytest.approx(1e-4)


@pytest.mark.parametrize("kind", ["euler", "zoh"])
def test_stacking_is_simulation(kind: str) -> None:
    n = 7
    model = quadruple_integrator(0.1, "euler" if kind == "euler" else "zoh")
    prediction = stack(model, n)
    x, U = RNG.normal(size=12), RNG.normal(size=(n, 3))
    steps, state = [], x
    for u in U:
        state = model.A_p @ state + model.B_p @ u
        steps.append(state)
    np.testing.assert_allclose(prediction.G @ x + prediction.H @ U.ravel(), np.concatenate(steps), rtol=1e-12)


@pytest.mark.parametrize("coordinates", [(0, 1), (2,)])
def test_selector_picks_positions(coordinates: tuple[int, ...]) -> None:
    Y = RNG.normal(size=(5, 12))
    picked = selector(5, coordinates) @ Y.ravel()
    np.testing.assert_array_equal(picked, Y[:, coordinates].ravel())


def test_condensed_cost_has_the_gradient_and_curvature_of_the_step_by_step_sum() -> None:
    n, beta = 4, 3.0
    model = quadruple_integrator(0.4, "zoh")
    x, P, F = RNG.normal(size=12), RNG.normal(size=(n, 2)), RNG.uniform(0.5, 2, (n, 2))

    def cost(U: np.ndarray) -> float:
        state, total = x, 0.5 * float(U @ U)
        for h, u in enumerate(U.reshape(n, 3)):
            state = model.A_p @ state + model.B_p @ u
            total += 0.5 * beta * float((F[h] * (state[:2] - P[h]) ** 2).sum())
        return total

    prediction, C = stack(model, n), selector(n, (0, 1))
    CH = C @ prediction.H
    W1 = cost_matrix(CH, F.ravel(), beta)
    w2 = cost_vector(CH, F.ravel(), beta, C @ prediction.G @ x - P.ravel())
    U, unit = RNG.normal(size=3 * n), np.eye(3 * n)
    step = 1e-3  # the cost is quadratic: central differences are exact up to rounding
    gradient = np.array([(cost(U + step * e) - cost(U - step * e)) / (2 * step) for e in unit])
    np.testing.assert_allclose(W1 @ U + w2, gradient, rtol=1e-6, atol=1e-6)
    at_zero = np.array([(cost(step * e) - cost(-step * e)) / (2 * step) for e in unit])
    np.testing.assert_allclose(w2, at_zero, rtol=1e-6, atol=1e-6)
    assert (np.linalg.eigvalsh(W1) >= 1.0 - 1e-9).all()
