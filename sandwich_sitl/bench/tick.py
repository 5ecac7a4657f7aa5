"""What a control tick costs, telemetry in to set-point out.

A flight is flown in lockstep and its ticks are then gone through again from the frames of its log, on this thread alone:
frames to `VehicleView`, mission's pilot (estimator, both plans, examination), set-point to frame. Nothing is recorded,
and the garbage collector is off as in the loop. Times are processor time of the thread.
"""

import gc
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandwich_sitl.config import RunConfig, load_config
from sandwich_sitl.errors import InputError
from sandwich_sitl.launcher import run
from sandwich_sitl.link.inbox import Inbox
from sandwich_sitl.link.messages import Encoder
from sandwich_sitl.link.telemetry import Telemetry
from sandwich_sitl.link.wire import FrameSplitter
from sandwich_sitl.mission.orders import Stream
from sandwich_sitl.mission.pilot import Pilot
from sandwich_sitl.progress import Progress
from sandwich_sitl.recording.reader import RunLog

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TickCost:
    """Processor time of each tick (K,) in microseconds: frames in, pilot, frame out."""

    telemetry_us: Array
    pilot_us: Array
    setpoint_us: Array

    def lines(self) -> list[str]:
        """Aligned text, the whole tick last."""
        parts = {
            "telemetry to view": self.telemetry_us,
            "view to set-point": self.pilot_us,
            "set-point to frame": self.setpoint_us,
            "whole tick": self.telemetry_us + self.pilot_us + self.setpoint_us,
        }
        head = f"{len(self.pilot_us):6d} ticks, us of CPU {'median':>8s} {'p99':>8s} {'p99.9':>8s} {'worst':>8s}"
        rows = [head]
        for name, spent in parts.items():
            median, p99, p999 = np.percentile(spent, (50.0, 99.0, 99.9))
            rows.append(f"{name:>27s} {median:8.0f} {p99:8.0f} {p999:8.0f} {spent.max():8.0f}")
        return rows


def tick_cost(config_path: Path, overrides: Mapping[str, Any], work: Path, repeat: int) -> TickCost:
    """Fly once into the directory `work`, then go through the flight's ticks `repeat` times."""
    config = configured(config_path, overrides)
    fly(config, config_path, work)
    log = RunLog.read(work / "run.mcap")
    spent = np.concatenate([_replay(config, log) for _ in range(repeat)])
    return TickCost(spent[:, 0], spent[:, 1], spent[:, 2])


def configured(config_path: Path, overrides: Mapping[str, Any]) -> RunConfig:
    """The run's configuration on a free port and without debug streams."""
    return load_config(config_path, {"link.uri": "udpin://127.0.0.1:0", "zenoh.enabled": False, **overrides})


def fly(config: RunConfig, config_path: Path, work: Path) -> dict[str, Any]:
    """One whole run into the directory `work`; its summary."""
    with Progress() as progress:
        return run(config, config_path, work, progress, False).summary


def _replay(config: RunConfig, log: RunLog) -> Array:
    """CPU microseconds (K, 3) of the three parts of every tracking tick of the log."""
    if log.plan is None:
        raise InputError(f"{log.path}: holds no plan")
    pilot = Pilot(config, log.plan.reference, log.plan.corridor)
    own = (config.link.system_id, config.link.component_id)
    inbox = Inbox(Telemetry(config.start_m, own), lambda *_: None)
    encoder, splitter = Encoder(*own, config.start_m), FrameSplitter()
    frames = log.frames_of("/mavlink/rx")
    stamps = np.array([frame.t_ns for frame in frames]) * 1e-9
    ends = np.searchsorted(stamps, log.control.t_s, side="right")
    inbox.take(splitter.feed(b"".join(frame.data for frame in frames[: ends[0]])), float(log.control.t_s[0]))
    pilot.steer(Stream.POSE, float(log.control.t_s[0]), inbox.telemetry.view(heard=True))
    spent = np.empty((len(ends) - 1, 3))
    gc.collect()
    gc.disable()
    try:
        for k in range(1, len(ends)):
            data = b"".join(frame.data for frame in frames[ends[k - 1] : ends[k]])
            spent[k - 1] = _one_tick(float(log.control.t_s[k]), data, inbox, splitter, pilot, encoder)
    finally:
        gc.enable()
    return spent


def _one_tick(
    now_s: float, data: bytes, inbox: Inbox, splitter: FrameSplitter, pilot: Pilot, encoder: Encoder
) -> tuple[float, float, float]:
    began = time.thread_time_ns()
    inbox.take(splitter.feed(data), now_s)
    view = inbox.telemetry.view(heard=True)
    seen = time.thread_time_ns()
    setpoint = pilot.steer(Stream.TRACK, now_s, view).setpoint
    pilot.accepted(now_s)
    steered = time.thread_time_ns()
    if setpoint is not None:
        encoder.setpoint(setpoint, round(1e3 * now_s))
    ended = time.thread_time_ns()
    return (seen - began) / 1e3, (steered - seen) / 1e3, (ended - steered) / 1e3
