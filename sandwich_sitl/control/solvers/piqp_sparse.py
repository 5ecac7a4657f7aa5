"""PIQP (proximal interior point, multistage factorisation) on the stage form."""

import numpy as np
import piqp
import scipy.sparse as sp
from numpy.typing import NDArray

from sandwich_sitl.control.horizon import SOLVED, Horizon, HorizonAnswer, HorizonTick
from sandwich_sitl.control.solvers.stage_form import StageForm

Array = NDArray[np.float64]


class PiqpSolver:
    """One PIQP workspace; equalities and inequalities are handed over apart."""

    def __init__(self, horizon: Horizon, tolerance: float = 1e-6) -> None:
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
        self._equal = np.flatnonzero(form.l == form.u)
        self._other = np.flatnonzero(form.l != form.u)
        number = sp.csr_array((np.arange(1.0, form.A.nnz + 1), form.A.indices, form.A.indptr), shape=form.A.shape[::-1])
        self._G = sp.csc_array(number.T.tocsr()[self._other])
        self._from = self._G.data.astype(np.intp) - 1
        self._G.data = form.A.data[self._from].copy()
        C = sp.csc_array(sp.csr_array(form.A)[self._equal])
        self._solver = piqp.SparseSolver()
        settings = self._solver.settings
        settings.kkt_solver = piqp.KKTSolver.sparse_multistage
        settings.eps_abs = settings.eps_rel = tolerance
        settings.verbose = False
        self._solver.setup(
            sp.csc_matrix(form.P), form.q, sp.csc_matrix(C), form.u[self._equal], sp.csc_matrix(self._G),
            _finite(form.l[self._other]), _finite(form.u[self._other]), None, None,
        )  # fmt: skip

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        """The answer to the tolerance."""
        if not all(np.isfinite(part).all() for part in (tick.state, tick.desired, tick.normals, tick.offsets)):
            return self._horizon.failed()
        form = self._form
        form.update(tick)
        self._G.data[:] = form.A.data[self._from]
        self._solver.update(c=form.q, b=form.u[self._equal], G=sp.csc_matrix(self._G), h_u=_finite(form.u[self._other]))
        status = self._solver.solve()
        unknowns = np.asarray(self._solver.result.x, dtype=float)
        iterations = int(self._solver.result.info.iter)
        if status != piqp.PIQP_SOLVED or not np.isfinite(unknowns).all():
            return self._horizon.failed(iterations)
        return self._horizon.answer_of_snap(form.snap(unknowns), tick, SOLVED, iterations)


def _finite(bounds: Array) -> Array:
    """PIQP writes infinity as 1e30."""
    return np.asarray(np.clip(bounds, -1e30, 1e30))
