"""The paper's condensed QP, softened so that every tick has an answer, in OSQP (paper, section V-B; notes N13-N16).

    minimise  1/2 U' W1 U + w2' U + beta (rho_1 sum s + rho_2/2 sum s^2)
    subject to  Lambda_h [x_h, y_h] - s_h <= Gamma_h,  s_h >= 0,   h = 1 .. n

over the snap of x and y. One slack a step, in metres, shared by its half-planes; the linear term makes the penalty
exact, so a feasible problem keeps its hard solution. z meets x and y nowhere (its equality became a penalty, notes
N15), so its snap comes from the same cost in closed form.

The cost is divided by beta and the inputs are whitened, xi = L' U with W1 / beta = L L': the Hessian is the identity
and the rows of the constraints are positions in metres, so OSQP sees numbers near one. The workspace is set up once;
a tick updates q, the bounds and the entries of A, whose pattern is full and therefore never changes, and starts warm
from the last solution.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import osqp
import scipy.sparse as sp
from numpy.typing import NDArray

from sandwich_sitl.control.model import quadruple_integrator
from sandwich_sitl.control.stacking import cost_matrix, cost_vector, selector, stack

Array = NDArray[np.float64]

_RHO_1 = 5.0  # m: see the weights measured for the exact penalty
_RHO_2 = 50.0
_Z_WEIGHT = 20.0
_SOLVED = (1, 2)  # OSQP: solved, solved inaccurate
_ITERATION_LIMIT = 7  # OSQP: stopped at max_iter with a usable iterate


@dataclass(frozen=True)
class MpcSolution:
    """Snap (n, 3) over the horizon, predicted states (n, 12), slack per step (n,), and what the solver said.

    `usable` is false when the solver gave no finite answer; `snap` is then the last plan that was.
    """

    snap: Array
    states: Array
    slack_m: Array
    status: int
    iterations: int
    usable: bool


class Mpc:
    """One OSQP workspace for a horizon of `n_tau` steps with `faces` half-planes a step."""

    def __init__(
        self, n_tau: int, step_s: float, discretisation: Literal["euler", "zoh"], bandwidth_radps: float, faces: int
    ) -> None:
        self.n_tau, self.faces = n_tau, faces
        self._beta = beta = bandwidth_radps**8
        prediction = stack(quadruple_integrator(step_s, discretisation), n_tau)
        self._G, self._H = prediction.G, prediction.H
        plane = np.flatnonzero(np.arange(3 * n_tau) % 3 < 2)
        C_p, C_z = selector(n_tau, (0, 1)), selector(n_tau, (2,))
        self._CH_xy, self._CH_z = C_p @ self._H[:, plane], C_z @ self._H[:, 2::3]
        self._CG_xy, self._CG_z = C_p @ self._G, C_z @ self._G
        self._F_xy, self._F_z = np.ones(2 * n_tau), np.full(n_tau, _Z_WEIGHT)
        factor = np.linalg.cholesky(cost_matrix(self._CH_xy, self._F_xy, beta) / beta)
        self._unwhiten = np.linalg.inv(factor).T
        self._M = self._CH_xy @ self._unwhiten
        self._inverse_W1_z = np.linalg.inv(cost_matrix(self._CH_z, self._F_z, beta))
        self._plane = plane
        self._snap = np.zeros(3 * n_tau)
        self._solver = self._set_up()

    def solve(self, x: Array, desired_m: Array, Lambda: Array, Gamma: Array) -> MpcSolution:
        """One tick: state x (12,), desired positions (n, 3), half-planes Lambda (n, F, 2), Gamma (n, F)."""
        n = self.n_tau
        drift = self._CG_xy @ x
        M = self._M.reshape(n, 2, 2 * n)
        A = np.concatenate([(Lambda @ M).reshape(n * self.faces, 2 * n), np.zeros((n, 2 * n))])
        upper = np.concatenate([(Gamma - (Lambda @ drift.reshape(n, 2, 1))[..., 0]).ravel(), np.zeros(n)])
        w2 = cost_vector(self._CH_xy, self._F_xy, self._beta, drift - desired_m[:, :2].ravel())
        q = np.concatenate([self._unwhiten.T @ w2 / self._beta, np.full(n, _RHO_1)])
        self._solver.update(q=q, u=upper, Ax=np.concatenate([A.ravel(order="F"), self._slack_entries]))
        result = self._solver.solve(raise_error=False)
        solution = np.asarray(result.x, dtype=float)
        status = int(result.info.status_val)
        usable = status in (*_SOLVED, _ITERATION_LIMIT) and bool(np.isfinite(solution).all())
        if usable:
            snap = np.empty(3 * n)
            snap[self._plane] = self._unwhiten @ solution[: 2 * n]
            w2_z = cost_vector(self._CH_z, self._F_z, self._beta, self._CG_z @ x - desired_m[:, 2])
            snap[2::3] = -self._inverse_W1_z @ w2_z
            slack = np.maximum(solution[2 * n :], 0.0)
        else:
            snap = self._snap
            slack = np.full(n, np.nan)
            # Iterates that are not finite would spoil every later tick.
            self._solver.warm_start(x=np.zeros(3 * n), y=np.zeros(len(upper)))
        self._snap = snap
        states = (self._G @ x + self._H @ snap).reshape(n, 12)
        return MpcSolution(snap.reshape(n, 3), states, slack, status, int(result.info.iter), usable)

    def _set_up(self) -> osqp.OSQP:
        n, rows = self.n_tau, self.n_tau * self.faces
        P = sp.diags_array(np.concatenate([np.ones(2 * n), np.full(n, _RHO_2)])).tocsc()
        step = np.repeat(np.arange(n), self.faces)
        # Column-major entries of A: the dense block of the inputs first, then each slack's own rows.
        slack = sp.csc_array(
            (
                np.full(rows + n, -1.0),
                (np.concatenate([np.arange(rows), rows + np.arange(n)]), np.concatenate([step, np.arange(n)])),
            ),
            shape=(rows + n, n),
        )
        dense = sp.csc_array(np.ones((rows + n, 2 * n)))
        A = sp.hstack([dense, slack]).tocsc()
        A.sort_indices()
        self._slack_entries = np.full(rows + n, -1.0)
        solver = osqp.OSQP()
        solver.setup(
            sp.csc_matrix(P), np.zeros(3 * n), sp.csc_matrix(A), np.full(rows + n, -np.inf), np.full(rows + n, 1.0),
            verbose=False, warm_starting=True, scaling=0, adaptive_rho=False, rho=1.0, alpha=1.6,
            eps_abs=1e-4, eps_rel=1e-4, max_iter=200, check_termination=10, polishing=False,
        )  # fmt: skip
        return solver
