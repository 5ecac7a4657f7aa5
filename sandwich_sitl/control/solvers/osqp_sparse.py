"""OSQP on the stage form: own scaling, fixed rho, warm start, a fixed number of iterations at most.

OSQP's own scaling is off because it would run again with every update of the matrix; index arrays are built once
since OSQP does not check their range.
"""

import numpy as np
import osqp
import scipy.sparse as sp

from sandwich_sitl.control.horizon import CUT_OFF, SOLVED, Horizon, HorizonAnswer, HorizonTick
from sandwich_sitl.control.solvers.stage_form import StageForm

_STATUS = {1: SOLVED, 2: SOLVED, 7: CUT_OFF}  # OSQP: solved, solved inaccurate, max_iter


class OsqpSolver:
    """One OSQP workspace."""

    def __init__(self, horizon: Horizon) -> None:
        self._horizon = horizon
        self._form = form = StageForm(horizon, scaled=True)
        n, axes = horizon.n_tau, horizon.axes
        form.update(
            HorizonTick(
                np.zeros((4, axes)),
                np.zeros((n, axes)),
                np.ones((n, horizon.faces, axes)),
                np.ones((n, horizon.faces)),
            )
        )
        self._solver = osqp.OSQP()
        self._solver.setup(
            sp.csc_matrix(form.P), form.q, sp.csc_matrix(form.A), form.l, form.u,
            verbose=False, warm_starting=True, scaling=0, adaptive_rho=False, rho=0.05, alpha=1.6,
            eps_abs=1e-4, eps_rel=1e-4, max_iter=200, check_termination=25, polishing=False,
        )  # fmt: skip
        self._normals = form.A.data[form.normals_at]

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        """An answer to OSQP's tolerance, or as near as its last iteration came."""
        if not all(np.isfinite(part).all() for part in (tick.state, tick.desired, tick.normals, tick.offsets)):
            return self._horizon.failed()
        form = self._form
        form.update(tick)
        normals = form.A.data[form.normals_at]
        if np.array_equal(normals, self._normals):
            self._solver.update(q=form.q, l=form.l, u=form.u)
        else:
            self._normals = normals
            self._solver.update(q=form.q, l=form.l, u=form.u, Ax=normals, Ax_idx=form.normals_at)
        result = self._solver.solve(raise_error=False)
        unknowns = np.asarray(result.x, dtype=float)
        status = _STATUS.get(int(result.info.status_val))
        iterations = int(result.info.iter)
        if status is None or not np.isfinite(unknowns).all():
            self._solver.warm_start(x=np.zeros(len(form.q)), y=np.zeros(len(form.l)))
            return self._horizon.failed(iterations)
        return self._horizon.answer_of_snap(form.snap(unknowns), tick, status, iterations)
