"""The planner beside the loop: the same answers as inside it, the newest question's alone, and an end that is survived."""

import time
from functools import cache

import numpy as np
import shapely

from sandwich_sitl.config import PlannerConfig, RunConfig, WorldConfig
from sandwich_sitl.planner_process import Answer, InlinePlanner, Planner, PlannerProcess
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.plan import plan_flight
from sandwich_sitl.planning.replan import Question, Verdict
from sandwich_sitl.world.world import Obstacle, World

BOUNDS = (0.0, 0.0, 40.0, 24.0)
CONFIG = RunConfig(
    world=WorldConfig(bounds_m=BOUNDS), start_m=(4, 12), goal_m=(36, 12), altitude_m=3,
    planner=PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6, keep_map=False),
)  # fmt: skip
DEADLINE_S = 30.0


@cache
def plan() -> FlightPlan:
    return plan_flight(CONFIG, World(BOUNDS, (Obstacle("shed", shapely.box(12, 2, 16, 6)),)), lambda _: None)


def question(name: str, x_m: float) -> Question:
    reference = plan().reference
    from_s = float(reference.t_s[np.argmax(reference.xyz_m[:, 0] >= 10.0)])
    return Question((Obstacle(name, shapely.box(x_m, 10, x_m + 1, 14)),), reference, plan().corridor, from_s)


def awaited(planner: Planner) -> Answer:
    deadline = time.monotonic() + DEADLINE_S
    while (answer := planner.answer()) is None:
        assert time.monotonic() < deadline, "no answer in time"
        time.sleep(0.005)
    return answer


def test_a_process_answers_as_the_loop_itself_would_and_remembers() -> None:
    inline = InlinePlanner(CONFIG, plan())
    with PlannerProcess(CONFIG, plan()) as process:
        assert process.answer() is None
        for asked in (question("first", 22.0), question("second", 28.0)):
            found = []
            for planner in (inline, process):
                planner.ask(asked)
                found.append(awaited(planner).replan)
            np.testing.assert_array_equal(found[0].reference.xyz_m, found[1].reference.xyz_m)
            assert found[1].verdict is Verdict.ROUTE
        line = shapely.LineString(found[1].reference.xyz_m[:, :2])
        assert min(line.distance(shapely.box(x, 10, x + 1, 14)) for x in (22.0, 28.0)) > 0.4
        for planner in (inline, process):
            planner.ask(question("third", 18.0))
            planner.ask(question("fourth", 32.0))
            line = shapely.LineString(awaited(planner).replan.reference.xyz_m[:, :2])
            assert min(line.distance(shapely.box(x, 10, x + 1, 14)) for x in (18.0, 22.0, 28.0, 32.0)) > 0.4
            assert planner.answer() is None


def test_a_process_that_has_died_answers_that_there_is_no_plan() -> None:
    process = PlannerProcess(CONFIG, plan())
    process._process.kill()
    process._process.join(DEADLINE_S)
    process.ask(question("first", 22.0))
    answer = awaited(process)
    assert answer.replan.verdict is Verdict.NONE
    assert "planner has ended" in answer.replan.why
    process.close()
    process.close()
