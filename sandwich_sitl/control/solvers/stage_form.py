"""The tracking problem with the states kept, in the order of the steps, for sparse solvers.

    unknowns of step h    [u_h (D), r, v, a, j at h + 1 (4 D), s, t],   each divided by its scale
    rows of step h        dynamics (4 D, equalities), regions (F), motion limits, input (D, two-sided), s >= 0, t >= 0

P, q, A, l, u are named as OSQP has it. The pattern never changes: entries of Lambda that are zero stay stored, and only
they, Gamma, the first state and the desired positions move from tick to tick.
"""

from math import inf

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sandwich_sitl.control.horizon import Horizon, HorizonTick

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Beside the horizon's own scales, what saved PIQP iterations.
_SLACK_SCALE, _EXCESS_SCALE = 0.04, 0.6
_ROW_SCALE = {"dynamics": 7.0, "region": 5.5, "motion": 0.55, "input": 0.55, "slack": 5.0}


class StageForm:
    """`P`, `q`, `A` (csc), `l`, `u` of the scaled problem; `update` moves them to a tick."""

    def __init__(self, horizon: Horizon, scaled: bool) -> None:
        self.horizon = horizon
        n, D = horizon.n_tau, horizon.axes
        self.width = 5 * D + 2
        one = np.repeat(np.roll(horizon.scales, 1) if scaled else np.ones(5), D)
        slack = [_SLACK_SCALE, _EXCESS_SCALE] if scaled else [1.0, 1.0]
        self.scale = np.tile(np.concatenate([one, slack]), n)
        weight = np.concatenate([np.full(D, 1 / horizon.beta), np.full(D, horizon.weight), np.zeros(3 * D)])
        curvature = np.tile(np.concatenate([weight, horizon.penalties[:, 1]]), n)
        self.P = sp.diags_array(curvature * self.scale**2).tocsc()
        linear = np.concatenate([np.zeros(5 * D), horizon.penalties[:, 0]])
        self.q = np.tile(linear, n) * self.scale
        self._build_rows(scaled)

    def _build_rows(self, scaled: bool) -> None:
        hz = self.horizon
        n, D, F, width = hz.n_tau, hz.axes, hz.faces, self.width
        r, s, t = D, 5 * D, 5 * D + 1
        motion = [(k + 1, e) for k in range(3) if hz.bounded[k] for e in hz.edges[k]]
        boxed = D * hz.bounded[3]
        height = 4 * D + F + len(motion) + boxed + 2
        self.height = height
        stage, back = np.zeros((height, width)), np.zeros((height, width))
        for k in range(4):
            for d in range(D):
                row = k * D + d
                stage[row, r + row] = 1.0
                stage[row, d] = -hz.drive[k]
                back[row, r + d : r + 4 * D : D] = -hz.chain[k]
        low = np.zeros(height)
        high = np.zeros(height)
        low[4 * D :] = -inf
        top = 4 * D
        stage[top : top + F, r : r + D] = np.nan  # Lambda: set by `update`
        stage[top : top + F, s] = -1.0
        for i, (k, normal) in enumerate(motion):
            row = top + F + i
            stage[row, r + k * D : r + (k + 1) * D] = normal / hz.units[k]
            stage[row, t] = -1.0
            high[row] = 1.0
        top += F + len(motion)
        # An input polygon of four sides turned by nothing is the box |u_d| <= its unit.
        stage[top : top + boxed, :boxed] = np.eye(boxed) / hz.units[4]
        low[top : top + boxed], high[top : top + boxed] = -1.0, 1.0
        stage[top + boxed, s] = stage[top + boxed + 1, t] = -1.0
        names = ["dynamics"] * (4 * D) + ["region"] * F + ["motion"] * len(motion) + ["input"] * boxed + ["slack"] * 2
        self.row_scale = np.tile([_ROW_SCALE[name] if scaled else 1.0 for name in names], n)
        self.l, self.u = np.tile(low, n) * self.row_scale, np.tile(high, n) * self.row_scale
        self._assemble(stage, back)

    def _assemble(self, stage: Array, back: Array) -> None:
        hz = self.horizon
        n, D, F = hz.n_tau, hz.axes, hz.faces
        rows, columns, values = [], [], []
        for h in range(n):
            for block, shift in ((stage, 0), (back, -1)):
                if h + shift < 0:
                    continue
                i, j = np.nonzero(block)
                rows.append(h * self.height + i)
                columns.append((h + shift) * self.width + j)
                values.append(block[i, j])
        row, column, value = np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
        shape = (n * self.height, n * self.width)
        # Numbers instead of values first, so that the place of every entry in the column order is known.
        order = sp.csc_array((np.arange(1.0, len(value) + 1), (row, column)), shape=shape)
        order.sort_indices()
        source = order.data.astype(np.intp) - 1
        value = value * self.row_scale[row] * self.scale[column]
        self.A = sp.csc_array((value[source], order.indices, order.indptr), shape=shape)
        target = np.empty(len(source), dtype=np.intp)
        target[source] = np.arange(len(source))
        unset = np.flatnonzero(np.isnan(value))
        step, within = np.divmod(row[unset], self.height)
        place = np.empty((n, F, D), dtype=np.intp)
        place[step, within - 4 * D, column[unset] % self.width - D] = unset
        self.normals_at: Indices = target[place.ravel()]
        self._normals_scale = (self.row_scale[row] * self.scale[column])[place.ravel()]
        first = np.arange(n)[:, None] * self.height
        self._offsets_at = (first + 4 * D + np.arange(F)).ravel()
        self._desired_at = (np.arange(n)[:, None] * self.width + D + np.arange(D)).ravel()

    def update(self, tick: HorizonTick) -> None:
        """Put a tick's numbers into A, l, u and q."""
        hz = self.horizon
        D = hz.axes
        self.A.data[self.normals_at] = tick.normals.ravel() * self._normals_scale
        self.u[self._offsets_at] = tick.offsets.ravel() * self.row_scale[self._offsets_at]
        start = (hz.chain @ tick.state).ravel() * self.row_scale[: 4 * D]
        self.l[: 4 * D] = self.u[: 4 * D] = start
        self.q[self._desired_at] = -hz.weight * tick.desired.ravel() * self.scale[self._desired_at]

    def snap(self, unknowns: Array) -> Array:
        """Snap (n, D) of the solver's unknowns."""
        D = self.horizon.axes
        return np.asarray((unknowns * self.scale).reshape(-1, self.width)[:, :D])
