"""From one reference to the next in flight, and to rest.

`handover`: the vehicle is on a reference and gets a new route. The new curve begins at the reference's position with
the derivatives that its velocity, acceleration and jerk ask for, so nothing steps. With r = c(u(t)), |c'(0)| = 1:

    u' = |v|,   u'' = a . c',   c'' u'^2 = a - c' u'',   u''' = j . c' - 3 c' . c'' u' u'',   c''' u'^3 = j - 3 c'' u' u'' - c' u'''

At a crawl (`_CRAWL_MPS`), or when the limits or the clearance cannot be kept that way, it brakes on the old reference
first and leaves from where it rests.

`stop_reference`: the old reference itself, flown ever more slowly: r(sigma(t)) with sigma' falling smoothly from 1 to
0. It never leaves the curve, so every region on the way stays the proof it was; and no derivative steps.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from sandwich_sitl.config import RunConfig
from sandwich_sitl.errors import MapError
from sandwich_sitl.planning.corridor import proven_corridor
from sandwich_sitl.planning.flight_plan import Corridor, Reference
from sandwich_sitl.planning.reference import Ground, limits_of, route_curve, speed_cap, without_repeats
from sandwich_sitl.planning.smoothing import Departure
from sandwich_sitl.planning.time_law import Limits, TimedCurve, fly

Array = NDArray[np.float64]

_CRAWL_MPS = 0.3
_AROUND = 12  # samples on either side of which a reference's derivatives are taken
_SHORTEST_STOP_S = 0.2
_LEVEL_M = 1e-9
_LEAST_AHEAD = -0.5  # cosine between velocity and route below which the vehicle stops before it turns
_STOP_GROWTH = 1.05
_STOP_CLEARANCE_M = 0.1  # from the obstacles grown by the vehicle's radius
_OF_THE_PLANS = 0.7  # share of the plans' limits that a hard stop uses
_GRAVITY_MPS2 = 9.80665


@dataclass(frozen=True)
class State:
    """Position, velocity, acceleration and jerk (3,) of a reference, ENU SI."""

    r_m: Array
    v_mps: Array
    a_mps2: Array
    j_mps3: Array


@dataclass(frozen=True)
class Stop:
    """A reference that brakes to rest on the curve of the one before, and whether it keeps the limits."""

    reference: Reference
    limits_kept: bool


def state_at(reference: Reference, t_s: float) -> State:
    """State of a reference at a time, held at its end; derivatives from a spline through the samples round it."""
    t = reference.t_s
    at = float(np.clip(t_s, t[0], t[-1]))
    spline = _local_spline(reference, at)
    r, v, a, j = (np.asarray(spline(at)), *(np.asarray(spline.derivative(order)(at)) for order in (1, 2, 3)))
    return State(r, v, a, j)


def handover(
    config: RunConfig, ground: Ground, reference: Reference, t_s: float, new_route: Array
) -> tuple[Reference, Corridor]:
    """A reference from the state of `reference` at `t_s` along a tight route (n, 2), to rest, in a proven corridor.

    The route begins where the reference then is; times count from 0. Raises `MapError` when no safe reference leads
    from there to the route.
    """
    limits, dt = limits_of(config.planner), 1.0 / config.mpc.rate_hz
    begin = _sample_time(reference, t_s)
    state = state_at(reference, begin)
    height = float(reference.xyz_m[-1, 2])
    climbing = _climb_left(reference, begin)
    route = np.concatenate([state.r_m[None, :2], new_route[1:]])
    if len(climbing) == 0 and _forwards(state, route):
        timed = _rolling(config, ground, state, route, limits)
        if timed is not None:
            try:
                return _in_corridor(config, ground, _level(timed.sampled(dt), height))
            except MapError:
                pass
    if len(climbing):
        return _after(config, ground, climbing, route, height)
    for braking in stop_limits(config):
        stop = stop_reference(reference, begin, braking).reference.xyz_m
        if ground.outlines.keeps(stop[:, :2], _STOP_CLEARANCE_M):
            return _after(config, ground, stop, route, height)
    raise MapError("stop: there is no room for one on the way before the obstacle")


def stop_limits(config: RunConfig) -> tuple[Limits, Limits]:
    """Limits of a stop: those of every reference, and nearly all that the controller's plans may use."""
    mpc = config.mpc
    push = _OF_THE_PLANS * min(mpc.acceleration_mps2, _GRAVITY_MPS2 * float(np.tan(np.radians(mpc.tilt_deg))))
    return limits_of(config.planner), Limits(
        mpc.speed_mps, push, _OF_THE_PLANS * mpc.jerk_mps3, _OF_THE_PLANS * mpc.snap_mps4
    )


def _after(config: RunConfig, ground: Ground, stop: Array, route: Array, height: float) -> tuple[Reference, Corridor]:
    """Along `stop` (n, 3) to rest, and from there along the route."""
    onward = fly_route(config, ground, _joined(ground, stop[-1, :2], route))
    dt = 1.0 / config.mpc.rate_hz
    return _in_corridor(config, ground, np.concatenate([stop, _level(onward.sampled(dt)[1:], height)]))


def _forwards(state: State, route: Array) -> bool:
    """Whether the vehicle moves, and not away from the route."""
    speed = float(np.hypot(*state.v_mps[:2]))
    ahead = route[1] - route[0]
    return speed > _CRAWL_MPS and float(state.v_mps[:2] @ ahead) >= _LEAST_AHEAD * speed * float(np.hypot(*ahead))


def fly_route(config: RunConfig, ground: Ground, route: Array) -> TimedCurve:
    """The law from rest to rest along a tight route."""
    limits = limits_of(config.planner)
    curve = route_curve(config, ground, route)
    timed = fly(curve, limits, speed_cap(curve, ground.outlines, limits, config.mpc.step_s))
    assert timed is not None, "from rest there is always a law"
    return timed


def stop_reference(reference: Reference, t_s: float, limits: Limits, before_s: float | None = None) -> Stop:
    """Brake on the curve of `reference` from its state at `t_s`, as soon as the limits allow; times count from 0.

    With `before_s` the vehicle rests before the reference would be there, if need be beyond the limits. `region`
    indexes the same corridor.
    """
    begin = _sample_time(reference, t_s)
    dt = float(reference.t_s[1] - reference.t_s[0])
    longest = np.inf if before_s is None else max(2 * (before_s - begin), _SHORTEST_STOP_S)
    left = float(reference.t_s[-1]) - begin
    duration, spline = _SHORTEST_STOP_S, _whole_spline(reference, begin)
    while True:
        duration = min(duration, longest)
        if duration >= left and (before_s is None or before_s >= reference.t_s[-1]):
            return Stop(_tail(reference, begin), True)
        t = np.arange(int(np.ceil(duration / dt)) + 1, dtype=np.float64) * dt
        sigma = begin + _slowing(t, duration)
        at = np.minimum(sigma, reference.t_s[-1])
        xyz = np.asarray(spline(at))
        kept = _keeps(np.concatenate([np.asarray(spline(begin - dt * np.arange(4, 0, -1))), xyz]), dt, limits)
        if kept or duration >= longest:
            break
        duration *= _STOP_GROWTH
    steps = np.clip(np.floor((at - reference.t_s[0]) / dt + 1e-9).astype(np.int64), 0, len(reference.t_s) - 1)
    return Stop(Reference(np.arange(len(xyz), dtype=np.float64) * dt, xyz, reference.region[steps]), kept)


def _tail(reference: Reference, begin: float) -> Reference:
    k = int(np.searchsorted(reference.t_s, begin))
    return Reference(reference.t_s[k:] - reference.t_s[k], reference.xyz_m[k:], reference.region[k:])


def _climb_left(reference: Reference, begin: float) -> Array:
    """What is left (n, 3) of the climb over one spot to the reference's altitude; n = 0 when it is over."""
    k = int(np.searchsorted(reference.t_s, begin))
    low = np.flatnonzero(reference.xyz_m[k:, 2] < reference.xyz_m[-1, 2] - _LEVEL_M)
    return reference.xyz_m[k : k + int(low[-1]) + 2] if low.size else np.empty((0, 3))


def _slowing(t: Array, duration: float) -> Array:
    """sigma(t) with sigma' = 1 - (10 x^3 - 15 x^4 + 6 x^5), x = t / duration: C^3 onto motion and onto rest."""
    x = np.clip(t / duration, 0.0, 1.0)
    return np.asarray(duration * (x - x**4 * (2.5 - 3 * x + x**2)))


def _keeps(xyz: Array, dt: float, limits: Limits) -> bool:
    """Whether differences of samples (n, 3) keep the limits, up to a hundredth."""
    held = np.concatenate([xyz, np.repeat(xyz[-1:], 4, axis=0)])
    differences = [np.diff(held, n=order, axis=0) / dt**order for order in range(1, 5)]
    shortest = min(len(d) for d in differences)
    v, a, j, s = (d[:shortest] for d in differences)
    return bool(limits.excess(v, a, j, s).max() <= 1.01)


def _rolling(config: RunConfig, ground: Ground, state: State, route: Array, limits: Limits) -> TimedCurve | None:
    """The law along a curve that begins with the state's derivatives, or None when none keeps limits and clearance."""
    departure, start = _departure(state)
    try:
        curve = route_curve(config, ground, route, departure)
        return fly(curve, limits, speed_cap(curve, ground.outlines, limits, config.mpc.step_s), start)
    except MapError:
        return None


def _departure(state: State) -> tuple[Departure, tuple[float, float, float]]:
    v, a, j = state.v_mps[:2], state.a_mps2[:2], state.j_mps3[:2]
    speed = float(np.hypot(*v))
    c1 = v / speed
    u2 = float(a @ c1)
    c2 = (a - c1 * u2) / speed**2
    u3 = float(j @ c1) - 3 * float(c1 @ c2) * speed * u2
    c3 = (j - 3 * c2 * speed * u2 - c1 * u3) / speed**3
    return Departure(c1, c2, c3), (speed, u2, u3)


def _joined(ground: Ground, rest: Array, route: Array) -> Array:
    """The route from where the vehicle rests: straight to the last of its points that is in sight, else back over it."""
    for k in range(len(route) - 1, 0, -1):
        if ground.outlines.keeps(np.array([rest, route[k]]), _sight_m(ground, route)):
            return without_repeats(np.concatenate([rest[None], route[k:]]))
    return without_repeats(np.concatenate([rest[None], route]))


def _sight_m(ground: Ground, route: Array) -> float:
    """Clearance of the route itself: a short cut must not be nearer to the obstacles."""
    return float(ground.outlines.clearance(route, 1.0).min()) * 0.95


def _level(xy: Array, height: float) -> Array:
    return np.column_stack([xy, np.full(len(xy), height)])


def _in_corridor(config: RunConfig, ground: Ground, xyz: Array) -> tuple[Reference, Corridor]:
    t = np.arange(len(xyz), dtype=np.float64) / config.mpc.rate_hz
    return proven_corridor(t, xyz, ground.channel_map, ground.outlines, config.mpc.step_s)


def _sample_time(reference: Reference, t_s: float) -> float:
    """The first sample's time at or after `t_s`."""
    k = int(np.searchsorted(reference.t_s, t_s - 1e-9))
    return float(reference.t_s[min(k, len(reference.t_s) - 1)])


def _local_spline(reference: Reference, at: float) -> BSpline:
    t, xyz = _held(reference)
    k = int(np.searchsorted(t, at))
    window = slice(max(0, k - _AROUND), k + _AROUND + 1)
    return make_interp_spline(t[window], xyz[window], k=7)


def _whole_spline(reference: Reference, begin: float) -> BSpline:
    """A spline through what is left of the reference, and some samples before."""
    t, xyz = _held(reference)
    k = max(0, int(np.searchsorted(t, begin)) - _AROUND)
    return make_interp_spline(t[k:], xyz[k:], k=7)


def _held(reference: Reference) -> tuple[Array, Array]:
    """Samples with some at rest before the first and after the last."""
    dt = float(reference.t_s[1] - reference.t_s[0])
    more = np.arange(1, _AROUND + 1) * dt
    t = np.concatenate([reference.t_s[0] - more[::-1], reference.t_s, reference.t_s[-1] + more])
    first, last = reference.xyz_m[:1], reference.xyz_m[-1:]
    return t, np.concatenate([np.repeat(first, _AROUND, axis=0), reference.xyz_m, np.repeat(last, _AROUND, axis=0)])
