"""`plan_flight`: world and configuration in, `FlightPlan` out (paper, sections III and IV).

grow -> channel map -> A* route -> time law -> reference and corridor, with the two baselines beside it
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.channel_map import ChannelMap, Flow
from sandwich_sitl.channels.check import check_map
from sandwich_sitl.channels.flow import flow_along
from sandwich_sitl.channels.map_file import map_key
from sandwich_sitl.config import RunConfig
from sandwich_sitl.errors import InputError, NoRouteError
from sandwich_sitl.planning.baselines import exact_shortest_path, grid_astar, path_points
from sandwich_sitl.planning.corridor import mended_corridor, neighbouring_quadrangle, paper_corridor
from sandwich_sitl.planning.flight_plan import Corridor, FlightPlan, Reference
from sandwich_sitl.planning.free_space import FreeSpace
from sandwich_sitl.planning.map_graph import MapGraph, build_map_graph, links, locate
from sandwich_sitl.planning.search import Graph, astar
from sandwich_sitl.planning.smoothing import smooth_route
from sandwich_sitl.planning.time_law import climb, rest_to_rest
from sandwich_sitl.world.grow import GrownWorld, grow
from sandwich_sitl.world.world import World

Array = NDArray[np.float64]

_DETAIL = 0.15  # of a cell and of the margin: outline details below this are smoothed outwards
_MOST_NODES = 2_000_000
_KEPT_MARGIN = 0.6  # of the margin: what smoothing leaves between the reference and the radius-grown obstacles
_HAIR_M = 1e-6
_CLIMB_MPS = 1.5
_HALF_WIDTH_CELLS = 3.0  # how far a region may reach from its stretch of reference


@dataclass(frozen=True)
class Route:
    """A* path on the mapped grid: points (n, 2) with start and goal, and the grid places (n - 2, 3) between them."""

    points_m: Array
    places: NDArray[np.int64]


class Maps(Protocol):
    """Where maps are kept between runs."""

    def get(self, key: str) -> ChannelMap | None:
        """The map kept under a key."""

    def put(self, key: str, channel_map: ChannelMap) -> None:
        """Keep a map."""


def plan_flight(
    config: RunConfig, world: World, on_stage: Callable[[str], None], maps: Maps | None = None
) -> FlightPlan:
    """Plan a whole flight; `on_stage` is told the name of each stage as it begins; `maps` saves solving one twice.

    Raises `InputError` (start or goal outside the world or inside a grown obstacle), `NoRouteError` (not connected) and
    `MapError` (the map or the corridor cannot be made safe).
    """
    planner = config.planner
    on_stage("grow obstacles")
    check_size(config, world)
    detail = min(_DETAIL * planner.cell_m, _DETAIL * planner.margin_m)
    grown = grow(world, planner.vehicle_radius_m + planner.margin_m, detail)
    check_ends(config, grown)
    on_stage("channel map")
    channel_map = _checked_map(config, grown, maps)
    on_stage("route")
    start, goal = np.array(config.start_m, dtype=float), np.array(config.goal_m, dtype=float)
    map_graph = build_map_graph(channel_map)
    route = find_route(channel_map, map_graph, start, goal)
    on_stage("baselines")
    free = FreeSpace(grown.rings_m(), grown.bounds_m)
    regular = grid_astar(free, len(map_graph.graph.xy_m), start, goal)
    exact = exact_shortest_path(free, grown.rings_m(), start, goal)
    on_stage("reference and corridor")
    solid = grow(world, planner.vehicle_radius_m, detail)
    reference, corridor = (
        _paper_reference(config, channel_map, route)
        if config.mode == "paper"
        else _timed_reference(config, channel_map, route, list(solid.polygons))
    )
    return FlightPlan(
        name=config.name,
        bounds_m=world.bounds_m,
        start_m=config.start_m,
        goal_m=config.goal_m,
        altitude_m=config.altitude_m,
        vehicle_radius_m=planner.vehicle_radius_m,
        obstacle_names=tuple(o.name for o in world.obstacles),
        obstacles_m=tuple(
            shapely.get_coordinates(shapely.orient_polygons(o.polygon).exterior)[:-1] for o in world.obstacles
        ),
        obstacle_heights_m=np.array(
            [np.nan if o.height_m is None else o.height_m for o in world.obstacles], dtype=float
        ),
        grown_m=grown.rings_m(),
        channel_map=channel_map,
        sandwich_m=route.points_m,
        sandwich_phi_psi=_planning_space(channel_map, route.places),
        grid_astar_m=np.empty((0, 2)) if regular is None else regular,
        exact_m=np.empty((0, 2)) if exact is None else exact,
        reference=reference,
        corridor=corridor,
    )


def _checked_map(config: RunConfig, grown: GrownWorld, maps: Maps | None) -> ChannelMap:
    """The map along the configured flow; on `auto` along the longer leg, or across it where no channel passes that way."""
    planner = config.planner
    along = flow_along(config.start_m, config.goal_m)
    flows: tuple[Flow, ...] = (along, "y" if along == "x" else "x") if planner.flow == "auto" else (planner.flow,)
    for flow in flows:
        channel_map = _kept_map(config, grown, flow, maps)
        if channel_map.channels:
            break
    check_map(channel_map)
    return channel_map


def _kept_map(config: RunConfig, grown: GrownWorld, flow: Flow, maps: Maps | None) -> ChannelMap:
    """The map from where maps are kept, or built and kept there."""
    parameters = config.planner.cell_m, config.planner.min_rows, flow
    key = map_key(grown, *parameters)
    kept = None if maps is None else maps.get(key)
    if kept is not None:
        return kept
    channel_map = build_channel_map(grown, *parameters)
    if maps is not None:
        maps.put(key, channel_map)
    return channel_map


def find_route(channel_map: ChannelMap, map_graph: MapGraph, start: Array, goal: Array) -> Route:
    """A* from start to goal (2,), anywhere in mapped ground.

    Raises `InputError` when an end lies in ground the map has lost, `NoRouteError` naming the barrier when they are
    not connected.
    """
    start_links, goal_links = links(map_graph, channel_map, start), links(map_graph, channel_map, goal)
    for key, point, found in (("start_m", start, start_links), ("goal_m", goal, goal_links)):
        if not found:
            raise InputError(
                f"{key}: ({point[0]:g}, {point[1]:g}) lies in {_lost_ground(channel_map, point)}; move it out"
            )
    graph = map_graph.graph
    path = astar(graph, start_links, goal, goal_links)
    if path is None:
        reached = graph.reachable([node for node, _ in start_links])
        barrier = _barrier_between(graph, reached, channel_map.grown)
        raise NoRouteError(
            f"no route from start_m to goal_m: {barrier} is in the way; "
            "move start_m or goal_m, or reduce planner.margin_m"
        )
    return Route(path_points(graph, path, start, goal), map_graph.place[path.nodes])


def check_size(config: RunConfig, world: World) -> None:
    """Raise `InputError` when the world at this cell size has more nodes than fit in memory and patience."""
    x_min, y_min, x_max, y_max = world.bounds_m
    nodes = (x_max - x_min) * (y_max - y_min) / config.planner.cell_m**2
    if nodes > _MOST_NODES:
        fitting = float(np.sqrt((x_max - x_min) * (y_max - y_min) / _MOST_NODES))
        raise InputError(
            f"planner.cell_m: {config.planner.cell_m:g} gives about {nodes:.2g} nodes, the limit is {_MOST_NODES:.2g}; "
            f"use at least {fitting:.2g}"
        )


def check_ends(config: RunConfig, grown: GrownWorld) -> None:
    """Raise `InputError` when start or goal lies outside the world or inside a grown obstacle."""
    x_min, y_min, x_max, y_max = grown.bounds_m
    for key, (x, y) in (("start_m", config.start_m), ("goal_m", config.goal_m)):
        if not (x_min <= x <= x_max and y_min <= y <= y_max):
            raise InputError(f"{key}: ({x:g}, {y:g}) lies outside the world {list(grown.bounds_m)}; move it inside")
        blocker = grown.blocker((x, y))
        if blocker is not None:
            reach = config.planner.vehicle_radius_m + config.planner.margin_m
            raise InputError(
                f"{key}: ({x:g}, {y:g}) lies inside obstacle '{blocker}' grown by {reach:g} m "
                "(planner.vehicle_radius_m + planner.margin_m), or in ground that it encloses; move it out"
            )


def _lost_ground(channel_map: ChannelMap, point: Array) -> str:
    """Name of the ground left out of the map that holds a point."""
    for lost in channel_map.lost:
        if shapely.Polygon(lost.ring_m).buffer(_HAIR_M).contains(shapely.Point(point)):
            return f"{lost.name}, a sliver that the map leaves out"
    return "a sliver that the map leaves out"


def _barrier_between(graph: Graph, reached: NDArray[np.bool_], grown: GrownWorld) -> str:
    """Name of the obstacle nearest to both reached and unreached ground."""
    there = ~np.isnan(graph.xy_m[:, 0])
    sides = [shapely.MultiPoint(graph.xy_m[there & part]) for part in (reached, ~reached)]
    if not grown.polygons:
        return "the border of the world"
    apart = [max(polygon.distance(side) for side in sides) for polygon in grown.polygons]
    return f"obstacle '{grown.names[int(np.argmin(apart))]}'"


def _planning_space(channel_map: ChannelMap, places: NDArray[np.int64]) -> Array:
    """(phi, psi) of places (n, 3); nan in bays, which lie beside the planning space's rectangles."""
    rows = [channel_map.psi_rows(d) for d in range(channel_map.channels)]
    inside = [(channel_map.phi[i], rows[d][j]) if d < len(rows) else (np.nan, np.nan) for d, i, j in places]
    return np.array(inside, dtype=float).reshape(-1, 2)


def _timed_reference(
    config: RunConfig, channel_map: ChannelMap, route: Route, solid: list[shapely.Polygon]
) -> tuple[Reference, Corridor]:
    """Climb over the start, then the smoothed route under the configured limits; one mended region a route node."""
    planner, dt = config.planner, 1.0 / config.mpc.rate_hz
    kept = _KEPT_MARGIN * planner.margin_m
    curve = smooth_route(route.points_m, shapely.union_all(solid), channel_map.bounds_m, planner.cell_m / 2, kept)
    timed = rest_to_rest(curve, planner.speed_mps, planner.acceleration_mps2)
    along = np.arange(0.0, timed.t_s[-1] + dt, dt)
    up = climb(config.altitude_m, _CLIMB_MPS, planner.acceleration_mps2, dt)
    xy = np.concatenate([np.tile(timed.xy_m[0], (len(up), 1)), timed.at(along)])
    z = np.concatenate([up, np.full(len(along), config.altitude_m)])
    places = _places(channel_map, route)
    centres = np.array([_node_m(channel_map, place) for place in places])
    region = _in_turn(xy, centres)
    used, region = np.unique(region, return_inverse=True)
    stretches = [
        xy[max(0, int(at[0]) - 1) : int(at[-1]) + 2] for at in (np.flatnonzero(region == m) for m in range(len(used)))
    ]
    quadrangles = np.array([neighbouring_quadrangle(channel_map, places[m]) for m in used])
    corridor = mended_corridor(quadrangles, stretches, solid, kept, _HALF_WIDTH_CELLS * planner.cell_m)
    return Reference(
        np.arange(len(xy), dtype=np.float64) * dt, np.column_stack([xy, z]), region.astype(np.int64)
    ), corridor


def _paper_reference(config: RunConfig, channel_map: ChannelMap, route: Route) -> tuple[Reference, Corridor]:
    """One route node a step of `mpc.step_s`, the paper's raw quadrangles (notes N12)."""
    step, dt = config.mpc.step_s, 1.0 / config.mpc.rate_hz
    up = climb(config.altitude_m, _CLIMB_MPS, config.planner.acceleration_mps2, dt)
    nodes_t = np.arange(len(route.points_m)) * step
    along = np.arange(0.0, nodes_t[-1] + dt, dt)
    xy = np.column_stack([np.interp(along, nodes_t, route.points_m[:, axis]) for axis in range(2)])
    places = _places(channel_map, route)
    quadrangles = np.array([neighbouring_quadrangle(channel_map, place) for place in places])
    node = np.clip(np.rint(along / step).astype(np.int64), 0, len(places) - 1)
    xyz = np.concatenate(
        [
            np.column_stack([np.tile(route.points_m[0], (len(up), 1)), up]),
            np.column_stack([xy, np.full(len(xy), config.altitude_m)]),
        ]
    )
    region = np.concatenate([np.zeros(len(up), dtype=np.int64), node])
    return Reference(np.arange(len(xyz), dtype=np.float64) * dt, xyz, region), paper_corridor(quadrangles)


def _places(channel_map: ChannelMap, route: Route) -> list[tuple[int, int, int]]:
    """Grid places (d, i, j) of the route's points; start and goal take the nearest corner of their cell."""
    ends = []
    for point in (route.points_m[0], route.points_m[-1]):
        b, i, j = locate(channel_map, point)[0]
        if b < channel_map.channels:
            corners = [(b, i + k, j + m) for k in (0, 1) for m in (0, 1)]
        else:
            corners = [(b, int(node), 0) for node in channel_map.bays[b - channel_map.channels].quads[i]]
        ends.append(min(corners, key=lambda c: float(np.hypot(*(_node_m(channel_map, c) - point)))))
    return [ends[0], *((int(d), int(i), int(j)) for d, i, j in route.places), ends[1]]


def _node_m(channel_map: ChannelMap, place: tuple[int, int, int]) -> Array:
    """Position (2,) of the node at a place of the map's graph."""
    b, i, j = place
    if b < channel_map.channels:
        return np.asarray(channel_map.xy_m[b][i, j])
    return np.asarray(channel_map.bays[b - channel_map.channels].xy_m[i])


def _in_turn(points: Array, centres: Array) -> NDArray[np.int64]:
    """Index (n,) of the centre each point belongs to: the nearest in a window ahead of the last, never going back."""
    index, found = 0, np.empty(len(points), dtype=np.int64)
    for k, point in enumerate(points):
        window = centres[index : index + 6]
        index += int(np.argmin(np.hypot(*(window - point).T)))
        found[k] = index
    return found
