"""A time law along a curve under limits on speed, acceleration, jerk and snap; the paper leaves the timing open.

The fastest law under the first two limits alone comes from a forward and a backward pass over the curve: the speed's
slope may use what turning leaves of the acceleration,  |a|^2 = (v^2 kappa)^2 + (v dv/ds)^2 <= a_max^2  (the numerical
integration of time-optimal path following). Two moving averages in time turn its steps of acceleration into ramps of
jerk: positions become C^3, jerk and snap bounded. Where the motion, differentiated, still exceeds a limit, speeds and
accelerations near that place are lowered and the passes repeated; of all rounds the one that is shortest after
stretching time by its largest excess is kept. So the limits hold by measurement, not by construction.

State: path parameter u (metres along the curve's parameter), its derivatives in time, seconds.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

Array = NDArray[np.float64]

_DU_M = 0.05
_DT_S = 0.01
_ROUNDS = 14
_ARRIVED_M = 1e-9
_CLOSE = 1.002  # an excess this small is left to stretching
_TOLERATED = 1.01  # of a law that cannot be stretched
_GAIN = 0.7  # share of an excess that one round takes away
_LAST = 4  # samples of a last, short average: steps of snap would make the spline through the samples ring
_FILTER = 1.0  # lengths of the averages in a_max / j_max and j_max / s_max


@dataclass(frozen=True)
class Limits:
    """Largest norms of velocity, acceleration, jerk and snap."""

    speed_mps: float
    acceleration_mps2: float
    jerk_mps3: float
    snap_mps4: float

    def excess(self, v: Array, a: Array, j: Array, s: Array) -> Array:
        """Factor (n,) by which time must stretch at each sample: 1 where one limit is just met. Inputs (n, d)."""
        norms = [np.sqrt((x * x).sum(axis=1)) for x in (v, a, j, s)]
        limits = self.speed_mps, self.acceleration_mps2, self.jerk_mps3, self.snap_mps4
        ratios = [(norm / limit) ** (1 / k) for k, (norm, limit) in enumerate(zip(norms, limits, strict=True), start=1)]
        return np.asarray(np.max(ratios, axis=0))


@dataclass(frozen=True)
class TimedCurve:
    """A curve flown by u(t): `progress` is a C^4 spline of t with values in the curve's parameter."""

    curve: BSpline
    progress: BSpline
    duration_s: float

    def at(self, t: Array) -> Array:
        """Positions (m, d) at times (m,), held at both ends."""
        return np.asarray(self.curve(self._u(t)))

    def sampled(self, dt_s: float) -> Array:
        """Positions (n, d) every `dt_s`, the last one at rest at the end."""
        return self.at(np.arange(int(np.ceil(self.duration_s / dt_s)) + 1, dtype=np.float64) * dt_s)

    def derivatives(self, t: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Position, velocity, acceleration, jerk and snap (m, d) at times (m,) inside [0, duration]."""
        u = [np.asarray(self.progress.derivative(order)(t)) for order in range(1, 5)]
        c = [np.asarray(self.curve.derivative(order)(self._u(t))) for order in range(1, 5)]
        return (self.at(t), *_chain(c, u))

    def _u(self, t: Array) -> Array:
        low, high = float(self.curve.t[0]), float(self.curve.t[-1])
        return np.asarray(np.clip(self.progress(np.clip(t, 0.0, self.duration_s)), low, high))


def fly(curve: BSpline, limits: Limits, cap_mps: Array | None = None, start: tuple[float, float, float] | None = None,
) -> TimedCurve | None:  # fmt: skip
    """The law along the whole curve, to rest, from rest or from du/dt, d2u/dt2, d3u/dt3 `start`.

    `cap_mps` caps the speed at parameters evenly spread over the curve. A start that moves cannot be stretched: None
    when the limits cannot be kept from there.
    """
    grid = _Grid(curve, cap_mps)
    lowered = np.ones(len(grid.u))
    windows = _windows(limits)
    half = sum(windows) // 2 + 1
    best: tuple[float, float, Array] | None = None
    moving = start is not None and start[0] > 0.0
    for _ in range(_ROUNDS):
        progress = _progress(grid, limits, lowered, windows, start)
        excess = limits.excess(*_chain([np.column_stack([np.interp(progress[0], grid.u, x) for x in d.T])
                                        for d in grid.derivatives], progress[1:]))  # fmt: skip
        if (np.diff(progress[0]) < -1e-9).any():
            excess = np.maximum(excess, 1.2)
        if cap_mps is not None:
            speed = np.abs(progress[1]) * np.interp(progress[0], grid.u, grid.rate)
            excess = np.maximum(excess, speed / np.interp(progress[0], grid.u, grid.cap))
        worst = float(excess.max())
        duration = (len(progress[0]) - 1) * _DT_S
        cost = duration + 1e3 * max(0.0, worst - 1.0) if moving else duration * max(1.0, worst)
        if best is None or cost < best[0]:
            best = cost, worst, progress[0]
        near = _average(_widest(np.pad(excess, half, mode="edge"), 2 * half), 2 * half + 1)
        at_grid = np.interp(grid.u, np.maximum.accumulate(progress[0]), near)
        if worst <= _CLOSE:
            break
        lowered = np.clip(lowered * np.maximum(at_grid, 0.9) ** -_GAIN, 0.05, 1.0)
    assert best is not None
    _, worst, u = best
    if moving and worst > _TOLERATED:
        return None
    stretch = 1.0 if moving else max(1.0, worst)
    t = np.arange(len(u), dtype=np.float64) * _DT_S * stretch
    return TimedCurve(curve, make_interp_spline(t, u, k=5), float(t[-1]))


def least_duration_s(curve: BSpline, limits: Limits, cap_mps: Array | None = None) -> float:
    """Duration of the fastest law from rest to rest under the limits on speed and acceleration alone."""
    grid = _Grid(curve, cap_mps)
    return float(_times(grid, _speeds(grid, limits, np.ones(len(grid.u)), 0.0))[-1])


class _Grid:
    """The curve's derivatives on an even grid of its parameter."""

    def __init__(self, curve: BSpline, cap_mps: Array | None) -> None:
        end = float(curve.t[-1])
        self.u = np.linspace(0.0, end, max(16, int(np.ceil(end / _DU_M)) + 1))
        self.derivatives = [
            np.asarray(curve.derivative(order)(self.u)).reshape(len(self.u), -1) for order in range(1, 5)
        ]
        d1, d2 = self.derivatives[:2]
        self.rate = np.maximum(np.sqrt((d1 * d1).sum(axis=1)), 1e-9)
        along = (d1 * d2).sum(axis=1) / self.rate**2
        across = d2 - along[:, None] * d1
        self.curvature = np.sqrt((across * across).sum(axis=1)) / self.rate**2
        if cap_mps is None:
            self.cap = np.full(len(self.u), np.inf)
        else:
            self.cap = np.interp(self.u, np.linspace(0.0, end, len(cap_mps)), cap_mps)


def _windows(limits: Limits) -> tuple[int, int]:
    first = _FILTER * limits.acceleration_mps2 / limits.jerk_mps3
    second = _FILTER * limits.jerk_mps3 / limits.snap_mps4
    return max(1, round(first / _DT_S)), max(1, round(second / _DT_S))


def _speeds(grid: _Grid, limits: Limits, lowered: Array, first_mps: float) -> Array:
    """Speed |dc/dt| at every grid point."""
    a_max = limits.acceleration_mps2 * lowered**2
    cap = np.minimum(np.minimum(limits.speed_mps * lowered, grid.cap * lowered),
                     np.sqrt(a_max / np.maximum(grid.curvature, 1e-9)))  # fmt: skip
    step = np.diff(grid.u) * (grid.rate[1:] + grid.rate[:-1]) / 2
    # A start that moves cannot be slower than braking makes it.
    travelled = np.concatenate([[0.0], np.cumsum(step)])
    cap = np.maximum(cap, np.sqrt(np.maximum(first_mps**2 - limits.acceleration_mps2 * travelled, 0.0)))
    return np.asarray(_passes(cap, grid.curvature, a_max, step, first_mps))


@njit(cache=True)
def _passes(cap: Array, curvature: Array, a_max: Array, step: Array, first: float) -> Array:
    v = cap.copy()
    v[0], v[-1] = first, 0.0
    for k in range(1, len(v)):
        turn = v[k - 1] ** 2 * curvature[k - 1]
        spare = np.sqrt(max(a_max[k - 1] ** 2 - turn * turn, 0.0))
        v[k] = min(v[k], np.sqrt(v[k - 1] ** 2 + 2 * spare * step[k - 1]))
    for k in range(len(v) - 2, -1, -1):
        turn = v[k + 1] ** 2 * curvature[k + 1]
        spare = np.sqrt(max(a_max[k + 1] ** 2 - turn * turn, 0.0))
        v[k] = min(v[k], np.sqrt(v[k + 1] ** 2 + 2 * spare * step[k]))
    return v


def _times(grid: _Grid, v: Array) -> Array:
    length = np.diff(grid.u) * (grid.rate[1:] + grid.rate[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(2 * length / np.maximum(v[:-1] + v[1:], 1e-9))])


def _progress(
    grid: _Grid, limits: Limits, lowered: Array, windows: tuple[int, int], start: tuple[float, float, float] | None
) -> list[Array]:
    """u and its first four derivatives in time, every `_DT_S`: the raw law, averaged twice."""
    first_mps = 0.0 if start is None else start[0] * float(grid.rate[0])
    v = _speeds(grid, limits, lowered, first_mps)
    du = v / grid.rate
    t_grid = np.concatenate([[0.0], np.cumsum(2 * np.diff(grid.u) / np.maximum(du[:-1] + du[1:], 1e-9))])
    pad = sum(windows) + _LAST
    t = np.arange(-pad, int(np.ceil(t_grid[-1] / _DT_S)) + pad + 1) * _DT_S
    k = np.clip(np.searchsorted(t_grid, t, side="right") - 1, 0, len(t_grid) - 2)
    tau = t - t_grid[k]
    slope = (du[k + 1] - du[k]) / (t_grid[k + 1] - t_grid[k])
    u = grid.u[k] + du[k] * tau + slope * tau**2 / 2
    rest = 0.0 if start is None else start[0]
    braking = 0.0 if start is None else start[1]
    u = np.where(t < 0, rest * t + braking * t**2 / 2, np.where(t > t_grid[-1], grid.u[-1], u))
    rate = np.where(t < 0, rest + braking * t, np.where(t > t_grid[-1], 0.0, du[k] + slope * tau))
    once, twice = windows
    # Averages of u and of its rate; differences of a rate over a window are the average's next derivative.
    values = _average(_average(u, once), twice)
    first = _average(_average(rate, once), twice)
    second = _average(_difference(rate, once), twice)
    third = _difference(_difference(rate, once), twice)
    if twice < 2 or once < 2:
        third = np.gradient(second, _DT_S)
    fourth = np.gradient(third, _DT_S)
    out = [_average(x, _LAST) for x in (values, first, second, third, fourth)]
    if start is None:
        return out
    centred = pad - (once + twice + _LAST - 3) // 2
    return _joined([x[centred:] for x in out], start)


def _joined(out: list[Array], start: tuple[float, float, float]) -> list[Array]:
    """Add the polynomial of degree seven that makes the law begin at 0 with the given derivatives."""
    wanted = np.array([0.0, *start]) - np.array([x[0] for x in out[:4]])
    span = min(1.5, (len(out[0]) - 1) * _DT_S)
    t = np.arange(len(out[0])) * _DT_S
    inside = t <= span
    powers = np.arange(8)
    rows = np.zeros((8, 8))
    for order in range(4):
        factor = np.array([np.prod(np.arange(p, p - order, -1)) if p >= order else 0.0 for p in powers])
        rows[order, order] = factor[order]
        rows[4 + order] = np.where(powers >= order, factor * span ** np.maximum(powers - order, 0), 0.0)
    polynomial = np.polynomial.Polynomial(np.linalg.solve(rows, np.concatenate([wanted, np.zeros(4)])))
    return [x + np.where(inside, (polynomial.deriv(order) if order else polynomial)(t), 0.0)
            for order, x in enumerate(out)]  # fmt: skip


def _average(x: Array, window: int) -> Array:
    total = np.concatenate([[0.0], np.cumsum(x)])
    return np.asarray((total[window:] - total[:-window]) / window)


def _difference(x: Array, window: int) -> Array:
    """Derivative of the average over a window: (x(t + w / 2) - x(t - w / 2)) / w, on the average's samples."""
    held = np.concatenate([x[:1], x, x[-1:]])
    between = (held[1:] + held[:-1]) / 2
    return np.asarray((between[window:] - between[:-window]) / (window * _DT_S))


def _chain(c: list[Array], u: list[Array]) -> tuple[Array, Array, Array, Array]:
    """Derivatives in time of c(u(t)), orders one to four (Faa di Bruno)."""
    c1, c2, c3, c4 = c
    u1, u2, u3, u4 = (x[:, None] for x in u)
    return (
        c1 * u1,
        c2 * u1**2 + c1 * u2,
        c3 * u1**3 + 3 * c2 * u1 * u2 + c1 * u3,
        c4 * u1**4 + 6 * c3 * u1**2 * u2 + c2 * (3 * u2**2 + 4 * u1 * u3) + c1 * u4,
    )


def _widest(x: Array, half: int) -> Array:
    """Largest value within `half` samples."""
    padded = np.pad(x, half, mode="edge")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).max(axis=1))


def climb(height_m: float, limits: Limits, dt_s: float) -> Array:
    """Heights (n,) every `dt_s` from rest at 0 to rest at `height_m` along a straight line within the limits."""
    line = make_interp_spline(np.linspace(0.0, height_m, 8), np.linspace(0.0, height_m, 8)[:, None], k=5)
    timed = fly(line, limits)
    assert timed is not None
    z = timed.sampled(dt_s)[:, 0]
    moving = int(np.count_nonzero(z < height_m - _ARRIVED_M))
    return np.append(z[:moving], height_m)
