"""What the vehicle does, seen beside what it was told: its motion, its offset and its delay from telemetry.

The autopilot's own loops make the vehicle follow its set-points c after a delay tau, up to an error e that wind, drag
and model errors leave:  r(t) = c(t - tau) + e(t).  Error and delay are estimated:

    error    e+ = A e + L ([r, v] - c(t - tau) - [e_r, e_v]),   e = [e_r, e_v, e_a, e_j]:  L is the steady Kalman gain of
             the integrator chain driven by white snap, with poles near w. The vehicle's r, v, a, j are c(t - tau) + e
    delay    tau' = -kappa (v - c'(t - tau)) . a / (1 + a . a)    a late vehicle is slow while it speeds up; a steady
             error has no velocity, so wind is not mistaken for delay. Horizontal axes, 0 <= tau <= 0.3 s

What is aimed off is the error to come,  o(t) = e_r + T (1 - exp(-t / T)) e_v:  a vehicle that wind has begun to move
moves on, until the autopilot stops it after about T. Without e_v the correction comes after the error; e_a and e_j
carry e_v over the gust without lag and say nothing more about the time after T, so they end here and in the log.

A measurement is compared with the command at its own time stamp. Nothing here writes into the command: a jump of the
estimate moves the controller's aim at the rate w, and the command follows as smoothly as the plant model does. For the
same reason the plan starts from the command and not from the vehicle's estimated motion, which carries the noise of
its sensors into every derivative.
"""

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
_GAP_S = 0.1  # without measurements for longer, only the place of the error is still believed
_DELAY_GAIN = 0.5  # kappa
_KEPT = 128  # commands remembered


def kalman_gain(period_s: float, bandwidth_radps: float) -> Array:
    """L (4, 2) for measured r and v of one axis; the weights make the poles those of radius `bandwidth_radps`."""
    model = quadruple_integrator(period_s, "zoh")
    A, B = model.A_p[::3, ::3], model.B_p[::3, :1]
    C = np.eye(4)[:2]
    w = bandwidth_radps
    drive = B @ B.T * (w**8 / period_s**2) * period_s**2
    noise = np.diag([1.0, w**2])
    P = solve_discrete_are(A.T, C.T, drive + 1e-12 * np.eye(4), noise)
    return np.asarray(A @ P @ C.T @ np.linalg.inv(C @ P @ C.T + noise))


class VehicleEstimator:
    """State: commands sent in the last seconds, `delay_s`, the error. Times of one run clock, ENU SI. `motion` (12,) is
    the vehicle's estimated r, v, a, j at the time of the last measurement.
    """

    def __init__(self, config: TrackingConfig, period_s: float, t_s: float, state: Array) -> None:
        """Starts with `state` (12,) as the command that has been in force up to `t_s`."""
        self._config, self._period_s = config, period_s
        self.delay_s = _FIRST_DELAY_S if config.delay_s is None else config.delay_s
        self._chain = quadruple_integrator(period_s, "zoh").A_p[::3, ::3]
        self._gain = kalman_gain(period_s, config.motion_radps)
        self._error = np.zeros((4, 3))
        self._times = np.full(_KEPT, t_s)
        self._states = np.tile(state, (_KEPT, 1))
        self._newest = 0
        self._measured_s = -np.inf
        self.motion = state.copy()

    def restarted(self, t_s: float, state: Array) -> "VehicleEstimator":
        """A new estimate of a vehicle that seems to have followed `state` (12,) at its speed up to `t_s`: the delay and
        the place of the error are kept.
        """
        fresh = VehicleEstimator(self._config, self._period_s, t_s, state)
        fresh.delay_s = self.delay_s
        fresh._error[0] = self._error[0]
        ago_s = self._period_s * np.arange(_KEPT)[::-1]
        fresh._times, fresh._newest = t_s - ago_s, _KEPT - 1
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
        self._newest = (self._newest + 1) % _KEPT
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
        self._carry(dt)
        self._error = self._error + self._gain @ (error - self._error[:2])
        self.motion = command + self._error.ravel()
        return True

    def _carry(self, dt: float) -> None:
        """The error from the last measurement to this one."""
        if dt > _GAP_S:
            self._error[1:] = 0.0
            return
        for _ in range(max(1, round(dt / self._period_s))):
            self._error = self._chain @ self._error

    def _learn_delay(self, slow_mps: Array, a_mps2: Array, dt: float) -> None:
        if self._config.delay_s is not None:
            return
        change = -_DELAY_GAIN * dt * float(slow_mps @ a_mps2) / (1.0 + float(a_mps2 @ a_mps2))
        self.delay_s = min(max(self.delay_s + change, 0.0), _MOST_DELAY_S)
