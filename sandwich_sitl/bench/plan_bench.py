"""Lengths and times of routes, world by world: uniform-grid A*, the paper's A* on the map, tight, exact, and peers.

Every method answers the same questions. A query's time is the best of a few runs on this machine; preparation (map,
graph, mesh, grid) is told apart.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from time import perf_counter
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.bench.plan_peers import Query, peers
from sandwich_sitl.bench.plan_worlds import BenchWorld, questions
from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.planning.baselines import path_length, uniform_grid
from sandwich_sitl.planning.free_space import FreeSpace
from sandwich_sitl.planning.map_graph import build_map_graph
from sandwich_sitl.planning.nav_mesh import build_nav_mesh
from sandwich_sitl.planning.routes import find_route, in_its_class, shortened
from sandwich_sitl.planning.shortest import shortest_path

Array = NDArray[np.float64]
T = TypeVar("T")

GRID, SANDWICH, CLASS, TIGHT, EXACT = "grid A*", "Sandwich A*", "  its class, tight", "tight", "exact"
_REPEATS = 3
_PEER_QUERIES = 5
_LEAST_ROWS = 5
_SAME = 1e-6  # of the length: as short as the exact path, hence in its class or in one as good
_PAPER_M = (145.95, 138.51)
_PAPER_PERCENT = 6.21


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

    def of(self, method: str) -> Score:
        """A method's score."""
        return next(score for score in self.scores if score.method == method)


def bench_world(
    world: BenchWorld, nodes: int, queries: int, seed: int, on_step: Callable[[str], None], *, with_peers: bool
) -> WorldScores:
    """Ask every method the same `queries` random questions on a map of about `nodes` nodes."""
    grown = world.grown
    prepared: dict[str, float] = {}

    def timed(name: str, make: Callable[[], T]) -> T:
        on_step(f"{world.name}: {name}")
        begin = perf_counter()
        made = make()
        prepared[name] = 1e3 * (perf_counter() - begin)
        return made

    cell_m = float(np.sqrt(grown.free_area_m2 / nodes))
    channel_map = timed("map", lambda: build_channel_map(grown, cell_m, _LEAST_ROWS))
    build_map_graph(channel_map)
    map_graph = timed("graph", lambda: build_map_graph(channel_map))
    timed("index", lambda: (map_graph.cells, map_graph.around))
    mesh = timed("mesh", lambda: build_nav_mesh(grown))
    x_min, y_min, x_max, y_max = grown.bounds_m
    in_free = len(map_graph.graph.xy_m) * (x_max - x_min) * (y_max - y_min) / grown.free_area_m2
    grid = timed("grid", lambda: uniform_grid(FreeSpace(grown.rings_m(), grown.bounds_m), round(in_free)))
    asked = questions(grown, map_graph, queries, seed)

    def exact(start: Array, goal: Array) -> Array | None:
        found = shortest_path(mesh, start, goal)
        return None if found is None else found.points_m

    methods: dict[str, Query] = {
        EXACT: exact,
        GRID: grid.path,
        SANDWICH: lambda start, goal: find_route(channel_map, map_graph, start, goal).points_m,
        CLASS: lambda start, goal: in_its_class(map_graph, mesh, find_route(channel_map, map_graph, start, goal)),
        TIGHT: lambda start, goal: (
            shortened(map_graph, mesh, find_route(channel_map, map_graph, start, goal), "tight").points_m
        ),
    }
    scores = {name: Score(name) for name in methods}
    on_step(f"{world.name}: {len(asked)} queries")
    least = []
    for start, goal in asked:
        for name, query in methods.items():
            points, time_ms = _best_of(query, start, goal, _REPEATS)
            if name == EXACT:
                least.append(np.nan if points is None else path_length(points))
            scores[name].add(least[-1], points, time_ms)
    for name, prepare in peers().items() if with_peers else ():
        peer = timed(name, lambda prepare=prepare: prepare(grown, round(in_free)))  # type: ignore[misc]
        if peer is None:
            continue
        scores[name] = Score(name)
        for (start, goal), exact_m in list(zip(asked, least, strict=True))[:_PEER_QUERIES]:
            scores[name].add(exact_m, *_best_of(peer, start, goal, 1))
    return WorldScores(world.name, len(map_graph.graph.xy_m), len(asked), prepared, tuple(scores.values()))


def _best_of(query: Query, start: Array, goal: Array, repeats: int) -> tuple[Array | None, float]:
    points, best = None, np.inf
    for _ in range(repeats):
        begin = perf_counter()
        points = query(start, goal)
        best = min(best, 1e3 * (perf_counter() - begin))
    return points, best


def table(results: Iterable[WorldScores]) -> str:
    """The lines to print: a block a world, then the paper's Table I line over all of them."""
    lines, grid_m, sandwich_m = [], np.empty(0), np.empty(0)
    for result in results:
        lines.append(f"{result.world}: {result.nodes} nodes, {result.queries} queries")
        lines.append(
            "  prepared  " + ", ".join(f"{name.strip()} {ms:.0f} ms" for name, ms in result.prepared_ms.items())
        )
        lines.append(f"  {'':22} length/exact mean     p95   worst  as short   no path   ms p50     p99")
        lines += [*map(_line, result.scores), ""]
        grid_m = np.concatenate([grid_m, result.of(GRID).lengths_m])
        sandwich_m = np.concatenate([sandwich_m, result.of(SANDWICH).lengths_m])
    both = np.isfinite(grid_m) & np.isfinite(sandwich_m)
    lines += _paper_lines(grid_m[both], sandwich_m[both])
    return "\n".join(lines)


def _line(score: Score) -> str:
    ratios, times = score.found, np.array(score.times_ms)
    if not len(ratios):
        return f"  {score.method:22} found no path"
    return (
        f"  {score.method:22} {ratios.mean():17.5f} {np.percentile(ratios, 95):7.4f} {ratios.max():7.4f}"
        f" {100 * float((ratios <= 1 + _SAME).mean()):7.1f} %  {len(score.ratios) - len(ratios):8d}"
        f" {np.median(times):8.2f} {np.percentile(times, 99):7.2f}"
    )


def _paper_lines(grid_m: Array, sandwich_m: Array) -> list[str]:
    """A reduction of the existing A*'s length, and the same metres as a share of the Sandwich A*'s."""
    rows = [("paper", *_PAPER_M, f"; its text says {_PAPER_PERCENT:.2f} %")]
    if len(grid_m):
        shorter = 100 * float((sandwich_m < grid_m).mean())
        rows.append(("here", grid_m.mean(), sandwich_m.mean(), f"; Sandwich shorter in {shorter:.1f} % of queries"))
    return ["Table I     existing A*   Sandwich A*   reduction"] + [
        f"  {name:8} {existing:11.2f} m {sandwich:11.2f} m   {100 * (existing - sandwich) / existing:.2f} % of the "
        f"existing A*'s, {100 * (existing - sandwich) / sandwich:.2f} % of the Sandwich A*'s{rest}"
        for name, existing, sandwich, rest in rows
    ]
