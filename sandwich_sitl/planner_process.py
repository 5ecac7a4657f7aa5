"""Who plans while the vehicle flies: `PlannerProcess` beside the loop in real time, `InlinePlanner` in lockstep.

Both keep what is known of the ground, learn each question's obstacles for good, and answer with `replan`. In real time
planning takes several ticks, and Python's lock would let a thread of planning hold up the loop; so it runs in a process
of its own, which is started and has planned once before there is a flight. In lockstep the vehicle's clock stands still
meanwhile: the answer is computed when it is collected, at a fixed simulation time, so that equal seeds give equal bytes.
"""

import dataclasses
import multiprocessing
import signal
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Protocol, Self

import numpy as np
import shapely

from sandwich_sitl.config import RunConfig
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.plan import plan_flight
from sandwich_sitl.planning.replan import Known, Question, Replan, Verdict, learnt, replan
from sandwich_sitl.world.world import Obstacle, World

_START_S = 60.0
_STOP_S = 5.0
_THING_M = 0.3
_REHEARSED_M = (4.0, 12.0)  # ahead
_FAST_MPS = 12.0


@dataclass(frozen=True)
class Answer:
    """A plan, and the wall and processor time that it took."""

    replan: Replan
    wall_s: float
    cpu_s: float


class Planner(Protocol):
    """Answers the newest question."""

    def ask(self, question: Question) -> None:
        """Begin to plan; a question under way is of no interest any more."""

    def answer(self) -> Answer | None:
        """The answer to the newest question, or None while there is none yet."""

    def close(self) -> None:
        """End."""


class InlinePlanner:
    """Plans when it is asked for the answer. `keeps`: obstacles of one question are known in the next."""

    def __init__(self, config: RunConfig, plan: FlightPlan, *, keeps: bool = True) -> None:
        self._config, self._plan, self._keeps = config, plan, keeps
        self._known: Known | None = None
        self._question: Question | None = None

    def ask(self, question: Question) -> None:
        """Keep the question; what one that was never answered told is told again."""
        if self._question is not None and self._keeps:
            question = dataclasses.replace(question, obstacles=(*self._question.obstacles, *question.obstacles))
        self._question = question

    def answer(self) -> Answer | None:
        """Plan now."""
        if self._question is None:
            return None
        question, self._question = self._question, None
        begun, begun_cpu = time.perf_counter(), time.process_time()
        before = Known.of(self._plan) if self._known is None else self._known
        known = learnt(self._config, before, question.obstacles)
        self._known = known if self._keeps else before
        found = replan(self._config, known, question)
        return Answer(found, time.perf_counter() - begun, time.process_time() - begun_cpu)

    def close(self) -> None:
        """Nothing to end."""


class PlannerProcess:
    """An `InlinePlanner` in a process of its own; context manager. Creating one waits until it is ready, at most
    `_START_S`.
    """

    def __init__(self, config: RunConfig, plan: FlightPlan, *, keeps: bool = True) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, config, plan, keeps), daemon=True)
        self._process.start()
        theirs.close()
        self._asked: Question | None = None
        self._overtaken = 0  # questions under way whose answers nobody wants
        self._ready = self._connection.poll(_START_S) and self._received() == "ready"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def ask(self, question: Question) -> None:
        """Send the question."""
        self._overtaken += self._asked is not None
        self._asked = question
        if self._ready:
            try:
                self._connection.send(question)
            except OSError:
                self._ready = False

    def answer(self) -> Answer | None:
        """What the process has answered; a process that is gone has no plan."""
        if self._asked is None:
            return None
        while self._ready and self._connection.poll() and self._overtaken:
            self._overtaken -= 1
            self._received()
        if self._ready and not self._connection.poll():
            return None
        question, found = self._asked, self._received() if self._ready else None
        self._asked = None
        if isinstance(found, Answer):
            return found
        self._ready = False
        gone = Replan(Verdict.NONE, question.reference, question.corridor, np.empty((0, 2)), "the planner has ended")
        return Answer(gone, 0.0, 0.0)

    def close(self) -> None:
        """End the process; a second call does nothing."""
        self._connection.close()
        self._process.join(_STOP_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(_STOP_S)

    def _received(self) -> object:
        try:
            received: object = self._connection.recv()
        except (EOFError, OSError):
            return None
        return received


def _serve(connection: Connection, config: RunConfig, plan: FlightPlan, keeps: bool) -> None:
    """The process: plan once for practice, then answer until the other side closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the mission's
    planner = InlinePlanner(config, plan, keeps=keeps)
    rehearse(config, plan)
    connection.send("ready")
    while True:
        try:
            question = connection.recv()
        except EOFError:
            return
        planner.ask(question)
        connection.send(planner.answer())


def rehearse(config: RunConfig, plan: FlightPlan) -> None:
    """Plan round things near and far on the route and, fast, in an open field, where a plan wishes for more berth than it
    gets: what is compiled or loaded at first use is then at hand.
    """
    planner = dataclasses.replace(config.planner, cell_m=1.0, flow="x", floors_m=(), speed_mps=_FAST_MPS)
    field = dataclasses.replace(config, start_m=(5.0, 15.0), goal_m=(75.0, 15.0), planner=planner, mode="timed")
    shed = Obstacle("shed", shapely.box(20.0, 2.0, 24.0, 8.0))
    in_field = plan_flight(field, World((0.0, 0.0, 80.0, 30.0), (shed,)), lambda _: None)
    for practice, flight in ((field, in_field), (config, plan)):
        for ahead_m in _REHEARSED_M:
            _rehearse(practice, flight, ahead_m)


def _rehearse(config: RunConfig, plan: FlightPlan, ahead_m: float) -> None:
    reference = plan.reference
    k = len(reference.t_s) // 2
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(reference.xyz_m[k:, :2], axis=0).T))])
    x, y = reference.xyz_m[min(k + int(np.searchsorted(travelled, ahead_m)), len(reference.t_s) - 1), :2].tolist()
    thing = Obstacle("rehearsal", shapely.box(x - _THING_M, y - _THING_M, x + _THING_M, y + _THING_M))
    planner = InlinePlanner(config, plan)
    planner.ask(Question((thing,), reference, plan.corridor, float(reference.t_s[k])))
    planner.answer()
