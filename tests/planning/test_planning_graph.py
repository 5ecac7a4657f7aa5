"""The mapped grid as a graph: nodes shared where they should be, edges clear of obstacles, joined as free ground is."""

import functools
import itertools

import numpy as np
import pytest
import scipy.sparse as sp
import shapely
from map_laws import bilinear, bilinear_inverse, check_edges, check_lookup, check_reachability, free_points
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist
from shapely import LineString, Point, Polygon, box
from world_samples import QUICK, REACH_M, grown_world, horseshoe, sample_world, yard

from sandwich_sitl.channels.bays import Bay
from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.channel_map import ChannelMap, Flow
from sandwich_sitl.errors import InputError, NoRouteError
from sandwich_sitl.planning.baselines import path_length
from sandwich_sitl.planning.map_graph import MapGraph, build_map_graph, distances, links, locate
from sandwich_sitl.planning.routes import find_route
from sandwich_sitl.world.grow import GrownWorld

HAIR_M = 1e-7
FLOWS: tuple[Flow, ...] = ("x", "y")
FAMILIES = ["mixed", "horseshoes", "spirals", "combs", "nested", "border_walls", "gaps", "split", "none"]


@functools.cache
def mapped(family: str) -> tuple[ChannelMap, MapGraph]:
    sample = sample_world(QUICK[family])
    channel_map = build_channel_map(sample.grown, max(1.5, sample.cell_m), 5, sample.flow)
    return channel_map, build_map_graph(channel_map)


@functools.cache
def rooms() -> tuple[ChannelMap, MapGraph]:
    """One room with a door, one obstacle with a pocket, one wall from the left border to the right."""
    shapes = (yard(18, 14, 22, 1.5, 5, 0), horseshoe(55, 14, 14, 90), box(-5, 33, 90, 36))
    channel_map = build_channel_map(grown_world(*shapes), 1.5, 5)
    return channel_map, build_map_graph(channel_map)


def adjacency(map_graph: MapGraph) -> sp.csr_array:
    graph = map_graph.graph
    n = len(graph.xy_m)
    return sp.csr_array((graph.length_m, graph.neighbour, graph.first), shape=(n, n))


@pytest.mark.parametrize("family", FAMILIES)
def test_no_edge_cuts_an_obstacle(family: str) -> None:
    """Every edge against every obstacle, one by one with shapely."""
    channel_map, map_graph = mapped(family)
    check_edges(channel_map, map_graph, HAIR_M)
    graph = map_graph.graph
    start = np.repeat(np.arange(len(graph.xy_m)), np.diff(graph.first))
    lines = shapely.linestrings(np.stack([graph.xy_m[start], graph.xy_m[graph.neighbour]], axis=1))
    for polygon in channel_map.grown.polygons:
        inside = polygon.buffer(-HAIR_M, join_style="mitre")
        shapely.prepare(inside)
        assert not shapely.intersects(inside, lines).any()
    np.testing.assert_allclose(graph.length_m, shapely.length(lines))


@pytest.mark.parametrize("family", FAMILIES)
def test_graph_joins_what_free_ground_joins(family: str) -> None:
    check_reachability(*mapped(family))


@pytest.mark.parametrize("family", FAMILIES)
def test_every_free_point_lies_in_a_cell_whose_map_gives_it_back(family: str) -> None:
    channel_map, _ = mapped(family)
    check_lookup(channel_map, free_points(channel_map, 60, 5))


@pytest.mark.parametrize("family", FAMILIES)
def test_places_and_numbers_are_inverse_and_name_the_same_point(family: str) -> None:
    channel_map, map_graph = mapped(family)
    nodes = [*channel_map.xy_m, *(bay.xy_m[:, None] for bay in channel_map.bays)]
    for number, xy in zip(map_graph.node, nodes, strict=True):
        np.testing.assert_array_equal(map_graph.graph.xy_m[number], xy)
    b, i, j = map_graph.place.T
    at = [map_graph.node[k][m, n] for k, m, n in zip(b, i, j, strict=True)]
    np.testing.assert_array_equal(at, np.arange(len(b)))


def test_nodes_are_shared_on_free_streamlines_and_apart_on_walls() -> None:
    channel_map = build_channel_map(grown_world(box(20, 15, 40, 25)), 1.5, 5)
    map_graph = build_map_graph(channel_map)
    barred = channel_map.barred[0]
    assert 0 < barred.sum() < len(barred)
    np.testing.assert_array_equal(map_graph.node[0][:, -1] == map_graph.node[1][:, 0], ~barred)
    numbers = [number.ravel() for number in map_graph.node]
    assert len(np.unique(np.concatenate(numbers))) == sum(map(len, numbers)) - (~barred).sum()
    joined = adjacency(map_graph)
    below, above = map_graph.node[0][:, -1], map_graph.node[1][:, 0]
    for i, k in itertools.product(np.flatnonzero(barred), (-1, 0, 1)):
        assert joined[below[i], above[i + k]] == 0 or not barred[i + k]


def test_bays_that_meet_share_their_nodes_off_walls_and_are_crossed_there() -> None:
    """Two stretches of neighbouring channels meshed as bays: every node at one point is one, found pair by pair."""
    sample = sample_world(127)
    channel_map = build_channel_map(sample.grown, sample.cell_m, 5, sample.flow)
    map_graph = build_map_graph(channel_map)
    walls = shapely.union_all([polygon.exterior for polygon in channel_map.grown.polygons])
    crossed = 0
    for (a, first), (b, second) in itertools.combinations(enumerate(channel_map.bays), 2):
        near_first, near_second = np.nonzero(cdist(first.xy_m, second.xy_m) < 1e-9)
        for k, m in zip(near_first.tolist(), near_second.tolist(), strict=True):
            if k in first.lid_nodes or m in second.lid_nodes or walls.distance(Point(first.xy_m[k])) < 1e-3:
                continue
            node = map_graph.node[channel_map.channels + a][k, 0]
            assert map_graph.node[channel_map.channels + b][m, 0] == node
            middles = [middle_of_a_quad_at(bay, at) for bay, at in ((first, k), (second, m))]
            through = sum(np.hypot(*(middle - first.xy_m[k])) for middle in middles)
            assert distances(map_graph, middles[0], middles[1][None])[0] <= through + 1e-9
            crossed += 1
    assert crossed > 20


def middle_of_a_quad_at(bay: Bay, node: int) -> np.ndarray:
    quad = bay.quads[(bay.quads == node).any(axis=1)][0]
    return np.asarray(bay.xy_m[quad].mean(axis=0))


def test_bay_is_entered_through_its_lid_only() -> None:
    channel_map, map_graph = rooms()
    labels = connected_components(adjacency(map_graph), directed=False)[1]
    joined = adjacency(map_graph)
    in_channels = np.unique(np.concatenate([number.ravel() for number in map_graph.node[: channel_map.channels]]))
    assert channel_map.bays
    for bay, number in zip(channel_map.bays, map_graph.node[channel_map.channels :], strict=True):
        on_lid = number[bay.lid_nodes, 0]
        assert np.isin(on_lid, in_channels).all()
        inside = np.setdiff1d(number[:, 0], on_lid)
        row, beyond = joined[inside].nonzero()
        leaving = ~np.isin(beyond, number[:, 0])
        ends = np.stack([map_graph.graph.xy_m[inside[row[leaving]]], map_graph.graph.xy_m[beyond[leaving]]], axis=1)
        assert leaving.any()
        assert (shapely.distance(shapely.linestrings(ends), lids(bay)) < HAIR_M).all()
        assert len(np.unique(labels[number[:, 0]])) == 1


def lids(bay: Bay) -> shapely.Geometry:
    """The sides of a bay's outline between lid nodes."""
    sides = np.sort(np.concatenate([bay.quads[:, [k, (k + 1) % 4]] for k in range(4)]), axis=1)
    once, count = np.unique(sides, axis=0, return_counts=True)
    open_sides = once[(count == 1) & np.isin(once, bay.lid_nodes).all(axis=1)]
    return shapely.union_all(shapely.linestrings(bay.xy_m[open_sides]))


def test_every_link_lies_in_the_cells_and_corners_of_a_cell_are_linked() -> None:
    """Corners cell by cell in a dictionary; all other links as chords against the union of the cells."""
    channel_map, map_graph = rooms()
    corners: set[tuple[int, int]] = set()
    cells = [
        (d, i, j)
        for d, xy in enumerate(channel_map.xy_m)
        for i in np.flatnonzero(channel_map.gridded[d])
        for j in range(xy.shape[1] - 1)
    ]
    cells += [(channel_map.channels + b, q, 0) for b, bay in enumerate(channel_map.bays) for q in range(len(bay.quads))]
    assert sorted(map(tuple, map_graph.cell_place.tolist())) == sorted(cells)
    for cell in cells:
        corners |= {
            (min(pair), max(pair)) for pair in itertools.combinations(corner_nodes(channel_map, map_graph, cell), 2)
        }
    graph = map_graph.graph
    found = pairs(map_graph)
    assert corners < found
    assert corners == pairs(build_map_graph(channel_map, wide=False))
    ground = shapely.union_all(shapely.polygons(graph.xy_m[map_graph.quads])).buffer(HAIR_M)
    shapely.prepare(ground)
    assert shapely.covers(ground, shapely.linestrings(graph.xy_m[np.array(sorted(found - corners))])).all()


def pairs(map_graph: MapGraph) -> set[tuple[int, int]]:
    """Linked nodes, the lower first; each link is there in both directions, once."""
    graph = map_graph.graph
    start = np.repeat(np.arange(len(graph.xy_m)), np.diff(graph.first))
    found = {(a, b) for a, b in zip(start.tolist(), graph.neighbour.tolist(), strict=True) if a < b}
    assert len(graph.neighbour) == 2 * len(found)
    return found


def test_links_leave_no_wide_gap_where_nothing_is_in_the_way() -> None:
    """An empty world: inside it the directions of a node's links are nowhere 36 degrees apart."""
    channel_map = build_channel_map(GrownWorld((0.0, 0.0, 60.0, 40.0), (), ()), 2.0, 5)
    map_graph = build_map_graph(channel_map)
    graph = map_graph.graph
    inner = np.flatnonzero(((graph.xy_m > 9.0) & (graph.xy_m < (51.0, 31.0))).all(axis=1))
    assert len(inner) > 50
    for node in inner:
        row = slice(graph.first[node], graph.first[node + 1])
        assert gaps_deg(graph.xy_m[graph.neighbour[row]] - graph.xy_m[node]).max() < 36.0


def gaps_deg(directions: np.ndarray) -> np.ndarray:
    """Angles between neighbouring directions (n, 2) all the way round."""
    angle = np.sort(np.degrees(np.arctan2(directions[:, 1], directions[:, 0])))
    return np.diff(np.append(angle, angle[0] + 360.0))


def test_a_path_on_the_map_pays_little_for_its_directions() -> None:
    """Between corners of an empty world, at every angle: the gaps' own law 1 / cos(gap / 2)."""
    channel_map = build_channel_map(GrownWorld((0.0, 0.0, 60.0, 40.0), (), ()), 1.0, 5)
    map_graph = build_map_graph(channel_map)
    for angle in np.radians(np.arange(2.0, 90.0, 8.0)):
        start, goal = np.array([30.0, 20.0]), np.array([30.0, 20.0]) + 18.0 * np.array([np.cos(angle), np.sin(angle)])
        route = find_route(channel_map, map_graph, start, goal).points_m
        assert 18.0 - 1e-9 <= path_length(route) <= 18.0 / np.cos(np.radians(18.0)) + 0.1


def corner_nodes(channel_map: ChannelMap, map_graph: MapGraph, cell: tuple[int, int, int]) -> list[int]:
    """Numbers of the four corners of a cell."""
    b, i, j = cell
    if b < channel_map.channels:
        return [int(map_graph.node[b][m, n]) for m in (i, i + 1) for n in (j, j + 1)]
    return map_graph.node[b][channel_map.bays[b - channel_map.channels].quads[i], 0].tolist()


def test_links_of_a_point_are_straight_lines_in_free_ground_to_the_corners_of_its_cells_and_further() -> None:
    channel_map, map_graph = rooms()
    solid = shapely.union_all([polygon.buffer(-HAIR_M) for polygon in channel_map.grown.polygons])
    shapely.prepare(solid)
    for point in free_points(channel_map, 40, 2):
        found = links(map_graph, point)
        corners = {n for cell in locate(map_graph, point) for n in corner_nodes(channel_map, map_graph, cell)}
        assert corners < {node for node, _ in found}
        chords = [[point, map_graph.graph.xy_m[node]] for node, _ in found]
        assert not shapely.intersects(solid, shapely.linestrings(chords)).any()
        for node, length in found:
            assert length == pytest.approx(float(np.hypot(*(map_graph.graph.xy_m[node] - point))))


def test_point_on_a_shared_edge_lies_in_both_cells_and_one_on_a_node_in_all() -> None:
    channel_map, map_graph = rooms()
    xy = channel_map.xy_m[1]
    assert len(locate(map_graph, (xy[4, 2] + xy[5, 2]) / 2)) == 2
    assert len(locate(map_graph, xy[4, 2])) == 4


def test_points_inside_obstacles_and_outside_the_world_lie_in_no_cell() -> None:
    channel_map, map_graph = rooms()
    inside = [np.array(polygon.representative_point().coords[0]) for polygon in channel_map.grown.polygons]
    for point in [*inside, np.array([-1.0, 20.0]), np.array([81.0, 20.0]), np.array([40.0, 50.5])]:
        assert locate(map_graph, point) == []


def test_bilinear_inverse_finds_known_places() -> None:
    quad = np.array([[0.0, 0.0], [3.0, 0.5], [3.5, 2.5], [-0.5, 2.0]])
    for u, v in itertools.product((0.0, 0.2, 0.7, 1.0), repeat=2):
        assert bilinear_inverse(quad, bilinear(quad, u, v)) == pytest.approx((u, v), abs=1e-12)


def test_route_into_a_room_passes_its_door() -> None:
    channel_map, map_graph = rooms()
    start, goal = np.array([18.0, 14.0]), np.array([70.0, 28.0])
    route = find_route(channel_map, map_graph, start, goal).points_m
    solid = shapely.union_all([polygon.buffer(-HAIR_M) for polygon in channel_map.grown.polygons])
    assert not LineString(route).intersects(solid)
    door = box(15.5, 23, 20.5, 26)
    assert LineString(route).intersects(door)
    assert path_length(route) >= np.hypot(*(goal - start))


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("turn_deg", [0, 90, 180, 270])
def test_route_leaves_a_pocket_through_its_mouth(turn_deg: float, flow: Flow) -> None:
    grown = grown_world(horseshoe(40, 25, 24, turn_deg))
    channel_map = build_channel_map(grown, 1.5, 5, flow)
    map_graph = build_map_graph(channel_map)
    start = np.array([40.0, 25.0])
    turn = np.radians(turn_deg)
    behind, mouth = (start + step * np.array([-np.sin(turn), np.cos(turn)]) for step in (-16.0, 11.0))
    for ends in ((start, behind), (behind, start)):
        route = LineString(find_route(channel_map, map_graph, *ends).points_m)
        assert not route.intersects(grown.polygons[0].buffer(-HAIR_M))
        assert route.distance(Point(mouth)) < 6.0
        assert route.length > 30.0


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("lying", [False, True], ids=["upright wall", "lying wall"])
@pytest.mark.parametrize("spare_m", [0.02, 0.2])
def test_gap_is_passed_exactly_when_it_is_wider_than_the_vehicle(spare_m: float, lying: bool, flow: Flow) -> None:
    """Two walls from border to border but for a gap of twice what the vehicle's middle keeps, more or less."""

    def walls(gap_m: float) -> tuple[Polygon, Polygon]:
        half = gap_m / 2
        if lying:
            return box(-5, 24, 40 - half, 26), box(40 + half, 24, 90, 26)
        return box(39, -5, 41, 25 - half), box(39, 25 + half, 41, 60)

    start, goal = (
        (np.array([40.0, 5.0]), np.array([40.0, 45.0])) if lying else (np.array([5.0, 25]), np.array([75, 25]))
    )
    for gap_m, passes in ((2 * REACH_M + spare_m, True), (2 * REACH_M - spare_m, False)):
        channel_map = build_channel_map(grown_world(*walls(gap_m)), 1.5, 5, flow)
        map_graph = build_map_graph(channel_map)
        if passes:
            assert path_length(find_route(channel_map, map_graph, start, goal).points_m) == pytest.approx(
                np.hypot(*(goal - start)), rel=0.05
            )
        else:
            with pytest.raises(NoRouteError, match=r"obstacle 'o0\+o1' is in the way"):
                find_route(channel_map, map_graph, start, goal)


def test_walled_off_ground_is_out_of_reach_and_the_wall_is_named() -> None:
    channel_map, map_graph = rooms()
    with pytest.raises(NoRouteError, match="obstacle 'o2' is in the way"):
        find_route(channel_map, map_graph, np.array([18.0, 14.0]), np.array([40.0, 44.0]))


def test_world_split_across_the_flow_has_no_route_and_says_so() -> None:
    channel_map = build_channel_map(grown_world(box(35, -5, 45, 60)), 1.5, 5)
    with pytest.raises(NoRouteError, match="obstacle 'o0' is in the way"):
        find_route(channel_map, build_map_graph(channel_map), np.array([5.0, 20.0]), np.array([75.0, 20.0]))


def test_end_in_a_lost_sliver_is_refused_by_its_name() -> None:
    sample = sample_world(271)
    channel_map = build_channel_map(sample.grown, 2.0, 5, sample.flow)
    lost = max(channel_map.lost, key=lambda ground: ground.area_m2)
    middle = Polygon(lost.ring_m).representative_point()
    goal = free_points(channel_map, 1, 0)[0]
    with pytest.raises(InputError) as refused:
        find_route(channel_map, build_map_graph(channel_map), np.array(middle.coords[0]), goal)
    assert "start_m" in str(refused.value)
    assert lost.name in str(refused.value)
    assert Polygon(lost.ring_m).covers(Point(middle))
