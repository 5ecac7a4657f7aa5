"""The route of every floor, and which of them is flown (why one floor decides: `floors`)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.config import RunConfig
from sandwich_sitl.errors import InputError, MapError, NoRouteError, SandwichError
from sandwich_sitl.planning.baselines import grid_astar, path_length
from sandwich_sitl.planning.flight_plan import FloorFigures, FloorPlan, Reference
from sandwich_sitl.planning.floor_reference import way_of
from sandwich_sitl.planning.floors import Floor, climb_cost_m
from sandwich_sitl.planning.free_space import FreeSpace
from sandwich_sitl.planning.map_graph import MapGraph
from sandwich_sitl.planning.nav_mesh import NavMesh
from sandwich_sitl.planning.routes import Route
from sandwich_sitl.planning.shortest import ShortPath, shortest_path

Array = NDArray[np.float64]
Found = TypeVar("Found")


@dataclass(frozen=True)
class Refused:
    """A floor without a route, and why."""

    floor: Floor
    reason: str


@dataclass(frozen=True)
class FloorRoute:
    """A floor's checked map with its A* route, and that made shorter; `tight` is None when the A* route is flown."""

    floor: Floor
    channel_map: ChannelMap
    map_graph: MapGraph
    sandwich: Route
    mesh: NavMesh
    tight: ShortPath | None

    @property
    def route_m(self) -> Array:
        """The route (n, 2) to fly."""
        return self.sandwich.points_m if self.tight is None else self.tight.points_m


@dataclass(frozen=True)
class Baselines:
    """The existing A* on as many nodes and the exact shortest path, (n, 2); empty where there is none."""

    grid_astar_m: Array
    exact_m: Array


def mapped_floors(
    floors: Sequence[Floor], search: Callable[[Floor], Found]
) -> tuple[list[tuple[Floor, Found]], list[Refused]]:
    """What the search finds on each floor, and the floors on which it finds nothing.

    Raises what it raised on the highest floor when it finds nothing on any.
    """
    found: list[tuple[Floor, Found]] = []
    refused: list[Refused] = []
    last: SandwichError | None = None
    for floor in floors:
        try:
            found.append((floor, search(floor)))
        except (InputError, NoRouteError, MapError) as error:
            refused.append(Refused(floor, str(error)))
            last = error
    if not found and last is not None:
        raise last
    return found, refused


def cheapest(config: RunConfig, routes: Sequence[FloorRoute]) -> int:
    """Which route costs least, with the climb to its floor."""
    costs = [path_length(route.route_m) + climb_cost_m(config, route.floor.altitude_m) for route in routes]
    return int(np.argmin(costs))


def baselines_of(route: FloorRoute, start: Array, goal: Array) -> Baselines:
    """What a floor's route is compared with."""
    grown = route.floor.grown
    regular = grid_astar(FreeSpace(grown.rings_m(), grown.bounds_m), len(route.map_graph.graph.xy_m), start, goal)
    exact = shortest_path(route.mesh, start, goal, route.route_m)
    none = np.empty((0, 2))
    return Baselines(none if regular is None else regular, none if exact is None else exact.points_m)


def floor_plan(
    config: RunConfig, routes: Sequence[FloorRoute], compared: Sequence[Baselines], refused: Sequence[Refused],
    reference: Reference,
) -> FloorPlan:  # fmt: skip
    """Figures of all floors, and of the way that is flown."""
    figures = [_figures(config, route, baselines) for route, baselines in zip(routes, compared, strict=True)]
    flown = figures[cheapest(config, routes)]
    figures += [_without_route(config, floor.floor, floor.reason) for floor in refused]
    figures.sort(key=lambda floor: floor.altitude_m)
    ends = config.altitude_m, config.landing_altitude_m
    way = way_of(reference, ends, config.planner.floors_m)
    return FloorPlan(
        tuple(figures), figures.index(flown), way.length_m, way.climbed_m, way.descended_m, way.changes
    )  # fmt: skip


def _figures(config: RunConfig, route: FloorRoute, compared: Baselines) -> FloorFigures:
    lengths = [path_length(path) if len(path) else np.nan for path in (compared.grid_astar_m, compared.exact_m)]
    return FloorFigures(
        altitude_m=route.floor.altitude_m,
        obstacles=len(route.floor.world.obstacles),
        channels=route.channel_map.channels,
        nodes=route.channel_map.nodes,
        grid_astar_m=lengths[0],
        sandwich_m=path_length(route.sandwich.points_m),
        route_m=path_length(route.route_m),
        exact_m=lengths[1],
        climb_cost_m=climb_cost_m(config, route.floor.altitude_m),
    )


def _without_route(config: RunConfig, floor: Floor, reason: str) -> FloorFigures:
    cost, none = climb_cost_m(config, floor.altitude_m), np.nan
    return FloorFigures(floor.altitude_m, len(floor.world.obstacles), 0, 0, none, none, none, none, cost, reason)
