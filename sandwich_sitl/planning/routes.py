"""Routes from one channel map: the paper's A* path, and shorter ones made from it.

`tight`: the A* path's cells give its homotopy class; the string is pulled tight in it; then corners in sight of each
other are searched for a shorter way round, up to a limit of work. `exact`: the same without the limit, so that the
result is the optimum.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.channels.channel_map import ChannelMap
from sandwich_sitl.errors import InputError, NoRouteError
from sandwich_sitl.planning.baselines import path_length, path_points
from sandwich_sitl.planning.cell_chain import inner_line
from sandwich_sitl.planning.funnel import pulled_tight
from sandwich_sitl.planning.map_graph import MapGraph, links
from sandwich_sitl.planning.nav_mesh import NavMesh
from sandwich_sitl.planning.search import Graph, astar
from sandwich_sitl.planning.shortest import ShortPath, shortest_path
from sandwich_sitl.world.grow import GrownWorld

Array = NDArray[np.float64]
RouteKind = Literal["tight", "exact"]

MOST_CONES = 100_000  # of sight, for a tight route: some milliseconds
_HAIR_M = 1e-6


@dataclass(frozen=True)
class Route:
    """A* path on the mapped grid: points (n, 2) with start and goal, and the grid places (n - 2, 3) between them."""

    points_m: Array
    places: NDArray[np.int64]


def find_route(channel_map: ChannelMap, map_graph: MapGraph, start: Array, goal: Array) -> Route:
    """A* from start to goal (2,), anywhere in mapped ground.

    Raises `InputError` when an end lies in ground the map has lost, `NoRouteError` naming the barrier when they are
    not connected.
    """
    start_links, goal_links = links(map_graph, start), links(map_graph, goal)
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


def in_its_class(map_graph: MapGraph, mesh: NavMesh, route: Route) -> Array | None:
    """An A* path pulled tight: the shortest path (n, 2) that passes every obstacle on the same hand."""
    nodes = np.array([map_graph.node[b][i, j] for b, i, j in route.places.tolist()], dtype=np.int64)
    return pulled_tight(mesh, inner_line(map_graph, route.points_m[0], nodes, route.points_m[-1]))


def shortened(map_graph: MapGraph, mesh: NavMesh, route: Route, kind: RouteKind) -> ShortPath:
    """The tight or exact route made from an A* path; the path itself when there is nothing shorter."""
    start, goal = route.points_m[0], route.points_m[-1]
    limit = MOST_CONES if kind == "tight" else None
    found = shortest_path(mesh, start, goal, in_its_class(map_graph, mesh, route), limit)
    length = path_length(route.points_m)
    if found is None or found.length_m > length:
        return ShortPath(route.points_m, length, proven=False)
    return found


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
