"""The garbage collector does not run between the first and the last tick of a flight, and there is nothing for it to do."""

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sandwich_sitl.control.solvers.registry import solver_for_flight

from .conftest import Process
from .test_loop_assurance import Watch, flown


class CollectingAtTheEnd(Watch):
    """Counts what is unreachable once the last set-point is out, while the loop's objects are still there."""

    found = -1

    def __call__(self, now_s: float, state: str, text: str) -> None:
        super().__call__(now_s, state, text)
        if state == "DONE":
            self.found = gc.collect()


@contextmanager
def collections_at() -> Iterator[list[float]]:
    """When collections began, `time.monotonic()`."""
    at_s: list[float] = []

    def note(phase: str, info: dict[str, Any]) -> None:
        del info
        if phase == "start":
            at_s.append(time.monotonic())

    gc.callbacks.append(note)
    try:
        yield at_s
    finally:
        gc.callbacks.remove(note)


def test_a_flight_is_not_held_up_by_the_collector_and_does_not_need_it(
    start: Callable[..., Process], short_config: Path, tmp_path: Path
) -> None:
    watch = CollectingAtTheEnd()
    with collections_at() as at_s:
        log, result, _ = flown(start, short_config, tmp_path, solver_for_flight, watch)
    assert result.outcome.outcome == "landed"
    assert len(log.timings.sent_s) > 1000
    first_s, last_s = log.timings.sent_s[[0, -1]].tolist()
    assert min(at_s) < first_s < last_s < max(at_s)  # collections are seen, and on the clock of the set-points
    assert not [t_s for t_s in at_s if first_s < t_s < last_s]
    assert gc.isenabled()
    assert 0 <= watch.found < 20  # not one a tick, nor one a second
