"""`ObstacleWatch`: reports come in, plans go out. The shell round `mission.rerouting`.

Each tick: what the range sensor sees (link) and what others report (Zenoh) become `ObstacleReport`s; a question goes to
the planner, its answer back. In lockstep an answer is collected when it is due and not before, so that a flight does
not depend on the machine's speed; in real time as soon as there is one.
"""

import dataclasses
import time
from collections.abc import Callable

import numpy as np

from sandwich_sitl.config import RunConfig
from sandwich_sitl.errors import InputError
from sandwich_sitl.mission.reports import ObstacleReport, Source, parse_obstacle
from sandwich_sitl.mission.rerouting import RerouteOrders, Rerouting, Whereabouts
from sandwich_sitl.mission.sightings import unexplained
from sandwich_sitl.mission.vehicle_view import VehicleView
from sandwich_sitl.planner_process import InlinePlanner, Planner, PlannerProcess
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.replan import Replan
from sandwich_sitl.recording.streams import Heard
from sandwich_sitl.world.world import Obstacle

_SOON_S = 1e-6


class ObstacleWatch:
    """One flight's; `close` it. `heard` hands out what others have reported since its last call.

    `given_up` says why the vehicle stops for good, `wall_s` what each plan took.
    """

    def __init__(self, config: RunConfig, plan: FlightPlan, heard: Callable[[], list[Heard]]) -> None:
        self._config, self._heard = config, heard
        self._lockstep = config.clock.mode == "lockstep"
        self._rerouting = Rerouting(config, plan)
        in_lockstep = self._lockstep or config.mode == "paper"
        self._planner: Planner = InlinePlanner(config, plan) if in_lockstep else PlannerProcess(config, plan)
        self._seen = 0
        self.wall_s: list[float] = []

    @property
    def given_up(self) -> bool:
        """Whether the vehicle is to stop for good."""
        return bool(self._rerouting.given_up)

    def close(self) -> None:
        """End the planner."""
        self._planner.close()

    def tick(self, now_s: float, view: VehicleView, at: Whereabouts) -> RerouteOrders:
        """What the run has to do now about obstacles."""
        malformed = [("warning", text) for text in view.scan_problems]
        reports = self._reported(now_s, malformed) + self._sighted(view, at)
        orders = self._rerouting.step(now_s, at, reports, self._answer(now_s))
        if orders.ask is not None:
            self._planner.ask(orders.ask)
        return dataclasses.replace(orders, log=(*malformed, *orders.log))

    def refuse(self, state: str) -> tuple[tuple[str, str], ...]:
        """Pass over what has been reported in a `state` in which no plan is flown any more; lines for the log."""
        return tuple(("warning", f"an obstacle reported in {state} is left alone") for _ in self._heard())

    def _answer(self, now_s: float) -> Replan | None:
        if self._rerouting.idle or (self._lockstep and now_s < self._rerouting.due_s - _SOON_S):
            return None
        answer = self._planner.answer()
        if answer is None:
            return None
        self.wall_s.append(answer.wall_s)
        return answer.replan

    def _reported(self, now_s: float, malformed: list[tuple[str, str]]) -> list[ObstacleReport]:
        reports = []
        for heard in self._heard():
            age_s = 0.0 if self._lockstep else (time.monotonic() - heard.wall_s) * self._config.clock.speed
            try:
                reports.append(ObstacleReport(parse_obstacle(heard.payload), Source.MESSAGE, now_s - max(0.0, age_s)))
            except InputError as error:
                malformed.append(("warning", str(error)))
        return reports

    def _sighted(self, view: VehicleView, at: Whereabouts) -> list[ObstacleReport]:
        """What the newest scan shows that nobody knew."""
        if not view.scans or not self._rerouting.idle:
            return []
        scan = view.scans[-1]
        reports: list[ObstacleReport] = []
        altitude_m = -np.inf if at.r_m is None else float(at.r_m[2])
        for polygon in unexplained(scan, self._rerouting.explained, self._config.replan, altitude_m):
            self._seen += 1
            reports.append(ObstacleReport(Obstacle(f"seen-{self._seen}", polygon), Source.SENSOR, scan.heard_s))
        return reports
