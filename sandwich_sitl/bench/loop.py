"""The whole loop in lockstep: two processes, UDP, MAVLink both ways, MPC, both logs. Where does a tick's time go?

A configuration is flown plainly for the factor, then once more with both sides timed part by part. The two sides take
turns: while one decides, the other records and waits. Wall-clock times of a busy machine are what they are, so the
processor time of each part stands beside them.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from sandwich_sitl import launcher
from sandwich_sitl.bench.stopwatch import Parts, Stopwatch
from sandwich_sitl.config import load_config
from sandwich_sitl.control.mpc import Mpc
from sandwich_sitl.errors import SandwichError
from sandwich_sitl.link.session import LinkSession
from sandwich_sitl.link.transport import UdpTransport
from sandwich_sitl.mission.machine import Mission
from sandwich_sitl.mission.pilot import Pilot
from sandwich_sitl.progress import Progress
from sandwich_sitl.recording.recorder import RunRecorder

WAIT = "wait for the other side"
_PARTS = (
    (UdpTransport, "receive", WAIT),
    (LinkSession, "next_tick", "decode"),
    (Mission, "step", "mission table"),
    (Pilot, "steer", "estimator, stop, examination"),
    (Mpc, "solve", "MPC"),
    (LinkSession, "send", "encode"),
    (UdpTransport, "send", "send"),
    *((RunRecorder, method, "record") for method in ("tf_and_estimate", "control", "horizon", "log", "mavlink")),
)


@dataclass(frozen=True)
class Side:
    """One process of a flight: processor seconds of its loop and the parts of its ticks (none when it was not timed)."""

    processor_s: float
    parts: Parts


@dataclass(frozen=True)
class LoopFlight:
    """One flight: simulated and wall seconds of the loop, control period, both sides, the vehicle's peak memory, processor
    seconds of the whole machine.
    """

    solver: str
    simulated_s: float
    wall_s: float
    period_s: float
    offboard: Side
    vehicle: Side
    vehicle_memory_mib: float
    machine_s: float

    @property
    def others(self) -> float:
        """Cores that other programs used meanwhile."""
        return max(0.0, self.machine_s - self.offboard.processor_s - self.vehicle.processor_s) / self.wall_s

    @property
    def factor(self) -> float:
        """Simulated over wall-clock time."""
        return self.simulated_s / self.wall_s

    @property
    def processor_us(self) -> tuple[float, float]:
        """Processor time of a tick on our side and on the vehicle's, microseconds, all threads."""
        us_of = 1e6 * self.period_s / self.simulated_s
        return self.offboard.processor_s * us_of, self.vehicle.processor_s * us_of


def fly(config_path: Path, overrides: Mapping[str, Any], work: Path, timed: bool) -> LoopFlight:
    """One flight of `config_path` with its logs in `work`. Raises `SandwichError` when it does not land at its goal."""
    config = load_config(config_path, {"link.uri": "udpin://127.0.0.1:0", **overrides, "clock.mode": "lockstep"})
    report = work / "vehicle.npz"
    program = ("sandwich_sitl.bench.loop_vehicle", str(report), "timed" if timed else "plain")
    with _observed(timed) as (spent, watch), Progress() as progress:
        result = launcher.run(config, config_path, work, progress, live=False, vehicle_program=program)
    flight = result.summary["flight"]
    if result.exit_status != 0:
        raise SandwichError(f"{config_path}: ended as {result.summary['outcome']}; its speed would say nothing")
    with np.load(report) as data:
        vehicle, memory_mib = Side(float(data["processor_s"]), Parts.load(data)), float(data["memory_mib"])
    simulated_s = flight["wall_seconds"] * flight["realtime_factor"]
    period_s = 1.0 / config.mpc.rate_hz
    processor_s, machine_s = spent
    return LoopFlight(
        config.mpc.solver, simulated_s, flight["wall_seconds"], period_s, Side(processor_s, watch.parts()), vehicle,
        memory_mib, machine_s,
    )  # fmt: skip


@contextmanager
def _observed(timed: bool) -> Iterator[tuple[list[float], Stopwatch]]:
    """Processor seconds of our loop and of the machine meanwhile and, when `timed`, its parts; every class is as before
    afterwards.
    """
    spent: list[float] = []
    watch, names = Stopwatch(), vars(launcher)
    loop = names["fly"]
    before = [(owner, method, owner.__dict__[method]) for owner, method, _ in (*_PARTS, (RunRecorder, "timing", ""))]
    if timed:
        for owner, method, part in _PARTS:
            watch.around(owner, method, part)
        watch.around(RunRecorder, "timing", "record", ends_tick=True)

    def counted(*arguments: Any, **named: Any) -> Any:
        begin_s, machine_s = process_time(), _machine_s()
        result = loop(*arguments, **named)
        spent.extend((process_time() - begin_s, _machine_s() - machine_s))
        return result

    names["fly"] = counted
    try:
        yield spent, watch
    finally:
        names["fly"] = loop
        for owner, method, original in before:
            setattr(owner, method, original)


def _machine_s() -> float:
    """Seconds that all cores have been busy since boot."""
    fields = Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()[1:]
    idle, waiting = 3, 4
    return sum(int(field) for k, field in enumerate(fields[:8]) if k not in (idle, waiting)) / os.sysconf("SC_CLK_TCK")


FACTORS_HEAD = (
    f"{'':12s} {'x real time':^39s} {'a tick takes, us':^20s} {'x real time':>12s}\n"
    f"{'mpc.solver':12s} {'median':>6s} {'worst':>6s} {'quietest flight':>15s} {'others':>9s} "
    f"{'our CPU':>9s} {'its CPU':>9s}  {'on one core':>12s}"
)


def factors_text(flights: Sequence[LoopFlight]) -> str:
    """Factors of the plain flights of one solver, that of the flight with the least company, and processor time of a tick.

    `others` are the cores that other programs used in that flight; `on one core` is what both processes would reach if
    nothing overlapped.
    """
    factors = [flight.factor for flight in flights]
    quiet = min(flights, key=lambda flight: flight.others)
    ours_us, theirs_us = (float(np.median([flight.processor_us[side] for flight in flights])) for side in range(2))
    return (
        f"{quiet.solver:12s} {np.median(factors):6.1f} {min(factors):6.1f} {quiet.factor:15.1f} {quiet.others:9.2f} "
        f"{ours_us:9.0f} {theirs_us:9.0f}  {1e6 * quiet.period_s / (ours_us + theirs_us):12.1f}"
    )


def parts_text(title: str, parts: Parts) -> str:
    """A table of one side's parts, microseconds of a tick."""
    lines = [
        f"{title:34s} {'CPU p50':>8s} {'p99':>7s} {'max':>8s} {'mean':>7s} {'wall p50':>9s} {'p99':>7s} {'max':>9s}"
    ]
    whole_cpu, whole_wall = sum(parts.cpu_s.values()), sum(parts.wall_s.values())
    rows = [(part, parts.cpu_s[part], parts.wall_s[part]) for part in parts.cpu_s]
    for part, cpu_s, wall_s in (*rows, ("whole tick", whole_cpu, whole_wall)):
        cpu, wall = np.asarray(cpu_s) * 1e6, np.asarray(wall_s) * 1e6
        lines.append(
            f"  {part:32s} {np.median(cpu):8.0f} {np.percentile(cpu, 99):7.0f} {cpu.max():8.0f} {cpu.mean():7.0f} "
            f"{np.median(wall):9.0f} {np.percentile(wall, 99):7.0f} {wall.max():9.0f}"
        )
    return "\n".join(lines)
