"""`RunRecorder`: the offboard process's MCAP log, and the same payloads as debug streams.

State: one MCAP writer. Input: frozen records with the vehicle's boot time in seconds, which becomes the log time. The
writer works inline, in the slack after the setpoint has been sent, and never on a thread of its own. It is flushed
right after the first message and then every `flush_s` of wall time, so a killed process loses at most that much.

Metadata records: `run` (run id, name, seed, clock, versions, configuration), `plan` (`seconds` of each planning
stage), `wall_timing` (lists of wall-clock seconds, one record a `TIMING_BATCH` ticks) and `result` (outcome, reason,
wall_seconds).
"""

import contextlib
import json
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema
from numpy.typing import NDArray

from sandwich_sitl.errors import InputError
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.recording import messages
from sandwich_sitl.recording.plan_file import plan_bytes
from sandwich_sitl.recording.records import (
    ControlRecord,
    MissionRecord,
    PlanUpdate,
    ReportedObstacle,
    TickTiming,
    Vector,
)
from sandwich_sitl.recording.scene import map_update, scene_update
from sandwich_sitl.recording.streams import DebugStreams
from sandwich_sitl.recording.topics import MAVLINK_TOPICS, PLAN_ATTACHMENT, PLAN_TOPIC, PROTOBUF_TOPICS

_LOG = logging.getLogger(__name__)

TIMING_BATCH = 50
CHUNK_BYTES = 256 * 1024
MAVLINK_CHANNEL = {"dialect": "common", "framing": "one MAVLink frame a message"}


class RunRecorder:
    """Context manager; `close` (or leaving the block) completes the file's summary."""

    def __init__(
        self, path: Path, *, flush_s: float, metadata: Mapping[str, str], streams: DebugStreams | None = None
    ) -> None:
        """Create `path`, with `metadata` as a first record `run`. Raises `InputError` when that fails."""
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise InputError(
                f"{path}: cannot be created ({error.strerror}); give a directory that can be written"
            ) from error
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(library="sandwich-sitl")
        self._channels = _register(self._writer)
        self._path = path
        self._streams = streams
        self.problem: str | None = None  # why recording stopped: a full disk must not end a flight
        self._flush_s = flush_s
        self._flush_due_s = 0.0
        self._encoder = messages.PayloadEncoder()
        self._rooted = False
        self._closed = False
        self._timings: list[tuple[int, TickTiming]] = []
        self._last_ns = 0
        self._first_tick = 0
        if metadata:
            self.metadata("run", metadata)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def plan(self, t_s: float, plan: FlightPlan) -> None:
        """The plan before take-off: attachment `plan.npz`, `/plan/path`, `/plan/map`, `/scene`, metadata `plan`."""
        t_ns = messages.nanoseconds(t_s)
        data = plan_bytes(plan)
        self._store(self._writer.add_attachment, t_ns, t_ns, PLAN_ATTACHMENT, "application/x-npz", data)
        if self._streams is not None:
            self._streams.put(PLAN_TOPIC, data)
        self.metadata("plan", {"name": plan.name, "seconds": plan.seconds})
        self._write("/plan/path", t_ns, messages.poses(t_ns, plan.path_m))
        self._write("/plan/map", t_ns, map_update(plan, t_ns))
        self._write("/scene", t_ns, scene_update(plan, t_ns))

    def tf_and_estimate(self, t_s: float, r_m: Vector, q_wxyz: Sequence[float] | NDArray[np.float64]) -> None:
        """The estimated pose: position ENU (3,), attitude body to world as w, x, y, z."""
        t_ns = messages.nanoseconds(t_s)
        if not self._rooted:
            self._rooted = True
            self._write("/tf", t_ns, messages.root_transform(t_ns))
        self._write("/tf", t_ns, self._encoder.transform(t_ns, r_m, q_wxyz))
        self._write("/state/estimate", t_ns, self._encoder.estimate(t_ns, r_m, q_wxyz))

    def control(self, record: ControlRecord) -> None:
        """One tick of the controller."""
        t_ns = messages.nanoseconds(record.t_s)
        self._write("/control/telemetry", t_ns, self._encoder.control(t_ns, record))

    def horizon(self, t_s: float, xyz_m: NDArray[np.float64]) -> None:
        """The MPC's plan ahead, points (N, 3)."""
        t_ns = messages.nanoseconds(t_s)
        self._write("/plan/horizon", t_ns, messages.poses(t_ns, xyz_m))

    def mission(self, t_s: float, record: MissionRecord) -> None:
        """A change of the mission's state."""
        t_ns = messages.nanoseconds(t_s)
        self._write("/mission/state", t_ns, messages.mission_state(t_ns, record))

    def obstacle(self, record: ReportedObstacle) -> None:
        """An obstacle that was heard of in flight: `/obstacles`."""
        t_ns = messages.nanoseconds(record.t_s)
        self._write("/obstacles", t_ns, messages.reported_obstacle(t_ns, record))

    def plan_update(self, record: PlanUpdate, altitude_m: float) -> None:
        """A plan that took the place of the one before: `/plan/update`, and its route on `/plan/path`."""
        t_ns = messages.nanoseconds(record.t_s)
        self._write("/plan/update", t_ns, messages.plan_update(t_ns, record))
        route = np.column_stack([record.route_m, np.full(len(record.route_m), altitude_m)])
        self._write("/plan/path", t_ns, messages.poses(t_ns, route))

    def log(self, t_s: float, level: str, message: str) -> None:
        """One line of text; `level` is debug, info, warning, error or fatal."""
        t_ns = messages.nanoseconds(t_s)
        self._write("/log", t_ns, messages.log_line(t_ns, level, message, "offboard"))

    def mavlink(self, t_s: float, direction: Literal["tx", "rx"], frame: bytes) -> None:
        """One MAVLink frame as it was on the wire, sent (tx) or received (rx) by this process."""
        self._write(f"/mavlink/{direction}", messages.nanoseconds(t_s), frame)

    def timing(self, tick: int, timing: TickTiming) -> None:
        """Wall-clock times of one tick, stamped with the last message's time; ticks are numbered without gaps."""
        if not self._timings:
            self._first_tick = tick
        self._timings.append((self._last_ns, timing))
        if len(self._timings) >= TIMING_BATCH:
            self._write_timings()

    def metadata(self, name: str, mapping: Mapping[str, Any]) -> None:
        """A metadata record: strings as they are, other values as JSON. The last record of a name wins."""
        self._store(self._writer.add_metadata, name, {key: _text(value) for key, value in mapping.items()})
        self._store(self._file.flush)

    def close(self) -> None:
        """Write what is buffered and the file's summary; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        self._write_timings()
        self._store(self._writer.finish)
        self._store(self._file.flush)
        with contextlib.suppress(OSError):
            self._file.close()

    def _write(self, topic: str, t_ns: int, payload: bytes) -> None:
        if self._streams is not None:
            self._streams.put(topic, payload)
        if self.problem is None:
            try:
                self._writer.add_message(self._channels[topic], t_ns, payload, t_ns)
            except OSError as error:
                self._give_up(error)
        self._last_ns = t_ns
        now_s = time.monotonic()
        if now_s >= self._flush_due_s:
            self._store(self._writer.flush)
            self._flush_due_s = now_s + self._flush_s

    def _store(self, action: Callable[..., None], *arguments: Any) -> None:
        """Do one thing to the file; when that fails, record nothing more and say so once."""
        if self.problem is not None:
            return
        try:
            action(*arguments)
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self.problem = f"{self._path}: recording stopped ({error.strerror}); free some space for the next run"
        _LOG.error(self.problem)

    def _write_timings(self) -> None:
        if not self._timings:
            return
        batch, self._timings = self._timings, []
        columns = {
            "t_ns": [t_ns for t_ns, _ in batch],
            "solve_s": [round(timing.solve_s, 7) for _, timing in batch],
            "loop_s": [round(timing.loop_s, 7) for _, timing in batch],
            "late_s": [round(timing.late_s, 7) for _, timing in batch],
            "sent_s": [round(timing.sent_s, 6) for _, timing in batch],
        }
        self.metadata("wall_timing", {"first_tick": self._first_tick, **columns})


def _register(writer: Writer) -> dict[str, int]:
    schemas = {kind: register_schema(writer, kind) for kind in dict.fromkeys(PROTOBUF_TOPICS.values())}
    channels = {
        topic: writer.register_channel(topic, "protobuf", schemas[kind]) for topic, kind in PROTOBUF_TOPICS.items()
    }
    mavlink = writer.register_schema("mavlink", "", b"")
    for topic in MAVLINK_TOPICS:
        channels[topic] = writer.register_channel(topic, "mavlink", mavlink, MAVLINK_CHANNEL)
    return channels


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
