"""The channel map measured: seconds, growth and memory of a whole build, against one sparse factorisation.

A whole build is from the classification of a grown world to a checked map. Its yardstick is `scipy.sparse.linalg.splu`
of the 5-point Laplacian on a square with as many unknowns as the map has nodes, in its symmetric mode with minimum
degree on A' + A, which is its faster way with this matrix. Both alternate in one process; the best of several counts,
since other work on the machine can only add.
"""

import resource
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import scipy.sparse as sparse
import shapely
from scipy.sparse.linalg import splu

from sandwich_sitl.bench.child import peak_memory_mib
from sandwich_sitl.bench.map_worlds import BenchWorld
from sandwich_sitl.channels import build
from sandwich_sitl.channels.check import examine
from sandwich_sitl.channels.map_file import load_map, save_map
from sandwich_sitl.channels.update import update_map

MIN_ROWS = 5
_LONG_S = 8.0  # no repetition of what takes longer
_WARM_UP_NODES = 2000  # compiles what is compiled at run time
_LOADS = 7
_POP_UPS = 9
_POP_UP_M = 3.0
_POP_UP_SEED = 1
_STAGES = {  # functions of other modules that `build` calls
    "close": "close_world",
    "mesh bays": "mesh_bay",
    "classify": "classify",
    "dividers": "lay_dividers",
    "stations": "lay_stations",
    "boundary nodes": "spread_nodes",
    "solve": "solve_elliptic",
    "unfold": "untangle",
    "stretches": "without_folds",
    "measure": "measure",
}


@dataclass(frozen=True)
class SizeFigures:
    """One size. `stages_s` are of the fastest build; solve, unfold and stretches run on two threads and count both."""

    nodes: int
    cells: int
    cell_m: float
    channels: int
    bays: int
    coverage: float
    failures: tuple[str, ...]
    build_s: float
    check_s: float
    stages_s: dict[str, float]
    peak_mib: float
    splu_s: float | None
    splu_problem: str

    @property
    def whole_s(self) -> float:
        """From classification to checked map."""
        return self.build_s + self.check_s

    @property
    def ratio(self) -> float | None:
        """Whole build over factorisation."""
        return None if self.splu_s is None else self.whole_s / self.splu_s


def measure_size(world: BenchWorld, nodes: int, repeats: int) -> SizeFigures:
    """Build, check and factorise at about `nodes` nodes, `repeats` times; memory is that of the build and check alone."""
    build.build_channel_map(world.grown, world.cell_m(_WARM_UP_NODES), MIN_ROWS)
    cell_m = world.cell_m(nodes)
    builds: list[tuple[float, dict[str, float]]] = []
    checks, factorisations = [], []
    peak_mib, problem = 0.0, ""
    for turn in range(repeats):
        with _timed_stages() as stages:
            began = time.perf_counter()
            channel_map = build.build_channel_map(world.grown, cell_m, MIN_ROWS)
            builds.append((time.perf_counter() - began, stages))
        began = time.perf_counter()
        found = examine(channel_map)
        checks.append(time.perf_counter() - began)
        peak_mib = peak_mib if turn else peak_memory_mib()
        if not problem:
            try:
                factorisations.append(factorise_s(channel_map.nodes))
            except MemoryError:
                problem = "does not fit in memory"
        if max(builds[-1][0], *factorisations[-1:], 0.0) > _LONG_S:
            break
    build_s, stages_s = min(builds, key=lambda timed: timed[0])
    return SizeFigures(
        nodes=channel_map.nodes,
        cells=channel_map.quality.cells,
        cell_m=cell_m,
        channels=channel_map.channels,
        bays=len(channel_map.bays),
        coverage=channel_map.quality.coverage,
        failures=found.failures,
        build_s=build_s,
        check_s=min(checks),
        stages_s=stages_s,
        peak_mib=peak_mib,
        splu_s=min(factorisations) if factorisations else None,
        splu_problem=problem,
    )


def factorise_s(unknowns: int) -> float:
    """Seconds of one factorisation. Raises `MemoryError` when it does not fit in what is available now."""
    side = max(2, round(float(np.sqrt(unknowns))))
    second: Any = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(side, side))
    unit = sparse.eye_array(side)
    laplacian: Any = (sparse.kron(second, unit) + sparse.kron(unit, second)).tocsc()
    with _memory_limit():
        began = time.perf_counter()
        splu(laplacian, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        return time.perf_counter() - began


def growth(figures: Sequence[SizeFigures]) -> float | None:
    """Exponent k of whole build ~ N^k: the slope of the logarithms, least squares; None for a single size."""
    if len({figure.nodes for figure in figures}) < 2:
        return None
    logs = np.log([[figure.nodes, figure.whole_s] for figure in figures])
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])


def measure_load(world: BenchWorld, nodes: int) -> tuple[int, float]:
    """Nodes of a saved map and the seconds that loading it takes, best of several."""
    channel_map = build.build_channel_map(world.grown, world.cell_m(nodes), MIN_ROWS)
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.npz"
        save_map(channel_map, path)
        for _ in range(_LOADS):
            began = time.perf_counter()
            load_map(path)
            seconds.append(time.perf_counter() - began)
    return channel_map.nodes, min(seconds)


@dataclass(frozen=True)
class UpdateFigures:
    """Pop-up obstacles put into one map, each alone: the median and the longest time, against a whole new build."""

    nodes: int
    channels: int
    obstacles: int
    median_s: float
    longest_s: float
    build_s: float
    failures: tuple[str, ...]


def measure_update(world: BenchWorld, nodes: int, repeats: int) -> UpdateFigures:
    """Obstacles `_POP_UP_M` across, grown, at random places of the free ground; every map that results is checked."""
    cell_m = world.cell_m(nodes)
    build_s = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        channel_map = build.build_channel_map(world.grown, cell_m, MIN_ROWS)
        build_s.append(time.perf_counter() - began)
    rng = np.random.default_rng(_POP_UP_SEED)
    ground = world.free_ground().buffer(-_POP_UP_M)
    x_min, y_min, x_max, y_max = world.grown.bounds_m
    seconds: list[float] = []
    failures: list[str] = []
    while len(seconds) < _POP_UPS:
        x, y = rng.uniform((x_min, y_min), (x_max, y_max))
        if not shapely.contains_xy(ground, x, y):
            continue
        obstacle = shapely.Point(x, y).buffer(_POP_UP_M / 2, quad_segs=4)
        times = []
        for _ in range(repeats):
            began = time.perf_counter()
            updated = update_map(channel_map, obstacle, "pop-up", cell_m)
            times.append(time.perf_counter() - began)
        seconds.append(min(times))
        failures += [f"pop-up at ({x:.3f}, {y:.3f}): {failure}" for failure in examine(updated).failures]
    return UpdateFigures(
        channel_map.nodes,
        channel_map.channels,
        _POP_UPS,
        float(np.median(seconds)),
        max(seconds),
        min(build_s),
        tuple(failures),
    )


@contextmanager
def _timed_stages() -> Iterator[dict[str, float]]:
    """Seconds spent in each stage of the builds done meanwhile."""
    seconds = dict.fromkeys(_STAGES, 0.0)
    with ExitStack() as stack:
        for stage, name in _STAGES.items():
            stack.enter_context(patch.object(build, name, _timed(getattr(build, name), stage, seconds)))
        yield seconds


def _timed(function: Any, stage: str, seconds: dict[str, float]) -> Any:
    def timed(*arguments: Any) -> Any:
        began = time.perf_counter()
        result = function(*arguments)
        seconds[stage] += time.perf_counter() - began
        return result

    return timed


@contextmanager
def _memory_limit() -> Iterator[None]:
    """No more address space than is available: an allocation too many fails instead of ending the process."""
    sizes = Path("/proc/self/statm").read_text(encoding="ascii").split()
    lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    available = next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")) * 1024
    before = resource.getrlimit(resource.RLIMIT_AS)
    limit = int(sizes[0]) * resource.getpagesize() + int(0.9 * available)
    resource.setrlimit(resource.RLIMIT_AS, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
