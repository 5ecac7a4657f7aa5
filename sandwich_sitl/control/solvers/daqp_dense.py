"""DAQP (dense dual active set) on the whitened form with slacks as unknowns: Hessian I, rows over [xi, s, t].

Only the region rows change from tick to tick. DAQP's Python interface sets a problem up anew in every call; what can be
kept is the working set, given as the multipliers of the last answer.
"""

import daqp
import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.control.horizon import SOLVED, Horizon, HorizonAnswer, HorizonTick

Array = NDArray[np.float64]


class DaqpSolver:
    """Rows of the motion limits built once; slacks are scaled so that their curvature is one too."""

    def __init__(self, horizon: Horizon) -> None:
        self._horizon = horizon
        n, D, F = horizon.n_tau, horizon.axes, horizon.faces
        self._curvature = np.sqrt(horizon.penalties[:, 1])
        blocks = horizon.M.reshape(5, n, n)
        rows = [np.zeros((n * F, D * n + 2 * n))]
        for k in range(4):
            for normal in horizon.edges[k] if horizon.bounded[k] else ():
                row = np.zeros((n, D * n + 2 * n))
                for d in range(D):
                    row[:, d * n : (d + 1) * n] = normal[d] * blocks[k + 1]
                if k < 3:
                    row[:, D * n + n :] = -np.eye(n) / self._curvature[1]
                rows.append(row)
        self._A = np.concatenate(rows)
        for h in range(n):
            self._A[h * F : (h + 1) * F, D * n + h] = -1.0 / self._curvature[0]
        size = D * n + 2 * n
        self._H = np.eye(size)
        self._f = np.concatenate(
            [
                np.zeros(D * n),
                np.repeat(horizon.penalties[:, 0] / self._curvature, n),
            ]
        )
        self._lower = np.concatenate([np.full(D * n, -1e30), np.zeros(2 * n), np.full(len(self._A), -1e30)])
        self._multipliers: Array | None = None

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        """The exact answer."""
        hz = self._horizon
        n, D, F = hz.n_tau, hz.axes, hz.faces
        free = hz.free(tick)
        if not (np.isfinite(free).all() and np.isfinite(tick.offsets).all() and np.isfinite(tick.normals).all()):
            return hz.failed()
        position = hz.M[:n]
        for d in range(D):
            self._A[: n * F, d * n : (d + 1) * n] = (tick.normals[:, :, d, None] * position[:, None, :]).reshape(
                n * F, n
            )
        by_kind = free.reshape(5, n, D)
        bounds = [(tick.offsets - (tick.normals @ by_kind[0][..., None])[..., 0]).ravel()]
        bounds += [1.0 - by_kind[k + 1] @ normal for k in range(4) if hz.bounded[k] for normal in hz.edges[k]]
        upper = np.concatenate([np.full(D * n + 2 * n, 1e30), *bounds])
        warm = {} if self._multipliers is None else {"dual_start": self._multipliers}
        x, _, flag, info = daqp.solve(self._H, self._f, self._A, upper, self._lower, **warm)
        x = np.asarray(x, dtype=float)
        if flag < 1 or not np.isfinite(x).all():
            self._multipliers = None
            return hz.failed(int(info["iterations"]))
        self._multipliers = np.asarray(info["lam"], dtype=float)
        shares = free + hz.M @ x[: D * n].reshape(D, n).T
        return hz.answer(shares, tick, SOLVED, int(info["iterations"]))
