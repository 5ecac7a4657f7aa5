"""`plan_flight`: world and configuration in, `FlightPlan` out (paper, sections III and IV).

grow -> channel map -> A* route, pulled tight -> time law -> reference and corridor, with the two baselines beside it
"""

from collections.abc import Callable
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
from sandwich_sitl.errors import InputError
from sandwich_sitl.planning.baselines import grid_astar
from sandwich_sitl.planning.corridor import mended_corridor, neighbouring_quadrangle, paper_corridor
from sandwich_sitl.planning.flight_plan import Corridor, FlightPlan, Reference
from sandwich_sitl.planning.free_space import FreeSpace
from sandwich_sitl.planning.map_graph import MapGraph, Place, build_map_graph, links
from sandwich_sitl.planning.nav_mesh import build_nav_mesh
from sandwich_sitl.planning.routes import Route, find_route, shortened
from sandwich_sitl.planning.shortest import shortest_path
from sandwich_sitl.planning.smoothing import smooth_route
from sandwich_sitl.planning.time_law import climb, rest_to_rest
from sandwich_sitl.world.grow import GrownWorld, grow
from sandwich_sitl.world.world import World

Array = NDArray[np.float64]

_DETAIL = 0.15  # of a cell and of the margin: outline details below this are smoothed outwards
_MOST_NODES = 2_000_000
_KEPT_MARGIN = 0.6  # of the margin: what smoothing leaves between the reference and the radius-grown obstacles
_CLIMB_MPS = 1.5
_HALF_WIDTH_CELLS = 3.0  # how far a region may reach from its stretch of reference


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
    sandwich = find_route(channel_map, map_graph, start, goal)
    mesh = build_nav_mesh(grown)
    kind = "sandwich" if config.mode == "paper" else planner.route
    route = sandwich if kind == "sandwich" else shortened(map_graph, mesh, sandwich, kind, planner.cell_m)
    on_stage("baselines")
    free = FreeSpace(grown.rings_m(), grown.bounds_m)
    regular = grid_astar(free, len(map_graph.graph.xy_m), start, goal)
    exact = shortest_path(mesh, start, goal, route.points_m)
    on_stage("reference and corridor")
    solid = grow(world, planner.vehicle_radius_m, detail)
    reference, corridor = (
        _paper_reference(config, channel_map, map_graph, route)
        if config.mode == "paper"
        else _timed_reference(config, channel_map, map_graph, route, list(solid.polygons))
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
        sandwich_m=sandwich.points_m,
        sandwich_phi_psi=_planning_space(channel_map, sandwich.places),
        grid_astar_m=np.empty((0, 2)) if regular is None else regular,
        exact_m=np.empty((0, 2)) if exact is None else exact.points_m,
        reference=reference,
        corridor=corridor,
        route_kind=kind,
        route_proven=route.proven,
        tight_m=np.empty((0, 2)) if kind == "sandwich" else route.points_m,
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


def _planning_space(channel_map: ChannelMap, places: NDArray[np.int64]) -> Array:
    """(phi, psi) of places (n, 3); nan in bays, which lie beside the planning space's rectangles."""
    rows = [channel_map.psi_rows(d) for d in range(channel_map.channels)]
    inside = [(channel_map.phi[i], rows[d][j]) if d < len(rows) else (np.nan, np.nan) for d, i, j in places]
    return np.array(inside, dtype=float).reshape(-1, 2)


def _timed_reference(
    config: RunConfig, channel_map: ChannelMap, map_graph: MapGraph, route: Route, solid: list[shapely.Polygon]
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
    places = _places(map_graph, route)
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


def _paper_reference(
    config: RunConfig, channel_map: ChannelMap, map_graph: MapGraph, route: Route
) -> tuple[Reference, Corridor]:
    """One route node a step of `mpc.step_s`, the paper's raw quadrangles (notes N12)."""
    step, dt = config.mpc.step_s, 1.0 / config.mpc.rate_hz
    up = climb(config.altitude_m, _CLIMB_MPS, config.planner.acceleration_mps2, dt)
    nodes_t = np.arange(len(route.points_m)) * step
    along = np.arange(0.0, nodes_t[-1] + dt, dt)
    xy = np.column_stack([np.interp(along, nodes_t, route.points_m[:, axis]) for axis in range(2)])
    places = _places(map_graph, route)
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


def _places(map_graph: MapGraph, route: Route) -> list[Place]:
    """Grid places (d, i, j) of the route's points; start and goal take the nearest corner of their cell."""
    ends = [min(links(map_graph, point), key=lambda link: link[1])[0] for point in route.points_m[[0, -1]]]
    first, last = map_graph.place[ends]
    return [(int(b), int(i), int(j)) for b, i, j in (first, *route.places, last)]


def _node_m(channel_map: ChannelMap, place: Place) -> Array:
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
