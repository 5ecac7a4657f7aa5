"""Other people's planners on the same questions, each where it is installed."""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandwich_sitl.planning.baselines import exact_shortest_path
from sandwich_sitl.planning.free_space import FreeSpace
from sandwich_sitl.world.grow import GrownWorld

Array = NDArray[np.float64]
Query = Callable[[Array, Array], Array | None]
Prepare = Callable[[GrownWorld, int], Query | None]

OMPL_S = 1.0
_MOST_CORNERS = 400  # for planners whose preparation grows with the square of the corners or worse


def peers() -> dict[str, Prepare]:
    """Name and preparation of every peer at hand: from a grown world and a number of nodes to a query, or None."""
    known: tuple[tuple[str, str, Prepare], ...] = (
        ("visibility graph", "shapely", _visibility_graph),
        ("extremitypathfinder", "extremitypathfinder", _extremities),
        ("pyastar2d", "pyastar2d", _pyastar2d),
        (f"OMPL BIT* {OMPL_S:g} s", "ompl", _ompl),
    )
    return {name: prepare for name, package, prepare in known if find_spec(package) is not None}


def _corners(grown: GrownWorld) -> int:
    return sum(len(ring) for ring in grown.rings_m())


def _visibility_graph(grown: GrownWorld, _: int) -> Query | None:
    """Built anew for each query, so its times count the building."""
    if _corners(grown) > _MOST_CORNERS:
        return None
    rings = grown.rings_m()
    free = FreeSpace(rings, grown.bounds_m)
    return lambda start, goal: exact_shortest_path(free, rings, start, goal)


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


def _ompl(grown: GrownWorld, _: int) -> Query | None:
    """BIT* for `OMPL_S` a query, its motions tested with shapely."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    x_min, y_min, x_max, y_max = grown.bounds_m
    solid = shapely.union_all(list(grown.polygons))
    shapely.prepare(solid)

    def query(start: Array, goal: Array) -> Array | None:
        space = base.RealVectorStateSpace(2)
        bounds = base.RealVectorBounds(2)
        for axis, (low, high) in enumerate(((x_min, x_max), (y_min, y_max))):
            bounds.setLow(axis, low)
            bounds.setHigh(axis, high)
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        setup.setStateValidityChecker(lambda state: not shapely.contains_xy(solid, state[0], state[1]))
        setup.getSpaceInformation().setStateValidityCheckingResolution(0.002)
        setup.setStartAndGoalStates(_state(space, start), _state(space, goal))
        setup.setPlanner(geometric.BITstar(setup.getSpaceInformation()))
        if not setup.solve(OMPL_S) or not setup.haveExactSolutionPath():
            return None
        return np.array([[state[0], state[1]] for state in setup.getSolutionPath().getStates()])

    def _state(space: Any, point: Array) -> Any:
        state = space.allocState()
        state[0], state[1] = float(point[0]), float(point[1])
        return state

    return query
