"""What the dual active-set kernel (`dual_kernel`) works on from tick to tick: the rows it starts from and leaves."""

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.control.dual_kernel import dual_active_set
from sandwich_sitl.control.horizon import QUANTITIES, Horizon

Array = NDArray[np.float64]


class WorkingSet:
    """Rows (m, 3) = quantity, step, face with their multipliers, and the slack groups (2 n,) that are open.

    m is 6 n, or `given` where a caller puts in more rows than that, which it can with a short horizon.

    `edges` (4, 8, D) are the sides of the motion limits, `edge_count` (4,) in use; `rho` (2, 2) the penalties;
    `shares` (5 n, D) receives what the rows move the free answer by.
    """

    def __init__(self, horizon: Horizon, given: int = 0) -> None:
        self._horizon = horizon
        n, axes = horizon.n_tau, horizon.axes
        self.edges = np.zeros((4, 8, axes))
        self.edge_count = np.zeros(4, dtype=np.int64)
        for k, normals in enumerate(horizon.edges):
            self.edges[k, : len(normals)] = normals
            self.edge_count[k] = len(normals) if horizon.bounded[k] else 0
        self.rho = horizon.penalties
        most = max(6 * n, given)
        self.rows = np.full((most, 3), -1, dtype=np.int64)
        self.multipliers = np.zeros(most)
        self.opened = np.zeros(2 * n, dtype=np.int64)
        self.shares = np.empty((QUANTITIES * n, axes))

    def forget(self) -> None:
        """Begin from no row the next time."""
        self.rows[:, 0], self.opened[:] = -1, 0

    def solve(self, free: Array, normals: Array, offsets: Array, most_rounds: int) -> tuple[int, int]:
        """Rounds and working rows, from the set at hand; fewer rounds than none: not solved in so many."""
        return dual_active_set(
            free, self._horizon.table, normals, offsets, self.edges, self.edge_count, self.rho,
            self.rows, self.multipliers, self.opened, most_rounds, self.shares,
        )  # fmt: skip
