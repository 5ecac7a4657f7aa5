"""The plan in force: the MPC's own motion, slowed down along its path until it rests.

The MPC's plan p(s), s = 0 .. n dT, is flown at the rate s' = 1 - S(t / T), S(x) = 10 x^3 - 15 x^4 + 6 x^5:

    y(t) = p(s(t)),  y' = p' s',  y'' = p'' s'^2 + p' s'',  y''' = p''' s'^3 + 3 p'' s' s'' + p' s'''

S and two derivatives vanish at t = 0, so y continues p without a jump in position, velocity, acceleration or jerk;
s' vanishes with two derivatives at T, so y ends at rest. y visits only points of p: a stop leaves the regions
nowhere where the plan keeps them. It needs T / 2 of the plan; v s'' <= 1.875 v / T bounds what braking adds.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.control.lookup import slowed_progress

Array = NDArray[np.float64]

STEEPEST = 1.875  # of S
SHORTEST_S = 0.8  # s''' grows with v / T^2: a slow vehicle that stopped as fast as it could would be shaken


def _slowed(knots: Array, snap: Array, step_s: float, start_s: float, stop_s: float, times: Array, out: Array) -> None:
    """States (m, 12) of y at `times` (m,) from knots (n + 1, 12) and snap (n, 3); `start_s` is s at t = 0."""
    n = len(snap)
    for i in range(len(times)):
        x = min(max(times[i] / stop_s, 0.0), 1.0)
        s = start_s + stop_s * (x - 2.5 * x**4 + 3 * x**5 - x**6)
        rate = 1.0 - x**3 * (10 - 15 * x + 6 * x * x)
        rate_1 = -30 * x * x * (1 - x) ** 2 / stop_s
        rate_2 = -60 * x * (1 - x) * (1 - 2 * x) / stop_s**2
        piece = min(int(s / step_s), n - 1)
        t = s - piece * step_s
        for d in range(3):
            r, v, a, j = knots[piece, d], knots[piece, 3 + d], knots[piece, 6 + d], knots[piece, 9 + d]
            u = snap[piece, d]
            p1 = v + t * (a + t * (j / 2 + t * u / 6))
            p2 = a + t * (j + t * u / 2)
            out[i, d] = r + t * (v + t * (a / 2 + t * (j / 6 + t * u / 24)))
            out[i, 3 + d] = p1 * rate
            out[i, 6 + d] = p2 * rate * rate + p1 * rate_1
            out[i, 9 + d] = (j + t * u) * rate**3 + 3 * p2 * rate * rate_1 + p1 * rate_2


slowed: Callable[[Array, Array, float, float, float, Array, Array], None] = numba.njit(cache=True)(_slowed)


@dataclass(frozen=True)
class StopPlan:
    """Knots (n + 1, 12) and snap (n, 3) of an MPC plan of steps `step_s`, to be slowed down over `stop_s` from s = `start_s`."""

    knots: Array
    snap: Array
    step_s: float
    start_s: float
    stop_s: float

    def states(self, times_s: Array) -> Array:
        """States (m, 12) = r, v, a, j at times (m,) after the start; at rest from `stop_s` on."""
        out = np.empty((len(times_s), 12))
        slowed(self.knots, self.snap, self.step_s, self.start_s, self.stop_s, times_s, out)
        return out

    def progress(self, times_s: Array) -> tuple[Array, Array]:
        """s - `start_s` (m,) in seconds of the plan, and the rate s' (m,)."""
        return slowed_progress(times_s, self.stop_s)


def stop_along(knots: Array, snap: Array, step_s: float, start_s: float, brake_mps2: float) -> StopPlan:
    """The stop of a plan: as long as `brake_mps2` asks for at the plan's top speed, as far as the plan reaches."""
    longest = 2.0 * (len(snap) * step_s - start_s)
    speed = float(np.sqrt((knots[:, 3:6] ** 2).sum(axis=1).max()))
    stop_s = min(max(STEEPEST * speed / brake_mps2, SHORTEST_S), longest)
    return StopPlan(knots, snap, step_s, start_s, stop_s)


def straight_on(state: Array, brake_mps2: float) -> StopPlan:
    """The stop of a vehicle at `state` (12,), a = j = 0, that has no plan: along its velocity, at about `brake_mps2`."""
    stop_s = max(STEEPEST * float(np.linalg.norm(state[3:6])) / brake_mps2, SHORTEST_S)
    end = state.copy()
    end[:3] += stop_s / 2 * state[3:6]
    return StopPlan(np.stack([state, end]), np.zeros((1, 3)), stop_s / 2, 0.0, stop_s)


def standing(state: Array, step_s: float) -> StopPlan:
    """The plan of a vehicle that rests at `state` (12,): to stay there."""
    return StopPlan(np.tile(state, (2, 1)), np.zeros((1, 3)), step_s, 0.0, SHORTEST_S)
