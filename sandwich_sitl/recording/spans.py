"""Times of a flight by the state of its mission."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.recording.reader import RunLog

Array = NDArray[np.float64]
Span = tuple[float, float]


def spans(log: RunLog, holds: Sequence[bool]) -> list[Span]:
    """Intervals [from, to) of the mission track in which `holds` is true; the last row holds to the end of the log."""
    ends = [*log.mission.t_s[1:].tolist(), np.nextafter(log.span_s[1], np.inf)]
    rows = zip(holds, log.mission.t_s.tolist(), ends, strict=False)
    found = []
    for on, group in itertools.groupby(rows, key=lambda row: row[0]):
        members = list(group)
        if on:
            found.append((members[0][1], members[-1][2]))
    return found


def state_spans(log: RunLog, state: str) -> list[Span]:
    """Intervals [from, to) in which the mission was in a state."""
    return spans(log, [name == state for name in log.mission.state])


def within(t_s: Array, intervals: Sequence[Span]) -> NDArray[np.bool_]:
    """Which times (N,) lie in one of the intervals."""
    inside = np.zeros(t_s.shape, dtype=np.bool_)
    for start, end in intervals:
        inside |= (t_s >= start) & (t_s < end)
    return inside
