"""What others prepare before the first query, on the same free ground: visibility graph, navigation mesh, roadmap.

Each peer answers shortest-path queries for a point among the same grown obstacles. A peer whose package is missing is
named with what installs it. Preparation of the first two does not depend on a cell size.
"""

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pythoncdt
import shapely
from numpy.typing import NDArray

from sandwich_sitl.bench.child import ChildFailedError, in_child
from sandwich_sitl.bench.map_worlds import BenchWorld
from sandwich_sitl.bench.ompl_plane import plane

Array = NDArray[np.float64]

MILESTONES = 2000
_SEED = 1


@dataclass(frozen=True)
class PeerFigures:
    """Seconds of preparation and what they made, or why there are none."""

    peer: str
    seconds: float | None
    made: str


def measure_peers(world: BenchWorld, timeout_s: float) -> tuple[PeerFigures, ...]:
    """Every peer, each in a process of its own that is ended after `timeout_s`."""
    return tuple(_measured(peer, prepare, world, timeout_s) for peer, prepare in _PEERS.items())


def _measured(
    peer: str, prepare: Callable[[BenchWorld], tuple[float, str]], world: BenchWorld, timeout_s: float
) -> PeerFigures:
    try:
        seconds, made = in_child(_prepared, prepare, world, timeout_s=timeout_s)
    except ChildFailedError as error:
        return PeerFigures(peer, None, str(error))
    return PeerFigures(peer, seconds, made)


def _prepared(prepare: Callable[[BenchWorld], tuple[float, str]], world: BenchWorld) -> tuple[float | None, str]:
    try:
        return prepare(world)
    except ModuleNotFoundError as error:
        return None, f"not installed ({_INSTALL.get(error.name or '', error.name)})"


def visibility_graph(world: BenchWorld) -> tuple[float, str]:
    """Exact visibility graph by extremitypathfinder."""
    from extremitypathfinder import PolygonEnvironment

    ground = shapely.orient_polygons(world.free_ground())
    rings = [shapely.get_coordinates(ring)[:-1] for ring in (ground.exterior, *ground.interiors)]
    began = time.perf_counter()
    environment = PolygonEnvironment()
    environment.store(rings[0], rings[1:], validate=False)
    seconds = time.perf_counter() - began
    return seconds, f"{environment.nr_vertices} vertices, {environment.graph.number_of_edges()} edges"


def navigation_mesh(world: BenchWorld) -> tuple[float, str]:
    """Constrained Delaunay triangles of the free ground and which of them are neighbours, by PythonCDT."""
    ground = world.free_ground()
    rings = [shapely.get_coordinates(ring)[:-1] for ring in (ground.exterior, *ground.interiors)]
    began = time.perf_counter()
    points = np.concatenate(rings)
    first = np.cumsum([0, *(len(ring) for ring in rings)])
    edges = [
        np.column_stack([np.arange(a, b), np.roll(np.arange(a, b), -1)]) for a, b in itertools.pairwise(first.tolist())
    ]
    mesh: Any = pythoncdt.Triangulation(
        pythoncdt.VertexInsertionOrder.AUTO, pythoncdt.IntersectingConstraintEdges.NOT_ALLOWED, 0.0
    )
    mesh.insert_vertices(points)
    mesh.insert_edges(np.concatenate(edges).astype(np.uint32))
    mesh.erase_outer_triangles_and_holes()
    triangles = mesh.triangles_array()["vertices"].astype(np.int64)
    neighbours = _neighbours(triangles)
    seconds = time.perf_counter() - began
    return seconds, f"{len(triangles)} triangles, {len(neighbours)} shared sides"


def roadmap(world: BenchWorld) -> tuple[float, str]:
    """PRM* of `MILESTONES` points by OMPL; validity of points and motions by shapely, called from OMPL."""
    from ompl import base, geometric
    from ompl import util as ompl_util

    ompl_util.setLogLevel(ompl_util.LogLevel.LOG_NONE)
    ompl_util.RNG.setSeed(_SEED)
    ground = world.free_ground()
    shapely.prepare(ground)
    space = plane(world.grown.bounds_m)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(lambda state: bool(shapely.contains_xy(ground, state[0], state[1])))
    information.setStateValidityCheckingResolution(world.cell_m(10_000) / space.getMaximumExtent())
    information.setup()
    problem = base.ProblemDefinition(information)
    planner = geometric.PRMstar(information)
    planner.setProblemDefinition(problem)
    planner.setup()
    began = time.perf_counter()
    planner.constructRoadmap(base.PlannerTerminationCondition(lambda: planner.milestoneCount() >= MILESTONES))
    seconds = time.perf_counter() - began
    return seconds, f"{planner.milestoneCount()} milestones, {planner.edgeCount()} edges"


def _neighbours(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pairs (n, 2) of triangles that share a side."""
    sides = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    order = np.lexsort(sides.T)
    same = (np.diff(sides[order], axis=0) == 0).all(axis=1)
    return np.column_stack([order[:-1][same], order[1:][same]]) // 3


_PEERS: dict[str, Callable[[BenchWorld], tuple[float, str]]] = {
    "visibility graph, extremitypathfinder": visibility_graph,
    "navigation mesh, PythonCDT": navigation_mesh,
    "PRM*, OMPL": roadmap,
}
_INSTALL: dict[str, Any] = {
    "ompl": "pip install 'sandwich-sitl[bench]'",
    "extremitypathfinder": "pip install --no-deps extremitypathfinder: it asks for an older numpy",
    "networkx": "pip install networkx",
}
