"""Braking to rest along a straight line.

State: none; input: position and velocity at the start, deceleration. With t_b = |v0| / d and direction u = v0 / |v0|:
r(t) = r0 + v0 t - d u t^2 / 2 for t < t_b, then rest at r0 + v0 t_b / 2. Metres, seconds, any one inertial frame.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BrakeProfile:
    """Constant deceleration `decel_mps2` > 0 from `r0_m` (3,) and `v0_mps` (3,) to rest, then hold."""

    r0_m: Vector
    v0_mps: Vector
    decel_mps2: float

    @property
    def duration_s(self) -> float:
        """Time until rest."""
        return float(np.linalg.norm(self.v0_mps)) / self.decel_mps2

    def at(self, t_s: float) -> tuple[Vector, Vector, Vector]:
        """Position, velocity and acceleration, each (3,), at `t_s` >= 0 after the start."""
        duration_s = self.duration_s
        if t_s >= duration_s:
            return self.r0_m + 0.5 * duration_s * self.v0_mps, np.zeros(3), np.zeros(3)
        a_mps2 = -self.v0_mps / duration_s
        return self.r0_m + t_s * self.v0_mps + 0.5 * t_s**2 * a_mps2, self.v0_mps + t_s * a_mps2, a_mps2
