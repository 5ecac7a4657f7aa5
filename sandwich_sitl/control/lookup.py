"""Looking a plan's times up, compiled: arrays of a few dozen numbers, where every numpy call costs more than its work.

`between` interpolates a table with even time steps, `resumed` is the reference clock's sigma(t), `slowed_progress` the
progress of a plan that is slowed down to a stop, `drifting` the estimator's offset to come and `carried_on` its command
of a moment; the equations stand where they are used.
"""

from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def _between(t_s: Array, period_s: float, table: Array, label: Indices) -> tuple[Array, Indices]:
    values, labels = np.empty((len(t_s), table.shape[1])), np.empty(len(t_s), dtype=np.int64)
    last = len(table) - 1
    for i in range(len(t_s)):
        at = min(max(t_s[i] / period_s, 0.0), float(last))
        below = min(int(at), last - 1)
        share = at - below
        for axis in range(table.shape[1]):
            values[i, axis] = (1 - share) * table[below, axis] + share * table[below + 1, axis]
        labels[i] = label[int(np.rint(at))]
    return values, labels


def _resumed(times_s: Array, t_s: float, rate: float, slope: float) -> Array:
    sigma = np.empty(len(times_s))
    ramp_s = (1.0 - rate) / slope
    for i in range(len(times_s)):
        t = min(max(times_s[i], 0.0), ramp_s)
        sigma[i] = t_s + rate * times_s[i] + slope * t * (times_s[i] - t / 2)
    return sigma


def _slowed_progress(times_s: Array, stop_s: float) -> tuple[Array, Array]:
    s, rate = np.empty(len(times_s)), np.empty(len(times_s))
    for i in range(len(times_s)):
        x = min(max(times_s[i] / stop_s, 0.0), 1.0)
        s[i] = stop_s * (x - 2.5 * x**4 + 3 * x**5 - x**6)
        rate[i] = 1.0 - x**3 * (10 - 15 * x + 6 * x * x)
    return s, rate


def _drifting(times_s: Array, error: Array, drift_s: float, limit_m: float) -> Array:
    offset = np.empty((len(times_s), 3))
    for i in range(len(times_s)):
        drift = drift_s * (1.0 - np.exp(-times_s[i] / drift_s))
        for d in range(3):
            offset[i, d] = error[0, d] + drift * error[1, d]
        size = np.sqrt(offset[i, 0] * offset[i, 0] + offset[i, 1] * offset[i, 1] + offset[i, 2] * offset[i, 2])
        share = limit_m / max(size, limit_m)
        for d in range(3):
            offset[i, d] *= share
    return offset


def _carried_on(t_s: float, times_s: Array, states: Array, newest: int, longest_s: float) -> Array:
    back = newest
    for _ in range(len(times_s) - 1):
        if times_s[back] <= t_s:
            break
        back = (back - 1) % len(times_s)
    dt = min(max(0.0, t_s - times_s[back]), longest_s)
    moved = np.empty(12)
    for d in range(3):
        r, v, a, j = states[back, d], states[back, 3 + d], states[back, 6 + d], states[back, 9 + d]
        moved[d] = r + dt * (v + dt * (a / 2 + dt * j / 6))
        moved[3 + d] = v + dt * (a + dt * j / 2)
        moved[6 + d], moved[9 + d] = a + dt * j, j
    return moved


#: Values (n, d) and labels (n,) of `table` (K, d) and `label` (K,), a row every `period_s`, at times (n,), held at both ends.
between: Callable[[Array, float, Array, Indices], tuple[Array, Indices]] = numba.njit(cache=True)(_between)
#: sigma (n,) at times (n,) from now, from sigma, its rate, and the slope of the rate towards one.
resumed: Callable[[Array, float, float, float], Array] = numba.njit(cache=True)(_resumed)
#: Seconds of the plan (n,) and rate (n,) at times (n,) after a stop of `stop_s` began.
slowed_progress: Callable[[Array, float], tuple[Array, Array]] = numba.njit(cache=True)(_slowed_progress)
#: Offset (n, 3) at times (n,) from now, of an error (>= 2, 3) that drifts on at its speed for about `drift_s`, at most `limit_m` long.
drifting: Callable[[Array, Array, float, float], Array] = numba.njit(cache=True)(_drifting)
#: State (12,) at `t_s` of a ring of states (K, 12) sent at times (K,): the newest not after it, carried on by at most `longest_s`.
carried_on: Callable[[float, Array, Array, int, float], Array] = numba.njit(cache=True)(_carried_on)
