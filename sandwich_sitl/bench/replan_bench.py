"""How long a new plan takes in flight, and what planning does to the loop beside it.

A case: somewhere on a planned flight through a random town a box appears 3 to 30 m ahead. Timed is what a flight waits
for: the question sent to the planner's process, the answer received. A set-point of the new plan then goes out with the
next tick, `TICK_S` later at most.

Lateness: a loop of 50 Hz that works 1 ms a tick, alone, with a planner's process busy beside it, and with a thread of
the same process planning instead.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import rotate

from sandwich_sitl.bench.plan_worlds import questions, random_town
from sandwich_sitl.channels.build import build_channel_map
from sandwich_sitl.config import PlannerConfig, RunConfig, WorldConfig
from sandwich_sitl.mission.rerouting import FIRST_REACH_M
from sandwich_sitl.planner_process import Answer, InlinePlanner, Planner, PlannerProcess
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.map_graph import build_map_graph
from sandwich_sitl.planning.plan import plan_flight
from sandwich_sitl.planning.replan import Question
from sandwich_sitl.world.grow import GrownWorld, grow
from sandwich_sitl.world.world import Obstacle, World

Array = NDArray[np.float64]

TICK_S = 0.02
_WORK_S = 0.001
_POLL_S = 0.0005
_LOOKS = 30  # questions of which the longest way is flown
_DETAIL_M = 0.09


@dataclass(frozen=True)
class ReplanFigures:
    """Milliseconds (n,) from question to answer and of the planner's processor; how many of each verdict."""

    world: str
    nodes: int
    answer_ms: list[float]
    cpu_ms: list[float]
    verdicts: dict[str, int]


@dataclass(frozen=True)
class Lateness:
    """Milliseconds by which ticks began late: median, 99th percentile, most; by who planned meanwhile."""

    beside: str
    p50_ms: float
    p99_ms: float
    most_ms: float


def flight_through(seed: int, nodes: int) -> tuple[RunConfig, FlightPlan]:
    """A flight across the random town of a seed, on a map of about so many nodes."""
    world = random_town(seed)
    planner = PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6)
    grown = grow(world, planner.vehicle_radius_m + planner.margin_m, _DETAIL_M)
    start, goal = _far_apart(grown, seed)
    cell_m = float(np.sqrt(grown.free_area_m2 / nodes))
    config = RunConfig(
        world=WorldConfig(bounds_m=world.bounds_m),
        start_m=start,
        goal_m=goal,
        altitude_m=10,
        planner=PlannerConfig(vehicle_radius_m=0.4, margin_m=0.6, cell_m=cell_m, flow="x"),
    )
    return config, plan_flight(config, World(world.bounds_m, world.obstacles), lambda _: None)


def _far_apart(grown: GrownWorld, seed: int) -> tuple[tuple[float, float], tuple[float, float]]:
    coarse = build_channel_map(grown, 2.0, 5, "x")
    pairs = questions(grown, build_map_graph(coarse), _LOOKS, seed)
    start, goal = max(pairs, key=lambda pair: float(np.hypot(*(pair[1] - pair[0]))))
    return (float(start[0]), float(start[1])), (float(goal[0]), float(goal[1]))


def pop_ups(plan: FlightPlan, seed: int) -> Iterator[Question]:
    """Boxes of 1 to 6 m that appear ahead of a vehicle in level flight, turned at will."""
    rng = np.random.default_rng(seed)
    reference = plan.reference
    level = np.flatnonzero(reference.xyz_m[:, 2] >= plan.altitude_m - 1e-6)
    while True:
        k = int(rng.choice(level[:-100]))
        travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(reference.xyz_m[k:, :2], axis=0).T))])
        ahead = k + int(np.searchsorted(travelled, rng.uniform(3.0, 30.0)))
        middle = reference.xyz_m[min(ahead, len(reference.t_s) - 1), :2]
        low, high = middle - rng.uniform(0.5, 3.0, 2), middle + rng.uniform(0.5, 3.0, 2)
        body = rotate(shapely.box(*low, *high), float(rng.uniform(0, 90)))
        if (
            body.distance(shapely.Point(reference.xyz_m[k, :2])) > 1.0
            and body.distance(shapely.Point(plan.goal_m)) > 1.5
        ):
            new = (Obstacle("pop-up", body),)
            yield Question(new, reference, plan.corridor, float(reference.t_s[k]), FIRST_REACH_M)


def measure(seed: int, nodes: int, cases: int, say: Callable[[str], None]) -> ReplanFigures:
    """Ask a planner's process about each case, each on the map as it was before take-off."""
    say(f"plan through random town {seed}")
    config, plan = flight_through(seed, nodes)
    answers: list[float] = []
    found: list[Answer] = []
    say(f"{cases} pop-ups at {plan.channel_map.nodes} nodes")
    with PlannerProcess(config, plan, keeps=False) as planner:
        for question, _ in zip(pop_ups(plan, seed), range(cases), strict=False):
            begun = time.perf_counter()
            planner.ask(question)
            found.append(_awaited(planner))
            answers.append(1e3 * (time.perf_counter() - begun))
    verdicts = Counter(str(answer.replan.verdict) for answer in found)
    return ReplanFigures(
        f"random {seed}", plan.channel_map.nodes, answers, [1e3 * answer.cpu_s for answer in found], dict(verdicts)
    )


def _awaited(planner: Planner) -> Answer:
    while (answer := planner.answer()) is None:
        time.sleep(_POLL_S)
    return answer


def lateness(seed: int, nodes: int, seconds: float) -> list[Lateness]:
    """The loop's lateness with nobody, a process and a thread planning without pause."""
    config, plan = flight_through(seed, nodes)
    rows = [_ticks("nobody", seconds)]
    with PlannerProcess(config, plan, keeps=False) as planner:
        rows.append(_busy("a process", planner, plan, seed, seconds))
    rows.append(_busy("a thread", InlinePlanner(config, plan, keeps=False), plan, seed, seconds))
    return rows


def _busy(name: str, planner: Planner, plan: FlightPlan, seed: int, seconds: float) -> Lateness:
    """Lateness while a thread keeps a planner busy; with a process the thread only waits."""
    stop = threading.Event()

    def keep_asking() -> None:
        for question in pop_ups(plan, seed):
            if stop.is_set():
                return
            planner.ask(question)
            _awaited(planner)

    thread = threading.Thread(target=keep_asking)
    thread.start()
    try:
        return _ticks(name, seconds)
    finally:
        stop.set()
        thread.join()


def _ticks(name: str, seconds: float) -> Lateness:
    late_s, deadline = [], time.monotonic()
    for _ in range(round(seconds / TICK_S)):
        deadline += TICK_S
        time.sleep(max(0.0, deadline - time.monotonic()))
        late_s.append(time.monotonic() - deadline)
        until = time.monotonic() + _WORK_S
        while time.monotonic() < until:
            pass
    p50, p99, most = 1e3 * np.percentile(late_s, (50, 99, 100))
    return Lateness(name, float(p50), float(p99), float(most))


def table(rows: list[ReplanFigures], late: list[Lateness], budget_s: float) -> str:
    """What was measured, for a terminal."""
    lines = ["question to answer, ms                     p50      p99      max   of that CPU p50 / max   in time"]
    for row in rows:
        wall, cpu = np.array(row.answer_ms), np.array(row.cpu_ms)
        p50, p99, most = np.percentile(wall, (50, 99, 100))
        in_time = 100 * np.mean(wall + 1e3 * TICK_S <= 1e3 * budget_s)
        verdicts = ", ".join(f"{count} {name}" for name, count in sorted(row.verdicts.items()))
        lines.append(
            f"{row.world:10s} {row.nodes:7d} nodes, {len(wall):4d} cases {p50:7.1f}  {p99:7.1f}  {most:7.1f}"
            f"   {np.median(cpu):8.1f} / {cpu.max():6.1f}   {in_time:7.1f} %   ({verdicts})"
        )
    lines.append(f"in time: a tick of {1e3 * TICK_S:g} ms later it is still within {1e3 * budget_s:g} ms")
    if late:
        lines += ["", "ticks of 20 ms late by, ms    p50      p99      max"]
        lines += [f"beside {row.beside:16s} {row.p50_ms:9.2f} {row.p99_ms:8.2f} {row.most_ms:8.2f}" for row in late]
    return "\n".join(lines)
