"""The own dual active-set solver behind the port: exact, warm, no matrix of a tick but that of its working rows."""

import numpy as np

from sandwich_sitl.control.horizon import SOLVED, Horizon, HorizonAnswer, HorizonTick
from sandwich_sitl.control.solvers.working_set import WorkingSet

_MOST_ROUNDS_A_STEP = 25  # a tick from flight takes one or two in all, one that no plan can mend up to 13 a step


class ActiveSetSolver:
    """Working set and multipliers of the last tick; compiled (or loaded from the cache) when it is built."""

    def __init__(self, horizon: Horizon) -> None:
        self._horizon = horizon
        self._set = WorkingSet(horizon)
        n, axes = horizon.n_tau, horizon.axes
        still = HorizonTick(
            np.zeros((4, axes)), np.zeros((n, axes)), np.zeros((n, horizon.faces, axes)), np.ones((n, horizon.faces))
        )
        self.solve(still)

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        """The exact answer, to 1e-8 m."""
        free = self._horizon.free(tick)
        if not self._horizon.sane(tick, free):
            return self._horizon.failed()
        most = _MOST_ROUNDS_A_STEP * self._horizon.n_tau
        rounds, working = self._set.solve(free, np.ascontiguousarray(tick.normals), tick.offsets, most)
        if rounds < 0:
            self._set.forget()
            return self._horizon.failed(-rounds)
        if not working:
            return self._horizon.free_answer(free)
        return self._horizon.answer(self._set.shares, tick, SOLVED, rounds)
