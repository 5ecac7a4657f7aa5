"""Random tracking problems and an independent statement of their hard form."""

import clarabel
import numpy as np
import osqp
import scipy.sparse as sp
from scipy.linalg import expm
from scipy.optimize import linprog

from sandwich_sitl.control.horizon import MOTION_PENALTY, REGION_PENALTY, Horizon, HorizonTick, MotionLimits
from sandwich_sitl.control.model import quadruple_integrator

N, STEP_S, OMEGA, FACES = 12, 0.1, 4.0, 4
BOX = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
LIMITS = MotionLimits(6.0, 5.0, 40.0, 600.0)
FLIGHT = MotionLimits(12.0, 3.2, 40.0, 600.0)
FLIGHT_N, FLIGHT_FACES = 20, 8


def horizon(limits: MotionLimits = LIMITS, kind: str = "zoh") -> Horizon:
    return Horizon(N, STEP_S, "zoh" if kind == "zoh" else "euler", OMEGA, 2, FACES, limits)


def flight_horizon() -> Horizon:
    """As flown by default, with the acceleration that `bench mpc` allows."""
    return Horizon(FLIGHT_N, STEP_S, "zoh", 8.0, 2, FLIGHT_FACES, FLIGHT)


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


def corridor_problem(seed: int) -> HorizonTick:
    """A flight along a bend at up to 6 m/s: every desired position lies inside its region, the start near the path."""
    rng = np.random.default_rng(seed)
    n, speed, turn = FLIGHT_N, rng.uniform(0, 6), rng.uniform(-0.75, 0.75)
    heading = rng.uniform(0, 2 * np.pi) + turn * STEP_S * np.arange(n)
    along = speed * np.column_stack([np.cos(heading), np.sin(heading)])
    path = STEP_S * np.cumsum(along, axis=0)
    region = np.arange(n) // rng.integers(4, 12)
    normals, offsets = np.empty((n, FLIGHT_FACES, 2)), np.empty((n, FLIGHT_FACES))
    for m in range(region[-1] + 1):
        angle = 2 * np.pi * np.arange(FLIGHT_FACES) / FLIGHT_FACES + rng.uniform(-0.3, 0.3, FLIGHT_FACES)
        sides, here = np.column_stack([np.cos(angle), np.sin(angle)]), region == m
        normals[here] = sides
        offsets[here] = (path[here] @ sides.T).max(axis=0) + rng.uniform(0.02, 0.5, FLIGHT_FACES)
    aside = rng.normal(0, 1, (4, 2)) * np.array([[0.1], [0.4], [0.7], [3.0]])
    aside[1] += along[0]
    return HorizonTick(aside, path, normals, offsets)


def stacked_rows(tick: HorizonTick, limits: MotionLimits) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows A u <= b of regions and motion limits over u (2 n,) = u_x, u_y, stated without `Horizon`; what each is
    relaxed by (m, 2 n): a metre of its step's s or a share of its step's t.
    """
    n = len(tick.desired)
    step = expm(STEP_S * np.block([[np.eye(4, k=1), np.eye(4)[:, 3:]], [np.zeros((1, 5))]]))
    state, response = tick.state, np.zeros((4, n))
    rows, bounds, relaxed = [], [], []
    for h in range(n):
        state, response = step[:4, :4] @ state, step[:4, :4] @ response
        response[:, h] = step[:4, 4]
        sides = [(0, normal, offset, h) for normal, offset in zip(tick.normals[h], tick.offsets[h], strict=True)]
        for k, (limit, count) in enumerate(
            ((limits.speed_mps, 8), (limits.acceleration_mps2, 8), (limits.jerk_mps3, 4)), 1
        ):
            angle = 2 * np.pi * np.arange(count) / count
            apothem = limit * np.cos(np.pi / count)
            sides += [(k, np.array([np.cos(a), np.sin(a)]) / apothem, 1.0, n + h) for a in angle]
        for k, normal, bound, slack in sides:
            rows.append(np.outer(normal, response[k]).ravel())
            bounds.append(bound - normal @ state[k])
            relaxed.append(np.eye(2 * n)[slack])
    return np.array(rows), np.array(bounds), np.array(relaxed)


def room(tick: HorizonTick, limits: MotionLimits) -> float:
    """By how much, in metres and in shares of a limit, every row can be kept at once; negative: no hard answer."""
    A, b, _ = stacked_rows(tick, limits)
    largest = limits.snap_mps4 * np.sqrt(0.5)
    bounds = [(-largest, largest)] * A.shape[1] + [(None, 1.0)]
    result = linprog(np.append(np.zeros(A.shape[1]), -1.0), np.column_stack([A, np.ones(len(A))]), b, bounds=bounds)
    assert result.status == 0
    return float(result.x[-1])


def least_penalty(tick: HorizonTick, limits: MotionLimits) -> float:
    """The least that the penalties alone can come to, whatever the plan costs otherwise."""
    A, b, relaxed = stacked_rows(tick, limits)
    n, inputs = len(tick.desired), A.shape[1]
    (s_1, s_2), (t_1, t_2) = REGION_PENALTY, MOTION_PENALTY
    size = inputs + 2 * n
    P = sp.diags_array(np.repeat([0.0, s_2, t_2], [inputs, n, n])).tocsc()
    q = np.repeat([0.0, s_1, t_1], [inputs, n, n])
    box, largest = np.eye(size)[:inputs], limits.snap_mps4 * np.sqrt(0.5)
    rows = np.concatenate([np.hstack([A, -relaxed]), box, -box, -np.eye(size)[inputs:]])
    bounds = np.concatenate([b, np.full(2 * inputs, largest), np.zeros(2 * n)])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-8
    rows[:, :inputs] *= largest  # the solver sees inputs as shares of their bound
    result = clarabel.DefaultSolver(
        sp.csc_matrix(P), q, sp.csc_matrix(rows), bounds, [clarabel.NonnegativeConeT(len(rows))], settings
    ).solve()
    assert result.status == clarabel.SolverStatus.Solved
    assert abs(result.obj_val - result.obj_val_dual) < 1e-6 * (1.0 + result.obj_val)
    return float(result.obj_val)
