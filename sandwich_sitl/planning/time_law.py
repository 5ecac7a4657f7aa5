"""A time law along a curve under limits on speed and acceleration (notes N12).

Speed is limited by v_max and by the curve (v^2 kappa <= a_max / sqrt 2); a forward and a backward pass limit its
slope (v dv/ds <= a_max / sqrt 2); a moving average in time, which keeps ends and order, makes the acceleration
continuous. Last, time is stretched by whatever factor the sampled motion still exceeds a limit, so that the limits
hold by measurement, not by construction.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

Array = NDArray[np.float64]

_DS_M = 0.05
_AVERAGE_S = 0.4  # length of each of the two moving averages
_DT_S = 0.01


@dataclass(frozen=True)
class TimedCurve:
    """Position (n, 2) at times `t_s` (n,), uniformly `_DT_S` apart before the last stretch."""

    t_s: Array
    xy_m: Array

    def at(self, t: Array) -> Array:
        """Positions (m, 2) at times (m,), held at both ends; a quintic through the samples."""
        spline = make_interp_spline(self.t_s, self.xy_m, k=5)
        return np.asarray(spline(np.clip(t, self.t_s[0], self.t_s[-1])))


def rest_to_rest(curve: BSpline, speed_mps: float, acceleration_mps2: float) -> TimedCurve:
    """Fly the whole curve from rest to rest."""
    end = float(curve.t[-1])
    s = np.linspace(0.0, end, max(16, int(np.ceil(end / _DS_M)) + 1))
    t_of_s = _times(s, _speeds(curve, s, speed_mps, acceleration_mps2 / np.sqrt(2)))
    window = max(1, round(_AVERAGE_S / _DT_S))
    t = np.arange(0.0, t_of_s[-1] + _DT_S, _DT_S)
    arc = np.interp(t, t_of_s, s)
    for _ in range(2):
        padded = np.concatenate([np.zeros(window), arc, np.full(window, end)])
        arc = np.convolve(padded, np.ones(window) / window, mode="valid")
    arc = np.clip(arc, 0.0, end)
    xy = np.asarray(curve(arc))
    t = np.arange(len(xy), dtype=np.float64) * _DT_S
    velocity = np.gradient(xy, t, axis=0)
    acceleration = np.gradient(velocity, t, axis=0)
    stretch = max(
        1.0,
        float(np.hypot(*velocity.T).max()) / speed_mps,
        float(np.sqrt(np.hypot(*acceleration.T).max() / acceleration_mps2)),
    )
    return TimedCurve(t * stretch, xy)


def _speeds(curve: BSpline, s: Array, v_max: float, a_max: float) -> Array:
    d1, d2 = curve.derivative(1)(s), curve.derivative(2)(s)
    curvature = np.abs(d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / np.maximum(np.hypot(*d1.T), 1e-9) ** 3
    v = np.asarray(np.minimum(v_max, np.sqrt(a_max / np.maximum(curvature, 1e-9))))
    v[0] = v[-1] = 0.0
    step = 2 * a_max * np.diff(s)
    for k in range(1, len(v)):
        v[k] = min(v[k], np.sqrt(v[k - 1] ** 2 + step[k - 1]))
    for k in range(len(v) - 2, -1, -1):
        v[k] = min(v[k], np.sqrt(v[k + 1] ** 2 + step[k]))
    return v


def _times(s: Array, v: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(2 * np.diff(s) / (v[:-1] + v[1:]))])


def climb(height_m: float, speed_mps: float, acceleration_mps2: float, dt_s: float) -> Array:
    """Heights (n,) every `dt_s` of a minimum-jerk climb from 0 to `height_m` within both limits.

    Peaks of the minimum-jerk polynomial: speed 15/8 h/T, acceleration 10/sqrt(3) h/T^2.
    """
    duration = max(15 / 8 * height_m / speed_mps, np.sqrt(10 / np.sqrt(3) * height_m / acceleration_mps2))
    steps = int(np.ceil(duration / dt_s))
    tau = np.arange(steps + 1) / steps
    return np.asarray(height_m * tau**3 * (10 - 15 * tau + 6 * tau**2))
