"""What the vehicle does, seen beside what it was told: its motion, its offset and its delay from telemetry.

The autopilot's own loops make the vehicle follow its set-points c after a delay tau, up to an error e that wind, drag
and model errors leave:  r(t) = c(t - tau) + e(t).  Error and delay are estimated:

    error    e- = A e,  e+ = e- + L ([r, v] - c(t - tau) - [e-_r, e-_v]),   e = [e_r, e_v, e_a, e_j]:  A is the integrator
             chain over the time since the last measurement and L the steady Kalman gain, for measurements that far
             apart, of that chain driven by white snap. (I - L C) A has its poles near w however far apart they come.
             The vehicle's r, v, a, j are c(t - tau) + e
    delay    tau' = -kappa (v - c'(t - tau)) . a / (1 + a . a)    a late vehicle is slow while it speeds up; a steady
             error has no velocity, so wind is not mistaken for delay. Horizontal axes, 0 <= tau <= 0.3 s

What is aimed off is the error to come,  o(t) = e_r + T (1 - exp(-t / T)) e_v:  a vehicle that wind has begun to move
moves on, until the autopilot stops it after about T. Without e_v the correction comes after the error; e_a and e_j
carry e_v over the gust without lag and say nothing more about the time after T, so they end here and in the log.

Telemetry comes at its own rate, so A and L are tabulated by ticks. An error is carried as it moves from one measurement
to the next where that is how they usually come; after a gap only its place is believed.

A measurement is compared with the command at its own time stamp. Nothing here writes into the command: a jump of the
estimate moves the controller's aim at the rate w, and the command follows as smoothly as the plant model does. For the
same reason the plan starts from the command and not from the vehicle's estimated motion, which carries the noise of
its sensors into every derivative.
"""

from functools import lru_cache
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from sandwich_sitl.config import TrackingConfig
from sandwich_sitl.control.lookup import carried_on, drifting
from sandwich_sitl.control.model import quadruple_integrator

Array = NDArray[np.float64]

STALE_S = 0.5  # age at which a measurement says nothing any more
_MOST_DELAY_S = 0.3
_FIRST_DELAY_S = 0.06  # a multicopter's attitude loop, until its delay has been seen
_DRIFT_S = 0.12  # T
_GAP_S = 0.1  # a pause in the measurements no longer than this is no gap,
_GAP_RATIO = 1.5  # nor one no longer than this many times the one before:
_CARRIED_S = 0.25  # but after a longer one only the place of the error is believed, however usual it is
_FASTEST_RAD = 3.0  # from one measurement to the next: a filter told to be faster rings with their period
_DELAY_GAIN = 0.5  # kappa


def kalman_gain(interval_s: float, bandwidth_radps: float) -> Array:
    """L (4, 2) for r and v of one axis, measured every `interval_s`; (I - L C) A has poles of radius `bandwidth_radps`.

    Both white densities are held, w^8 of the snap and 1 of the noise of r (w^2 of v), so that the poles stay where they
    are for any interval: snap held for T has the variance w^8 / T, a measurement every T the variance 1 / T, and their
    common factor 1 / T is left out. Poles faster than `_FASTEST_RAD` an interval are not to be had.
    """
    model = quadruple_integrator(interval_s, "zoh")
    A, B = model.A_p[::3, ::3], model.B_p[::3, :1]
    C = np.eye(4)[:2]
    w = min(bandwidth_radps, _FASTEST_RAD / interval_s)
    noise = np.diag([1.0, w**2])
    P = solve_discrete_are(A.T, C.T, B @ B.T * w**8 + 1e-12 * np.eye(4), noise)
    return np.asarray(P @ C.T @ np.linalg.inv(C @ P @ C.T + noise))


@lru_cache(maxsize=8)
def steps_of(period_s: float, bandwidth_radps: float) -> tuple[tuple[Array, Array], ...]:
    """A (4, 4) and L (4, 2) for a measurement 1, 2, ... ticks of `period_s` after the last one, to `_CARRIED_S` or one.

    Remembered, because a vehicle in flight does not wait for the estimate of a second start.
    """
    intervals_s = [m * period_s for m in range(1, max(1, round(_CARRIED_S / period_s)) + 1)]
    return tuple(
        (quadruple_integrator(dt, "zoh").A_p[::3, ::3], kalman_gain(dt, bandwidth_radps)) for dt in intervals_s
    )


class VehicleEstimator:
    """State: commands sent in the last seconds, `delay_s`, the error. Times of one run clock, ENU SI. `motion` (12,) is
    the vehicle's estimated r, v, a, j at the time of the last measurement.
    """

    def __init__(self, config: TrackingConfig, period_s: float, t_s: float, state: Array) -> None:
        """Starts with `state` (12,) as the command that has been in force up to `t_s`."""
        self._config, self._period_s = config, period_s
        self.delay_s = _FIRST_DELAY_S if config.delay_s is None else config.delay_s
        self._steps = steps_of(period_s, config.motion_radps)
        self._error = np.zeros((4, 3))
        self._kept = ceil((STALE_S + _MOST_DELAY_S) / period_s) + 2  # commands that can still be asked for
        self._times = np.full(self._kept, t_s)
        self._states = np.tile(state, (self._kept, 1))
        self._newest = 0
        self._measured_s, self._last_dt_s = -np.inf, period_s
        self.motion = state.copy()

    def restarted(self, t_s: float, state: Array) -> "VehicleEstimator":
        """A new estimate of a vehicle that seems to have followed `state` (12,) at its speed up to `t_s`: the delay and
        the place of the error are kept.
        """
        fresh = VehicleEstimator(self._config, self._period_s, t_s, state)
        fresh.delay_s = self.delay_s
        fresh._error[0] = self._error[0]
        ago_s = self._period_s * np.arange(self._kept)[::-1]
        fresh._times, fresh._newest = t_s - ago_s, self._kept - 1
        fresh._states[:, :3] -= ago_s[:, None] * state[3:6]
        return fresh

    @property
    def offset_m(self) -> Array:
        """What is aimed off (3,) now."""
        return np.asarray(self.offset_ahead(np.zeros(1))[0])

    def offset_ahead(self, times_s: Array) -> Array:
        """What is to be aimed off (n, 3) at times (n,) >= 0 from the last measurement, at most `offset_limit_m` long."""
        return drifting(times_s, self._error, _DRIFT_S, self._config.offset_limit_m)

    def commanded(self, t_s: float, state: Array) -> None:
        """Remember what was sent: `state` (12,) at `t_s`."""
        self._newest = (self._newest + 1) % self._kept
        self._times[self._newest], self._states[self._newest] = t_s, state

    def command_at(self, t_s: float) -> Array:
        """The command (12,) in force at `t_s`: the newest not after it, carried on without snap."""
        return carried_on(t_s, self._times, self._states, self._newest, 2 * self._period_s)

    def measure(self, now_s: float, measured_s: float, r_m: Array, v_mps: Array) -> bool:
        """Take in position and velocity (3,) of time `measured_s`; false when there is nothing to go by.

        A measurement that came before is not taken in twice.
        """
        if not (np.isfinite(r_m).all() and np.isfinite(v_mps).all()) or now_s - measured_s > STALE_S:
            return False
        if measured_s <= self._measured_s:
            return True
        dt = self._period_s if self._measured_s < 0 else min(measured_s - self._measured_s, STALE_S)
        self._measured_s = measured_s
        command = self.command_at(measured_s - self.delay_s)
        error = np.stack([r_m, v_mps]) - command[:6].reshape(2, 3)
        self._learn_delay(error[1, :2], command[6:8], dt)
        self._correct(error, dt)
        self.motion = command + self._error.ravel()
        return True

    def _correct(self, measured: Array, dt: float) -> None:
        """The error, by what was `measured` (2, 3) of it, r and v, `dt` seconds after the last time.

        What comes after a gap weighs no more than what came before it: one late measurement does not move the aim.
        """
        is_gap = dt > max(_GAP_S, _GAP_RATIO * self._last_dt_s) or round(dt / self._period_s) > len(self._steps)
        ticks = max(1, round((self._last_dt_s if is_gap else dt) / self._period_s))
        chain, gain = self._steps[min(ticks, len(self._steps)) - 1]
        if is_gap:
            self._error[1:] = 0.0
        else:
            self._error = chain @ self._error
        self._error = self._error + gain @ (measured - self._error[:2])
        self._last_dt_s = dt

    def _learn_delay(self, slow_mps: Array, a_mps2: Array, dt: float) -> None:
        if self._config.delay_s is not None:
            return
        change = -_DELAY_GAIN * dt * float(slow_mps @ a_mps2) / (1.0 + float(a_mps2 @ a_mps2))
        self.delay_s = min(max(self.delay_s + change, 0.0), _MOST_DELAY_S)
