"""`plan_flight` on the shipped configurations, in both modes."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import Polygon

from sandwich_sitl.config import RunConfig, load_config
from sandwich_sitl.planning.baselines import path_length
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.plan import plan_flight
from sandwich_sitl.world.load import load_world

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))


@pytest.fixture(scope="module", params=CONFIGS, ids=lambda path: path.stem)
def planned(request: pytest.FixtureRequest) -> tuple[RunConfig, FlightPlan, list[str]]:
    config = load_config(request.param, {"mode": "timed"})
    stages: list[str] = []
    return config, plan_flight(config, load_world(config.world, request.param), stages.append), stages


Planned = tuple[RunConfig, FlightPlan, list[str]]


def test_route_joins_start_and_goal_and_no_path_beats_the_exact_one(planned: Planned) -> None:
    config, plan, stages = planned
    assert stages == ["grow obstacles", "channel map", "route", "baselines", "reference and corridor"]
    least = path_length(plan.exact_m)
    for path in (plan.sandwich_m, plan.grid_astar_m, plan.exact_m):
        np.testing.assert_allclose(path[[0, -1]], [config.start_m, config.goal_m])
        assert path_length(path) >= least - 1e-3
    assert path_length(plan.sandwich_m) < 1.1 * least
    if config.name == "paper":
        assert path_length(plan.sandwich_m) < path_length(plan.grid_astar_m)


def test_reference_is_a_rest_to_rest_flight_within_the_limits(planned: Planned) -> None:
    config, plan, _ = planned
    reference, dt = plan.reference, 1.0 / config.mpc.rate_hz
    np.testing.assert_allclose(np.diff(reference.t_s), dt)
    np.testing.assert_allclose(reference.xyz_m[0], [*config.start_m, 0.0], atol=1e-9)
    np.testing.assert_allclose(reference.xyz_m[-1], [*config.goal_m, config.altitude_m], atol=1e-6)
    velocity = np.diff(reference.xyz_m, axis=0) / dt
    acceleration = np.diff(velocity, axis=0) / dt
    assert np.hypot(*velocity[:, :2].T).max() <= 1.01 * config.planner.speed_mps
    assert np.linalg.norm(acceleration, axis=1).max() <= 1.05 * config.planner.acceleration_mps2
    assert np.linalg.norm(velocity[[0, -1]], axis=1).max() < 0.05
    # It climbs before it leaves.
    below = reference.xyz_m[:, 2] < config.altitude_m - 1e-6
    assert np.abs(reference.xyz_m[below, :2] - config.start_m).max() < 1e-9


def test_corridor_holds_the_reference_and_meets_no_obstacle(planned: Planned) -> None:
    config, plan, _ = planned
    reference, corridor = plan.reference, plan.corridor
    assert (np.diff(reference.region) >= 0).all()
    excess = (corridor.Lambda[reference.region] @ reference.xyz_m[:, :2, None])[..., 0] - corridor.Gamma[
        reference.region
    ]
    assert excess.max() <= 1e-9
    np.testing.assert_allclose(np.linalg.norm(corridor.Lambda, axis=-1), 1.0)
    radius_m = config.planner.vehicle_radius_m
    bodies = np.array([Polygon(ring).buffer(radius_m) for ring in plan.obstacles_m], dtype=object)
    low = corridor.z_m[:, 0] if len(corridor.z_m) else np.full(len(corridor.polygons_m), -np.inf)
    for ring, z in zip(corridor.polygons_m, low, strict=True):
        assert Polygon(ring).convex_hull.area == pytest.approx(Polygon(ring).area)
        reaching = bodies[plan.blocking_heights_m + radius_m > z]
        assert shapely.area(shapely.intersection(reaching, Polygon(ring))).sum() < 1e-6
    # Neighbouring regions overlap, so that the vehicle can pass from one to the next.
    for a, b in zip(corridor.polygons_m[:-1], corridor.polygons_m[1:], strict=True):
        assert Polygon(a).intersects(Polygon(b))


def test_reference_keeps_its_distance_from_the_bare_obstacles(planned: Planned) -> None:
    config, plan, _ = planned
    if not plan.obstacles_m:
        assert plan.grown_m == ()
        return
    least = config.planner.vehicle_radius_m + 0.5 * config.planner.margin_m
    flown = shapely.points(plan.reference.xyz_m[:, :2])
    for ring, height in zip(plan.obstacles_m, plan.blocking_heights_m, strict=True):
        above = plan.reference.xyz_m[:, 2] - height
        assert np.hypot(shapely.distance(Polygon(ring), flown), np.maximum(above, 0.0)).min() >= least


def test_plan_tells_the_world_as_it_was_given(planned: Planned) -> None:
    config, plan, _ = planned
    if config.world.file is not None:
        world = load_world(config.world, next(path for path in CONFIGS if path.stem == config.name))
        assert plan.obstacle_names == tuple(o.name for o in world.obstacles)
        assert plan.bounds_m == world.bounds_m
        return
    assert len(plan.obstacles_m) == len(config.world.obstacles) == len(plan.obstacle_names)
    for ring, item, height in zip(plan.obstacles_m, config.world.obstacles, plan.obstacle_heights_m, strict=True):
        assert shapely.is_ccw(shapely.LinearRing(ring))
        assert (np.isnan(height) and item.height_m is None) or height == item.height_m
        if item.polygon_m is not None:
            assert Polygon(ring).equals(Polygon(item.polygon_m))
    assert plan.sandwich_phi_psi.shape == (len(plan.sandwich_m) - 2, 2)
    phi, psi = plan.sandwich_phi_psi.T
    assert plan.channel_map.phi[0] <= phi.min() <= phi.max() <= plan.channel_map.phi[-1]
    assert plan.channel_map.Psi[0] <= psi.min() <= psi.max() <= plan.channel_map.Psi[-1]


@pytest.mark.parametrize("name", ["open", "single", "paper"])
def test_paper_mode_visits_one_node_a_step(name: str) -> None:
    path = next(path for path in CONFIGS if path.stem == name)
    config = load_config(path, {"mode": "paper"})
    plan = plan_flight(config, load_world(config.world, path), lambda _: None)
    reference = plan.reference
    level = np.flatnonzero(reference.xyz_m[:, 2] >= config.altitude_m)
    begin = reference.t_s[level[0]] + 1.0 / config.mpc.rate_hz
    times = begin + np.arange(len(plan.sandwich_m)) * config.mpc.step_s
    visited = np.column_stack([np.interp(times, reference.t_s, reference.xyz_m[:, axis]) for axis in range(2)])
    np.testing.assert_allclose(visited, plan.sandwich_m, atol=1e-6)
    columns = np.searchsorted(plan.channel_map.phi, plan.sandwich_phi_psi[:, 0])
    assert np.abs(np.diff(columns)).max() == 1, "a step leads to one of the eight neighbours"
    assert len(plan.corridor.Lambda) == len(plan.sandwich_m)
    np.testing.assert_array_equal(np.array(plan.corridor.polygons_m), plan.corridor.neighbours_m)
    for quadrangle in plan.corridor.neighbours_m:
        assert shapely.is_ccw(shapely.LinearRing(quadrangle))


def test_planning_twice_gives_the_same_bytes() -> None:
    path = next(path for path in CONFIGS if path.stem == "single")
    config = load_config(path)
    plans = [plan_flight(config, load_world(config.world, path), lambda _: None) for _ in range(2)]
    for name in ("sandwich_m", "grid_astar_m", "exact_m"):
        assert getattr(plans[0], name).tobytes() == getattr(plans[1], name).tobytes()
    assert plans[0].reference.xyz_m.tobytes() == plans[1].reference.xyz_m.tobytes()
    assert plans[0].corridor.Gamma.tobytes() == plans[1].corridor.Gamma.tobytes()


def test_slower_limits_give_a_longer_flight() -> None:
    path = next(path for path in CONFIGS if path.stem == "single")
    config = load_config(path)
    slow = dataclasses.replace(config, planner=dataclasses.replace(config.planner, speed_mps=1.0))
    world = load_world(config.world, path)
    fast_plan, slow_plan = (plan_flight(c, world, lambda _: None) for c in (config, slow))
    assert slow_plan.reference.t_s[-1] > 2 * fast_plan.reference.t_s[-1] * 0.9
    np.testing.assert_array_equal(slow_plan.sandwich_m, fast_plan.sandwich_m)
