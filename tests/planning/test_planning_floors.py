"""Floors: what each sees, which one is flown, altitude along the way, regions with altitudes and their proof."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from sandwich_sitl.config import PlannerConfig, RunConfig, WorldConfig
from sandwich_sitl.errors import InputError, NoRouteError
from sandwich_sitl.planning.baselines import path_length
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.floor_profile import Ends, lifted, needed_altitudes, parameters
from sandwich_sitl.planning.floors import climb_cost_m, seen_from, solid_outlines
from sandwich_sitl.planning.plan import plan_flight
from sandwich_sitl.planning.proof import prove_corridor
from sandwich_sitl.planning.time_law import Limits
from sandwich_sitl.world.world import Obstacle, World

Array = np.ndarray

BOUNDS = (0.0, 0.0, 60.0, 40.0)
WALL = shapely.box(26, 6, 34, 40)  # leaves a way round at the south, a detour


def run(world: World, **changes: Any) -> RunConfig:
    top = {key: changes.pop(key) for key in ("altitude_m", "goal_altitude_m", "start_m", "goal_m") if key in changes}
    planner = {"vehicle_radius_m": 0.4, "margin_m": 0.6, "flow": "x", "floors_m": (5.0, 15.0), "keep_map": False}
    return RunConfig(
        world=WorldConfig(bounds_m=world.bounds_m),
        **({"start_m": (5.0, 30.0), "goal_m": (55.0, 30.0), "altitude_m": 5.0} | top),
        planner=PlannerConfig(**(planner | changes)),
    )


def planned(world: World, **changes: Any) -> tuple[RunConfig, FlightPlan]:
    config = run(world, **changes)
    return config, plan_flight(config, world, lambda _: None)


def walled(height_m: float | None) -> World:
    return World(BOUNDS, (Obstacle("wall", WALL, height_m),))


def proof_of(config: RunConfig, plan: FlightPlan, **changes: Any) -> Any:
    arguments = {
        "reference": plan.reference, "corridor": plan.corridor, "obstacles_m": plan.obstacles_m,
        "radius_m": plan.vehicle_radius_m, "interval_s": config.mpc.step_s, "heights_m": plan.blocking_heights_m,
    }  # fmt: skip
    return prove_corridor(**(arguments | changes))


def test_a_floor_sees_what_reaches_it_with_radius_and_margin() -> None:
    """0.4 m of vehicle and 1 m of margin: 13.5 m reach the floor of 15 m less 1.4 m only just not."""
    obstacles = [Obstacle(str(h), shapely.box(k, 0, k + 1, 1), h) for k, h in enumerate((13.5, 13.7, 2.0, 80.0, None))]
    world = World(BOUNDS, tuple(obstacles))
    assert [o.name for o in seen_from(run(world), world, 15.0).obstacles] == ["13.7", "80.0", "None"]
    assert [o.name for o in seen_from(run(world), world, 3.0).obstacles] == ["13.5", "13.7", "2.0", "80.0", "None"]


@pytest.mark.parametrize(
    ("height_m", "climb_cost", "altitude_m"), [(8.0, 0.5, 15.0), (8.0, 5.0, 5.0), (20.0, 0.0, 5.0), (None, 0.0, 5.0)]
)
def test_the_route_rises_over_a_low_wall_when_that_costs_less_than_the_way_round(
    height_m: float | None, climb_cost: float, altitude_m: float
) -> None:
    config, plan = planned(walled(height_m), climb_cost=climb_cost, descent_cost=climb_cost)
    assert plan.floors is not None
    assert plan.proof is not None
    assert plan.proof.proven
    flown = plan.floors.figures[plan.floors.flown]
    assert flown.altitude_m == altitude_m == plan.reference.xyz_m[:, 2].max().round(6)
    assert flown.climb_cost_m == pytest.approx(climb_cost * 2 * (altitude_m - 5.0))
    assert flown.route_m + flown.climb_cost_m == min(f.route_m + f.climb_cost_m for f in plan.floors.figures)
    over = altitude_m > 5.0
    assert (plan.floors.changes, plan.floors.climbed_m) == (2 * over, pytest.approx(10.0 * over, abs=1e-6))
    if over:
        assert path_length(plan.route_m) == pytest.approx(50.0)
        assert 50.0 < plan.floors.length_m < 50.0 + 2 * 10.0
    np.testing.assert_allclose(plan.reference.xyz_m[-1], [*config.goal_m, 5.0], atol=1e-6)


def test_a_way_that_stays_on_its_floor_is_the_one_without_floors() -> None:
    _, level = planned(walled(20.0))
    _, plain = planned(walled(20.0), floors_m=())
    np.testing.assert_array_equal(level.route_m, plain.route_m)
    np.testing.assert_allclose(level.reference.xyz_m, plain.reference.xyz_m, atol=1e-9)
    assert plain.floors is None
    assert len(plain.corridor.z_m) == 0
    where = level.reference.xyz_m[:, 2] > 5.0 - 1e-9
    for mine, theirs in zip(level.reference.region[where], plain.reference.region[where], strict=True):
        np.testing.assert_allclose(level.corridor.polygons_m[mine], plain.corridor.polygons_m[theirs], atol=1e-6)


def test_the_reference_keeps_its_limits_in_space_and_when_climbing() -> None:
    config, plan = planned(walled(8.0), climb_cost=0.0, descent_cost=0.0, climb_mps=1.0, descent_mps=0.7)
    dt, planner = 1.0 / config.mpc.rate_hz, config.planner
    limits = (planner.speed_mps, planner.acceleration_mps2, planner.jerk_mps3, planner.snap_mps4)
    for order, limit in enumerate(limits, start=1):
        values = np.diff(plan.reference.xyz_m, n=order, axis=0) / dt**order
        assert np.linalg.norm(values, axis=1).max() <= 1.02 * limit
    rise = np.diff(plan.reference.xyz_m[:, 2]) / dt
    assert 0.98 * planner.climb_mps <= rise.max() <= 1.002 * planner.climb_mps
    assert 0.98 * planner.descent_mps <= -rise.min() <= 1.002 * planner.descent_mps
    assert plan.reference.xyz_m[:, 2].max() == pytest.approx(15.0)


def test_start_and_goal_may_be_on_different_floors() -> None:
    _, plan = planned(walled(20.0), altitude_m=15.0, goal_altitude_m=5.0, floors_m=(5.0, 15.0))
    assert plan.floors is not None
    assert (plan.floors.climbed_m, plan.floors.descended_m) == (pytest.approx(0.0, abs=1e-6), pytest.approx(10.0))
    assert plan.reference.xyz_m[-1, 2] == pytest.approx(5.0)
    _, plan = planned(walled(20.0), altitude_m=5.0, goal_altitude_m=15.0)
    assert plan.reference.xyz_m[-1, 2] == pytest.approx(15.0)
    assert plan.floors is not None
    assert plan.floors.changes == 1


def test_a_start_beside_a_low_wall_climbs_on_the_spot_and_comes_down_over_the_goal() -> None:
    config, plan = planned(walled(8.0), start_m=(24.5, 30.0), goal_m=(35.5, 30.0))
    assert plan.proof is not None
    assert plan.proof.proven
    assert plan.floors is not None
    assert (plan.floors.changes, plan.floors.climbed_m) == (2, pytest.approx(10.0, abs=1e-6))
    high = plan.reference.xyz_m[plan.reference.xyz_m[:, 2] > 14.99]
    assert high[0, 0] < 25.0
    assert high[-1, 0] > 35.0
    np.testing.assert_allclose(plan.reference.xyz_m[-1], [*config.goal_m, 5.0], atol=1e-6)


def test_a_courtyard_of_low_houses_is_left_over_the_roofs() -> None:
    ring = shapely.box(10, 10, 30, 30).difference(shapely.box(14, 14, 26, 26))
    sides = [
        shapely.box(10, 10, 30, 14),
        shapely.box(10, 26, 30, 30),
        shapely.box(10, 10, 14, 30),
        shapely.box(26, 10, 30, 30),
    ]
    assert shapely.union_all(sides).equals(ring)
    world = World(BOUNDS, tuple(Obstacle(f"side {k}", side, 8.0) for k, side in enumerate(sides)))
    _, plan = planned(world, start_m=(20.0, 20.0), goal_m=(50.0, 20.0))
    assert plan.floors is not None
    assert [bool(f.refused) for f in plan.floors.figures] == [True, False]
    assert path_length(plan.route_m) == pytest.approx(30.0)


def test_no_floor_over_a_wall_as_wide_as_the_world_is_no_route() -> None:
    wide = World(BOUNDS, (Obstacle("dam", shapely.box(26, -5, 34, 45), 14.0),))
    with pytest.raises(NoRouteError, match="dam"):
        planned(wide)
    _, plan = planned(wide, floors_m=(5.0, 16.0))
    assert plan.floors is not None
    assert plan.floors.flown == 1


def test_the_ground_beneath_start_and_goal_must_be_free_of_the_lowest_obstacle() -> None:
    world = World(BOUNDS, (Obstacle("bench", shapely.box(5.5, 29, 6.5, 31), 0.5),))
    with pytest.raises(InputError, match=r"start_m: \(5, 30\) is 0.50 m from obstacle 'bench'.*keep at least 1 m"):
        planned(world)


def test_a_margin_too_thin_for_the_climb_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"vertical_margin_m: 0.2 is less than 3 m/s up or down need; use at least 0.3"
    ):
        planned(walled(8.0), vertical_margin_m=0.2, climb_mps=3.0)


# --- the cheapest floor, a second way: Dijkstra on all floors at once, with a climb at every node free on both ---


def layered_costs(
    world: World, config: RunConfig, floors_m: tuple[float, ...], step_m: float
) -> tuple[float, list[float]]:
    """Least cost from start to goal over all layers, and over each layer alone with its climb."""
    x_min, y_min, x_max, y_max = world.bounds_m
    nx, ny = round((x_max - x_min) / step_m) + 1, round((y_max - y_min) / step_m) + 1
    xy = np.stack(np.meshgrid(np.linspace(x_min, x_max, nx), np.linspace(y_min, y_max, ny), indexing="ij"), axis=2)
    reach = config.planner.vehicle_radius_m + config.planner.margin_m
    points = shapely.points(xy.reshape(-1, 2))
    index = np.arange(nx * ny).reshape(nx, ny)
    rows, columns, costs, free_on = [], [], [], []
    for layer, z in enumerate(floors_m):
        seen = [o.polygon.buffer(reach, quad_segs=2) for o in seen_from(config, world, z).obstacles]
        free = ~shapely.intersects(shapely.union_all(seen), points).reshape(nx, ny)
        free_on.append(free)
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2)):
            a = (slice(0, nx - dx), slice(max(0, -dy), ny - max(0, dy)))
            b = (slice(dx, nx), slice(max(0, dy), ny - max(0, -dy)))
            both = free[a] & free[b]
            rows.append(index[a][both] + layer * nx * ny)
            columns.append(index[b][both] + layer * nx * ny)
            costs.append(np.full(both.sum(), step_m * np.hypot(dx, dy)))
    start, goal = (
        index[tuple(np.rint((np.array(p) - (x_min, y_min)) / step_m).astype(int))]
        for p in (config.start_m, config.goal_m)
    )
    alone = []
    size = nx * ny * len(floors_m)
    level = coo_array(
        (np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), shape=(size, size)
    ).tocsr()
    for layer, z in enumerate(floors_m):
        away = dijkstra(level, directed=False, indices=start + layer * nx * ny)
        alone.append(float(away[goal + layer * nx * ny]) + climb_cost_m(config, z))
    up, down, there, here = [], [], [], []
    for layer in range(len(floors_m) - 1):
        both = np.flatnonzero((free_on[layer] & free_on[layer + 1]).ravel())
        rise = floors_m[layer + 1] - floors_m[layer]
        here.append(both + layer * nx * ny)
        there.append(both + (layer + 1) * nx * ny)
        up.append(np.full(len(both), config.planner.climb_cost * rise))
        down.append(np.full(len(both), config.planner.descent_cost * rise))
    every = coo_array(
        (
            np.concatenate([*costs, *costs, *up, *down]),
            (np.concatenate([*rows, *columns, *here, *there]), np.concatenate([*columns, *rows, *there, *here])),
        ),
        shape=(size, size),
    ).tocsr()
    return float(dijkstra(every, indices=start)[goal]), alone


def random_world(seed: int) -> World:
    random = np.random.default_rng(seed)
    obstacles = []
    for number in range(7):
        x, y = random.uniform((12, 0), (44, 34))
        box = shapely.box(x, y, x + random.uniform(3, 8), y + random.uniform(4, 18))
        obstacles.append(Obstacle(f"box {number}", box, float(random.choice([3.0, 8.0, 12.0, 30.0]))))
    return World(BOUNDS, tuple(obstacles))


@pytest.mark.parametrize("seed", range(6))
def test_the_flown_floor_costs_no_more_than_any_way_over_all_floors(seed: int) -> None:
    world, floors_m = random_world(seed), (5.0, 10.0, 15.0)
    config, plan = planned(world, floors_m=floors_m, climb_cost=0.6, descent_cost=0.3, route="exact", cell_m=1.5)
    best, alone = layered_costs(world, config, floors_m, 0.5)
    assert best == pytest.approx(min(alone)), "changing floors anywhere gains nothing over one floor from end to end"
    assert plan.floors is not None
    flown = plan.floors.figures[plan.floors.flown]
    cost = flown.route_m + flown.climb_cost_m
    assert cost <= best + 0.3, "half a cell: the grid's points may be nearer to mitred corners"
    assert cost >= best / 1.028 - 1.5, "a grid of sixteen directions is at most 2.8 % longer"


# --- altitude along the way ---


def straight_curve(length_m: float) -> BSpline:
    knots = np.concatenate([np.zeros(5), np.linspace(0, length_m, round(length_m / 0.6) + 1), np.full(5, length_m)])
    places = np.array([knots[i + 1 : i + 6].mean() for i in range(len(knots) - 6)])
    return BSpline(knots, np.column_stack([places, np.zeros(len(places))]), 5)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.floats(2, 98), st.floats(0.1, 15), st.sampled_from([12.0, 18.0])), max_size=4),
    st.sampled_from([6.0, 12.0, 18.0]),
    st.sampled_from([6.0, 12.0]),
)
def test_the_profile_is_where_it_is_needed_and_never_sinks_to_rise_again(
    needs: list[tuple[float, float, float]], start_m: float, goal_m: float
) -> None:
    curve = straight_curve(100.0)
    u = parameters(curve)
    needed = np.full(len(u), 6.0)
    for at, width, z in needs:
        needed = np.where(np.abs(u - at) < width, np.maximum(needed, z), needed)
    z = np.asarray(lifted(curve, needed, Ends(start_m, goal_m, 1.5, 1.2), Limits(3.0, 2.0, 10.0, 60.0))(u))[:, 2]
    top = max(float(needed.max()), start_m, goal_m)
    assert (z >= needed - 1e-9).all()
    assert z.max() <= top + 1e-9
    assert z[0] >= start_m - 1e-9
    assert z[-1] >= goal_m - 1e-9
    slope = np.diff(z)
    sinks = np.flatnonzero(slope < -1e-9)
    assert sinks.size == 0 or (slope[sinks[0] :] <= 1e-9).all()


def test_what_is_needed_is_the_lowest_floor_with_room() -> None:
    world = World(
        BOUNDS, (Obstacle("low", shapely.box(10, 0, 20, 10), 8.0), Obstacle("tall", shapely.box(30, 0, 40, 10)))
    )
    solids = solid_outlines(run(world), world)
    points = np.array([[5.0, 5], [9.0, 5], [9.3, 5], [15, 5], [29.3, 5.0], [35, 5]])
    needed = needed_altitudes(points, solids, (5.0, 15.0), 0.48, 1.0)
    np.testing.assert_array_equal(needed, [5, 5, 15, 15, np.inf, np.inf])


# --- the proof ---


def test_the_proof_sees_every_way_in_which_a_region_may_be_too_low() -> None:
    config, plan = planned(walled(8.0), climb_cost=0.0, descent_cost=0.0)
    good = proof_of(config, plan)
    assert good.proven
    assert good.least_headroom_m is not None
    over = [m for m, ring in enumerate(plan.corridor.polygons_m) if WALL.distance(shapely.Polygon(ring)) <= 0.4]
    least_m = min(plan.corridor.z_m[over, 0]) - 8.0 - plan.vehicle_radius_m
    assert good.least_headroom_m == pytest.approx(least_m, abs=0.11)  # less what it may sink by between samples

    assert not proof_of(config, plan, heights_m=np.array([8.0 + good.least_headroom_m + 0.01])).proven
    assert proof_of(config, plan, heights_m=np.array([8.0 + good.least_headroom_m - 0.01])).proven
    assert not proof_of(config, plan, heights_m=None).proven
    z_m = plan.corridor.z_m.copy()
    z_m[over[0], 0] = 8.3
    assert not proof_of(config, plan, corridor=dataclasses.replace(plan.corridor, z_m=z_m)).proven
    for shift in (-1.5, 1.5):
        moved = dataclasses.replace(plan.corridor, z_m=plan.corridor.z_m + shift)
        assert "leaves its region" in proof_of(config, plan, corridor=moved).problem


def test_no_point_of_any_region_is_in_an_obstacle_grown_by_the_vehicle() -> None:
    """Sampled: points of the prisms against a ball of the vehicle's radius round them."""
    _, plan = planned(walled(8.0), climb_cost=0.0, descent_cost=0.0)
    random = np.random.default_rng(1)
    for ring, (low, high) in zip(plan.corridor.polygons_m, plan.corridor.z_m, strict=True):
        xy = random.dirichlet(np.ones(len(ring)), 40) @ ring
        z = np.concatenate([[low, high], random.uniform(low, high, 38)])
        outside = np.hypot(shapely.distance(WALL, shapely.points(xy)), np.maximum(z - 8.0, 0.0))
        assert outside.min() > plan.vehicle_radius_m
