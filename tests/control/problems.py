"""Random tracking problems and an independent statement of their hard form."""

import numpy as np
import osqp
import scipy.sparse as sp

from sandwich_sitl.control.horizon import Horizon, HorizonTick, MotionLimits
from sandwich_sitl.control.model import quadruple_integrator

N, STEP_S, OMEGA, FACES = 12, 0.1, 4.0, 4
BOX = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
LIMITS = MotionLimits(6.0, 5.0, 40.0, 600.0)


def horizon(limits: MotionLimits = LIMITS, kind: str = "zoh") -> Horizon:
    return Horizon(N, STEP_S, "zoh" if kind == "zoh" else "euler", OMEGA, 2, FACES, limits)


def turned_box(angle: float) -> np.ndarray:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.ascontiguousarray(np.broadcast_to(BOX @ turn.T, (N, FACES, 2)))


def inside_problem(seed: int) -> HorizonTick:
    """A slow start inside a turned box, a reference that leaves the box: the hard problem has an answer."""
    rng = np.random.default_rng(seed)
    state = np.concatenate([rng.uniform(-0.2, 0.2, 2), rng.uniform(-0.3, 0.3, 2), rng.uniform(-0.2, 0.2, 4)])
    offsets = np.ascontiguousarray(np.broadcast_to(rng.uniform(0.8, 1.2, FACES), (N, FACES)))
    desired = np.cumsum(rng.uniform(-0.05, 0.25, (N, 2)), axis=0)
    return HorizonTick(state.reshape(4, 2), desired, turned_box(rng.uniform(0, 6)), offsets)


def wild_problem(seed: int) -> HorizonTick:
    """Any speed, in or out of the box, which may jump from step to step: often without a hard answer."""
    rng = np.random.default_rng(seed)
    state = np.stack([rng.normal(0, 1, 2), rng.normal(0, 3, 2), rng.normal(0, 3, 2), rng.normal(0, 10, 2)])
    normals = np.concatenate([turned_box(angle)[: N // 2] for angle in rng.uniform(0, 6, 2)])
    desired = np.cumsum(rng.normal(0, 0.4, (N, 2)), axis=0)
    return HorizonTick(state, desired, normals, rng.uniform(0.2, 1.5, (N, FACES)))


def hard_answer(tick: HorizonTick) -> tuple[np.ndarray, float]:
    """Positions (N, 2) and cost of the hard problem, states kept as unknowns of another solver at high accuracy.

    Only the regions are put in: it is the answer of the whole problem where that keeps its motion limits by itself.
    """
    model = quadruple_integrator(STEP_S, "zoh")
    states, inputs = 12 * N, 3 * N
    dynamics = sp.hstack([sp.eye(states) - sp.kron(sp.eye(N, k=-1), model.A_p), -sp.kron(sp.eye(N), model.B_p)])
    start, x = np.zeros(states), np.zeros((4, 3))
    x[:, :2] = tick.state
    start[:12] = model.A_p @ x.ravel()
    rows, weight, target = np.zeros((N * FACES, states + inputs)), np.zeros(states + inputs), np.zeros(states + inputs)
    for h in range(N):
        rows[h * FACES : (h + 1) * FACES, 12 * h : 12 * h + 2] = tick.normals[h]
        weight[12 * h : 12 * h + 2] = 1.0
        target[12 * h : 12 * h + 2] = tick.desired[h]
    weight[states:] = OMEGA**-8
    solver = osqp.OSQP()
    solver.setup(
        sp.csc_matrix(sp.diags(weight)),
        -weight * target,
        sp.csc_matrix(sp.vstack([dynamics, rows])),
        np.concatenate([start, np.full(N * FACES, -np.inf)]),
        np.concatenate([start, tick.offsets.ravel()]),
        verbose=False, eps_abs=1e-9, eps_rel=1e-9, max_iter=200000, polishing=True,
    )  # fmt: skip
    result = solver.solve(raise_error=False)
    assert result.info.status_val == 1
    return result.x[:states].reshape(N, 12)[:, :2], float(result.info.obj_val)
