"""The offboard process: the only loop and the only clock (design: shell over core).

A tick: wait for the vehicle's telemetry -> obstacles -> mission table -> MPC -> set-point out -> record. Recording comes after the
set-point has been sent, in the slack of the tick. Garbage collection is off in the loop: a full collection costs more
than a tick.
"""

import gc
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.config import RunConfig
from sandwich_sitl.control.assurance import Fault, Rung, describe
from sandwich_sitl.control.horizon import Horizon, HorizonSolver
from sandwich_sitl.control.solvers.registry import solver_for_flight
from sandwich_sitl.control.tracker import accepted_motion
from sandwich_sitl.errors import LinkError
from sandwich_sitl.link.guard import fence_around
from sandwich_sitl.link.session import LinkSession, LinkStatistics
from sandwich_sitl.mission.machine import Mission
from sandwich_sitl.mission.orders import (
    EXIT_STATUS,
    TERMINAL,
    MissionInputs,
    Orders,
    Outcome,
    OutcomeName,
    State,
    Stream,
)
from sandwich_sitl.mission.pilot import Pilot, Steering
from sandwich_sitl.mission.rerouting import RerouteOrders
from sandwich_sitl.mission.vehicle_view import VehicleView
from sandwich_sitl.obstacle_watch import ObstacleWatch
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.prisms import Prisms
from sandwich_sitl.recording.recorder import RunRecorder
from sandwich_sitl.recording.records import ControlRecord, MissionRecord, PlanUpdate, ReportedObstacle, TickTiming
from sandwich_sitl.recording.streams import Heard

_AFTERWARDS = frozenset({State.BRAKE, State.HOLD, State.LAND, State.WATCH, *TERMINAL})
_NO_ROTATION = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class FlightResult:
    """How the flight ended, what the link counted, and the wall time the loop took."""

    outcome: Outcome
    link: LinkStatistics
    wall_seconds: float


@dataclass(frozen=True)
class Observers:
    """Whom the loop tells: `recorder` everything, `on_state(now_s, state, text)` changes and progress for people; and
    `obstacle_reports`, which hands out what others have reported since the last call.
    """

    recorder: RunRecorder
    on_state: Callable[[float, str, str], None]
    obstacle_reports: Callable[[], list[Heard]] = list


def fly(
    config: RunConfig,
    plan: FlightPlan,
    observers: Observers,
    stop_requests: Callable[[], int],
    make_solver: Callable[[str, Horizon], HorizonSolver] = solver_for_flight,
) -> FlightResult:
    """Fly one mission over the configured link and return how it ended; `make_solver` builds what `mpc.solver` names.

    A vehicle that falls silent ends in outcome `lost`; `InputError` is raised for a link that cannot be opened.
    """
    return _Loop(config, plan, observers, stop_requests, make_solver).run()


class _Loop:
    def __init__(
        self,
        config: RunConfig,
        plan: FlightPlan,
        observers: Observers,
        stop_requests: Callable[[], int],
        make_solver: Callable[[str, Horizon], HorizonSolver],
    ) -> None:
        self._config, self._plan = config, plan
        self._recorder, self._on_state = observers.recorder, observers.on_state
        self._stop_requests = stop_requests
        route = plan.reference
        self._mission = Mission(
            config.mission,
            config.start_m,
            config.altitude_m,
            float(route.t_s[-1]),
            float(route.xyz_m[:, 2].max()),
            config.position_std_limit_m,
        )
        self._pilot = Pilot(config, plan.reference, plan.corridor, make_solver)
        self._obstacles = Prisms(plan.obstacles_m, plan.blocking_heights_m)
        self._watch = ObstacleWatch(config, plan, observers.obstacle_reports)
        self._orders = RerouteOrders()
        self._frames: list[tuple[float, str, bytes]] = []
        self._last_state: State | None = None
        self._refused: str | None = None
        self._ladder = (Rung.PLAN, Fault.NONE)
        self._uncertain = False
        self._not_finite: set[str] = set()
        self._ticks = 0
        self._horizon_due_s = 0.0

    def run(self) -> FlightResult:
        period_s = 1.0 / self._config.mpc.rate_hz
        most = accepted_motion(self._config)
        session = LinkSession(
            self._config.link,
            self._config.clock,
            period_s,
            self._config.start_m,
            lambda t_s, direction, frame: self._frames.append((t_s, direction, frame)),
            fence=fence_around(
                self._plan.bounds_m,
                float(self._plan.reference.xyz_m[:, 2].max()),
                math.hypot(most.speed_mps, most.climb_mps),
                math.hypot(most.across_mps2, most.up_mps2),
            ),
            connect_timeout_s=self._config.mission.connect_timeout_s,
            stop_requested=lambda: self._stop_requests() > 0,
        )
        self._on_state(0.0, str(State.CONNECT), f"listening for a vehicle on {self._config.link.uri}")
        began = time.perf_counter()
        with session as link, _no_garbage_collection():
            try:
                while (outcome := self._tick(link)) is None:
                    pass
            except LinkError as error:
                outcome = Outcome(OutcomeName.LOST, EXIT_STATUS[OutcomeName.LOST], str(error))
            finally:
                self._watch.close()
            self._record_frames()
            self._recorder.metadata("replans", {"wall_s": [round(wall_s, 4) for wall_s in self._watch.wall_s]})
            return FlightResult(outcome, link.statistics, time.perf_counter() - began)

    def _tick(self, link: LinkSession) -> Outcome | None:
        now_s = link.next_tick()
        began = time.monotonic()
        view = link.view
        self._orders = self._reroute(now_s, view) if view.heard else RerouteOrders()
        inputs = MissionInputs(
            self._stop_requests(),
            self._pilot.route_finished(view),
            self._pilot.plan_stale(now_s),
            self._pilot.no_way(view, self._watch.given_up),
        )
        orders = self._mission.step(now_s, view, inputs)
        solving = time.monotonic()
        steering = self._pilot.steer(orders.stream, now_s, view)
        solved = time.monotonic()
        # The last tick sends nothing: in lockstep the vehicle would go on to a step that nobody waits for.
        refused = None if orders.finished else link.send(steering.setpoint, orders.commands)
        if refused is None:
            self._pilot.accepted(now_s)
        sent = time.monotonic()
        if view.heard:
            if self._ticks == 0:
                # Until now the clock was this process's own: what was heard first is stamped with the vehicle's.
                self._frames = [(now_s, direction, frame) for _, direction, frame in self._frames]
            self._record(now_s, view, orders, steering, refused)
            solve_s = solved - solving if steering.tick is not None else 0.0
            self._recorder.timing(self._ticks, TickTiming(solve_s, sent - began, link.late_s(sent), sent))
            self._ticks += 1
        return orders.finished

    def _reroute(self, now_s: float, view: VehicleView) -> RerouteOrders:
        """Look after obstacles as long as a plan is flown or about to be."""
        state = self._mission.state
        if state in _AFTERWARDS:
            return RerouteOrders(log=self._watch.refuse(str(state)))
        orders = self._watch.tick(now_s, view, self._pilot.whereabouts(view))
        if orders.adopted is not None:
            replan = orders.adopted.replan
            self._pilot.adopt(replan)
            self._mission.rerouted(float(replan.reference.t_s[-1]))
        self._pilot.bar(orders.barred)
        return orders

    def _record(self, now_s: float, view: VehicleView, orders: Orders, steering: Steering, refused: str | None) -> None:
        self._record_frames()
        if orders.state is not self._last_state:
            self._last_state = orders.state
            reason = orders.finished.reason if orders.finished else ""
            self._recorder.mission(
                now_s, MissionRecord(str(orders.state), str(view.mode), view.armed, bool(view.landed), reason)
            )
            self._on_state(now_s, str(orders.state), reason)
        for line in orders.log:
            self._recorder.log(now_s, "info", line)
        self._record_rerouting(now_s, orders.state)
        for text in view.status_texts:
            self._recorder.log(now_s, "warning" if text.severity <= 4 else "info", f"vehicle: {text.text}")
        limit_m = self._config.position_std_limit_m
        if view.is_uncertain(limit_m) is not self._uncertain:
            self._uncertain = not self._uncertain
            self._recorder.log(now_s, "warning" if self._uncertain else "info", f"vehicle: {view.uncertainty(limit_m)}")
        for name in view.not_finite:
            if name not in self._not_finite:
                self._not_finite.add(name)
                self._recorder.log(now_s, "warning", f"vehicle: {name} is not finite and not used (said once)")
        if refused is not None and self._refused is None:
            self._recorder.log(now_s, "error", f"set-point not sent: {refused}")
        self._refused = refused
        if view.r_m is not None:
            q_wxyz = _NO_ROTATION if view.q_wxyz is None else view.q_wxyz
            self._recorder.tf_and_estimate(now_s, view.r_m, q_wxyz)
        if steering.tick is not None:
            self._record_control(now_s, view, orders, steering)
        if orders.stream is Stream.TRACK and self._ticks % round(self._config.mpc.rate_hz) == 0:
            self._on_state(now_s, str(orders.state), "")

    def _record_rerouting(self, now_s: float, state: State) -> None:
        for level, text in self._orders.log:
            self._recorder.log(now_s, level, text)
            if level != "debug":
                self._on_state(now_s, str(state), text)
        for report in self._orders.new:
            self._recorder.obstacle(ReportedObstacle.of(now_s, report))
            ring_m = shapely.get_coordinates(report.obstacle.polygon.exterior)
            height_m = report.obstacle.height_m if self._plan.floors is not None else None
            self._obstacles = self._obstacles.joined_by(ring_m, np.inf if height_m is None else height_m)
        if self._orders.adopted is not None:
            self._recorder.plan_update(PlanUpdate.of(self._orders.adopted), self._config.altitude_m)

    def _record_control(self, now_s: float, view: VehicleView, orders: Orders, steering: Steering) -> None:
        tick = steering.tick
        assert tick is not None
        assert view.r_m is not None
        assert view.v_mps is not None
        if (tick.rung, tick.fault) != self._ladder:
            self._ladder = (tick.rung, tick.fault)
            level = "info" if tick.rung is Rung.PLAN else "warning"
            self._recorder.log(now_s, level, f"assurance: {describe(tick.rung, tick.fault, tick.error)}")
        lift = np.array([0.0, 0.0, self._pilot.ground_m])
        self._recorder.control(
            ControlRecord(
                t_s=now_s,
                phase=str(orders.state),
                reference_m=tick.desired_m + lift,
                estimate_r_m=view.r_m,
                estimate_v_mps=view.v_mps,
                model_a_mps2=tick.motion[6:9],
                model_j_mps3=tick.motion[9:12],
                setpoint_r_m=tick.setpoint[:3] + lift,
                setpoint_v_mps=tick.setpoint[3:6],
                setpoint_a_mps2=tick.setpoint[6:9],
                snap_mps4=tick.snap,
                slack_m=float(tick.solution.slack_m.max()),
                solver_status=tick.solution.status,
                solver_iterations=tick.solution.iterations,
                region=tick.region,
                clearance_m=self._clearance(view.r_m - lift),
                offset_m=tick.offset_m,
                delay_s=tick.delay_s,
                reference_rate=tick.rate,
                rung=int(tick.rung),
                fault=str(tick.fault),
            )
        )
        if now_s >= self._horizon_due_s:
            self._recorder.horizon(now_s, tick.ahead_m + lift)
            self._horizon_due_s = now_s + 1.0 / self._config.logging.horizon_hz

    def _clearance(self, r_m: NDArray[np.float64]) -> float:
        distance_m = float(self._obstacles.distance_m(r_m[None])[0])
        return distance_m if math.isfinite(distance_m) else math.nan

    def _record_frames(self) -> None:
        frames, self._frames = self._frames, []
        for t_s, direction, frame in frames:
            self._recorder.mavlink(t_s, "tx" if direction == "tx" else "rx", frame)


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
