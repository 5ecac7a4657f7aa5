"""Reports on a flight over a wall: what is low enough is flown over, what is taller than what was known is new."""

from functools import cache

import numpy as np
import pytest
from shapely import Polygon, box

from sandwich_sitl.config import PlannerConfig, RunConfig, WorldConfig
from sandwich_sitl.mission.reports import ObstacleReport, Source
from sandwich_sitl.mission.rerouting import RerouteOrders, Rerouting, Whereabouts
from sandwich_sitl.mission.sightings import Explained
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.plan import plan_flight
from sandwich_sitl.planning.replan import Known, Verdict, replan
from sandwich_sitl.world.world import Obstacle, World

WALL = box(34, 0, 42, 40)
WORLD = World((0.0, 0.0, 76.0, 40.0), (Obstacle("wall", WALL, 8.0),))
CONFIG = RunConfig(
    world=WorldConfig(bounds_m=WORLD.bounds_m), start_m=(5, 20), goal_m=(71, 20), altitude_m=5,
    planner=PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6, floors_m=(5.0, 15.0), keep_map=False),
)  # fmt: skip


@cache
def plan() -> FlightPlan:
    return plan_flight(CONFIG, WORLD, lambda _: None)


def told(x_m: float, polygon: Polygon, height_m: float | None) -> tuple[Rerouting, RerouteOrders]:
    """What becomes of a report when the vehicle is at `x_m` on its way."""
    rerouting, reference = Rerouting(CONFIG, plan()), plan().reference
    k = int(np.argmax(reference.xyz_m[:, 0] >= x_m))
    at = Whereabouts(float(reference.t_s[k]), True, reference.xyz_m[k])
    report = ObstacleReport(Obstacle("new", polygon, height_m), Source.MESSAGE, 0.0)
    return rerouting, rerouting.step(0.0, at, [report], None)


@pytest.mark.parametrize(
    ("x_m", "polygon", "height_m", "asks"),
    [
        (10.0, box(36, 18, 40, 22), 14.0, True),  # on the wall: with the vehicle's radius it reaches the regions
        (10.0, box(36, 18, 40, 22), 12.0, False),  # on the wall, higher than it, but not that high
        (10.0, box(36, 18, 40, 22), 7.0, False),  # lower than the wall it stands in
        (10.0, box(30, 18, 33, 22), 9.0, False),  # before the wall, where the way is high already
        (10.0, box(12, 18, 15, 22), 4.8, True),  # under the start's floor, where regions begin at 4 m
        (10.0, box(12, 18, 15, 22), 3.0, False),
        (10.0, box(70, 19, 72, 21), 2.0, True),  # where it is to land
        (50.0, box(12, 18, 15, 22), 30.0, False),  # behind
        (10.0, box(36, 18, 40, 22), None, True),  # of unknown height
    ],
)
def test_only_what_reaches_the_way_asks_for_another(
    x_m: float, polygon: Polygon, height_m: float | None, asks: bool
) -> None:
    over = plan().reference.xyz_m[np.abs(plan().reference.xyz_m[:, 0] - 38) < 2, 2]
    assert over.min() > 14.9
    rerouting, orders = told(x_m, polygon, height_m)
    assert (orders.ask is not None) is asks
    assert not rerouting.given_up


def test_a_tower_on_a_known_low_wall_is_not_known() -> None:
    _, orders = told(10.0, box(36, 18, 40, 22), 30.0)
    assert len(orders.new) == 1
    _, orders = told(10.0, box(36, 18, 40, 22), 8.0)
    assert orders.new == ()
    assert "known already" in orders.log[0][1]


def test_among_floors_no_new_way_is_sought() -> None:
    rerouting, orders = told(10.0, box(50, 0, 52, 40), 30.0)
    assert orders.ask is not None
    answer = replan(CONFIG, Known.of(plan()), orders.ask)
    assert answer.verdict is Verdict.NONE
    reference = plan().reference
    at = Whereabouts(orders.ask.from_s, True, reference.xyz_m[0])
    orders = rerouting.step(0.1, at, [], answer)
    assert orders.barred
    assert "floors" in rerouting.given_up


def test_a_return_at_altitude_is_not_explained_by_what_ends_far_below() -> None:
    known = Explained.by([WALL, box(50, 0, 52, 4)], [8.0, np.inf])
    points, within = np.array([[36.0, 20.0], [51.0, 2.0]]), np.array([0.5, 0.5])
    assert known.near(points, within, 15.0).tolist() == [False, True]
    assert known.near(points, within, 8.5).tolist() == [True, True]
    assert Explained.by([WALL]).near(points, within, 500.0).tolist() == [True, False]
