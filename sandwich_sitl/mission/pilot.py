"""`Pilot`: what the mission wants streamed becomes this tick's set-point (pure; time is an argument).

State: the tracker while it flies and until its last plan has come to its stop, the braking profile where there is no
such plan, the pose while it holds. Heights are measured
above the ground the vehicle stood on when it was primed, because autopilots start with height errors of a metre and
more.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.config import RunConfig
from sandwich_sitl.control.assurance import Rung
from sandwich_sitl.control.horizon import Horizon, HorizonSolver
from sandwich_sitl.control.mpc import Mpc
from sandwich_sitl.control.solvers.registry import solver_for_flight
from sandwich_sitl.control.tracker import Tick, Tracker, rehearse
from sandwich_sitl.mission.brake import BrakeProfile
from sandwich_sitl.mission.orders import Stream
from sandwich_sitl.mission.rerouting import Whereabouts
from sandwich_sitl.mission.room import check_room
from sandwich_sitl.mission.setpoint import Setpoint
from sandwich_sitl.mission.vehicle_view import VehicleView
from sandwich_sitl.planning.flight_plan import Corridor, Reference
from sandwich_sitl.planning.replan import Replan, Verdict

Vector = NDArray[np.float64]

STALE_S = 0.3  # age at which the last usable plan must not be sent on as if it were fresh
_LATEST_S = 0.1
_SETTLED_MPS = 0.3


@dataclass(frozen=True)
class Steering:
    """This tick's set-point, if any, with the controller's answer when it was the tracker that made it."""

    setpoint: Setpoint | None
    tick: Tick | None


class Pilot:
    """Set-points of one flight along one reference; positions (3,) ENU in the world's frame."""

    def __init__(
        self,
        config: RunConfig,
        reference: Reference,
        corridor: Corridor,
        make_solver: Callable[[str, Horizon], HorizonSolver] = solver_for_flight,
    ) -> None:
        """Everything that takes time to build, the controller above all, is built here, before there is a flight.

        Raises `InputError` when the configuration leaves the plans no room (`room`).
        """
        self._config, self._reference, self._corridor = config, reference, corridor
        self._mpc = Mpc(config.mpc, config.mode, corridor.Gamma.shape[1], make_solver)
        check_room(config, self._mpc)
        rehearse(self._mpc, config, reference, corridor)
        self._tracker: Tracker | None = None
        self._track_from_s = 0.0
        self._idle_s = 0.0
        self._last_s = 0.0
        self._fresh = False
        self._lost = False
        self._leads_on = True
        self._brake: BrakeProfile | None = None
        self._brake_from_s = 0.0
        self._ground_m: float | None = None
        self._yaw_rad = 0.0
        self._asked: Setpoint | None = None  # this tick's set-point
        self._last: Setpoint | None = None  # the last one that went out

    @property
    def ground_m(self) -> float:
        """Height of the start in the autopilot's frame."""
        return self._ground_m or 0.0

    def plan_stale(self, now_s: float) -> bool:
        """Whether there is no plan to fly on: at once when the tracker has come to the end of its ladder, and after
        `STALE_S` in which set-points were refused by the fence or the vehicle was astray.

        A tick that comes late counts as one of `_LATEST_S`: this process was not there, and nothing was refused.
        """
        idle_s = self._idle_s + min(now_s - self._last_s, _LATEST_S)
        return self._tracker is not None and (self._lost or idle_s > STALE_S)

    def accepted(self, now_s: float) -> None:
        """This tick's set-point went out; it counts as fresh when its plan was usable and the vehicle on its track."""
        self._last = self._asked or self._last
        if self._fresh:
            self._idle_s, self._last_s = 0.0, now_s

    def whereabouts(self, view: VehicleView) -> Whereabouts:
        """Where the flight is: the reference's own time, and the vehicle in the world."""
        flying = self._tracker is not None
        r_m = None if view.r_m is None else view.r_m - np.array([0.0, 0.0, self.ground_m])
        return Whereabouts(self._tracker.clock.t_s if self._tracker is not None else 0.0, flying, r_m)

    def adopt(self, replan: Replan) -> None:
        """Fly another reference from now on; it agrees with the present one up to now."""
        self._reference, self._corridor = replan.reference, replan.corridor
        self._leads_on = replan.verdict is Verdict.ROUTE and replan.whole
        if self._tracker is not None:
            self._tracker.adopt(self._reference, self._corridor)

    def bar(self, barred: bool) -> None:
        """Whether the way is barred: as long as it is, no plan is accepted and the last one is flown to its stop."""
        if self._tracker is not None:
            self._tracker.way_is_barred = barred

    def no_way(self, view: VehicleView, given_up: bool) -> bool:
        """Whether there is no way on to the goal and the vehicle rests."""
        if self._tracker is None:
            return given_up or not self._leads_on
        return not self._leads_on and self._tracker.finished and view.speed_mps < _SETTLED_MPS

    def route_finished(self, view: VehicleView) -> bool:
        """Whether the reference has ended and the vehicle rests at its end."""
        if self._tracker is None or view.r_m is None or not (self._leads_on and self._tracker.finished):
            return False
        miss = float(np.hypot(*(view.r_m[:2] - self._reference.xyz_m[-1, :2])))
        return miss < self._config.mission.goal_tolerance_m and view.speed_mps < _SETTLED_MPS

    def steer(self, stream: Stream, now_s: float, view: VehicleView) -> Steering:
        """The set-point that `stream` asks for now."""
        self._asked = None
        if stream in (Stream.IDLE, Stream.NONE) or view.r_m is None or view.v_mps is None:
            self._tracker = self._brake = None
            self._lost = False
            return Steering(None, None)
        if stream is Stream.TRACK:
            return self._track(now_s, view.r_m, view.v_mps, view)
        if stream is Stream.BRAKE and self._tracker is not None and not self.plan_stale(now_s):
            self._tracker.stops = True
            if not self._tracker.lifting:
                return self._track(now_s, view.r_m, view.v_mps, view)
        self._tracker = None
        if stream is Stream.POSE:
            return self._answer(self._pose(view.r_m, view))
        return Steering(self._braked(now_s, view.r_m, view.v_mps), None)

    def _braked(self, now_s: float, r_m: Vector, v_mps: Vector) -> Setpoint:
        """Brake from the last set-point, or from where the vehicle is; then stay."""
        if self._brake is None:
            self._brake = BrakeProfile(*self._moving(r_m, v_mps), self._config.mission.brake_mps2)
            self._brake_from_s = now_s
        self._asked = Setpoint(*self._brake.at(now_s - self._brake_from_s), self._yaw_rad)
        return self._asked

    def _track(self, now_s: float, r_m: Vector, v_mps: Vector, view: VehicleView) -> Steering:
        lift = np.array([0.0, 0.0, self.ground_m])
        if self._tracker is None:
            self._tracker = Tracker(self._config, self._mpc, self._reference, self._corridor, r_m - lift)
            self._track_from_s = self._last_s = now_s
            self._idle_s = 0.0
        self._idle_s += min(now_s - self._last_s, _LATEST_S)
        self._last_s = now_s
        age_s = 0.0 if view.position_time_s is None else max(0.0, now_s - view.position_time_s)
        self._tracker.is_uncertain = view.is_uncertain(self._config.position_std_limit_m)
        tick = self._tracker.tick(now_s - self._track_from_s, r_m - lift, v_mps, age_s)
        if tick.rung is Rung.BRAKE:
            self._lost = True
            return Steering(self._braked(now_s, r_m, v_mps), tick)
        astray = float(np.linalg.norm(r_m - lift - tick.desired_m)) > self._config.mission.lost_track_m
        self._fresh = not astray
        state = tick.setpoint
        return self._answer(Setpoint(state[:3] + lift, state[3:6], state[6:9], self._yaw_rad), tick)

    def _pose(self, r_m: Vector, view: VehicleView) -> Setpoint:
        if self._last is not None:
            return self._last
        self._ground_m = float(r_m[2])
        self._yaw_rad = _yaw(view)
        return Setpoint(r_m.copy(), np.zeros(3), None, self._yaw_rad)

    def _moving(self, r_m: Vector, v_mps: Vector) -> tuple[Vector, Vector]:
        """Where braking starts: from the last set-point while one was flown, so that the command does not jump."""
        last = self._last
        if last is None or last.r_m is None or last.v_mps is None:
            return r_m.copy(), v_mps.copy()
        return last.r_m, last.v_mps

    def _answer(self, setpoint: Setpoint, tick: Tick | None = None) -> Steering:
        self._asked = setpoint
        return Steering(setpoint, tick)


def _yaw(view: VehicleView) -> float:
    if view.q_wxyz is None:
        return 0.0
    w, x, y, z = view.q_wxyz.tolist()
    return float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
