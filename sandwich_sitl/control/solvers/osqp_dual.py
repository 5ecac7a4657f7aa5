"""OSQP finds which rows bind, the active-set kernel proves it.

OSQP solves the dual over the rows in play (`rows_in_play`), warm from tick to tick, for a fixed number of iterations: a
first-order method is good at telling which multipliers are not zero and slow at their last digits. The kernel
(`dual_kernel`) starts from that set: its first factorisation gives the digits, and its look at every row of the problem
is the proof. Where OSQP's set is not yet the right one the kernel goes on from it. A tick that no plan can mend has so
many rows that bind that the kernel would take longer than an interior point, whose time hardly depends on them: after
two rounds a step PIQP is asked instead. No answer of its either is none, and the last accepted plan is flown on
(`assurance`).
"""

import numpy as np
import osqp
import scipy.sparse as sp
from numpy.typing import NDArray

from sandwich_sitl.control.horizon import QUANTITIES, SOLVED, Horizon, HorizonAnswer, HorizonTick
from sandwich_sitl.control.solvers.piqp_sparse import PiqpSolver
from sandwich_sitl.control.solvers.rows_in_play import BESIDE, assemble, gather
from sandwich_sitl.control.solvers.working_set import WorkingSet

Array = NDArray[np.float64]

_SLOTS = (12, 24, 48)  # of the workspaces; a tick takes the smallest that fits, or the worst rows into the largest
_ITERATIONS = 25
_BINDS = 1e-4  # of the largest multiplier
_MOST_ROUNDS_A_STEP = 2


class _Workspace:
    """OSQP for `slots` rows in play, and the arrays that it is filled from."""

    def __init__(self, slots: int) -> None:
        m = self._slots = slots
        self.scale, self.high = np.empty(m), np.empty(m)
        self.quadratic = np.ones(m * (m + 1) // 2 + m)
        self.linear = np.empty(2 * m)
        self.band = np.zeros((m, BESIDE))
        P = sp.block_diag([sp.triu(np.ones((m, m))), sp.eye_array(m)], format="csc")
        sums = sum((np.eye(m, k=b) for b in range(BESIDE)), np.zeros((m, m)))
        A = sp.csc_array(sp.vstack([sp.eye_array(2 * m), sp.hstack([sp.csc_array(sums), -sp.eye_array(m)])]))
        A.sort_indices()
        # The sum of slot i - b is row 2 m + i - b of A; multiplier i enters it in column i.
        column = np.repeat(np.arange(2 * m), np.diff(A.indptr))
        inside = (A.indices >= 2 * m) & (column < m)
        self._sums_at = np.flatnonzero(inside).astype(np.int32)
        self._band_at = (column[inside], column[inside] - (A.indices[inside] - 2 * m))
        A.data[self._sums_at] = 0.0
        P.data[:] = np.concatenate([*(np.append(np.zeros(j), 1.0) for j in range(m)), np.ones(m)])
        low = np.concatenate([np.zeros(2 * m), np.full(m, -1e30)])
        self._upper = np.full(3 * m, 1e30)
        self._start = np.zeros(2 * m)
        self._solver = osqp.OSQP()
        self._solver.setup(
            sp.csc_matrix(P), np.ones(2 * m), sp.csc_matrix(A), low, self._upper,
            verbose=False, warm_starting=True, scaling=0, adaptive_rho=False, rho=0.1, alpha=1.6,
            eps_abs=1e-6, eps_rel=1e-6, max_iter=_ITERATIONS, check_termination=_ITERATIONS, polishing=False,
        )  # fmt: skip

    def solve(self, guess: Array) -> Array:
        """Multipliers (count,) near `guess` (count,) of what the arrays were filled with."""
        count = len(guess)
        self._upper[2 * self._slots :] = self.high
        self._solver.update(
            q=self.linear, u=self._upper, Px=self.quadratic, Ax=self.band[self._band_at], Ax_idx=self._sums_at
        )
        self._start[:] = 0.0
        self._start[:count] = guess / self.scale[:count]
        self._solver.warm_start(x=self._start)
        return np.asarray(self._solver.solve(raise_error=False).x[:count] * self.scale[:count])


class OsqpSolver:
    """OSQP workspaces and the multipliers of the last tick; compiled (or loaded from the cache) when it is built."""

    def __init__(self, horizon: Horizon) -> None:
        self._horizon = horizon
        n, axes = horizon.n_tau, horizon.axes
        self._set = WorkingSet(horizon, given=_SLOTS[-1])
        self._known, self._merit = np.zeros((2, QUANTITIES, n, max(8, horizon.faces)))
        self._in_play, self._target = np.zeros((_SLOTS[-1], 3), dtype=np.int64), np.empty(_SLOTS[-1])
        self._workspaces = tuple(_Workspace(slots) for slots in _SLOTS)
        self._interior_point = PiqpSolver(horizon)
        aside = HorizonTick(
            np.zeros((4, axes)), np.ones((n, axes)), np.ones((n, horizon.faces, axes)), np.zeros((n, horizon.faces))
        )
        self.solve(aside)
        self._known[:] = 0.0

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        """The exact answer, to 1e-8 m; PIQP's where the kernel gave up."""
        hz = self._horizon
        free = hz.free(tick)
        if not hz.sane(tick, free):
            return hz.failed()
        normals = np.ascontiguousarray(tick.normals)
        count = gather(
            free, hz.table, normals, tick.offsets, self._set.edges, self._set.edge_count,
            self._known, self._merit, self._in_play, self._target,
        )  # fmt: skip
        if count == 0:
            return hz.free_answer(free)
        multipliers = self._ask_osqp(normals, count)
        self._known[:] = 0.0
        self._start_kernel(multipliers, count)
        rounds, working = self._set.solve(free, normals, tick.offsets, _MOST_ROUNDS_A_STEP * hz.n_tau)
        if rounds < 0:
            return self._interior_point.solve(tick)
        k, h, f = self._set.rows[:working].T
        self._known[k, h, f] = self._set.multipliers[:working]
        return hz.answer(self._set.shares, tick, SOLVED, rounds)

    def _ask_osqp(self, normals: Array, count: int) -> Array:
        """OSQP's multipliers (count,) of the rows in play."""
        space = next(space for space, slots in zip(self._workspaces, _SLOTS, strict=True) if count <= slots)
        assemble(
            self._horizon.table, normals, self._set.edges, self._set.rho, self._in_play, self._target, count,
            space.quadratic, space.linear, space.band, space.high, space.scale,
        )  # fmt: skip
        k, h, f = self._in_play[:count].T
        return space.solve(self._known[k, h, f])

    def _start_kernel(self, multipliers: Array, count: int) -> None:
        """Working set and multipliers where the kernel begins: OSQP's rows that bind."""
        rho_1, n = self._set.rho[:, 0], self._horizon.n_tau
        binds = np.flatnonzero(multipliers > _BINDS * max(1.0, float(multipliers.max())))
        rows = self._in_play[:count][binds]
        size = len(binds)
        self._set.rows[:size], self._set.rows[size:, 0] = rows, -1
        self._set.multipliers[:size] = multipliers[binds]
        quantity, step = rows[:, 0], rows[:, 1]
        soft = np.flatnonzero(quantity < 4)
        group = np.where(quantity == 0, step, n + step)[soft]
        total = np.bincount(group, multipliers[binds][soft], 2 * n)
        limit = np.repeat(rho_1, n)
        self._set.opened[:] = total > limit * (1 + 1e-6)
        over = np.where(self._set.opened, 1.0, np.minimum(1.0, limit / np.maximum(total, 1e-12)))
        self._set.multipliers[soft] *= over[group]
