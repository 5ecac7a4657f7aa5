"""Exact and tight routes against a visibility graph built by brute force, shapely's crossing tests and each other."""

import itertools
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box
from shapely.affinity import rotate

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.channels.update import update_map
from sandwich_sitl.config import load_config
from sandwich_sitl.plan_report import plan_report
from sandwich_sitl.planning.baselines import exact_shortest_path, path_length
from sandwich_sitl.planning.cell_chain import inner_line
from sandwich_sitl.planning.free_space import FreeSpace
from sandwich_sitl.planning.funnel import pulled_tight
from sandwich_sitl.planning.map_graph import build_map_graph, links
from sandwich_sitl.planning.nav_mesh import build_nav_mesh
from sandwich_sitl.planning.plan import plan_flight
from sandwich_sitl.planning.routes import find_route, shortened
from sandwich_sitl.planning.search import astar
from sandwich_sitl.planning.shortest import shortest_path
from sandwich_sitl.recording.plan_file import plan_bytes, plan_from_bytes
from sandwich_sitl.world.grow import GrownWorld, grow
from sandwich_sitl.world.load import load_world
from sandwich_sitl.world.world import Obstacle, World

CONFIGS = Path(__file__).parents[2] / "configs"
BOUNDS = (0.0, 0.0, 80.0, 50.0)
HAIR = 1e-5  # metres by which the brute force may cut corners


def grown_world(*shapes: Polygon) -> GrownWorld:
    return grow(World(BOUNDS, tuple(Obstacle(f"o{k}", shape) for k, shape in enumerate(shapes))), 1.0, 0.1)


@cache
def random_world(seed: int) -> GrownWorld:
    """Rectangles, triangles and angles, turned at will; some overlap, some reach over the border."""
    rng = np.random.default_rng(seed)
    shapes = []
    for _ in range(rng.integers(1, 18)):
        x, y, a, b = *rng.uniform((0, 0), (80, 50)), *rng.uniform(2, 14, 2)
        corner = box(x + a / 3, y + b / 3, x + a, y + b)
        shape = box(x, y, x + a, y + b)
        shape = (shape, Polygon([(x, y), (x + a, y), (x, y + b)]), shape.difference(corner))[rng.integers(0, 3)]
        shape = rotate(shape, rng.choice([0.0, 90.0, rng.uniform(0, 360)]))
        if shape.intersects(box(*BOUNDS)):
            shapes.append(shape)
    return grown_world(*shapes)


def aligned_world(seed: int) -> GrownWorld:
    """Houses along streets: many walls lie on one line."""
    rng = np.random.default_rng(seed)
    plots = [(i, j) for i in range(7) for j in range(4) if rng.random() < 0.6]
    houses = [box(5 + 11 * i, 5 + 11 * j, 12 + 11 * i, 5 + 11 * j + rng.choice([5, 7])) for i, j in plots]
    return grown_world(*houses)


def free_points(grown: GrownWorld, count: int, seed: int) -> np.ndarray:
    """Points off the obstacles, and corners of obstacles."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(BOUNDS[:2], BOUNDS[2:], (20 * count, 2))
    near = shapely.distance(shapely.points(points), shapely.union_all(list(grown.polygons))) <= 1e-3
    points = points[~near]
    corners = np.concatenate([points[:1], *grown.rings_m()])
    return np.concatenate([points[:count], rng.choice(corners, 2)])


def crosses(points: np.ndarray, grown: GrownWorld) -> bool:
    solid = shapely.union_all([polygon.buffer(-HAIR / 10, join_style="mitre") for polygon in grown.polygons])
    return bool(shapely.LineString(points).intersects(solid))


def squeezed(path: np.ndarray) -> bool:
    """Whether it turns on the world's border, where an obstacle meets it: the brute force cuts through by its hair."""
    turns = shapely.points(path[1:-1])
    return bool((shapely.distance(turns, box(*BOUNDS).exterior) < HAIR).any())


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_mesh_fills_the_free_ground_and_has_no_vertex_off_the_walls(seed: int) -> None:
    grown = random_world(seed)
    mesh = build_nav_mesh(grown)
    triangles = shapely.polygons(mesh.xy_m[mesh.triangles])
    assert shapely.is_ccw(shapely.get_exterior_ring(triangles)).all()
    assert shapely.area(triangles).sum() == pytest.approx(grown.free_area_m2, rel=1e-6)
    walls = shapely.union_all([box(*BOUNDS).exterior, *(polygon.exterior for polygon in grown.polygons)])
    assert shapely.distance(shapely.points(mesh.xy_m), walls).max() < 1e-4
    assert (mesh.before >= 0).all()
    assert (mesh.after[mesh.before] == np.arange(len(mesh.xy_m))).all()
    for t, side in itertools.product(range(len(mesh.triangles)), range(3)):
        other = mesh.beyond[t, side]
        if other >= 0:
            assert t in mesh.beyond[other]
            assert len(set(mesh.triangles[t]) & set(mesh.triangles[other])) == 2


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), make=st.sampled_from([random_world, aligned_world]))
def test_shortest_path_is_as_long_as_that_of_a_visibility_graph(seed: int, make: Callable[[int], GrownWorld]) -> None:
    grown = make(seed)
    mesh, free = build_nav_mesh(grown), FreeSpace(grown.rings_m(), grown.bounds_m)
    for start, goal in itertools.pairwise(free_points(grown, 5, seed)):
        expected = exact_shortest_path(free, grown.rings_m(), start, goal)
        found = shortest_path(mesh, start, goal)
        assert (found is None) == (expected is None)
        if found is None or expected is None or squeezed(expected):
            continue
        assert found.proven
        assert found.length_m == pytest.approx(path_length(found.points_m), rel=1e-12)
        assert found.length_m == pytest.approx(path_length(expected), abs=2 * HAIR)
        np.testing.assert_array_equal(found.points_m[[0, -1]], [start, goal])
        assert not crosses(found.points_m, grown)
        back = shortest_path(mesh, goal, start)
        assert back is not None
        assert back.length_m == pytest.approx(found.length_m, rel=1e-12)


def test_shortest_path_round_a_square_by_hand() -> None:
    square = GrownWorld(BOUNDS, (box(20, 10, 30, 24),), ("square",))
    mesh = build_nav_mesh(square)
    start, goal = np.array([10.0, 15.0]), np.array([45.0, 15.0])
    found = shortest_path(mesh, start, goal)
    assert found is not None
    np.testing.assert_array_equal(found.points_m, [start, [20, 10], [30, 10], goal])
    over = np.array([start, [20, 24], [30, 24], goal])
    np.testing.assert_array_equal(pulled_tight(mesh, np.array([start, [19, 30], [40, 30], [41, 25], goal])), over)
    known = shortest_path(mesh, start, goal, over)
    assert known is not None
    assert known.proven
    assert known.length_m == found.length_m
    unproven = shortest_path(mesh, start, goal, over, most_cones=0)
    assert unproven is not None
    assert not unproven.proven
    assert shortest_path(mesh, start, np.array([25.0, 15.0])) is None


def test_no_way_between_walls_that_touch_in_a_point() -> None:
    touching = GrownWorld(BOUNDS, (box(20, 0, 40, 25), box(40, 25, 60, 50)), ("low", "high"))
    mesh = build_nav_mesh(touching)
    assert shortest_path(mesh, np.array([10.0, 30.0]), np.array([70.0, 20.0])) is None
    assert shortest_path(mesh, np.array([10.0, 30.0]), np.array([38.0, 40.0])) is not None


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_pulled_line_is_shortest_on_its_side_of_a_lone_obstacle(seed: int) -> None:
    """On either side of one convex obstacle the shortest path is the hull's: another way to the same length."""
    rng = np.random.default_rng(seed)
    hull = shapely.MultiPoint(rng.uniform((30, 15), (50, 35), (6, 2))).convex_hull
    mesh = build_nav_mesh(GrownWorld(BOUNDS, (shapely.orient_polygons(hull),), ("hull",)))
    start, goal = np.array([5.0, rng.uniform(20, 30)]), np.array([75.0, rng.uniform(20, 30)])
    for y, side in ((2.0, -1.0), (48.0, 1.0)):
        wander = np.column_stack([rng.uniform(8, 72, 8), y + rng.uniform(-1, 1, 8)])
        tight = pulled_tight(mesh, np.concatenate([[start, (20.0, y)], wander, [(60.0, y), goal]]))
        around = shapely.MultiPoint([start, goal, *hull.exterior.coords]).convex_hull
        ring = shapely.get_coordinates(around.exterior)[:-1]
        outline = shapely.get_coordinates(hull.exterior)[:-1]
        chord = goal - start
        offset = (outline - start) @ np.array([-chord[1], chord[0]])
        assert tight is not None
        if (offset * side > 0).any():
            beyond = (ring - start) @ np.array([-chord[1], chord[0]]) * side > 1e-9
            chain = ring[beyond][np.argsort((ring[beyond] - start) @ chord)]
            expected = path_length(np.concatenate([[start], chain, [goal]]))
        else:
            expected = float(np.hypot(*chord))
        assert path_length(tight) == pytest.approx(expected, rel=1e-9)


def popped_up(channel_map: ChannelMap) -> ChannelMap:
    return update_map(channel_map, rotate(box(34, 18, 46, 27), 25.0), "pop-up", 1.5)


@pytest.mark.parametrize("change", [None, popped_up])
@pytest.mark.parametrize("seed", range(6))
def test_routes_keep_off_obstacles_and_in_order_of_length(seed: int, change: object) -> None:
    channel_map = build_channel_map(random_world(seed), 1.5, 5)
    if callable(change):
        channel_map = change(channel_map)
    grown = channel_map.grown
    map_graph, mesh = build_map_graph(channel_map), build_nav_mesh(grown)
    free = FreeSpace(grown.rings_m(), grown.bounds_m)
    points = [point for point in free_points(grown, 16, seed) if links(map_graph, point)]
    for start, goal in itertools.pairwise(points):
        path = astar(map_graph.graph, links(map_graph, start), goal, links(map_graph, goal))
        if path is None:
            continue
        line = inner_line(map_graph, start, np.array(path.nodes), goal)
        assert not crosses(line, grown)
        in_class = pulled_tight(mesh, line)
        assert in_class is not None
        sandwich = find_route(channel_map, map_graph, start, goal)
        expected = exact_shortest_path(free, grown.rings_m(), start, goal)
        assert expected is not None
        least = path_length(expected)
        tight, exact = (shortened(map_graph, mesh, sandwich, kind) for kind in ("tight", "exact"))
        for points_m in (in_class, tight.points_m, exact.points_m):
            np.testing.assert_array_equal(points_m[[0, -1]], [start, goal])
            assert not crosses(points_m, grown)
            assert path_length(points_m) >= least - 2 * HAIR
        assert path_length(in_class) <= path_length(sandwich.points_m) * (1 + 1e-9)
        assert path_length(tight.points_m) <= path_length(in_class) * (1 + 1e-12)
        assert exact.proven
        assert path_length(exact.points_m) == pytest.approx(least, abs=2 * HAIR)


@pytest.mark.parametrize("name", ["paper", "city"])
def test_tight_routes_are_close_to_the_shortest(name: str) -> None:
    path = CONFIGS / f"{name}.yaml"
    config = load_config(path)
    grown = grow(load_world(config.world, path), 1.0, 0.15)
    channel_map = build_channel_map(grown, 1.0, 5)
    map_graph, mesh = build_map_graph(channel_map), build_nav_mesh(grown)
    rng = np.random.default_rng(2)
    points = [p for p in rng.uniform(grown.bounds_m[:2], grown.bounds_m[2:], (120, 2)) if links(map_graph, p)]
    ratios = []
    for start, goal in zip(points[::2], points[1::2], strict=False):
        sandwich = find_route(channel_map, map_graph, start, goal)
        tight = shortened(map_graph, mesh, sandwich, "tight")
        exact = shortest_path(mesh, start, goal)
        assert exact is not None
        ratios.append(path_length(tight.points_m) / exact.length_m)
    assert min(ratios) >= 1 - 1e-9
    assert np.mean(ratios) <= 1.001
    assert np.percentile(ratios, 95) <= 1.005
    assert max(ratios) <= 1.01
    assert np.mean(np.array(ratios) < 1 + 1e-9) >= 0.95


@pytest.mark.parametrize("kind", ["sandwich", "tight", "exact"])
def test_plan_flies_the_route_that_is_asked_for_and_keeps_it_in_its_file(kind: str) -> None:
    path = CONFIGS / "single.yaml"
    config = load_config(path, {"planner.route": kind})
    plan = plan_flight(config, load_world(config.world, path), lambda _: None)
    assert plan.route_kind == kind
    if kind == "sandwich":
        assert plan.tight_m.shape == (0, 2)
        assert plan.route_m is plan.sandwich_m
    else:
        assert plan.route_proven
        assert path_length(plan.route_m) == pytest.approx(path_length(plan.exact_m), rel=1e-9)
        assert path_length(plan.route_m) < path_length(plan.sandwich_m)
    assert f"flown     {kind} route" in plan_report(plan)
    again = plan_from_bytes(plan_bytes(plan))
    assert (again.route_kind, again.route_proven) == (plan.route_kind, plan.route_proven)
    np.testing.assert_array_equal(again.tight_m, plan.tight_m)
