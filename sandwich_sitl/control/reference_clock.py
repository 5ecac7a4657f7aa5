"""The reference's own time sigma: it runs with the run's clock, but for stops.

    sigma' = rate,    rate' = slope towards 1,    slope = 1.5 m/s^2 / max(v, 0.5 m/s)

A plan that is slowed down to a stop takes the rate down with it; afterwards the rate comes back no faster than the
slope, so that speeding up costs no more than that acceleration, v being the speed of the reference at rate 1.
"""

from collections.abc import Callable
from copy import copy

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.control.lookup import resumed

Array = NDArray[np.float64]

_PUSH_MPS2 = 1.5
_SLOWEST_MPS = 0.5


class ReferenceClock:
    """`t_s` is sigma, `rate` its slope."""

    def __init__(self, t_s: float) -> None:
        self.t_s, self.rate = t_s, 1.0
        self._slope = _PUSH_MPS2 / _SLOWEST_MPS

    def advance(self, dt_s: float, speed_mps: float) -> None:
        """One tick of `dt_s`, where the reference at rate 1 has `speed_mps`."""
        self._slope = _PUSH_MPS2 / max(speed_mps, _SLOWEST_MPS)
        self.t_s = float(self.ahead(np.array([dt_s]))[0])
        self.rate = min(1.0, self.rate + self._slope * dt_s)

    def follow(self, t_s: float, rate: float) -> None:
        """Be where a stopping plan is."""
        self.t_s, self.rate = t_s, rate

    def frozen(self) -> Callable[[Array], Array]:
        """`ahead` as of now, whatever becomes of this clock."""
        return copy(self).ahead

    def ahead(self, times_s: Array) -> Array:
        """sigma (n,) at times (n,) from now on."""
        return resumed(times_s, self.t_s, self.rate, self._slope)
