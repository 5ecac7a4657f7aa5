"""What the controller believes the vehicle does: the quadruple integrator driven by the commanded snap, corrected by
telemetry.

    x_hat' = A x_hat + B u,   then   r_hat += 2 w dt (r - r_hat),   v_hat += w^2 dt (r - r_hat) + 2 w dt (v - v_hat)

w is the bandwidth. Acceleration and jerk follow the command. A measurement is compared with the estimate at its own
time stamp, and a low bandwidth keeps noise and jumps of the estimate out of the command: steps enter at the rate w,
not at once.
"""

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.control.model import quadruple_integrator

Array = NDArray[np.float64]


class Observer:
    """State x_hat (12,) = [r, v, a, j], ENU SI, advanced every `period_s`."""

    def __init__(self, period_s: float, bandwidth_radps: float, r_m: Array) -> None:
        self._model = quadruple_integrator(period_s, "zoh")
        self._period_s, self._bandwidth = period_s, bandwidth_radps
        self.x = np.concatenate([r_m, np.zeros(9)])

    def advance(self, snap: Array) -> Array:
        """Predict one period ahead under `snap` (3,); returns the new state, which is also the next set-point."""
        self.x = self._model.A_p @ self.x + self._model.B_p @ snap
        return self.x

    def correct(self, r_m: Array, v_mps: Array, age_s: float) -> None:
        """Pull towards a measured position and velocity (3,) that is `age_s` old."""
        w, dt = self._bandwidth, self._period_s
        r_then = self.x[:3] - self.x[3:6] * age_s + self.x[6:9] * age_s**2 / 2
        v_then = self.x[3:6] - self.x[6:9] * age_s
        e_r, e_v = r_m - r_then, v_mps - v_then
        self.x[:3] += 2 * w * dt * e_r
        self.x[3:6] += w * w * dt * e_r + 2 * w * dt * e_v
