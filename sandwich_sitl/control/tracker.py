"""`Tracker`: one control tick from reference, corridor and telemetry to a checked set-point (paper, section V).

The command is one unbroken motion of the plant model: each tick's plan starts from the command in force, so feedback
never makes it jump; only after a pause of this process does it begin anew, where the vehicle has come to. Feedback
moves what the plan aims at: the reference, and the regions, less the offset that the estimator sees between vehicle and
command. What is commanded now is flown a delay later, so the plan looks that much further ahead. Estimated motion
enters through the offset to come (`estimator`) and nowhere else.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.config import RunConfig
from sandwich_sitl.control.assurance import GRID_S, AcceptedMotion, Bounds, Fault, Rung, examine
from sandwich_sitl.control.estimator import VehicleEstimator
from sandwich_sitl.control.lookup import between
from sandwich_sitl.control.mpc import Mpc, MpcSolution, motion_limits
from sandwich_sitl.control.reference_clock import ReferenceClock
from sandwich_sitl.control.stop_plan import SHORTEST_S, StopPlan, standing, stop_along, straight_on
from sandwich_sitl.planning.flight_plan import Corridor, Reference

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_PAUSE_S = 0.2  # a tick that comes later than this, and than two periods, finds the vehicle somewhere else
LIFT_M, _LIFT_MPS = 0.2, 0.5  # autopilots take a take-off for one when it has come so high or so fast
_LIFT_S = 5.0
_BEYOND = 1.25  # of a limit: limits are soft in the problem, and a stop brakes beside what its plan does
_LEFT_M = 1e-3  # a reference this far from its start over ground has left it


@dataclass(frozen=True)
class Tick:
    """Result of one tick: the state (12,) to command, the snap (3,) that leads there, the solver's answer, and by which
    `rung` of the ladder and `fault` the set-point came about. At rung BRAKE the state is the last one and not to be sent.

    `desired_m` (3,) is the reference and `region` its corridor index at the time of the tick; `ahead_m` (n, 3) is the
    plan in force; `offset_m` (3,) and `delay_s` are the estimator's, `rate` the reference clock's; `motion` (12,) is
    the estimated r, v, a, j of the vehicle. `error` is what the solver raised, if it did.
    """

    setpoint: Array
    snap: Array
    desired_m: Array
    region: int
    solution: MpcSolution
    rung: Rung
    fault: Fault
    ahead_m: Array
    offset_m: Array
    delay_s: float
    rate: float
    motion: Array
    error: str


class Tracker:
    """Tracks a reference from its first sample on; the vehicle is taken to be at rest at `r_m` (3,) then."""

    def __init__(
        self,
        config: RunConfig,
        mpc: Mpc,
        reference: Reference,
        corridor: Corridor,
        r_m: Array,
    ) -> None:
        self._reference, self._corridor = reference, corridor
        self._config, self._period_s, self._mpc = config, 1.0 / config.mpc.rate_hz, mpc
        self._brake_mps2 = config.mission.brake_mps2
        self._pause_s = max(_PAUSE_S, 2.0 * self._period_s)
        self._bounds = bounds_of(config)
        self._steps_s = np.arange(1, mpc.n_tau + 1, dtype=np.float64) * mpc.step_s
        self.command = np.concatenate([r_m, np.zeros(9)])
        self._start_m = r_m.copy()
        self.lifting = bool(r_m[2] < reference.xyz_m[0, 2] + LIFT_M / 2 < reference.xyz_m[-1, 2])
        self.clock = ReferenceClock(self._when_at(r_m[2]) - self._period_s)  # the first tick advances it
        self.estimator = VehicleEstimator(config.tracking, self._period_s, 0.0, self.command)
        self._stop = standing(self.command, mpc.step_s)
        self._stop_began_s = 0.0
        begins_s = self._when_at(r_m[2])
        self._stop_sigma: Callable[[Array], Array] = lambda progress: np.full_like(progress, begins_s)  # it waits too
        self.way_is_barred = False  # no plan is accepted: the last one is slowed down to its stop
        self.is_uncertain = False  # the same because nobody knows well enough where the vehicle is
        self.stops = False  # the same because the flight is to end
        self._solver_error = ""
        self._last_s = -self._period_s

    @property
    def finished(self) -> bool:
        """Whether the reference has come to its end."""
        return self.clock.t_s >= float(self._reference.t_s[-1])

    def adopt(self, reference: Reference, corridor: Corridor) -> None:
        """Fly another reference, which agrees with the present one up to the reference's present time and on."""
        self._reference, self._corridor = reference, corridor
        self.way_is_barred = False

    def tick(self, t_s: float, r_m: Array, v_mps: Array, age_s: float) -> Tick:
        """Tick at `t_s` since tracking began, with the measured position and velocity (3,), `age_s` old."""
        gap_s, self._last_s = max(t_s - self._last_s, 0.0), t_s
        self._solver_error = ""
        dt = min(gap_s, self._pause_s)
        if gap_s > dt and not self.lifting and np.isfinite(r_m).all() and np.isfinite(v_mps).all():
            self._pick_up(t_s, gap_s, r_m + age_s * v_mps, v_mps)
            dt = self._period_s
        self._await_lift_off(t_s, r_m)
        before, stood_s = self.command, self.clock.t_s
        if not self.lifting:
            self.clock.advance(dt, float(np.linalg.norm(self._reference_at(self.clock.t_s)[1])))
        seen = self.estimator.measure(t_s, t_s - age_s, r_m, v_mps)
        solution, stop, fault = self._try_plan(dt) if seen else (self._mpc.no_solution(), None, Fault.BLIND)
        rung = self._take(stop, t_s, dt)
        if rung is Rung.BRAKE:
            self.clock.follow(stood_s, 0.0)
        snap = solution.snap[0] if rung is Rung.PLAN else (self.command[9:] - before[9:]) / max(dt, 1e-9)
        asked = self.command
        if self.lifting and rung is not Rung.BRAKE:
            asked, snap = self._push_off(r_m, v_mps), snap * (1.0, 1.0, 0.0)
        self.estimator.commanded(t_s, asked)
        return self._tick(solution, rung, fault, snap, self._rest_of_stop(t_s))

    def _pick_up(self, t_s: float, gap_s: float, r_m: Array, v_mps: Array) -> None:
        """After a pause of this process: the vehicle went on with its last set-point, so the plan begins with the command
        that it seems to follow now, and the reference where the vehicle has come to along it, as fast as the vehicle is.

        The plan from before the pause leads on from somewhere else: until one is accepted, the vehicle brakes straight on.
        """
        times = self.clock.t_s + np.arange(0.0, gap_s + self._period_s, self._period_s)
        places = self._sample(times)[0]
        nearest = int(np.argmin(((places - r_m) ** 2).sum(axis=1)))
        _, pace_mps = self._reference_at(float(times[nearest]))
        rate = float(v_mps @ pace_mps) / max(float(pace_mps @ pace_mps), 1e-6)
        self.clock.follow(float(times[nearest]), min(max(rate, 0.0), 1.0))
        followed_m = r_m - self.estimator.offset_m + self.estimator.delay_s * v_mps
        self.command = np.concatenate([followed_m, v_mps, np.zeros(6)])
        self.estimator = self.estimator.restarted(t_s, self.command)
        self._stop, self._stop_began_s = straight_on(self.command, self._brake_mps2), t_s
        begins_s, rate = self.clock.t_s, self.clock.rate
        self._stop_sigma = lambda progress: begins_s + rate * progress

    def _await_lift_off(self, t_s: float, r_m: Array) -> None:
        """Autopilots leave the ground in their own time: the reference goes along with the vehicle until it has.

        Then the height is planned from where the vehicle is. Across, the plan holds the vehicle over its start from the
        first tick on, because wind takes hold of it in the moment in which the ground lets go.
        """
        if not self.lifting:
            return
        height = float(r_m[2] - self._start_m[2])
        self.clock = ReferenceClock(self._when_at(self._start_m[2] + min(max(height, 0.0), LIFT_M)))
        self.lifting = t_s < _LIFT_S and not height > 0.9 * LIFT_M
        if not self.lifting:
            place_m, pace_mps = self._reference_at(self.clock.t_s)
            self.command = self.command.copy()
            self.command[2::3] = [place_m[2], pace_mps[2], 0.0, 0.0]

    def _push_off(self, r_m: Array, v_mps: Array) -> Array:
        """Ask for a height and a speed that make a take-off; what the vehicle makes of them is no error of its height."""
        self.command = self.command.copy()
        self.command[2::3] = [self._start_m[2] + LIFT_M, _LIFT_MPS, 0.0, 0.0]
        asked = self.command.copy()
        asked[2::3] = [r_m[2], v_mps[2], 0.0, 0.0]
        return asked

    def _when_at(self, height_m: float) -> float:
        """When the reference, over its start, first comes to a height, or to the greatest one that it has there."""
        xyz = self._reference.xyz_m
        away = np.hypot(*(xyz[:, :2] - xyz[0, :2]).T) > _LEFT_M
        z = xyz[: int(np.argmax(away)) if away.any() else len(xyz), 2]
        return float(self._reference.t_s[np.argmax(z >= min(height_m, float(z.max())))])

    def _tick(self, solution: MpcSolution, rung: Rung, fault: Fault, snap: Array, ahead_m: Array) -> Tick:
        now, region = self._sample(np.array([self.clock.t_s]))
        return Tick(
            self.command.copy(), snap, now[0], int(region[0]), solution, rung, fault, ahead_m,
            self.estimator.offset_m.copy(), self.estimator.delay_s, self.clock.rate, self.estimator.motion,
            self._solver_error,
        )  # fmt: skip

    def _try_plan(self, dt: float) -> tuple[MpcSolution, StopPlan | None, Fault]:
        """`_plan`; whatever it raises costs this tick's plan and no more, and the log says what it was."""
        try:
            return self._plan(dt)
        except Exception as error:  # noqa: BLE001 - a broken solver is no reason to fall out of the sky
            self._solver_error = f"{type(error).__name__}: {error}"
            return self._mpc.no_solution(), None, Fault.RAISED

    def _plan(self, dt: float) -> tuple[MpcSolution, StopPlan | None, Fault]:
        """This tick's own plan from the command in force, with its stop when it stands the examination."""
        if (refused := self._refused()) is not Fault.NONE:
            return self._mpc.no_solution(), None, refused
        delay = self.estimator.delay_s
        offset = self.estimator.offset_ahead(self._steps_s + delay)
        desired, region = self._sample(self.clock.ahead(self._steps_s + (delay - dt)))
        Lambda, Gamma = self._corridor.Lambda[region], self._corridor.Gamma[region]
        moved = Gamma - (Lambda @ offset[:, :2, None])[..., 0]
        band = self._corridor.z_m[region] - offset[:, 2:] if len(self._corridor.z_m) else None
        solution = self._mpc.solve(self.command, desired - offset, Lambda, moved, band)
        if not solution.usable:
            return solution, None, Fault.SOLVER
        knots = np.concatenate([self.command[None], solution.states])
        stop = stop_along(knots, solution.snap, self._mpc.step_s, dt, self._brake_mps2)
        if stop.stop_s < SHORTEST_S / 2:
            return solution, None, Fault.LATE
        times = np.arange(0.0, stop.stop_s + GRID_S, GRID_S)
        desired, along = self._sample(self.clock.ahead(stop.progress(times)[0] + delay))
        aimed_off, corridor = self.estimator.offset_ahead(times + delay), self._corridor
        fault = examine(
            stop.states(times), aimed_off, desired[:, 2], corridor.Lambda, corridor.Gamma, along, self._bounds,
            corridor.z_m,
        )  # fmt: skip
        return solution, stop if fault is Fault.NONE else None, fault

    def _refused(self) -> Fault:
        """Why no plan is accepted now, whatever it is."""
        if self.stops:
            return Fault.STOP
        if self.is_uncertain:
            return Fault.UNCERTAIN
        return Fault.OBSTACLE if self.way_is_barred else Fault.NONE

    def _take(self, stop: StopPlan | None, t_s: float, dt: float) -> Rung:
        """Put the accepted plan in force, or go on with the last one."""
        if stop is not None:
            self._stop, self._stop_began_s = stop, t_s
            self._stop_sigma = self.clock.frozen()
            self.command = stop.states(np.zeros(1))[0]
            return Rung.PLAN
        if t_s - self._stop_began_s >= self._stop.stop_s + dt:
            return Rung.BRAKE
        elapsed = np.array([t_s - self._stop_began_s])
        self.command = self._stop.states(elapsed)[0]
        progress, rate = self._stop.progress(elapsed)
        now_s, soon_s = self._stop_sigma(progress[0] + np.array([0.0, self._period_s])).tolist()
        self.clock.follow(now_s, float(rate[0]) * (soon_s - now_s) / self._period_s)
        return Rung.SHIFTED

    def _rest_of_stop(self, t_s: float) -> Array:
        return self._stop.states(t_s - self._stop_began_s + self._steps_s)[:, :3]

    def _sample(self, t_s: Array) -> tuple[Array, Indices]:
        """Desired positions (n, 3) and regions (n,) at times (n,), held at both ends."""
        return between(t_s, self._period_s, self._reference.xyz_m, self._reference.region)

    def _reference_at(self, t_s: float) -> tuple[Array, Array]:
        """Place (3,) and, at the reference's own rate 1, velocity (3,)."""
        here, there = self._sample(t_s + np.array([0.0, self._period_s]))[0]
        return here, (there - here) / self._period_s


def accepted_motion(config: RunConfig) -> AcceptedMotion:
    """What a plan may do and still be flown, where there are limits."""
    mpc, limits = config.mpc, motion_limits(config.mpc)
    across = max(_BEYOND * limits.acceleration_mps2, limits.acceleration_mps2 + config.mission.brake_mps2)
    up = max(_BEYOND * mpc.acceleration_mps2, mpc.acceleration_mps2 + config.mission.brake_mps2)
    jerk = _BEYOND * np.sqrt(2) * limits.jerk_mps3
    return AcceptedMotion(_BEYOND * limits.speed_mps, _BEYOND * mpc.climb_mps, across, up, jerk)


def bounds_of(config: RunConfig) -> Bounds:
    """Paper mode knows no limits and its raw quadrangles may miss their own reference: only finiteness is left."""
    if config.mode == "paper":
        return Bounds(np.full(5, np.inf), np.inf, np.inf)
    return Bounds(np.array(accepted_motion(config)), config.mpc.height_band_m, config.assurance.region_tolerance_m)


def rehearse(mpc: Mpc, config: RunConfig, reference: Reference, corridor: Corridor) -> None:
    """Take off for nobody: what is compiled or loaded at first use is then at hand."""
    start, still = reference.xyz_m[0], np.zeros(3)
    tracker = Tracker(config, mpc, reference, corridor, start)
    for k, height in enumerate((0.0, 2 * LIFT_M, 2 * LIFT_M)):
        tracker.tick(k / config.mpc.rate_hz, start + np.array([0.0, 0.0, height]), still, 0.0)
