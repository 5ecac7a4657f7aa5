"""Clarabel (interior point) on the stage form: no warm start, exact; the reference that the others are measured with."""

import clarabel
import numpy as np
import scipy.sparse as sp

from sandwich_sitl.control.horizon import SOLVED, Horizon, HorizonAnswer, HorizonTick
from sandwich_sitl.control.solvers.stage_form import StageForm


class ClarabelSolver:
    """Built anew every tick: Clarabel presolves its cones from the bounds."""

    def __init__(self, horizon: Horizon, tolerance: float = 1e-6) -> None:
        self._horizon = horizon
        self._form = StageForm(horizon, scaled=True)
        self._settings = clarabel.DefaultSettings()
        self._settings.verbose = False
        self._settings.tol_gap_abs = self._settings.tol_gap_rel = self._settings.tol_feas = tolerance
        self._equal = np.flatnonzero(self._form.l == self._form.u)
        self._above = np.flatnonzero((self._form.l != self._form.u) & np.isfinite(self._form.u))
        self._below = np.flatnonzero((self._form.l != self._form.u) & np.isfinite(self._form.l))

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        """The answer to the tolerance."""
        if not all(np.isfinite(part).all() for part in (tick.state, tick.desired, tick.normals, tick.offsets)):
            return self._horizon.failed()
        form = self._form
        form.update(tick)
        rows = sp.csr_array(form.A)
        A = sp.vstack([rows[self._equal], rows[self._above], -rows[self._below]]).tocsc()
        b = np.concatenate([form.u[self._equal], form.u[self._above], -form.l[self._below]])
        cones = [
            clarabel.ZeroConeT(len(self._equal)),
            clarabel.NonnegativeConeT(len(self._above) + len(self._below)),
        ]
        result = clarabel.DefaultSolver(
            sp.csc_matrix(form.P), form.q, sp.csc_matrix(A), b, cones, self._settings
        ).solve()
        unknowns = np.asarray(result.x, dtype=float)
        if result.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
            return self._horizon.failed(int(result.iterations))
        return self._horizon.answer_of_snap(form.snap(unknowns), tick, SOLVED, int(result.iterations))
