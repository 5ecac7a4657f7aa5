"""A new plan in flight: nothing steps at the change-over, the corridor is proven, and what cannot be is said."""

from functools import cache

import numpy as np
import pytest
import shapely
from shapely import Polygon, box
from shapely.affinity import rotate

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.config import PlannerConfig, RunConfig
from sandwich_sitl.planning.flight_plan import Corridor, Reference
from sandwich_sitl.planning.proof import prove_corridor
from sandwich_sitl.planning.reference import ground_of, timed_reference
from sandwich_sitl.planning.replan import Known, Question, Replan, Verdict, change_over, learnt, replan
from sandwich_sitl.world.grow import grow
from sandwich_sitl.world.world import Obstacle, World
from sandwich_sitl.world_config import WorldConfig

BOUNDS = (0.0, 0.0, 60.0, 40.0)
OBSTACLES = (Obstacle("west", box(20, 12, 30, 20)), Obstacle("east", box(38, 21, 46, 30)))
ROUTE = np.array([[4.0, 16.0], [19.0, 21.0], [31.0, 21.0], [56.0, 18.0]])
GOAL = (56.0, 18.0)
CONFIG = RunConfig(
    world=WorldConfig(bounds_m=BOUNDS), start_m=(4, 16), goal_m=GOAL, altitude_m=5,
    planner=PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6),
)  # fmt: skip
DT_S = 1.0 / CONFIG.mpc.rate_hz
LIMITS = np.array([3.0, 2.0, 10.0, 60.0])  # the reference's own
PLANS = np.array([12.0, 6.0, 40.0, 600.0])  # the controller's, which a hard stop may use


@cache
def flown() -> tuple[Known, Reference, Corridor]:
    channel_map = build_channel_map(grow(World(BOUNDS, OBSTACLES), 1.0, 0.1), 1.0, 5)
    ground = ground_of(CONFIG, channel_map, [o.polygon for o in OBSTACLES])
    reference, corridor, _ = timed_reference(CONFIG, ground, ROUTE)
    return Known(channel_map, OBSTACLES), reference, corridor


def when(x_m: float) -> float:
    """When the reference comes by, at cruising altitude."""
    _, reference, _ = flown()
    return float(reference.t_s[np.argmax(reference.xyz_m[:, 0] >= x_m)])


def planned(*polygons: Polygon, from_s: float) -> tuple[Known, Replan]:
    known, reference, corridor = flown()
    new = tuple(Obstacle(f"new{k}", polygon) for k, polygon in enumerate(polygons))
    known = learnt(CONFIG, known, new)
    return known, replan(CONFIG, known, Question(new, reference, corridor, from_s))


def check(known: Known, answer: Replan, before: tuple[Reference, Corridor], from_s: float) -> None:
    """The laws of every plan that may be adopted."""
    reference, k = answer.reference, change_over(before[0], from_s)
    np.testing.assert_array_equal(reference.xyz_m[:k], before[0].xyz_m[:k])
    np.testing.assert_allclose(reference.xyz_m[k], before[0].xyz_m[k], atol=1e-9)
    np.testing.assert_allclose(np.diff(reference.t_s), DT_S, atol=1e-9)
    for m in np.unique(before[0].region[:k]):
        np.testing.assert_array_equal(answer.corridor.polygons_m[m], before[1].polygons_m[m])
    held = np.concatenate([reference.xyz_m, np.repeat(reference.xyz_m[-1:], 4, axis=0)])
    # Differences of order n are bounded throughout, so derivatives of order n - 1 step nowhere.
    largest = [np.linalg.norm(np.diff(held, n=n, axis=0), axis=1).max() / DT_S**n for n in (1, 2, 3, 4)]
    gentle = bool((largest <= LIMITS * [1.02, 1.03, 1.04, 1.1]).all())
    assert gentle or (np.array(largest) <= PLANS).all(), largest
    new = Reference(reference.t_s[k:], reference.xyz_m[k:], reference.region[k:])
    rings = [shapely.get_coordinates(shapely.orient_polygons(o.polygon).exterior)[:-1] for o in known.obstacles]
    corridor = answer.corridor
    used = np.unique(new.region)
    own = Corridor(
        corridor.Lambda[used], corridor.Gamma[used], tuple(corridor.polygons_m[m] for m in used), np.empty((0, 4, 2))
    )
    renumbered = Reference(new.t_s, new.xyz_m, np.searchsorted(used, new.region))
    proof = prove_corridor(renumbered, own, rings, 0.4, CONFIG.mpc.step_s)
    assert proof.proven, proof.problem
    flown_line = shapely.LineString(new.xyz_m[:, :2]) if np.ptp(new.xyz_m[:, :2]) > 0 else shapely.Point(new.xyz_m[0])
    assert min(o.polygon.distance(flown_line) for o in known.obstacles) > 0.4
    if answer.verdict is Verdict.ROUTE:
        np.testing.assert_allclose(reference.xyz_m[-1], [*GOAL, 5.0], atol=1e-6)


@pytest.mark.parametrize("seed", range(24))
def test_whatever_pops_up_the_new_plan_keeps_every_law(seed: int) -> None:
    rng = np.random.default_rng(seed)
    _, reference, corridor = flown()
    k = int(rng.integers(0, len(reference.t_s) - 50))
    ahead = reference.xyz_m[min(k + int(rng.integers(50, 700)), len(reference.t_s) - 1), :2] + rng.uniform(-2, 2, 2)
    body = rotate(box(*(ahead - rng.uniform(0.2, 3, 2)), *(ahead + rng.uniform(0.2, 3, 2))), float(rng.uniform(0, 90)))
    from_s = float(reference.t_s[k])
    known, answer = planned(body, from_s=from_s)
    if answer.verdict is Verdict.NONE:
        assert body.distance(shapely.Point(reference.xyz_m[k, :2])) < 3.0, answer.why
        return
    check(known, answer, (reference, corridor), from_s)
    if answer.verdict is Verdict.STOP:
        assert body.distance(shapely.Point(GOAL)) < 1.1
        assert answer.why


def test_obstacles_one_after_another() -> None:
    known, reference, corridor = flown()
    for number, x_m in enumerate((24.0, 34.0, 40.0, 50.0)):
        from_s = float(reference.t_s[np.argmax(reference.xyz_m[:, 0] >= x_m - 7.0)])
        there = reference.xyz_m[np.argmax(reference.xyz_m[:, 0] >= x_m), :2]
        new = (Obstacle(f"crate {number}", shapely.Point(there).buffer(0.8, quad_segs=2)),)
        known = learnt(CONFIG, known, new)
        answer = replan(CONFIG, known, Question(new, reference, corridor, from_s))
        assert answer.verdict is Verdict.ROUTE
        check(known, answer, (reference, corridor), from_s)
        reference, corridor = answer.reference, answer.corridor


def test_before_take_off_the_climb_stays_and_the_route_is_new() -> None:
    _, reference, corridor = flown()
    known, answer = planned(box(24, 20.5, 26, 24), from_s=0.0)
    assert answer.verdict is Verdict.ROUTE
    check(known, answer, (reference, corridor), 0.0)
    assert answer.reference.region.min() == len(corridor.polygons_m)


def test_a_wall_across_the_world_stops_the_vehicle_before_it() -> None:
    _, reference, corridor = flown()
    wall = box(33, -1, 34, 41)
    from_s = when(20.0)
    known, answer = planned(wall, from_s=from_s)
    assert answer.verdict is Verdict.STOP
    assert "close every way" in answer.why
    check(known, answer, (reference, corridor), from_s)
    assert answer.reference.xyz_m[-1, 0] < 33 - 0.4
    assert len(answer.route_m) == 0
    curve = shapely.LineString(reference.xyz_m[:, :2])
    assert shapely.distance(shapely.points(answer.reference.xyz_m[:, :2]), curve).max() < 1e-3


def test_a_plan_of_limited_reach_ends_at_rest_and_the_rest_of_the_way_follows_on_seamlessly() -> None:
    known, reference, corridor = flown()
    crate = (Obstacle("crate", box(24, 20, 25, 23)),)
    known = learnt(CONFIG, known, crate)
    from_s = when(16.0)
    near = replan(CONFIG, known, Question(crate, reference, corridor, from_s, reach_m=15.0))
    assert (near.verdict, near.whole) == (Verdict.ROUTE, False)
    np.testing.assert_allclose(near.route_m[-1], GOAL)
    flown_m = np.hypot(*np.diff(near.reference.xyz_m[change_over(reference, from_s) :, :2], axis=0).T).sum()
    assert 14.5 < flown_m < 16.0
    assert np.linalg.norm(near.reference.xyz_m[-1] - near.reference.xyz_m[-2]) < 1e-4
    onward_s = from_s + 0.4
    whole = replan(CONFIG, known, Question((), near.reference, near.corridor, onward_s))
    assert whole.whole
    check(known, whole, (near.reference, near.corridor), onward_s)


def test_an_obstacle_over_the_goal_is_named() -> None:
    _, answer = planned(box(55, 17, 57, 19), from_s=when(20.0))
    assert answer.verdict is Verdict.STOP
    assert "the goal lies in obstacle 'new0'" in answer.why


def test_too_near_to_stop_there_is_no_plan() -> None:
    at = flown()[1].xyz_m[np.argmax(flown()[1].t_s >= when(24.0)), :2]
    _, answer = planned(box(at[0] + 0.9, at[1] - 2, at[0] + 2, at[1] + 2), from_s=when(24.0))
    assert answer.verdict is Verdict.NONE
    assert answer.reference is flown()[1]


def test_the_vehicle_may_stand_within_the_margin_of_what_appears() -> None:
    """0.5 m off its side: nearer than planning allows, but not touching."""
    _, reference, corridor = flown()
    from_s = when(24.0)
    at = reference.xyz_m[np.argmax(reference.t_s >= from_s), :2]
    known, answer = planned(box(at[0] - 1, at[1] + 1.0, at[0] + 1, at[1] + 3), from_s=from_s)
    assert answer.verdict is Verdict.ROUTE
    check(known, answer, (reference, corridor), from_s)
