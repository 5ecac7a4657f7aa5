"""`plan_flight`: world and configuration in, `FlightPlan` out (paper, sections III and IV).

grow -> channel map -> A* route, pulled tight -> time law -> reference and corridor, with the two baselines beside it;
with several floors all up to the route for each of them, and the rest for the cheapest
"""

from collections.abc import Callable
from typing import Literal, Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.channel_map import ChannelMap, Flow
from sandwich_sitl.channels.check import check_map
from sandwich_sitl.channels.map_file import map_key
from sandwich_sitl.config import RunConfig
from sandwich_sitl.errors import InputError, MapError, NoRouteError
from sandwich_sitl.planning.baselines import path_length
from sandwich_sitl.planning.flight_plan import Corridor, FlightFigures, FlightPlan, Reference
from sandwich_sitl.planning.floor_reference import floor_reference
from sandwich_sitl.planning.floor_routes import FloorRoute, baselines_of, cheapest, floor_plan, mapped_floors
from sandwich_sitl.planning.floors import Floor, check_ground, route_floors
from sandwich_sitl.planning.map_graph import MapGraph, build_map_graph
from sandwich_sitl.planning.nav_mesh import build_nav_mesh
from sandwich_sitl.planning.proof import prove_corridor
from sandwich_sitl.planning.reference import ground_of, paper_reference, timed_reference
from sandwich_sitl.planning.routes import Route, find_route, shortened
from sandwich_sitl.world.grow import GrownWorld
from sandwich_sitl.world.world import World

Array = NDArray[np.float64]

_DETAIL = 0.15  # of a cell and of the margin: outline details below this are smoothed outwards
_MOST_NODES = 2_000_000


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
    floors = _floors(config, world)
    on_stage("channel map")
    start, goal = np.array(config.start_m, dtype=float), np.array(config.goal_m, dtype=float)
    mapped, refused = mapped_floors(floors, lambda floor: _map_and_route(config, floor.grown, maps, start, goal))
    on_stage("route")
    kind: Literal["sandwich", "tight", "exact"] = "sandwich" if config.mode == "paper" else planner.route
    routes = [_shortened(floor, *on_floor, kind) for floor, on_floor in mapped]
    flown = cheapest(config, routes)
    best = routes[flown]
    on_stage("baselines")
    compared = [baselines_of(route, start, goal) for route in routes]
    on_stage("reference and corridor")
    reference, corridor, flight = _reference(config, best, world)
    obstacles_m = tuple(_ring(o.polygon) for o in world.obstacles)
    heights = np.array([np.nan if o.height_m is None else o.height_m for o in world.obstacles], dtype=float)
    tops = np.where(np.isfinite(heights) & bool(planner.floors_m), heights, np.inf)
    proof = prove_corridor(reference, corridor, obstacles_m, planner.vehicle_radius_m, config.mpc.step_s, tops)
    if config.mode == "timed" and not proof.proven:
        raise MapError(f"corridor: {proof.problem}; this plan must not be flown")
    return FlightPlan(
        name=config.name,
        bounds_m=world.bounds_m,
        start_m=config.start_m,
        goal_m=config.goal_m,
        altitude_m=config.altitude_m,
        vehicle_radius_m=planner.vehicle_radius_m,
        obstacle_names=tuple(o.name for o in world.obstacles),
        obstacles_m=obstacles_m,
        obstacle_heights_m=heights,
        grown_m=best.floor.grown.rings_m(),
        channel_map=best.channel_map,
        sandwich_m=best.sandwich.points_m,
        sandwich_phi_psi=_planning_space(best.channel_map, best.sandwich.places),
        grid_astar_m=compared[flown].grid_astar_m,
        exact_m=compared[flown].exact_m,
        reference=reference,
        corridor=corridor,
        route_kind=kind,
        route_proven=best.tight is not None and best.tight.proven,
        tight_m=np.empty((0, 2)) if best.tight is None else best.tight.points_m,
        proof=proof,
        flight=flight,
        floors=floor_plan(config, routes, compared, refused, reference) if planner.floors_m else None,
    )


def check_places(config: RunConfig, world: World) -> None:
    """Raise `InputError` for what `plan_flight` refuses before it maps: start or goal not free on any floor, a world too large."""
    mapped_floors(_floors(config, world), lambda floor: check_ends(config, floor.grown))


def _floors(config: RunConfig, world: World) -> tuple[Floor, ...]:
    planner = config.planner
    check_size(config, world)
    floors = route_floors(config, world, _DETAIL * min(planner.cell_m, planner.margin_m))
    if planner.floors_m:
        check_ground(config, world)
    return floors


def _shortened(
    floor: Floor,
    channel_map: ChannelMap,
    map_graph: MapGraph,
    sandwich: Route,
    kind: Literal["sandwich", "tight", "exact"],
) -> FloorRoute:
    mesh = build_nav_mesh(floor.grown)
    tight = None if kind == "sandwich" else shortened(map_graph, mesh, sandwich, kind)
    return FloorRoute(floor, channel_map, map_graph, sandwich, mesh, tight)


def _reference(config: RunConfig, route: FloorRoute, world: World) -> tuple[Reference, Corridor, FlightFigures | None]:
    if config.mode == "paper":
        return *paper_reference(config, route.channel_map, route.route_m), None
    ground = ground_of(config, route.channel_map, [o.polygon for o in route.floor.world.obstacles])
    if config.planner.floors_m:
        return floor_reference(config, ground, route.floor, world, route.route_m)
    return timed_reference(config, ground, route.route_m)


def _ring(polygon: shapely.Polygon) -> Array:
    return np.asarray(shapely.get_coordinates(shapely.orient_polygons(polygon).exterior)[:-1])


def _map_and_route(
    config: RunConfig, grown: GrownWorld, maps: Maps | None, start: Array, goal: Array
) -> tuple[ChannelMap, MapGraph, Route]:
    """The checked map along the configured flow and its A* route; on `auto` of the flow whose route is shorter.

    A map with channels goes before one without. Raises what the search raised when it finds no route on any map, and
    `InputError` when start or goal is not free.
    """
    check_ends(config, grown)
    flows: tuple[Flow, ...] = ("x", "y") if config.planner.flow == "auto" else (config.planner.flow,)
    found: list[tuple[ChannelMap, MapGraph, Route]] = []
    refused: list[InputError | NoRouteError] = []
    for flow in flows:
        channel_map = _kept_map(config, grown, flow, maps)
        check_map(channel_map)
        map_graph = build_map_graph(channel_map, wide=config.mode != "paper")  # which takes one node a step
        try:
            found.append((channel_map, map_graph, find_route(channel_map, map_graph, start, goal)))
        except (InputError, NoRouteError) as error:
            refused.append(error)
    if not found:
        raise refused[0]
    return min(found, key=lambda tried: (not tried[0].channels, path_length(tried[2].points_m)))


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
