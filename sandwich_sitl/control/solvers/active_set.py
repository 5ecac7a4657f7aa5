"""The own dual active-set solver behind the port: exact, warm, no matrix of a tick but that of its working rows."""

import numpy as np

from sandwich_sitl.control.dual_kernel import dual_active_set
from sandwich_sitl.control.horizon import (
    MOTION_PENALTY,
    QUANTITIES,
    REGION_PENALTY,
    SOLVED,
    Horizon,
    HorizonAnswer,
    HorizonTick,
)

_MOST_ROUNDS_A_STEP = 25  # a tick from flight takes one or two in all, one that no plan can mend a few a step


class ActiveSetSolver:
    """Working set and multipliers of the last tick; compiled (or loaded from the cache) when it is built."""

    def __init__(self, horizon: Horizon) -> None:
        self._horizon = horizon
        n, axes = horizon.n_tau, horizon.axes
        self._edges = np.zeros((4, 8, axes))
        self._edge_count = np.zeros(4, dtype=np.int64)
        for k, normals in enumerate(horizon.edges):
            self._edges[k, : len(normals)] = normals
            self._edge_count[k] = len(normals) if horizon.bounded[k] else 0
        self._rho = np.array([REGION_PENALTY, MOTION_PENALTY])
        self._rows = np.full((6 * n, 3), -1, dtype=np.int64)
        self._multipliers = np.zeros(6 * n)
        self._opened = np.zeros(2 * n, dtype=np.int64)
        self._shares = np.empty((QUANTITIES * n, axes))
        still = HorizonTick(
            np.zeros((4, axes)), np.zeros((n, axes)), np.zeros((n, horizon.faces, axes)), np.ones((n, horizon.faces))
        )
        self.solve(still)

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        """The exact answer, to 1e-8 m."""
        free = self._horizon.free(tick)
        if not self._horizon.sane(tick, free):
            return self._horizon.failed()
        rounds, working = dual_active_set(
            free, self._horizon.table, np.ascontiguousarray(tick.normals), tick.offsets, self._edges, self._edge_count,
            self._rho, self._rows, self._multipliers, self._opened, _MOST_ROUNDS_A_STEP * self._horizon.n_tau, self._shares,
        )  # fmt: skip
        if rounds < 0:
            self._rows[:, 0] = -1
            self._opened[:] = 0
            return self._horizon.failed(-rounds)
        if not working:
            return self._horizon.free_answer(free)
        return self._horizon.answer(self._shares, tick, SOLVED, rounds)
