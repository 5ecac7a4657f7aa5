"""Most ticks have no active row: then the optimum without rows is the optimum, and no solver is asked."""

import numpy as np

from sandwich_sitl.control.horizon import Horizon, HorizonAnswer, HorizonSolver, HorizonTick


class IdleRowsFirst:
    """Asks `solver` only when the closed-form optimum breaks a row."""

    def __init__(self, horizon: Horizon, solver: HorizonSolver) -> None:
        self._horizon, self._solver = horizon, solver

    def solve(self, tick: HorizonTick) -> HorizonAnswer:
        """The closed form where it keeps every row, else the solver's answer."""
        horizon = self._horizon
        shares = horizon.free(tick)
        outside, beyond = horizon.excesses(shares, tick)
        inputs = shares[4 * horizon.n_tau :] @ horizon.edges[3].T
        too_much = bool(horizon.bounded[3]) and float(inputs.max()) > 1.0
        # Comparisons with nan are false, so that a tick with one goes on to the solver, which says FAILED.
        if outside.max() <= 0.0 and beyond.max() <= 0.0 and not too_much and np.isfinite(shares).all():
            return horizon.free_answer(shares)
        return self._solver.solve(tick)
