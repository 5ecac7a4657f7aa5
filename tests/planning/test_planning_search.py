"""Searches against scipy's Dijkstra, a shortest path worked out by hand, and each other; worlds without a route."""

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
import shapely
from scipy.sparse.csgraph import dijkstra
from shapely import Polygon, box

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.config import PlannerConfig, RunConfig, WorldConfig, load_config
from sandwich_sitl.errors import InputError, NoRouteError
from sandwich_sitl.planning.baselines import exact_shortest_path, grid_astar, path_length
from sandwich_sitl.planning.free_space import FreeSpace
from sandwich_sitl.planning.map_graph import build_map_graph, distances, links
from sandwich_sitl.planning.plan import plan_flight
from sandwich_sitl.planning.routes import find_route
from sandwich_sitl.planning.search import Graph, astar
from sandwich_sitl.world.grow import GrownWorld, grow
from sandwich_sitl.world.load import load_world
from sandwich_sitl.world.world import Obstacle, World

CONFIGS = Path(__file__).parents[2] / "configs"
BOUNDS = (0.0, 0.0, 60.0, 40.0)


def grown_world(*shapes: Polygon) -> GrownWorld:
    return grow(World(BOUNDS, tuple(Obstacle(f"o{k}", shape) for k, shape in enumerate(shapes))), 1.0, 0.1)


def shipped(name: str) -> GrownWorld:
    path = CONFIGS / f"{name}.yaml"
    config = load_config(path)
    return grow(load_world(config.world, path), 1.0, 0.1)


def random_free_points(grown: GrownWorld, count: int, seed: int) -> np.ndarray:
    x_min, y_min, x_max, y_max = grown.bounds_m
    points = np.random.default_rng(seed).uniform((x_min, y_min), (x_max, y_max), (40 * count, 2))
    solid = shapely.union_all(list(grown.polygons))
    return points[shapely.distance(shapely.points(points), solid) > 0.2][:count]


@pytest.mark.parametrize("seed", range(10))
def test_astar_is_as_short_as_dijkstra_on_random_graphs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 10, (60, 2))
    graph = Graph.from_edges(xy, rng.integers(0, 60, (100, 2)))
    lengths = sp.csr_array((graph.length_m, graph.neighbour, graph.first), shape=(60, 60))
    exact = dijkstra(lengths, indices=0)
    reached = graph.reachable([0])
    np.testing.assert_array_equal(reached, np.isfinite(exact))
    for target in range(1, 60):
        found = astar(graph, [(0, 0.0)], xy[target], [(target, 0.0)])
        assert (found is None) == (not reached[target])
        if found is not None:
            assert found.length_m == pytest.approx(exact[target])
            assert (found.nodes[0], found.nodes[-1]) == (0, target)


@pytest.mark.parametrize("name", ["single", "paper"])
def test_route_on_the_map_is_as_short_as_dijkstra(name: str) -> None:
    grown = shipped(name)
    channel_map = build_channel_map(grown, 1.5, 5)
    map_graph = build_map_graph(channel_map)
    graph = map_graph.graph
    n = len(graph.xy_m)
    points = random_free_points(grown, 8, 3)
    for start, goal in zip(points[:4], points[4:], strict=True):
        rows, columns, lengths = [], [], []
        for end, point in ((n, start), (n + 1, goal)):
            for node, length in links(map_graph, point):
                rows.append(end)
                columns.append(node)
                lengths.append(length)
        a = np.repeat(np.arange(n), np.diff(graph.first))
        matrix = sp.csr_array(
            (np.r_[graph.length_m, lengths], (np.r_[a, rows], np.r_[graph.neighbour, columns])), shape=(n + 2, n + 2)
        )
        expected = dijkstra(matrix, directed=False, indices=n)[n + 1]
        route = find_route(channel_map, map_graph, start, goal)
        assert path_length(route.points_m) == pytest.approx(expected)


def test_route_on_the_uniform_grid_is_as_short_as_dijkstra() -> None:
    grown = grown_world(box(20, 10, 30, 40), Polygon([(40, -5), (50, 15), (42, 28)]))
    free = FreeSpace(grown.rings_m(), BOUNDS)
    start, goal = np.array([6.0, 22.0]), np.array([54.0, 14.0])  # both are nodes of the 2 m grid
    found = grid_astar(free, 600, start, goal)
    assert found is not None
    x, y = np.linspace(0, 60, 31), np.linspace(0, 40, 21)
    xy = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    near = [
        (a, b) for a in range(len(xy)) for b in range(a + 1, min(a + 23, len(xy))) if np.abs(xy[a] - xy[b]).max() < 2.1
    ]
    # The shapes as they were, over the border: there is no way between an obstacle and the border it touches.
    solid = shapely.union_all([*grown.polygons, box(20, 39, 30, 45), Polygon([(40, -5), (45, 5), (41, 5)])]).buffer(
        -1e-4
    )
    edges = np.array([pair for pair in near if not shapely.LineString(xy[list(pair)]).intersects(solid)])
    lengths = np.hypot(*(xy[edges[:, 0]] - xy[edges[:, 1]]).T)
    matrix = sp.csr_array((lengths, edges.T), shape=(len(xy), len(xy)))
    number = {tuple(point): k for k, point in enumerate(xy)}
    expected = dijkstra(matrix, directed=False, indices=number[tuple(start)])[number[tuple(goal)]]
    # Start and goal may also join their neighbours' neighbours directly, which can only shorten the path.
    assert path_length(found) <= expected + 1e-9
    assert path_length(found) >= 0.9 * expected


@pytest.mark.parametrize("name", ["paper", "city"])
def test_index_finds_the_cells_that_a_look_at_every_cell_finds(name: str) -> None:
    grown = shipped(name)
    map_graph = build_map_graph(build_channel_map(grown, 2.0, 5))
    corners = map_graph.graph.xy_m[map_graph.quads]
    shapes = shapely.polygons(corners)
    x_min, y_min, x_max, y_max = grown.bounds_m
    inner = np.random.default_rng(4).uniform((x_min, y_min), (x_max, y_max), (200, 2))
    for point in np.concatenate([inner, corners[::50, 0], (corners[::50, 0] + corners[::50, 1]) / 2]):
        found = map_graph.cells.holding(point, 1e-7)
        distance = shapely.distance(shapes, shapely.Point(point))
        assert set(np.flatnonzero(distance < 1e-10)) <= set(found) <= set(np.flatnonzero(distance < 1e-5))


@pytest.mark.parametrize("seed", range(4))
def test_rows_of_a_graph_are_those_of_a_symmetric_matrix_of_its_edges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 10, (30, 2))
    edges = rng.integers(0, 30, (80, 2))
    graph = Graph.from_edges(xy, edges)
    a, b = np.concatenate([edges, edges[:, ::-1]]).T
    expected = np.zeros((30, 30))
    expected[a, b] = np.hypot(*(xy[a] - xy[b]).T)
    found = sp.csr_array((graph.length_m, graph.neighbour, graph.first), shape=(30, 30))
    assert found.nnz == np.count_nonzero(expected)
    np.testing.assert_allclose(found.toarray(), expected)


def test_one_search_to_many_goals_is_as_good_as_one_each() -> None:
    grown = shipped("city")
    map_graph = build_map_graph(build_channel_map(grown, 2.0, 5))
    points = random_free_points(grown, 30, 11)
    start, goals = points[0], np.concatenate([points[1:], points[:1], grown.polygons[0].centroid.coords])
    found = distances(map_graph, start, goals)
    for goal, length in zip(goals[:-2], found, strict=False):
        path = astar(map_graph.graph, links(map_graph, start), goal, links(map_graph, goal))
        assert path is not None
        assert length == pytest.approx(path.length_m, rel=1e-12)
    assert found[-2] == 0.0
    assert found[-1] == np.inf


def test_shortest_path_round_one_square_by_hand() -> None:
    ring = np.array([[20.0, 10.0], [30.0, 10.0], [30.0, 24.0], [20.0, 24.0]])
    free = FreeSpace((ring,), BOUNDS)
    start, goal = np.array([10.0, 15.0]), np.array([45.0, 15.0])
    found = exact_shortest_path(free, (ring,), start, goal)
    np.testing.assert_allclose(found, [start, [20, 10], [30, 10], goal])
    assert path_length(found) == pytest.approx(np.hypot(10, 5) + 10 + np.hypot(15, 5))
    np.testing.assert_array_equal(exact_shortest_path(free, (ring,), start, np.array([15.0, 30.0])), [start, [15, 30]])
    along_wall = exact_shortest_path(free, (ring,), np.array([10.0, 10.0]), goal - (0, 5))
    np.testing.assert_allclose(path_length(along_wall), 35.0)


@pytest.mark.parametrize("name", ["open", "single", "paper"])
def test_exact_path_is_never_longer_and_no_path_enters_an_obstacle(name: str) -> None:
    grown = shipped(name)
    channel_map = build_channel_map(grown, 1.5, 5)
    map_graph = build_map_graph(channel_map)
    free = FreeSpace(grown.rings_m(), grown.bounds_m)
    solid = shapely.union_all([polygon.buffer(-1e-4) for polygon in grown.polygons])
    points = random_free_points(grown, 10, 7)
    for start, goal in zip(points[:5], points[5:], strict=True):
        sandwich = find_route(channel_map, map_graph, start, goal).points_m
        grid = grid_astar(free, len(map_graph.graph.xy_m), start, goal)
        exact = exact_shortest_path(free, grown.rings_m(), start, goal)
        assert grid is not None
        assert exact is not None
        for path in (sandwich, grid, exact):
            np.testing.assert_array_equal(path[[0, -1]], [start, goal])
            assert not shapely.LineString(path).intersects(solid)
        least = path_length(exact)
        assert least >= np.hypot(*(goal - start)) - 1e-9
        # Paths may cut a grown corner by the hair that counts as touching.
        assert path_length(sandwich) >= least - 1e-3
        assert path_length(grid) >= least - 1e-3
        assert path_length(sandwich) <= 1.25 * least + 2.0


def run_config(start: tuple[float, float], goal: tuple[float, float]) -> RunConfig:
    return RunConfig(
        world=WorldConfig(bounds_m=BOUNDS),
        start_m=start,
        goal_m=goal,
        altitude_m=8,
        planner=PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6, cell_m=1.5),
    )


def planned_in(shapes: list[Polygon], start: tuple[float, float], goal: tuple[float, float]) -> None:
    world = World(BOUNDS, tuple(Obstacle(f"o{k}", shape) for k, shape in enumerate(shapes)))
    plan_flight(run_config(start, goal), world, lambda _: None)


def test_wall_from_left_to_right_is_named() -> None:
    with pytest.raises(NoRouteError, match="no route from start_m to goal_m: obstacle 'o1' is in the way"):
        planned_in([box(10, 5, 14, 9), box(-5, 18, 65, 22), box(40, 30, 46, 34)], (5, 5), (50, 37))


def test_two_walls_and_the_goal_between_them() -> None:
    with pytest.raises(NoRouteError, match=r"'o[01]' is in the way"):
        planned_in([box(-5, 10, 65, 13), box(-5, 26, 65, 29)], (5, 5), (50, 20))


def test_wall_from_bottom_to_top_is_named() -> None:
    with pytest.raises(NoRouteError, match="no route from start_m to goal_m: obstacle 'o0' is in the way"):
        planned_in([box(28, -5, 32, 50)], (5, 5), (50, 30))


@pytest.mark.parametrize("key", ["start_m", "goal_m"])
def test_end_in_ground_the_map_has_lost(key: str) -> None:
    """A closed yard is filled when obstacles are grown: it counts as inside the obstacle."""
    yard = box(20, 10, 40, 30).difference(box(24, 14, 36, 26))
    ends = ((30.0, 20.0), (5.0, 5.0)) if key == "start_m" else ((5.0, 5.0), (30.0, 20.0))
    with pytest.raises(InputError, match=rf"{key}: \(30, 20\) lies inside obstacle 'o0'"):
        planned_in([yard], *ends)


def test_end_outside_every_cell_of_the_map() -> None:
    channel_map = build_channel_map(grown_world(box(20, 15, 40, 25)), 1.5, 5)
    ends = np.array([5.0, 5.0]), np.array([30.0, 20.0])
    for key, (start, goal) in (("goal_m", ends), ("start_m", ends[::-1])):
        with pytest.raises(InputError, match=rf"{key}: \(30, 20\) lies in .* that the map leaves out"):
            find_route(channel_map, build_map_graph(channel_map), start, goal)
