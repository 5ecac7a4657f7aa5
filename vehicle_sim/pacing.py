"""The vehicle's clock in real time: an absolute schedule of batches, how late they were, pause and single step.

simulation time = wall time x speed. Lateness never adds up: the next deadline counts from the last deadline, unless that is more than
0.1 s ago; then the schedule begins anew and that is counted.
"""

from dataclasses import dataclass, field

_LATE_S = 0.1
_BATCH_US = 10_000
_MIN_WALL_BATCH_S = 0.002
_KEPT = 200_000


@dataclass
class Control:
    """Set by signals: while paused no time passes, but for the steps that are asked for."""

    paused: bool = False
    steps: int = 0


@dataclass
class Schedule:
    """Deadlines of one vehicle. `batch_us` of simulation time pass at each."""

    speed: float
    step_us: int
    deadline_s: float = 0.0
    resynchronised: int = 0
    lateness_s: list[float] = field(default_factory=list)
    batch_us: int = field(init=False)

    def __post_init__(self) -> None:
        wanted = max(_BATCH_US, round(_MIN_WALL_BATCH_S * self.speed * 1e6))
        self.batch_us = max(self.step_us, wanted // self.step_us * self.step_us)

    @property
    def batch_s(self) -> float:
        """Wall time of a batch."""
        return self.batch_us * 1e-6 / self.speed

    def start(self, now_s: float) -> None:
        """The first deadline."""
        self.deadline_s = now_s + self.batch_s

    def passed(self, now_s: float) -> None:
        """A batch begins at `now_s`: note how late, set the next deadline."""
        if len(self.lateness_s) < _KEPT:
            self.lateness_s.append(max(0.0, now_s - self.deadline_s))
        self.deadline_s += self.batch_s
        if now_s - self.deadline_s > _LATE_S:
            self.deadline_s = now_s + self.batch_s
            self.resynchronised += 1

    def report(self) -> str:
        """Percentiles of the lateness, milliseconds."""
        late = sorted(self.lateness_s)
        if not late:
            return "no batch was flown in real time"
        shown = ", ".join(
            f"{name} {late[min(len(late) - 1, int(share * len(late)))] * 1e3:.2f}"
            for name, share in (("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999), ("max", 1.0))
        )
        return f"lateness of {len(late)} batches, ms: {shown}; schedule begun anew {self.resynchronised} times"
