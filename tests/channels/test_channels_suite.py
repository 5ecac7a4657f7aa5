"""A thousand random worlds of every kind, on two processes; the figures are printed, worst first."""

import multiprocessing
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import pytest
from map_laws import check_laws, check_lookup, check_residual, free_points
from world_samples import FAMILIES, SampleWorld, sample_world, thousand_obstacles

from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.channels.check import examine

WORLDS = 1000
CROWDED_WORLDS = 3
LOOKED_UP = 15  # points a world
FULL_LAWS_EVERY = 30  # worlds; the independent measurement costs more than the map


@dataclass(frozen=True)
class Figures:
    """What was measured in one world."""

    family: str
    seed: int
    shapes: int
    cells: int
    folded: int
    repaired: float  # share of the cells
    in_bays: float  # share of the cells
    coverage: float
    least_sine: float
    residual: float  # of a cell
    seconds: float
    broken: str


def measured(sample: SampleWorld, *, all_laws: bool) -> Figures:
    """Map and examine a world; what goes wrong is told in `broken`."""
    begin = time.process_time()
    channel_map = build_channel_map(sample.grown, sample.cell_m, 5, sample.flow)
    seconds = time.process_time() - begin
    found, quality = examine(channel_map), channel_map.quality
    broken = list(found.failures)
    try:
        check_residual(channel_map, sample.cell_m)
        if sample.grown.free_area_m2 > 1.0:
            check_lookup(channel_map, free_points(channel_map, LOOKED_UP, sample.seed))
        if all_laws:
            check_laws(channel_map)
    except AssertionError as error:
        broken.append(f"law: {str(error).splitlines()[0] if str(error) else 'assertion'}")
    return Figures(
        sample.family,
        sample.seed,
        sample.shapes,
        quality.cells,
        found.folded_cells,
        quality.repaired_cells / max(1, quality.cells),
        quality.bay_cells / max(1, quality.cells),
        quality.coverage,
        quality.min_jacobian_ratio,
        quality.max_residual_m / sample.cell_m,
        seconds,
        "; ".join(broken),
    )


def world(number: int) -> Figures:
    """World `number` of the suite; the last ones have a thousand obstacles."""
    thousand = number >= WORLDS
    name, seed = ("thousand", number - WORLDS) if thousand else (list(FAMILIES)[number % len(FAMILIES)], number)
    try:
        sample = thousand_obstacles(seed) if thousand else sample_world(seed)
        return measured(sample, all_laws=number % FULL_LAWS_EVERY == 0)
    except Exception as error:  # noqa: BLE001 - whatever stops a world is a finding of the suite, not its end
        return Figures(name, seed, 0, 0, 0, 0, 0, 0, 0, 0, 0, f"{type(error).__name__}: {error}".splitlines()[0])


def table(rows: Iterable[Figures]) -> str:
    head = f"{'family':12} {'seed':>5} {'shapes':>6} {'cells':>7} {'folds':>5} {'repaired':>8} {'bays':>6} {'coverage':>8} "
    head += f"{'sine':>8} {'residual':>8} {'s':>6}"
    lines = [
        f"{f.family:12} {f.seed:5d} {f.shapes:6d} {f.cells:7d} {f.folded:5d} {f.repaired:8.3f} {f.in_bays:6.3f} "
        f"{f.coverage:8.5f} {f.least_sine:8.1e} {f.residual:8.1e} {f.seconds:6.2f} {f.broken}"
        for f in rows
    ]
    return "\n".join([head, *lines])


def of_families(all_figures: list[Figures]) -> str:
    """The worst of each family in every column, slowest family first."""
    families = {name: [f for f in all_figures if f.family == name] for name in {f.family for f in all_figures}}
    worst = [
        Figures(
            f"{name} {len(own)}",
            max(own, key=lambda f: f.seconds).seed,
            max(f.shapes for f in own),
            max(f.cells for f in own),
            sum(f.folded for f in own),
            max(f.repaired for f in own),
            max(f.in_bays for f in own),
            min(f.coverage for f in own),
            min(f.least_sine for f in own),
            max(f.residual for f in own),
            max(f.seconds for f in own),
            f"{sum(bool(f.broken) for f in own)} broken" if any(f.broken for f in own) else "",
        )
        for name, own in families.items()
    ]
    return table(sorted(worst, key=lambda f: -f.seconds))


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_a_thousand_worlds_keep_the_laws(capsys: pytest.CaptureFixture[str]) -> None:
    begin = time.perf_counter()
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        figures = list(pool.map(world, range(WORLDS + CROWDED_WORLDS), chunksize=8))
    broken = [f for f in figures if f.broken]
    cells = sum(f.cells for f in figures)
    with capsys.disabled():
        print(f"\n{len(figures)} worlds, {cells:,} cells, {time.perf_counter() - begin:.0f} s; {len(broken)} broken")
        print(f"repaired {sum(f.repaired * f.cells for f in figures) / cells:.3f} of the cells, ", end="")
        print(f"{sum(f.seconds > 3 for f in figures)} worlds took more than 3 s")
        for title, rows in (
            ("broken", broken),
            ("worst of each family", None),
            ("slowest", sorted(figures, key=lambda f: -f.seconds)[:8]),
            ("least sine", sorted(figures, key=lambda f: f.least_sine)[:8]),
            ("least coverage", sorted(figures, key=lambda f: f.coverage)[:8]),
            ("most repaired", sorted(figures, key=lambda f: -f.repaired)[:8]),
        ):
            print(f"\n{title}\n{of_families(figures) if rows is None else table(rows)}")
    assert not broken, table(broken)
