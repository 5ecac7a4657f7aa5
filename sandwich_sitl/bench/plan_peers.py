"""Other people's planners on the same questions, each where it is installed."""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.bench.ompl_plane import plane
from sandwich_sitl.planning.baselines import VisibilityGraph, path_points
from sandwich_sitl.planning.free_space import FreeSpace
from sandwich_sitl.planning.funnel import pulled_tight
from sandwich_sitl.planning.nav_mesh import build_nav_mesh
from sandwich_sitl.planning.search import Graph, Links, astar
from sandwich_sitl.world.grow import GrownWorld

Array = NDArray[np.float64]
Query = Callable[[Array, Array], Array | None]
Prepare = Callable[[GrownWorld, int], Query | None]

OMPL_S = (0.01, 1.0)  # what a tight query takes at most, and what sampling takes to come near
_OMPL = ("BITstar", "RRTstar", "PRMstar")
_MOST_CORNERS = 400  # for planners whose preparation grows with the square of the corners or worse


def peers() -> dict[str, Prepare]:
    """Name and preparation of every peer at hand: from a grown world and a number of nodes to a query, or None."""
    known: list[tuple[str, str, Prepare]] = [
        ("visibility graph", "shapely", _visibility_graph),
        ("navmesh A*, funnel", "pythoncdt", _mesh_funnel),
        ("extremitypathfinder", "extremitypathfinder", _extremities),
        ("pyastar2d", "pyastar2d", _pyastar2d),
    ]
    known += [
        (f"OMPL {planner} {seconds:g} s", "ompl", partial(_ompl, planner=planner, seconds=seconds))
        for seconds in OMPL_S
        for planner in _OMPL
    ]
    return {name: prepare for name, package, prepare in known if find_spec(package) is not None}


def _corners(grown: GrownWorld) -> int:
    return sum(len(ring) for ring in grown.rings_m())


def _visibility_graph(grown: GrownWorld, _: int) -> Query | None:
    if _corners(grown) > _MOST_CORNERS:
        return None
    rings = grown.rings_m()
    return VisibilityGraph.of(FreeSpace(rings, grown.bounds_m), rings).path


def _mesh_funnel(grown: GrownWorld, _: int) -> Query | None:
    """A* over the middles of the sides that a mesh's triangles share, then the funnel: a game's navigation mesh."""
    mesh = build_nav_mesh(grown)
    triangle, side = np.nonzero(mesh.beyond >= 0)
    ends = np.sort(np.column_stack([mesh.triangles[triangle, side], mesh.triangles[triangle, (side + 1) % 3]]), axis=1)
    sides, number = np.unique(ends, axis=0, return_inverse=True)
    of_side = np.full(mesh.triangles.shape, -1)
    of_side[triangle, side] = number.ravel()
    pairs = np.concatenate([of_side[:, [0, 1]], of_side[:, [1, 2]], of_side[:, [2, 0]]])
    graph = Graph.from_edges(mesh.xy_m[sides].mean(axis=1), pairs[(pairs >= 0).all(axis=1)])

    def links(point: Array) -> Links:
        nodes = np.unique(of_side[mesh.index.holding(point)])
        nodes = nodes[nodes >= 0]
        return list(zip(nodes.tolist(), np.hypot(*(graph.xy_m[nodes] - point).T).tolist(), strict=True))

    def query(start: Array, goal: Array) -> Array | None:
        if set(mesh.index.holding(start)) & set(mesh.index.holding(goal)):
            return np.stack([start, goal])
        found = astar(graph, links(start), goal, links(goal))
        return None if found is None else pulled_tight(mesh, path_points(graph, found, start, goal))

    return query


def _extremities(grown: GrownWorld, _: int) -> Query | None:
    if _corners(grown) > _MOST_CORNERS:
        return None
    from extremitypathfinder import PolygonEnvironment

    free = shapely.difference(shapely.box(*grown.bounds_m), shapely.union_all(list(grown.polygons)))
    ground = shapely.orient_polygons(max(shapely.get_parts(free), key=shapely.area))
    environment = PolygonEnvironment()
    environment.store(
        shapely.get_coordinates(ground.exterior)[:-1],
        [shapely.get_coordinates(hole)[:-1] for hole in ground.interiors],
        validate=False,
    )

    def query(start: Array, goal: Array) -> Array | None:
        path, _ = environment.find_shortest_path(tuple(start.tolist()), tuple(goal.tolist()), verify=False)
        return np.array(path) if len(path) else None

    return query


def _pyastar2d(grown: GrownWorld, nodes: int) -> Query | None:
    import pyastar2d  # type: ignore[import-not-found]

    x_min, y_min, x_max, y_max = grown.bounds_m
    cell = float(np.sqrt((x_max - x_min) * (y_max - y_min) / nodes))
    x, y = np.arange(x_min + cell / 2, x_max, cell), np.arange(y_min + cell / 2, y_max, cell)
    solid = shapely.union_all(list(grown.polygons))
    shapely.prepare(solid)
    weights = np.where(shapely.contains_xy(solid, *np.meshgrid(x, y, indexing="ij")), np.inf, 1.0).astype(np.float32)

    def at(point: Array) -> tuple[int, int]:
        return int(np.abs(x - point[0]).argmin()), int(np.abs(y - point[1]).argmin())

    def query(start: Array, goal: Array) -> Array | None:
        cells = pyastar2d.astar_path(weights, at(start), at(goal), allow_diagonal=True)
        if cells is None:
            return None
        return np.concatenate([start[None], np.column_stack([x[cells[1:-1, 0]], y[cells[1:-1, 1]]]), goal[None]])

    return query


def _ompl(grown: GrownWorld, _: int, planner: str, seconds: float) -> Query | None:
    """A planner of OMPL for some seconds a query, its motions tested with shapely."""
    from ompl import geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    solid = shapely.union_all(list(grown.polygons))
    shapely.prepare(solid)

    def query(start: Array, goal: Array) -> Array | None:
        space = plane(grown.bounds_m)
        setup = geometric.SimpleSetup(space)
        setup.setStateValidityChecker(lambda state: not shapely.contains_xy(solid, state[0], state[1]))
        setup.getSpaceInformation().setStateValidityCheckingResolution(0.002)
        setup.setStartAndGoalStates(_state(space, start), _state(space, goal))
        setup.setPlanner(getattr(geometric, planner)(setup.getSpaceInformation()))
        if not setup.solve(seconds) or not setup.haveExactSolutionPath():
            return None
        return np.array([[state[0], state[1]] for state in setup.getSolutionPath().getStates()])

    def _state(space: Any, point: Array) -> Any:
        state = space.allocState()
        state[0], state[1] = float(point[0]), float(point[1])
        return state

    return query
