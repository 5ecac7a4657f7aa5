"""What becomes of reports, tick by tick: each branch of the module's diagram, with answers made by hand."""

import dataclasses
from functools import cache

import numpy as np
import pytest
import shapely
from shapely import Polygon, box

from sandwich_sitl.config import PlannerConfig, ReplanConfig, RunConfig, WorldConfig
from sandwich_sitl.mission import rerouting
from sandwich_sitl.mission.reports import ObstacleReport, Source
from sandwich_sitl.mission.rerouting import RerouteOrders, Rerouting, Whereabouts
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.plan import plan_flight
from sandwich_sitl.planning.replan import Known, Question, Replan, Verdict, learnt, replan
from sandwich_sitl.world.world import Obstacle, World

BOUNDS = (0.0, 0.0, 60.0, 30.0)
CONFIG = RunConfig(
    world=WorldConfig(bounds_m=BOUNDS), start_m=(5, 15), goal_m=(55, 15), altitude_m=5,
    planner=PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6, keep_map=False),
)  # fmt: skip
PERIOD_S = 0.02
ACROSS = box(35, 12, 37, 19)
ASIDE = box(20, 24, 24, 28)
LEAD_S = 0.14  # whole periods in the budget


@cache
def plan() -> FlightPlan:
    return plan_flight(CONFIG, World(BOUNDS, (Obstacle("shed", box(10, 2, 14, 5)),)), lambda _: None)


class Flight:
    """The reference flown to the letter from `sigma_s` on, one tick at a time."""

    def __init__(self, sigma_s: float, **replan: float) -> None:
        self.config = dataclasses.replace(CONFIG, replan=ReplanConfig(**replan))
        self.rerouting = Rerouting(self.config, plan())
        self.reference = plan().reference
        self.sigma_s, self.now_s = sigma_s, 100.0
        self.asked: list[Question] = []
        self.lines: list[str] = []

    @classmethod
    def at(cls, x_m: float, **replan: float) -> "Flight":
        reference = plan().reference
        return cls(float(reference.t_s[np.argmax(reference.xyz_m[:, 0] >= x_m)]), **replan)

    def tick(self, *polygons: Polygon, answer: Replan | None = None, name: str = "new") -> RerouteOrders:
        k = min(int(np.searchsorted(self.reference.t_s, self.sigma_s - 1e-9)), len(self.reference.t_s) - 1)
        at = Whereabouts(self.sigma_s, True, self.reference.xyz_m[k])
        reports = [ObstacleReport(Obstacle(name, polygon), Source.MESSAGE, self.now_s) for polygon in polygons]
        orders = self.rerouting.step(self.now_s, at, reports, answer)
        if orders.ask is not None:
            self.asked.append(orders.ask)
        if orders.adopted is not None:
            self.reference = orders.adopted.replan.reference
        self.lines += [text for _, text in orders.log]
        self.sigma_s += PERIOD_S
        self.now_s += PERIOD_S
        return orders

    def answer(self) -> Replan:
        """What the planner answers to everything asked so far."""
        new = [obstacle for question in self.asked for obstacle in question.obstacles]
        return replan(self.config, learnt(self.config, Known.of(plan()), new), self.asked[-1])


def test_an_obstacle_across_the_way_is_planned_round_within_the_budget() -> None:
    flight = Flight.at(15.0)
    heard_s, sigma_s = flight.now_s, flight.sigma_s
    orders = flight.tick(ACROSS)
    assert orders.ask is not None
    assert orders.ask.from_s == pytest.approx(sigma_s + LEAD_S)
    assert [report.obstacle.polygon for report in orders.new] == [ACROSS]
    assert flight.rerouting.due_s == pytest.approx(heard_s + LEAD_S)
    while flight.now_s < flight.rerouting.due_s - 1e-6:
        orders = flight.tick()
        assert (orders.ask, orders.adopted, orders.barred) == (None, None, False)
    orders = flight.tick(answer=flight.answer())
    assert orders.adopted is not None
    assert orders.adopted.t_s - orders.adopted.heard_s <= CONFIG.replan.budget_s + 1e-9
    assert orders.adopted.replan.verdict is Verdict.ROUTE
    assert flight.rerouting.idle
    assert not flight.rerouting.given_up
    line = shapely.LineString(flight.reference.xyz_m[:, :2])
    assert line.distance(ACROSS) > 0.4
    assert any("new route in force" in text for text in flight.lines)


def test_a_report_that_has_been_under_way_leaves_less_time() -> None:
    flight = Flight.at(15.0)
    late = ObstacleReport(Obstacle("new", ACROSS), Source.MESSAGE, flight.now_s - 0.05)
    at = Whereabouts(flight.sigma_s, True, None)
    ask = flight.rerouting.step(flight.now_s, at, [late], None).ask
    assert ask is not None
    assert ask.from_s == pytest.approx(flight.sigma_s + 0.1)


@pytest.mark.parametrize(
    ("polygon", "said"),
    [(ASIDE, "keeps clear"), (box(11, 3, 13, 4), "known already"), (box(80, 0, 90, 10), "outside the world")],
)
def test_what_does_not_touch_the_way_leaves_the_plan_alone(polygon: Polygon, said: str) -> None:
    flight = Flight.at(15.0)
    orders = flight.tick(polygon)
    assert (orders.ask, orders.adopted, orders.barred) == (None, None, False)
    assert said in flight.lines[-1]
    assert len(orders.new) == (polygon is ASIDE)


def test_an_obstacle_that_has_been_passed_leaves_the_plan_alone() -> None:
    assert Flight.at(45.0).tick(ACROSS).ask is None


def test_the_same_report_again_changes_nothing() -> None:
    flight = Flight.at(15.0)
    flight.tick(ACROSS)
    flight.tick(ACROSS)
    flight.tick(box(35.2, 13, 36, 18), name="part of it")
    assert len(flight.asked) == 1
    flight.tick(answer=flight.answer())
    assert [flight.tick(ACROSS).ask for _ in range(5)] == [None] * 5


def test_one_name_in_two_places_counts_twice() -> None:
    flight = Flight.at(15.0)
    flight.tick(ASIDE)
    assert flight.tick(ACROSS).ask is not None
    assert any("both outlines count" in text for text in flight.lines)
    assert {obstacle.polygon for obstacle in flight.asked[-1].obstacles} == {ASIDE, ACROSS}


def test_an_obstacle_that_comes_while_planning_is_planned_round_afterwards() -> None:
    flight = Flight.at(15.0)
    flight.tick(ACROSS)
    second = box(44, 10, 46, 22)
    assert flight.tick(second, name="second").ask is None
    orders = flight.tick(answer=flight.answer())
    assert orders.adopted is not None
    assert orders.ask is not None
    assert [obstacle.polygon for obstacle in orders.ask.obstacles] == [second]
    orders = flight.tick(answer=flight.answer())
    assert orders.adopted is not None
    line = shapely.LineString(flight.reference.xyz_m[:, :2])
    assert min(line.distance(ACROSS), line.distance(second)) > 0.4


def test_a_plan_that_ends_short_of_the_goal_is_followed_by_one_for_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rerouting, "FIRST_REACH_M", 20.0)
    monkeypatch.setattr(rerouting, "_FIRST_REACH_S", 0.0)
    flight = Flight.at(15.0)
    orders = flight.tick(ACROSS)
    assert orders.ask is not None
    assert orders.ask.reach_m == 20.0
    orders = flight.tick(answer=flight.answer())
    assert orders.adopted is not None
    assert not orders.adopted.replan.whole
    assert not orders.adopted.onward
    assert orders.ask is not None
    assert orders.ask.obstacles == ()
    assert np.isinf(orders.ask.reach_m)
    second = box(flight.reference.xyz_m[-1, 0] - 3, 10, flight.reference.xyz_m[-1, 0] - 2, 22)
    orders = flight.tick(second, name="second")  # more urgent than the rest of the way
    assert orders.ask is not None
    assert orders.ask.reach_m == 20.0
    assert not flight.tick(answer=flight.answer()).adopted.onward  # type: ignore[union-attr]
    orders = flight.tick(answer=flight.answer())
    assert orders.adopted is not None
    assert orders.adopted.onward
    assert orders.ask is None
    np.testing.assert_allclose(flight.reference.xyz_m[-1, :2], (55, 15), atol=1e-6)


def test_an_answer_that_a_report_of_the_same_tick_has_withdrawn_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """The way on to the goal is answered in the very tick in which an obstacle closes the way before it."""
    monkeypatch.setattr(rerouting, "FIRST_REACH_M", 20.0)
    monkeypatch.setattr(rerouting, "_FIRST_REACH_S", 0.0)
    flight = Flight.at(15.0)
    flight.tick(ACROSS)
    flight.tick(answer=flight.answer())
    assert np.isinf(flight.asked[-1].reach_m)
    onward, kept = flight.answer(), flight.reference
    x_m = float(kept.xyz_m[-1, 0])
    second = box(x_m - 3, 10, x_m - 2, 22)
    orders = flight.tick(second, name="second", answer=onward)
    assert orders.adopted is None
    assert flight.reference is kept
    assert orders.ask is not None
    assert (orders.ask.reach_m, [o.polygon for o in orders.ask.obstacles]) == (20.0, [second])
    orders = flight.tick(answer=flight.answer())
    assert orders.adopted is not None
    assert shapely.LineString(flight.reference.xyz_m[:, :2]).distance(second) > 0.4


def test_a_late_answer_is_asked_for_again_with_twice_the_time_and_at_last_given_up() -> None:
    flight = Flight.at(8.0, tries=3)
    flight.tick(ACROSS)
    for number in (1, 2, 3):
        answer = flight.answer()
        while flight.sigma_s <= flight.asked[-1].from_s + 0.01:
            flight.tick()
        orders = flight.tick(answer=answer)
        assert orders.adopted is None
        if number < 3:
            assert orders.ask is not None
            lead_s = flight.asked[-1].from_s - (flight.sigma_s - PERIOD_S)
            assert lead_s == pytest.approx(LEAD_S * 2**number)
    assert "late 3 times" in flight.rerouting.given_up
    assert orders.barred


def test_without_a_proven_plan_the_way_is_barred_for_good() -> None:
    flight = Flight.at(15.0)
    flight.tick(ACROSS)
    none = Replan(Verdict.NONE, flight.reference, plan().corridor, np.empty((0, 2)), "nothing fits")
    assert flight.tick(answer=none).barred
    assert flight.rerouting.given_up == "nothing fits"
    assert flight.tick(box(50, 10, 52, 20)).barred


def test_while_it_waits_the_vehicle_begins_to_stop_before_it_is_too_late() -> None:
    """The planner never answers: the way is barred while a stop still fits, and not before."""
    flight = Flight.at(15.0)
    flight.tick(ACROSS)
    while not flight.tick().barred:
        assert flight.now_s < 120.0
    k = int(np.searchsorted(flight.reference.t_s, flight.sigma_s))
    room_m = ACROSS.distance(shapely.Point(flight.reference.xyz_m[k, :2])) - 0.4
    v, brake = 3.0, CONFIG.mission.brake_mps2
    needed_m = 1.875 / 2 * v**2 / brake
    assert needed_m < room_m < needed_m + 2.0
    assert not flight.rerouting.given_up
    orders = flight.tick(answer=dataclasses.replace(flight.answer(), reference=flight.asked[-1].reference))
    assert orders.adopted is None  # sigma has run on beyond the change-over: late


def test_on_top_of_the_vehicle_it_stops_at_once() -> None:
    flight = Flight.at(15.0)
    x, y = 15.0, 15.0
    orders = flight.tick(box(x - 1, y - 1, x + 1, y + 1))
    assert orders.barred
    assert orders.ask is None
    assert "on top of the vehicle" in flight.rerouting.given_up


def test_before_take_off_the_whole_plan_is_made_anew() -> None:
    before = Rerouting(CONFIG, plan())
    at = Whereabouts(0.0, False, np.array([5.0, 15.0, 0.0]))
    report = ObstacleReport(Obstacle("new", ACROSS), Source.MESSAGE, 1.0)
    ask = before.step(1.0, at, [report], None).ask
    assert ask is not None
    assert ask.from_s == 0.0


def test_paper_mode_stops() -> None:
    config = dataclasses.replace(CONFIG, mode="paper")
    printed = Rerouting(config, plan())
    at = Whereabouts(20.0, True, np.array([15.0, 15.0, 5.0]))
    assert printed.step(1.0, at, [ObstacleReport(Obstacle("new", ACROSS), Source.MESSAGE, 1.0)], None).barred
    assert "paper mode" in printed.given_up
