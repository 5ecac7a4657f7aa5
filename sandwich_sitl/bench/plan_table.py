"""What `bench plan` prints: a block a world, then the paper's Table I line and the goals' figures over all of them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.bench.plan_bench import CLASS, GRID, NARROW, SANDWICH, TIGHT, WIDE_GRID, Score, WorldScores
from sandwich_sitl.bench.plan_flights import FlightScores

Array = NDArray[np.float64]

_SAME = 1e-6  # of the length: as short as the exact path, hence in its class or in one as good
_PAPER_M = (145.95, 138.51)
_PAPER_PERCENT = 6.21


def table(results: Sequence[WorldScores]) -> str:
    """All lines to print."""
    lines = []
    for result in results:
        lines += [*_world_lines(result), ""]
    lines += _over_all(results)
    return "\n".join(lines)


def _world_lines(result: WorldScores) -> list[str]:
    prepared = ", ".join(f"{name.strip()} {ms:.0f} ms" for name, ms in result.prepared_ms.items())
    return [
        f"{result.world}: {result.nodes} nodes, {result.queries} queries",
        f"  prepared  {prepared}",
        f"  {'':25} length/exact mean     p95   worst  as short   no path   ms p50     p99",
        *map(_score_line, result.scores),
        *map(_flight_line, result.flights),
    ]


def _score_line(score: Score) -> str:
    ratios, times = score.found, np.array(score.times_ms)
    if not len(ratios):
        return f"  {score.method:25} found no path"
    return (
        f"  {score.method:25} {ratios.mean():17.5f} {np.percentile(ratios, 95):7.4f} {ratios.max():7.4f}"
        f" {_same_class(ratios):7.1f} %  {len(score.ratios) - len(ratios):8d}"
        f" {np.median(times):8.2f} {np.percentile(times, 99):7.2f}"
    )


def _same_class(ratios: Array) -> float:
    """Percentage that is as short as the exact path."""
    return 100 * float((ratios <= 1 + _SAME).mean())


def _flight_line(flight: FlightScores) -> str:
    head = f"  flown at {flight.speed_mps:4.1f} m/s, {flight.acceleration_mps2:.1f} m/s2:"
    refused = f", {len(flight.refused)} refused: {flight.refused[0]}" if flight.refused else ""
    if not flight.duration_ratio:
        return head + " none" + refused
    duration, count = np.array(flight.duration_ratio), len(flight.duration_ratio)
    own, paper, free = (np.mean(x) for x in (flight.corridor_m2, flight.quadrangle_m2, flight.decomposition_m2))
    return (
        f"{head} duration/time-optimal {duration.mean():.3f}, worst {duration.max():.3f}; curve/route "
        f"{np.mean(flight.curve_ratio):.4f}; corridor {own:.1f} m2 a step, quadrangle {paper:.1f}, decomposition "
        f"{free:.1f}; proven {flight.proven} of {count}{refused}"
    )


def _over_all(results: Sequence[WorldScores]) -> list[str]:
    def lengths(method: str) -> Array:
        return np.concatenate([np.empty(0), *(np.array(result.of(method).lengths_m) for result in results)])

    grid_m, wide_m, sandwich_m = lengths(GRID), lengths(WIDE_GRID), lengths(SANDWICH)
    both = np.isfinite(grid_m) & np.isfinite(wide_m) & np.isfinite(sandwich_m)
    grid_m, wide_m, sandwich_m = grid_m[both], wide_m[both], sandwich_m[both]
    rows = [("paper", *_PAPER_M, f"; its text says {_PAPER_PERCENT:.2f} %")]
    lines = []
    if len(grid_m):
        rows.append(("here", float(grid_m.mean()), float(sandwich_m.mean()), ""))
        lines = [
            f"Sandwich A* is shorter than {GRID} in {_share(sandwich_m, grid_m)} of queries, than {WIDE_GRID} in "
            f"{_share(sandwich_m, wide_m)} ({wide_m.mean():.2f} m on average)",
            "over the exact length, all queries:",
            *(_all_ratios(results, method) for method in (GRID, WIDE_GRID, NARROW, SANDWICH, CLASS, TIGHT)),
        ]
    table_one = [
        f"  {name:8} {existing:11.2f} m {sandwich:11.2f} m   {100 * (existing - sandwich) / existing:.2f} % of the "
        f"existing A*'s, {100 * (existing - sandwich) / sandwich:.2f} % of the Sandwich A*'s{rest}"
        for name, existing, sandwich, rest in rows
    ]
    return ["Table I     existing A*   Sandwich A*   reduction", *table_one, *lines]


def _share(shorter: Array, longer: Array) -> str:
    return f"{100 * float((shorter < longer).mean()):.1f} %"


def _all_ratios(results: Sequence[WorldScores], method: str) -> str:
    ratios = np.concatenate([result.of(method).found for result in results])
    lost = sum(len(result.of(method).ratios) for result in results) - len(ratios)
    in_class = f", optimal homotopy class in {_same_class(ratios):.1f} %" if method in (CLASS, TIGHT) else ""
    return (
        f"  {method:25} mean {ratios.mean():.5f}, p95 {np.percentile(ratios, 95):.4f}, worst {ratios.max():.4f}{in_class}"
        f", {lost} of {lost + len(ratios)} without a path"
    )
