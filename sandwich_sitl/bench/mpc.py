"""Solvers of the tracking problem side by side on recorded ticks: time, accuracy, violations.

Time is that of one call of the port, which is update and solve: what it takes from a tick's numbers to its answer.
Accuracy is against the own exact solver and, where it is installed, Clarabel at 1e-11, whichever has the lower cost:
du0 is the error of the first command relative to its size (1 m/s^4 at least), `outside` how much further than the
reference answer a plan leaves its regions.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.bench.ticks import TickSequence
from sandwich_sitl.control.horizon import FAILED, Horizon, HorizonAnswer, HorizonSolver, HorizonTick, MotionLimits
from sandwich_sitl.control.solvers.registry import NAMES, bare_solver
from sandwich_sitl.errors import InputError

Array = NDArray[np.float64]

_FACES = 8
_WARM_UP = 3


@dataclass(frozen=True)
class Case:
    """One horizon on one sequence."""

    sequence: TickSequence
    n_tau: int
    step_s: float
    bandwidth_radps: float
    limits: MotionLimits


@dataclass(frozen=True)
class Score:
    """One solver on one case; times in microseconds of CPU, errors as the module says, `failed` of `ticks`."""

    case: str
    n_tau: int
    solver: str
    ticks: int
    failed: int
    median_us: float
    p99_us: float
    p999_us: float
    du0_median: float
    du0_p99: float
    outside_m: float
    iterations: float


def installed() -> tuple[str, ...]:
    """Names of the solvers whose packages are there."""
    tiny = Horizon(4, 0.1, "zoh", 4.0, 1, 2, MotionLimits())
    names = []
    for name in NAMES:
        try:
            bare_solver(name, tiny)
        except InputError:
            continue
        names.append(name)
    return tuple(names)


def run_case(case: Case, names: Sequence[str], on_solver: Callable[[str], None]) -> list[Score]:
    """Each named solver through the sequence, warm from tick to tick as it would fly."""
    ticks = list(case.sequence.problems(case.n_tau, case.step_s))
    horizon = Horizon(case.n_tau, case.step_s, "zoh", case.bandwidth_radps, 2, _FACES, case.limits)
    on_solver("reference")
    best = references(horizon, ticks)
    scores = []
    for name in names:
        on_solver(name)
        scores.append(_score(case, name, horizon, ticks, best))
    return scores


def references(horizon: Horizon, ticks: Iterable[HorizonTick]) -> list[HorizonAnswer]:
    """The best answer known of each tick; a tick without one has status `FAILED`."""
    exact = bare_solver("active_set", horizon)
    second = _precise(horizon) if "clarabel" in installed() else None
    best = []
    for tick in ticks:
        answer = exact.solve(tick)
        if second is not None and answer.status != FAILED:
            other = second.solve(tick)
            if other.status != FAILED and horizon.cost(other.snap, tick) < horizon.cost(answer.snap, tick) - 1e-9:
                answer = other
        best.append(answer)
    return best


def _precise(horizon: Horizon) -> HorizonSolver:
    from sandwich_sitl.control.solvers.clarabel_sparse import ClarabelSolver

    return ClarabelSolver(horizon, 1e-11)


def _score(
    case: Case, name: str, horizon: Horizon, ticks: Sequence[HorizonTick], best: Sequence[HorizonAnswer]
) -> Score:
    solver = bare_solver(name, horizon)
    for tick in ticks[:_WARM_UP]:
        solver.solve(tick)
    spent, du0, outside, iterations, failed = [], [], [], [], 0
    for tick, reference in zip(ticks, best, strict=True):
        began = time.thread_time_ns()
        answer = solver.solve(tick)
        spent.append((time.thread_time_ns() - began) / 1e3)
        iterations.append(answer.iterations)
        if answer.status == FAILED:
            failed += 1
        elif reference.status != FAILED:
            wanted = reference.snap[0]
            du0.append(float(np.linalg.norm(answer.snap[0] - wanted)) / max(1.0, float(np.linalg.norm(wanted))))
            outside.append(float((answer.slack_m - reference.slack_m).max()))
    median, p99, p999 = np.percentile(spent, (50, 99, 99.9))
    errors = np.percentile(du0, (50, 99)) if du0 else (np.nan, np.nan)
    return Score(
        case.sequence.name, case.n_tau, name, len(ticks), failed, float(median), float(p99), float(p999),
        float(errors[0]), float(errors[1]), max(outside, default=float("nan")), float(np.mean(iterations)),
    )  # fmt: skip


def table(scores: Sequence[Score], yardstick: str) -> str:
    """Scores as aligned text, times also as ratios to `yardstick` in the same case where it ran."""
    by_case = {(s.case, s.n_tau): s for s in scores if s.solver == yardstick}
    lines = [
        f"{'sequence':28s} {'n':>3s} {'solver':10s} {'median us':>9s} {'p99':>8s} {'p99.9':>8s} "
        f"{'/ ' + yardstick:>13s} {'du0 median':>11s} {'p99':>8s} {'outside mm':>10s} {'iter':>6s} {'failed':>8s}"
    ]
    for s in scores:
        base = by_case.get((s.case, s.n_tau))
        ratio = f"{s.median_us / base.median_us:.2f} / {s.p99_us / base.p99_us:.2f}" if base else "-"
        lines.append(
            f"{s.case:28s} {s.n_tau:3d} {s.solver:10s} {s.median_us:9.0f} {s.p99_us:8.0f} {s.p999_us:8.0f} "
            f"{ratio:>13s} {s.du0_median:11.1e} {s.du0_p99:8.1e} {1e3 * s.outside_m:10.2f} {s.iterations:6.1f} "
            f"{s.failed:4d}/{s.ticks}"
        )
    return "\n".join(lines)
