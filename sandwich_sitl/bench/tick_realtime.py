"""Whether a flight in real time keeps the deadlines that a bare ticker beside it keeps.

The ticker is a process that waits as the loop does and does nothing. Both have the same deadlines: a set-point, or the
ticker's waking, has missed its own when its period is over. A host that takes the processor away makes both miss, so
they are compared in time: the flight is cut into windows of 1 s on the clock that processes of one machine share
(`time.monotonic()`), and a miss is the flight's alone when the ticker met every deadline in that window and in the two
beside it; the other way round likewise. With less than two idle cores a processor that is taken from one of the two
shows as that one's alone too, so `flight alone` is an upper bound on what the flight itself is to blame for.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.bench.tick import configured, fly
from sandwich_sitl.link.pacing import SPIN_S
from sandwich_sitl.recording.reader import RunLog

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

WINDOW_S = 1.0
_LONGEST_S = 600.0


@dataclass(frozen=True)
class Misses:
    """Ticks in the order of time: when each was done, `time.monotonic()` (K,), and by how much its period was over then
    (K,), both in seconds.
    """

    at_s: Array
    late_s: Array

    def per_window_s(self, edges_s: Array) -> Array:
        """The worst lateness (W,) in windows between edges (W + 1,); 0 where no deadline was missed."""
        worst_s = np.zeros(len(edges_s) - 1)
        window = np.searchsorted(edges_s, self.at_s, side="right") - 1
        inside = (window >= 0) & (window < len(worst_s))
        np.maximum.at(worst_s, window[inside], self.late_s[inside])
        return worst_s


@dataclass(frozen=True)
class Beside:
    """Windows of the flight in which deadlines were missed: by both, by the ticker alone and by the flight alone, and the
    worst lateness in milliseconds: of the flight and of the ticker where both were late, and of either alone.
    """

    windows: int
    both: int
    ticker_alone: int
    flight_alone: int
    both_ms: tuple[float, float]
    ticker_ms: float
    flight_ms: float

    @classmethod
    def of(cls, flight: Misses, ticker: Misses) -> "Beside":
        """Compare; the windows begin with the flight's first set-point and hold its last."""
        count = int((flight.at_s[-1] - flight.at_s[0]) / WINDOW_S) + 1
        edges_s = flight.at_s[0] + WINDOW_S * np.arange(-1, count + 2)  # and one window on either side
        own_s, bare_s = flight.per_window_s(edges_s), ticker.per_window_s(edges_s)
        own, bare = own_s > 0.0, bare_s > 0.0
        flight_alone, ticker_alone = own & ~_near(bare), bare & ~_near(own)
        flown = np.zeros_like(own)
        flown[1:-1] = True
        both = (own & _near(bare)) | (bare & _near(own))
        both, flight_alone, ticker_alone = both & flown, flight_alone & flown, ticker_alone & flown
        return cls(
            count, int(both.sum()), int(ticker_alone.sum()), int(flight_alone.sum()),
            (_worst_ms(own_s, both), _worst_ms(bare_s, both)), _worst_ms(bare_s, ticker_alone), _worst_ms(own_s, flight_alone),
        )  # fmt: skip


@dataclass(frozen=True)
class Deadlines:
    """A real-time flight and the bare ticker beside it: ticks and missed deadlines of each, and windows of both."""

    rate_hz: float
    outcome: str
    ticks: int
    missed: int
    bare_ticks: int
    bare_missed: int
    beside: Beside

    def line(self) -> str:
        """One line of text."""
        side = self.beside
        return (
            f"{self.rate_hz:4.0f} Hz, {self.outcome}: {self.missed} of {self.ticks} set-points after their period, bare "
            f"ticker {self.bare_missed} of {self.bare_ticks}; of {side.windows} windows of {WINDOW_S:g} s with a miss: "
            f"both {side.both} (worst {side.both_ms[0]:.1f} / {side.both_ms[1]:.1f} ms), "
            f"ticker alone {side.ticker_alone} ({side.ticker_ms:.1f} ms), "
            f"flight alone {side.flight_alone} ({side.flight_ms:.1f} ms)"
        )


def deadlines(config_path: Path, overrides: Mapping[str, Any], work: Path, rate_hz: float) -> Deadlines:
    """One flight in real time at `rate_hz`, with a bare ticker in a process of its own."""
    realtime = {"clock.mode": "realtime", "clock.speed": 1.0, "mpc.rate_hz": rate_hz}
    config = configured(config_path, {**overrides, **realtime})
    context = get_context("spawn")
    here, there = context.Pipe(duplex=False)
    stop = context.Event()
    ticker = context.Process(target=_tick_bare, args=(there, stop, 1.0 / rate_hz), daemon=True)
    ticker.start()
    there.close()
    try:
        here.recv()  # it has started
        summary = fly(config, config_path, work)
        stop.set()
        bare = Misses(*np.asarray(here.recv()).T)
    finally:
        ticker.kill()
        ticker.join()
    timings = RunLog.read(work / "run.mcap").timings
    flown = Misses(timings.sent_s, timings.late_s)
    during = (bare.at_s >= flown.at_s[0]) & (bare.at_s <= flown.at_s[-1])
    return Deadlines(
        rate_hz, summary["outcome"], flown.at_s.size, int(np.count_nonzero(flown.late_s)),
        int(during.sum()), int(np.count_nonzero(bare.late_s[during])), Beside.of(flown, bare),
    )  # fmt: skip


def _near(missed: Flags) -> Flags:
    """Windows with a miss in them or in one beside them."""
    near = missed.copy()
    near[1:] |= missed[:-1]
    near[:-1] |= missed[1:]
    return near


def _worst_ms(late_s: Array, chosen: Flags) -> float:
    return 1e3 * float(late_s[chosen].max(initial=0.0))


def _tick_bare(there: Any, stop: Event, period_s: float) -> None:
    """Time and lateness of each tick of a loop that waits as `RealtimePacer` does and does nothing."""
    there.send("started")
    ticks: list[tuple[float, float]] = []
    deadline = time.monotonic() + period_s
    while not stop.is_set() and len(ticks) * period_s < _LONGEST_S:
        time.sleep(max(0.0, deadline - SPIN_S - time.monotonic()))
        while (now := time.monotonic()) < deadline:
            pass
        ticks.append((now, max(0.0, now - deadline - period_s)))
        deadline = (now if now - deadline > period_s else deadline) + period_s
    there.send(ticks)
