"""Lengths and times of routes, world by world: uniform-grid A*, the paper's A* on the map, tight, exact, and peers.

Every method answers the same questions. A query's time is the CPU time of the best of a few runs; preparation (map,
graph, mesh, grid) is told apart.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from time import process_time
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.bench.plan_flights import FlightScores, fly_routes
from sandwich_sitl.bench.plan_peers import Query, peers
from sandwich_sitl.bench.plan_worlds import BenchWorld, questions
from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.planning.baselines import path_length, uniform_grid
from sandwich_sitl.planning.free_space import FreeSpace
from sandwich_sitl.planning.map_graph import build_map_graph
from sandwich_sitl.planning.nav_mesh import build_nav_mesh
from sandwich_sitl.planning.routes import Route, find_route, in_its_class, shortened
from sandwich_sitl.planning.shortest import shortest_path

Array = NDArray[np.float64]
T = TypeVar("T")

EXACT, GRID, WIDE_GRID = "exact", "grid A*", "grid A*, 16 neighbours"
NARROW, SANDWICH = "Sandwich A*, 8 neighbours", "Sandwich A*"
CLASS, TIGHT = "  its class, tight", "tight"
_REPEATS = 3
_PEER_QUERIES = 5
_LEAST_ROWS = 5


@dataclass
class Score:
    """Lengths of a method over the exact ones, its lengths and times; nan where it found no path."""

    method: str
    ratios: list[float] = field(default_factory=list)
    lengths_m: list[float] = field(default_factory=list)
    times_ms: list[float] = field(default_factory=list)

    def add(self, exact_m: float, points: Array | None, time_ms: float) -> None:
        """One query's path (n, 2)."""
        length = np.nan if points is None or not len(points) else path_length(points)
        self.lengths_m.append(length)
        self.ratios.append(length / exact_m)
        self.times_ms.append(time_ms)

    @property
    def found(self) -> Array:
        """Ratios where there was a path."""
        return np.array([ratio for ratio in self.ratios if np.isfinite(ratio)])


@dataclass(frozen=True)
class WorldScores:
    """All methods' scores on one world, and what preparing them took."""

    world: str
    nodes: int
    queries: int
    prepared_ms: dict[str, float]
    scores: tuple[Score, ...]
    flights: tuple[FlightScores, ...] = ()

    def of(self, method: str) -> Score:
        """A method's score."""
        return next(score for score in self.scores if score.method == method)


@dataclass(frozen=True)
class Asked:
    """How much is asked of each world."""

    nodes: int
    queries: int
    flights: int
    seed: int
    peers: bool


def bench_world(world: BenchWorld, asked: Asked, on_step: Callable[[str], None]) -> WorldScores:
    """Ask every method the same random questions on a map of about `asked.nodes` nodes, and time the tight routes."""
    bench = _Bench(world, asked, on_step)
    pairs = questions(world.grown, bench.map_graph, asked.queries, asked.seed)
    bench.timed("first query", lambda: bench.sandwich(*pairs[0]))
    on_step(f"{world.name}: {len(pairs)} queries")
    methods = bench.methods()
    scores = {name: Score(name) for name in methods}
    least, tight = [], []
    for start, goal in pairs:
        for name, query in methods.items():
            points, time_ms = _best_of(query, start, goal, _REPEATS)
            if name == EXACT:
                least.append(np.nan if points is None else path_length(points))
            if name == TIGHT and points is not None:
                tight.append(points)
            scores[name].add(least[-1], points, time_ms)
    for name, prepare in peers().items() if asked.peers else ():
        peer = bench.timed(name, lambda prepare=prepare: prepare(world.grown, bench.grid_nodes))  # type: ignore[misc]
        if peer is None:
            continue
        scores[name] = Score(name)
        for (start, goal), exact_m in list(zip(pairs, least, strict=True))[:_PEER_QUERIES]:
            scores[name].add(exact_m, *_best_of(peer, start, goal, 1))
    on_step(f"{world.name}: {min(asked.flights, len(tight))} flights")
    flights = fly_routes(world, bench.channel_map, tight[: asked.flights]) if asked.flights else ()
    nodes = len(bench.map_graph.graph.xy_m)
    return WorldScores(world.name, nodes, len(pairs), bench.prepared_ms, tuple(scores.values()), flights)


class _Bench:
    """A world's map, graph, mesh and grids, with the times that they took."""

    def __init__(self, world: BenchWorld, asked: Asked, on_step: Callable[[str], None]) -> None:
        grown = world.grown
        self.prepared_ms: dict[str, float] = {}
        self._name, self._on_step = world.name, on_step
        cell_m = float(np.sqrt(grown.free_area_m2 / asked.nodes))
        self.channel_map = self.timed("map", lambda: build_channel_map(grown, cell_m, _LEAST_ROWS))
        build_map_graph(self.channel_map)
        self.map_graph = self.timed("graph", lambda: build_map_graph(self.channel_map))
        self.timed("index", lambda: self.map_graph.cells)
        self.narrow_graph = build_map_graph(self.channel_map, wide=False)
        self.mesh = self.timed("mesh", lambda: build_nav_mesh(grown))
        x_min, y_min, x_max, y_max = grown.bounds_m
        in_free = len(self.map_graph.graph.xy_m) / grown.free_area_m2
        self.grid_nodes = round(in_free * (x_max - x_min) * (y_max - y_min))
        free = FreeSpace(grown.rings_m(), grown.bounds_m)
        self.grid = self.timed("grid", lambda: uniform_grid(free, self.grid_nodes))
        self.wide_grid = uniform_grid(free, self.grid_nodes, wide=True)

    def timed(self, name: str, make: Callable[[], T]) -> T:
        """What `make` makes, its CPU time kept under a name."""
        self._on_step(f"{self._name}: {name}")
        begin = process_time()
        made = make()
        self.prepared_ms[name] = 1e3 * (process_time() - begin)
        return made

    def sandwich(self, start: Array, goal: Array) -> Route:
        """The paper's route."""
        return find_route(self.channel_map, self.map_graph, start, goal)

    def methods(self) -> dict[str, Query]:
        """Name and query of every way to find a route that is the project's own."""
        map_graph, mesh = self.map_graph, self.mesh

        def exact(start: Array, goal: Array) -> Array | None:
            found = shortest_path(mesh, start, goal)
            return None if found is None else found.points_m

        return {
            EXACT: exact,
            GRID: self.grid.path,
            WIDE_GRID: self.wide_grid.path,
            NARROW: lambda start, goal: find_route(self.channel_map, self.narrow_graph, start, goal).points_m,
            SANDWICH: lambda start, goal: self.sandwich(start, goal).points_m,
            CLASS: lambda start, goal: in_its_class(map_graph, mesh, self.sandwich(start, goal)),
            TIGHT: lambda start, goal: shortened(map_graph, mesh, self.sandwich(start, goal), "tight").points_m,
        }


def _best_of(query: Query, start: Array, goal: Array, repeats: int) -> tuple[Array | None, float]:
    points, best = None, np.inf
    for _ in range(repeats):
        begin = process_time()
        points = query(start, goal)
        best = min(best, 1e3 * (process_time() - begin))
    return points, best
