"""The corridor and its proof: quadrangles, grown regions, gaps, and a proof that falls when any part of it is wrong."""

import dataclasses

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.config import MpcConfig, PlannerConfig, RunConfig
from sandwich_sitl.errors import MapError, NoRouteError
from sandwich_sitl.planning.corridor import (
    FACES,
    between_samples_m,
    hull,
    nearest_places,
    neighbouring_quadrangle,
    paper_corridor,
    safe_speed_mps,
    sound,
    speeds_mps,
)
from sandwich_sitl.planning.decomposition import areas_m2
from sandwich_sitl.planning.flight_plan import Corridor, CorridorProof, Reference
from sandwich_sitl.planning.inflation import inflate
from sandwich_sitl.planning.outlines import Outlines
from sandwich_sitl.planning.plan import plan_flight
from sandwich_sitl.planning.proof import prove_corridor
from sandwich_sitl.planning.reference import Ground, timed_reference
from sandwich_sitl.world.grow import grow
from sandwich_sitl.world.world import Obstacle, World
from sandwich_sitl.world_config import WorldConfig

RADIUS_M = 0.4
BOUNDS = (0.0, 0.0, 60.0, 40.0)


def config(margin_m: float, start: tuple[float, float] = (5, 20), goal: tuple[float, float] = (55, 20)) -> RunConfig:
    planner = PlannerConfig(vehicle_radius_m=RADIUS_M, margin_m=margin_m, keep_map=False)
    return RunConfig(
        world=WorldConfig(bounds_m=BOUNDS), start_m=start, goal_m=goal, altitude_m=5, planner=planner, mpc=MpcConfig()
    )


def ground(bodies: list[Polygon]) -> tuple[Ground, ChannelMap]:
    """A map that knows no obstacle, so that every quadrangle is there to be found wrong; outlines that know all."""
    channel_map = build_channel_map(grow(World(BOUNDS, ()), 1.0, 0.1), 1.0, 5)
    return Ground(channel_map, Outlines(bodies, RADIUS_M)), channel_map


def rings(bodies: list[Polygon]) -> list[np.ndarray]:
    return [shapely.get_coordinates(shapely.orient_polygons(body).exterior)[:-1] for body in bodies]


def random_bodies(seed: int, way: shapely.LineString, clear_m: float) -> list[Polygon]:
    rng = np.random.default_rng(seed)
    bodies = []
    for _ in range(60):
        angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 8)))
        centre, size = rng.uniform((2, 8), (58, 32)), rng.uniform(0.5, 2.5)
        shape = Polygon(centre + size * np.column_stack([np.cos(angles), np.sin(angles)])).convex_hull
        if isinstance(shape, Polygon) and shape.distance(way) > clear_m:
            bodies.append(shape)
    return bodies


@pytest.mark.parametrize("seed", range(8))
def test_corridor_among_random_obstacles_is_proven_and_convex_with_eight_sides_at_most(seed: int) -> None:
    route = np.array([[5.0, 20.0], [20.0, 14.0], [35.0, 24.0], [55.0, 20.0]])
    bodies = random_bodies(seed, shapely.LineString(route), RADIUS_M + 0.55)
    where, _ = ground(bodies)
    reference, corridor, figures = timed_reference(config(0.5), where, route)
    proof = prove_corridor(reference, corridor, rings(bodies), RADIUS_M, 0.1)
    assert proof.proven, proof.problem
    assert proof.steps == len(reference.t_s)
    assert corridor.Lambda.shape[1:] == (FACES, 2)
    assert (np.diff(reference.region) >= 0).all()
    assert figures.curve_m <= 1.005 * figures.route_m
    solid = shapely.union_all([body.buffer(RADIUS_M) for body in bodies])
    polygons = [Polygon(ring) for ring in corridor.polygons_m]
    assert all(len(ring) <= FACES for ring in corridor.polygons_m)
    assert all(polygon.convex_hull.area == pytest.approx(polygon.area) for polygon in polygons)
    assert sum(polygon.intersection(solid).area for polygon in polygons) == 0.0
    # A second way: points drawn in a region and moved by the bound stay out of every grown obstacle.
    rng = np.random.default_rng(seed)
    speed = speeds_mps(reference.t_s, reference.xyz_m[:, :2])
    for m in range(0, len(polygons), max(1, len(polygons) // 10)):
        polygon, bound = polygons[m], float(between_samples_m(speed[reference.region == m].max(), 0.1))
        x_min, y_min, x_max, y_max = polygon.bounds
        points = shapely.points(rng.uniform((x_min, y_min), (x_max, y_max), (200, 2)))
        moved = shapely.buffer(points[shapely.contains(polygon, points)], 0.99 * bound)
        assert not shapely.intersects(moved, solid).any()


@pytest.mark.parametrize("seed", [1, 4, 10])
def test_fast_flight_among_many_obstacles_is_proven(seed: int) -> None:
    """Worlds whose map has bays and holes, and whose quadrangles reach far beyond their stretch."""
    rng = np.random.default_rng(seed)
    obstacles = []
    for k in range(40):
        angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 9)))
        centre, size = rng.uniform((8, 4), (92, 56)), rng.uniform(1, 4.5)
        shape = Polygon(centre + size * np.column_stack([np.cos(angles), np.sin(angles)])).convex_hull
        if isinstance(shape, Polygon) and shape.area > 0.5:
            obstacles.append(Obstacle(f"o{k}", shape))
    world = World((0, 0, 100, 60), tuple(obstacles))
    asked = config(0.5, (2, 30), (98, float(rng.uniform(10, 50))))
    fast = dataclasses.replace(asked.planner, speed_mps=8.0, acceleration_mps2=3.0)
    plan = plan_flight(dataclasses.replace(asked, planner=fast), world, lambda _: None)
    assert plan.proof is not None
    assert plan.proof.proven, plan.proof.problem


@pytest.mark.parametrize("extra_m", [0.02, 0.1, 0.5])
def test_gap_just_wider_than_the_vehicle_has_a_corridor(extra_m: float) -> None:
    half = RADIUS_M + extra_m
    bodies = [box(28, 0, 31, 20 - half), box(28, 20 + half, 31, 40)]
    where, _ = ground(bodies)
    reference, corridor, _ = timed_reference(config(0.9 * extra_m), where, np.array([[5.0, 20.0], [55.0, 20.0]]))
    proof = prove_corridor(reference, corridor, rings(bodies), RADIUS_M, 0.1)
    assert proof.proven, proof.problem
    inside = np.abs(reference.xyz_m[:, 0] - 29.5) < 1.0
    slow = np.hypot(*np.diff(reference.xyz_m[inside, :2], axis=0).T).max() / 0.02
    assert slow <= safe_speed_mps(np.array(extra_m), 0.1, 1.0) + 1e-6


@pytest.mark.parametrize("extra_m", [-0.1, -0.01, 0.0])
def test_gap_narrower_than_the_vehicle_never_has_one(extra_m: float) -> None:
    half = RADIUS_M + extra_m
    where, _ = ground([box(28, 0, 31, 20 - half), box(28, 20 + half, 31, 40)])
    with pytest.raises(MapError):
        timed_reference(config(0.1), where, np.array([[5.0, 20.0], [55.0, 20.0]]))


def test_whole_plan_goes_through_the_gap_it_fits_and_through_no_other() -> None:
    def world(half: float) -> World:
        bodies = [box(28, 0, 31, 20 - half), box(28, 20 + half, 31, 40)]
        return World(BOUNDS, tuple(Obstacle(f"o{k}", body) for k, body in enumerate(bodies)))

    asked = config(0.2)
    plan = plan_flight(asked, world(RADIUS_M + 0.25), lambda _: None)
    assert plan.proof is not None
    assert plan.proof.proven
    with pytest.raises(NoRouteError):
        plan_flight(asked, world(RADIUS_M + 0.1), lambda _: None)


def proven() -> tuple[Reference, Corridor, list[np.ndarray]]:
    bodies = [box(20, 10, 40, 19), box(25, 21.5, 35, 30)]
    where, _ = ground(bodies)
    reference, corridor, _ = timed_reference(config(0.5), where, np.array([[5.0, 20.0], [55.0, 20.4]]))
    return reference, corridor, rings(bodies)


def prove(reference: Reference, corridor: Corridor, obstacles: list[np.ndarray]) -> CorridorProof:
    return prove_corridor(reference, corridor, obstacles, RADIUS_M, 0.1)


def test_proof_falls_when_any_part_of_it_is_wrong() -> None:
    reference, corridor, obstacles = proven()
    assert prove(reference, corridor, obstacles).proven
    moved = reference.xyz_m.copy()
    moved[len(moved) // 2, 1] += 30.0
    assert "leaves its region" in prove(dataclasses.replace(reference, xyz_m=moved), corridor, obstacles).problem
    wider = dataclasses.replace(corridor, Gamma=corridor.Gamma + 0.01)
    assert "half-planes" in prove(reference, wider, obstacles).problem
    pillar = corridor.polygons_m[int(reference.region[len(moved) // 2])].mean(axis=0) + 0.05 * np.array(
        [[0, 0], [1, 0], [0, 1]]
    )
    assert "too near an obstacle" in prove(reference, corridor, [*obstacles, pillar]).problem
    bulky = prove_corridor(reference, corridor, obstacles, RADIUS_M + 0.01, 0.1)
    rarer = prove_corridor(reference, corridor, obstacles, RADIUS_M, 0.12)
    assert not bulky.proven
    assert not rarer.proven
    swapped = dataclasses.replace(reference, region=np.roll(reference.region, 300))
    assert not prove(swapped, corridor, obstacles).proven


def test_reference_between_samples_lies_in_the_union_of_its_regions() -> None:
    reference, corridor, _ = proven()
    region, xy = reference.region, reference.xyz_m[:, :2]
    for k in np.flatnonzero(np.diff(region)):
        both = shapely.union(Polygon(corridor.polygons_m[region[k]]), Polygon(corridor.polygons_m[region[k + 1]]))
        assert both.covers(shapely.LineString(xy[k : k + 2]).buffer(1e-4))
        overlap = shapely.intersection(*(Polygon(corridor.polygons_m[m]) for m in region[k : k + 2]))
        assert overlap.area > 0.01


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_grown_region_holds_its_seed_and_keeps_its_distance(data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    seed = hull(rng.uniform(-0.7, 0.7, (data.draw(st.integers(1, 9)), 2)))
    keep = data.draw(st.floats(0.0, 0.4))
    ends = rng.uniform(-6, 6, (data.draw(st.integers(0, 25)), 2, 2))
    shape = shapely.MultiPoint(seed).convex_hull
    ends = np.array([pair for pair in ends if shapely.LineString(pair).distance(shape) > keep + 1e-6]).reshape(-1, 2, 2)
    frame = np.array([-5.0, -5.0, 5.0, 5.0])
    planes, ring = inflate(seed, ends.reshape(-1, 4), frame, keep, 60)
    polygon = Polygon(ring)
    assert polygon.is_valid
    assert polygon.exterior.is_ccw
    assert polygon.buffer(1e-9).covers(shape)
    assert box(*frame).buffer(1e-9).covers(polygon)
    for pair in ends:
        assert polygon.distance(shapely.LineString(pair)) >= keep - 1e-6
    np.testing.assert_allclose(np.hypot(planes[:, 0], planes[:, 1]), 1.0)
    beyond = ring @ planes[:, :2].T - planes[:, 2]
    assert beyond.max() < 1e-7
    np.testing.assert_allclose(np.diagonal(beyond), 0.0, atol=1e-7)


def test_seed_that_meets_an_obstacle_has_no_region() -> None:
    edges = np.array([[-2.0, 0.0, 2.0, 0.0]])
    frame = np.array([-3.0, -3.0, 3.0, 3.0])
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for seed in (square, square[[0, 2]], np.zeros((1, 2)), 0.1 * square):
        assert len(inflate(seed, edges, frame, 0.0, FACES)[0]) == 0
    inside = np.array([[-0.1, 0.2, 0.1, 0.2]])
    assert len(inflate(square, inside, frame, 0.0, FACES)[0]) == 0


@given(speed=st.floats(0, 20), interval=st.floats(0.01, 0.5))
def test_safe_speed_is_the_one_whose_bound_fits(speed: float, interval: float) -> None:
    clearance = between_samples_m(np.array(speed), interval)
    assert safe_speed_mps(clearance, interval, 1.0) == pytest.approx(speed, abs=1e-9)
    # Constant velocity straight out of a region for half the interval goes no further than the bound.
    assert speed * interval / 2 <= clearance


def test_quadrangles_are_counter_clockwise_and_hold_their_node() -> None:
    shape = box(20, 15, 40, 25)
    grown = grow(World(BOUNDS, (Obstacle("o", shape),)), 1.0, 0.1)
    channel_map = build_channel_map(grown, 1.5, 5)
    rng = np.random.default_rng(0)
    for _ in range(200):
        d = int(rng.integers(0, channel_map.channels))
        xy = channel_map.xy_m[d]
        i, j = int(rng.integers(0, xy.shape[0])), int(rng.integers(0, xy.shape[1]))
        ring = shapely.LinearRing(neighbouring_quadrangle(channel_map, (d, i, j)))
        assert shapely.is_ccw(ring)
        assert Polygon(ring).area > 0
        if 0 < i < xy.shape[0] - 1 and 0 < j < xy.shape[1] - 1:
            np.testing.assert_array_equal(
                neighbouring_quadrangle(channel_map, (d, i, j)),
                [xy[i - 1, j - 1], xy[i + 1, j - 1], xy[i + 1, j + 1], xy[i - 1, j + 1]],
            )


@pytest.mark.parametrize("split", [False, True], ids=["channels", "bays alone"])
def test_nearest_places_are_those_that_a_look_at_every_node_finds(split: bool) -> None:
    walls = [box(28, -5, 32, 45), box(-5, 18, 65, 22)] if split else [box(28, 10, 32, 30)]
    obstacles = tuple(Obstacle(f"w{k}", wall) for k, wall in enumerate(walls))
    channel_map = build_channel_map(grow(World(BOUNDS, obstacles), 1.0, 0.1), 1.5, 5)
    assert (channel_map.channels == 0) is split
    grids = [*channel_map.xy_m, *(bay.xy_m[:, None] for bay in channel_map.bays)]
    nodes = np.concatenate([grid.reshape(-1, 2) for grid in grids])
    points = np.random.default_rng(1).uniform((2, 2), (26, 16), (40, 2))
    for point, (b, i, j) in zip(points, nearest_places(channel_map, points), strict=True):
        assert np.hypot(*(grids[b][i, j] - point)) == pytest.approx(np.nanmin(np.hypot(*(nodes - point).T)))


def test_sound_quadrangles_are_convex_and_hold_the_stretch() -> None:
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    assert sound(square, np.array([[0.5, 0.5], [1.5, 1.0]]))
    assert not sound(square, np.array([[0.5, 0.5], [2.5, 1.0]]))
    assert not sound(square[::-1], np.array([[0.5, 0.5]]))
    dented = np.array([[0.0, 0.0], [2.0, 0.0], [0.5, 0.6], [0.0, 2.0]])
    assert not sound(dented, np.array([[0.2, 0.2]]))


def test_region_holds_the_papers_quadrangle_where_that_is_sound_and_the_corridor_is_wider() -> None:
    body = box(25, 15, 35, 25)
    plan = plan_flight(config(0.5), World(BOUNDS, (Obstacle("o", body),)), lambda _: None)
    own, paper, free = areas_m2(plan.reference, plan.corridor, Outlines([body], RADIUS_M))
    assert own > 5 * paper
    assert own > 0.5 * free
    assert free <= (2 * 6 + 12) ** 2


def test_paper_corridor_has_the_sides_of_the_quadrangle() -> None:
    quadrangle = np.array([[0.0, 0.0], [3.0, 0.5], [3.5, 2.0], [-0.5, 2.5]])
    corridor = paper_corridor(quadrangle[None])
    inside = np.array([[1.5, 1.2], [0.1, 0.1], [3.2, 1.9]])
    outside = np.array([[1.5, -0.1], [3.6, 1.2], [1.0, 2.5], [-0.5, 1.0]])
    assert (inside @ corridor.Lambda[0].T <= corridor.Gamma[0]).all()
    assert (outside @ corridor.Lambda[0].T > corridor.Gamma[0]).any(axis=1).all()
    np.testing.assert_allclose(np.hypot(*corridor.Lambda[0].T), 1.0)
