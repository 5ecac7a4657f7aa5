"""`Rerouting`: what becomes of reported obstacles, from the first look to a new plan in force (pure; time is an argument).

State: the obstacles known, the plan in force, the question under way. Input, each tick: reports, the reference's own
time sigma, where the vehicle is, the planner's answer. Output: `RerouteOrders`.

    report ──> malformed, outside the world, known already ──> a line in the log
           ├─> low enough for what is left of the way (floors) ─> remembered; the plan stands
           ├─> on top of the vehicle ────────────────────────> stop at once
           ├─> keeps clear of what is left of the corridor ──> remembered; the plan stands
           └─> else ─> question to the planner, from sigma + lead on
                          ├─ answer in time: adopt the new plan, or the stop it brings; when the plan ends
                          │    short of the goal, ask for the rest of the way
                          ├─ late: ask again, with twice the lead; after `replan.tries` stop at once
                          └─ no proven plan: stop at once

Until the answer the old plan is flown on, but no further than where the vehicle could still stop before the obstacle:
there it begins to slow down along its plan (the way is barred), and goes on when the new plan is adopted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.config import RunConfig
from sandwich_sitl.mission.reports import ObstacleReport, Source
from sandwich_sitl.mission.sightings import Explained
from sandwich_sitl.planning.corridor import between_samples_m, speeds_mps
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.replan import Question, Replan, Verdict, change_over
from sandwich_sitl.world.world import Obstacle, matter

Array = NDArray[np.float64]

_COVERED_M = 1e-3  # an outline that leaves a known obstacle by no more says nothing new
_STOP_SHARE = 1.875 / 2  # of v / brake: the reference's time that a stop along the plan uses up (`stop_plan`)
_ON_TIME_S = 1e-6
_LEAST_PERIODS = 2  # that a plan is given
FIRST_REACH_M, _FIRST_REACH_S = 60.0, 12.0  # how far the first plan leads, or how many seconds at full speed
_ONWARD_S = 0.4  # that the plan for the rest of the way is given
_SPARE_S = 0.3  # delay of the vehicle, and ticks


@dataclass(frozen=True)
class Whereabouts:
    """`sigma_s`, the reference's own time; whether the reference is being flown; the position (3,) if it is known."""

    sigma_s: float
    flying: bool
    r_m: Array | None


@dataclass(frozen=True)
class Adopted:
    """A new plan that goes into force at `t_s`, for reports that were heard at `heard_s`; `onward`: it only leads further
    than the one before, which ended short of the goal.
    """

    t_s: float
    heard_s: float
    from_s: float
    replan: Replan
    onward: bool


@dataclass(frozen=True)
class RerouteOrders:
    """What the run does this tick: ask the planner, adopt its answer, let the way be barred. `new` are the reports that
    were taken in; `log` lines (level, text).
    """

    ask: Question | None = None
    adopted: Adopted | None = None
    barred: bool = False
    new: tuple[ObstacleReport, ...] = ()
    log: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class _Attempt:
    """How a new plan is asked for: for reports of which the first was heard at `heard_s`, for the n-th time; or, `onward`,
    for the rest of the way.
    """

    heard_s: float
    number: int
    lead_s: float
    onward: bool = False


@dataclass(frozen=True)
class _Pending:
    """A question under way, and when its answer is needed."""

    question: Question
    due_s: float


class Rerouting:
    """Book-keeping of one flight. `plan` is the plan before take-off."""

    def __init__(self, config: RunConfig, plan: FlightPlan) -> None:
        self._config, self._bounds_m = config, plan.bounds_m
        self._reference, self._corridor = plan.reference, plan.corridor
        self._period_s = 1.0 / config.mpc.rate_hz
        self._known = [shapely.Polygon(ring) for ring in plan.obstacles_m]
        self._tops_m = plan.blocking_heights_m.tolist()
        self._names = set(plan.obstacle_names)
        self._explained = Explained.by(self._known, self._tops_m)
        self._unlearnt: list[ObstacleReport] = []  # what the planner has not been told yet
        self._attempt: _Attempt | None = None  # set while the plan in force needs another
        self._pending: _Pending | None = None
        self._conflict_s = np.inf  # when the reference meets an obstacle
        self._given_up = ""

    @property
    def explained(self) -> Explained:
        """Every obstacle known so far."""
        return self._explained

    @property
    def idle(self) -> bool:
        """Whether nothing is being planned: what a sensor sees meanwhile it will see again."""
        return self._pending is None

    @property
    def given_up(self) -> str:
        """Why the vehicle stops for good; empty while there is a way on."""
        return self._given_up

    @property
    def due_s(self) -> float:
        """When the answer is needed, run clock; infinite when nothing was asked."""
        return np.inf if self._pending is None else self._pending.due_s

    def step(
        self, now_s: float, at: Whereabouts, reports: Sequence[ObstacleReport], answer: Replan | None
    ) -> RerouteOrders:
        """One tick. An answer to a question that one of the `reports` withdraws is passed over."""
        log: list[tuple[str, str]] = []
        new = tuple(report for report in reports if self._hear(now_s, at, report, log))
        if self._attempt is not None and self._config.mode == "paper":
            self._give_up("paper mode plans before take-off only", log)
        if self._given_up:
            return RerouteOrders(barred=True, new=new, log=tuple(log))
        adopted = self._answered(now_s, at, answer, log) if answer is not None and not self.idle else None
        ask = None
        if self._attempt is not None and self._pending is None and not self._given_up:
            ask = self._ask(now_s, at, self._attempt)
        return RerouteOrders(ask, adopted, bool(self._given_up) or self._too_near(at), new, tuple(log))

    def _hear(self, now_s: float, at: Whereabouts, report: ObstacleReport, log: list[tuple[str, str]]) -> bool:
        """Take in a report; whether it says anything new."""
        obstacle, radius_m = report.obstacle, self._config.planner.vehicle_radius_m
        reach_m = radius_m + self._config.planner.margin_m
        if not matter([obstacle.polygon], self._bounds_m, reach_m)[0]:
            log.append(("warning", f"obstacle '{obstacle.name}' lies outside the world and is left alone"))
            return False
        if self._is_known(obstacle):
            log.append(("debug", f"obstacle '{obstacle.name}' is known already"))
            return False
        if obstacle.name in self._names and report.source is Source.MESSAGE:
            log.append(("warning", f"obstacle '{obstacle.name}' is reported elsewhere too: both outlines count"))
        self._known.append(obstacle.polygon)
        self._tops_m.append(self._top_m(obstacle))
        self._names.add(obstacle.name)
        self._explained = Explained.by(self._known, self._tops_m)
        self._unlearnt.append(report)
        if self._flown_over(at.sigma_s, obstacle):
            log.append(("info", f"obstacle '{obstacle.name}' heard of: the way leads over it"))
            return True
        if at.r_m is not None and obstacle.polygon.distance(shapely.Point(at.r_m[:2])) < radius_m:
            self._give_up(f"obstacle '{obstacle.name}' is reported on top of the vehicle", log)
            return True
        touches = self._check(now_s, at, report)
        log.append(("info", f"obstacle '{obstacle.name}' heard of: {_account(touches)}"))
        return True

    def _top_m(self, obstacle: Obstacle) -> float:
        """How high an obstacle is in the way: infinitely, where its height is unknown or there is one floor."""
        floors = len(self._corridor.z_m) > 0
        return obstacle.height_m if floors and obstacle.height_m is not None else np.inf

    def _is_known(self, obstacle: Obstacle) -> bool:
        """Whether an obstacle lies in one that is at least as high."""
        return any(
            self._tops_m[k] >= self._top_m(obstacle) and self._known[k].buffer(_COVERED_M).covers(obstacle.polygon)
            for k in self._explained.tree.query(obstacle.polygon).tolist()
        )

    def _flown_over(self, sigma_s: float, obstacle: Obstacle) -> bool:
        """Whether an obstacle stays below every region near it that is left, and out of the landing."""
        planner, interval_s = self._config.planner, self._config.mpc.step_s
        top_m = self._top_m(obstacle) + planner.vehicle_radius_m
        goal = shapely.Point(self._config.goal_m)
        if np.isinf(top_m) or obstacle.polygon.distance(goal) < planner.vehicle_radius_m + planner.margin_m:
            return False
        left = np.unique(self._reference.region[change_over(self._reference, sigma_s) :])
        fastest = np.array([planner.speed_mps, max(planner.climb_mps, planner.descent_mps)])
        aside_m, below_m = between_samples_m(fastest, interval_s).tolist()
        reached = left[self._corridor.z_m[left, 0] - below_m < top_m]
        regions = [shapely.Polygon(self._corridor.polygons_m[m]) for m in reached.tolist()]
        kept_m = planner.vehicle_radius_m + aside_m
        return not len(shapely.STRtree(regions).query(obstacle.polygon, predicate="dwithin", distance=kept_m))

    def _check(self, now_s: float, at: Whereabouts, report: ObstacleReport) -> bool:
        """Whether the plan in force must give way to an obstacle; if so, another is asked for."""
        touches = self._touches(at.sigma_s, report.obstacle.polygon)
        if touches and (self._attempt is None or self._attempt.onward):
            self._pending = None  # the rest of a way that is no longer flown
            left_s = self._config.replan.budget_s - (now_s - report.heard_s)
            periods = max(_LEAST_PERIODS, int(left_s / self._period_s + 1e-9))
            self._attempt = _Attempt(report.heard_s, 1, periods * self._period_s)
        return touches

    def _touches(self, sigma_s: float, polygon: shapely.Polygon) -> bool:
        """Whether what is left of the corridor is no longer proven; notes when the reference meets the obstacle."""
        k = change_over(self._reference, sigma_s)
        t_s, xy, region = self._reference.t_s[k:], self._reference.xyz_m[k:, :2], self._reference.region[k:]
        left = np.unique(region)
        bound_m = 0.0
        if len(t_s) > 1:
            fastest = float(speeds_mps(t_s, xy).max())
            bound_m = float(between_samples_m(np.array(fastest), self._config.mpc.step_s))
        kept_m = self._config.planner.vehicle_radius_m + bound_m
        regions = [shapely.Polygon(self._corridor.polygons_m[m]) for m in left.tolist()]
        if not len(shapely.STRtree(regions).query(polygon, predicate="dwithin", distance=kept_m)):
            return False
        near = np.flatnonzero(shapely.dwithin(shapely.points(xy), polygon, kept_m))
        if near.size:
            self._conflict_s = min(self._conflict_s, float(t_s[near[0]]))
        return True

    def _too_near(self, at: Whereabouts) -> bool:
        """Whether the vehicle must begin to stop now to rest before the obstacle."""
        if not at.flying or not np.isfinite(self._conflict_s):
            return False
        k = change_over(self._reference, at.sigma_s)
        ahead = self._reference.xyz_m[k : k + 2]
        speed = float(np.linalg.norm(np.diff(ahead, axis=0))) / self._period_s if len(ahead) > 1 else 0.0
        stop_s = _STOP_SHARE * speed / self._config.mission.brake_mps2 + _SPARE_S
        return at.sigma_s + stop_s >= self._conflict_s

    def _ask(self, now_s: float, at: Whereabouts, attempt: _Attempt) -> Question:
        from_s = at.sigma_s + attempt.lead_s if at.flying else 0.0
        from_s = float(self._reference.t_s[change_over(self._reference, from_s)])
        new, self._unlearnt = tuple(report.obstacle for report in self._unlearnt), []
        near = at.flying and not attempt.onward
        reach_m = max(FIRST_REACH_M, _FIRST_REACH_S * self._config.planner.speed_mps) if near else np.inf
        question = Question(new, self._reference, self._corridor, from_s, reach_m)
        self._pending = _Pending(question, now_s + attempt.lead_s)
        return question

    def _answered(self, now_s: float, at: Whereabouts, answer: Replan, log: list[tuple[str, str]]) -> Adopted | None:
        assert self._pending is not None, "an answer belongs to a question"
        assert self._attempt is not None
        question, self._pending = self._pending.question, None
        attempt, self._attempt = self._attempt, None
        if attempt.onward and answer.verdict is not Verdict.ROUTE:
            log.append(("warning", f"the way ends before the goal: {answer.why}"))
            return None
        if answer.verdict is Verdict.NONE:
            self._give_up(answer.why, log)
            return None
        if at.flying and at.sigma_s > question.from_s + _ON_TIME_S:
            self._late(attempt, log)
            return None
        self._reference, self._corridor, self._conflict_s = answer.reference, answer.corridor, np.inf
        for report in self._unlearnt:  # heard while this was planned
            self._check(now_s, at, report)
        if not answer.whole and self._attempt is None:
            self._attempt = _Attempt(now_s, 1, _ONWARD_S, onward=True)
        if answer.verdict is Verdict.STOP:
            log.append(("warning", f"no way on to the goal: {answer.why}; stopping on the way planned before"))
        elif not attempt.onward:
            log.append(("info", f"new route in force {now_s - attempt.heard_s:.2f} s after the report"))
        return Adopted(now_s, attempt.heard_s, question.from_s, answer, attempt.onward)

    def _late(self, attempt: _Attempt, log: list[tuple[str, str]]) -> None:
        if attempt.number >= self._config.replan.tries and not attempt.onward:
            self._give_up(f"the planner was late {attempt.number} times", log)
            return
        log.append(("warning", f"the new plan came later than the {attempt.lead_s:.2f} s it was given; asked again"))
        self._attempt = replace(attempt, number=attempt.number + 1, lead_s=2 * attempt.lead_s)

    def _give_up(self, why: str, log: list[tuple[str, str]]) -> None:
        self._given_up = why
        log.append(("error", f"no plan to fly on: {why}; braking along the last one"))


def _account(touches: bool) -> str:
    return "it touches the corridor, a new plan is asked for" if touches else "the plan keeps clear of it and stands"
