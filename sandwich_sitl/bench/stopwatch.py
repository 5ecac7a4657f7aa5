"""Where the time of a loop goes: parts of a tick, wall clock and processor time of the thread, each instant counted once.

State: the part under way, with those it was called from. Input: methods that are replaced by timed ones. A part's time
leaves out the parts called within it, so the parts of a tick add up to the tick. Reading both clocks costs about 0.7 us
a change of part, which is in the figures.
"""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter, thread_time
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

REST = "rest of the loop"


@dataclass(frozen=True)
class Parts:
    """Seconds of every tick: `wall_s[part]` and `cpu_s[part]` (K,)."""

    wall_s: Mapping[str, NDArray[np.float64]]
    cpu_s: Mapping[str, NDArray[np.float64]]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """For a file: names (P,), and both clocks' seconds (P, K)."""
        names = list(self.wall_s)
        wall_s, cpu_s = (np.array([clock[name] for name in names]) for clock in (self.wall_s, self.cpu_s))
        return {"names": np.array(names), "wall_s": wall_s, "cpu_s": cpu_s}

    @classmethod
    def load(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """The inverse of `arrays`."""
        names = arrays["names"].tolist()
        return cls(dict(zip(names, arrays["wall_s"], strict=True)), dict(zip(names, arrays["cpu_s"], strict=True)))


class Stopwatch:
    """Times the thread that first calls it."""

    def __init__(self) -> None:
        self._stack = [REST]
        self._wall_s: dict[str, float] = {REST: 0.0}
        self._cpu_s: dict[str, float] = {REST: 0.0}
        self._ticks: list[tuple[dict[str, float], dict[str, float]]] = []
        self._since_s = (perf_counter(), thread_time())

    def around(self, owner: Any, method: str, part: str, ends_tick: bool = False) -> None:
        """Count `owner.method` (a class's or an object's) as `part`; a tick is over when one that `ends_tick` returns."""
        self._wall_s[part] = self._cpu_s[part] = 0.0
        original: Callable[..., Any] = getattr(owner, method)
        stack = self._stack

        @functools.wraps(original)
        def timed(*arguments: Any, **named: Any) -> Any:
            self._charge()
            stack.append(part)
            try:
                return original(*arguments, **named)
            finally:
                self._charge()
                stack.pop()
                if ends_tick:
                    self._end_tick()

        setattr(owner, method, timed)

    def parts(self) -> Parts:
        """All ticks so far, but for the first, which begins before the loop does."""
        wall, cpu = ([tick[k] for tick in self._ticks[1:]] for k in range(2))
        return Parts(
            {part: np.array([tick[part] for tick in wall]) for part in self._wall_s},
            {part: np.array([tick[part] for tick in cpu]) for part in self._cpu_s},
        )

    def _charge(self) -> None:
        wall_s, cpu_s = perf_counter(), thread_time()
        part = self._stack[-1]
        self._wall_s[part] += wall_s - self._since_s[0]
        self._cpu_s[part] += cpu_s - self._since_s[1]
        self._since_s = (wall_s, cpu_s)

    def _end_tick(self) -> None:
        self._ticks.append((self._wall_s.copy(), self._cpu_s.copy()))
        for part in self._wall_s:
            self._wall_s[part] = self._cpu_s[part] = 0.0
