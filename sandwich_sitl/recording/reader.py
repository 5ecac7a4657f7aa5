"""`RunLog`: a finished (or cut-off) run as numpy arrays.

Input: `run.mcap`, `offboard.mcap` or `vehicle.mcap`. Times `t_s` are the vehicle's boot time in seconds, positions
ENU metres, attitudes body to world as w, x, y, z. Rows of every track are in the order of their log time.
"""

import dataclasses
import hashlib
import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from mcap.records import Message
from mcap_protobuf.decoder import DecoderFactory
from numpy.typing import NDArray

from sandwich_sitl.errors import InputError
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.recording.container import RawLog, read_raw
from sandwich_sitl.recording.messages import (
    INTEGER_FIELDS,
    SCALAR_FIELDS,
    VECTOR_FIELDS,
    component_names,
    plan_update_of,
    reported_obstacle_of,
)
from sandwich_sitl.recording.plan_file import plan_from_bytes
from sandwich_sitl.recording.records import PlanUpdate, ReportedObstacle
from sandwich_sitl.recording.topics import MESSAGE_KINDS, PLAN_ATTACHMENT
from sandwich_sitl.recording.tracks import ControlTrack, Frame, LogLine, MissionTrack, PoseTrack, WallTimings

Array = NDArray[np.float64]
Payloads = list[tuple[int, Any]]  # log time in ns, message

TRUTH_TOPIC = "/state/truth"
VEHICLE_TELEMETRY_TOPIC = "/vehicle/telemetry"
LOG_TOPICS = ("/log", "/vehicle/log")
MAVLINK_ENCODING = "mavlink"


@dataclass(frozen=True)
class RunLog:
    """Everything a run's log holds."""

    path: Path
    truncated: bool
    span_s: tuple[float, float]  # first and last log time of the offboard process (of the vehicle in its own file)
    control: ControlTrack
    mission: MissionTrack
    truth: PoseTrack
    estimate: PoseTrack
    horizon: tuple[tuple[float, Array], ...]  # time, points (N, 3)
    updates: tuple[PlanUpdate, ...]  # plans that took the place of the one before, in order
    reported: tuple[ReportedObstacle, ...]  # obstacles heard of in flight, in order
    lines: tuple[LogLine, ...]
    frames: tuple[Frame, ...]
    timings: WallTimings
    vehicle: dict[str, Array]  # `/vehicle/telemetry`: numeric fields by dotted name, with `t_s`
    metadata: dict[str, dict[str, str]]  # records of one name merged, the last value wins
    plan: FlightPlan | None
    digests: dict[str, str]  # topic -> SHA-256 over log times and payloads

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a log. Raises `InputError` when the file is not MCAP, is empty, or holds nothing of a run."""
        raw = read_raw(path)
        topics = _payloads(raw)
        if not raw.messages and not raw.metadata:
            raise InputError(f"{path}: holds no message; the run was killed before it wrote any, so run it again")
        if not topics and "run" not in _metadata(raw):
            raise InputError(f"{path}: is MCAP but not the log of a run; give a run.mcap that a run has written")
        metadata = _metadata(raw)
        return cls(
            path=path,
            truncated=raw.truncated,
            span_s=_span(raw),
            control=_control(topics.get("/control/telemetry", [])),
            mission=_mission(topics.get("/mission/state", [])),
            truth=_pose_track(topics.get(TRUTH_TOPIC, [])),
            estimate=_pose_track(topics.get("/state/estimate", [])),
            horizon=tuple((t_ns / 1e9, _points(message)) for t_ns, message in topics.get("/plan/horizon", [])),
            updates=tuple(plan_update_of(t_ns, message) for t_ns, message in topics.get("/plan/update", [])),
            reported=tuple(reported_obstacle_of(t_ns, message) for t_ns, message in topics.get("/obstacles", [])),
            lines=_lines(topics),
            frames=_frames(raw),
            timings=_timings(raw),
            vehicle=_vehicle(topics.get(VEHICLE_TELEMETRY_TOPIC, [])),
            metadata=metadata,
            plan=_plan(raw, metadata),
            digests=payload_digests(raw),
        )

    @property
    def notice(self) -> str | None:
        """What whoever uses the log must be told, if anything."""
        return f"{self.path}: is cut off; what follows covers what was written" if self.truncated else None

    def frames_of(self, topic: str) -> tuple[Frame, ...]:
        """Frames of one topic, in order."""
        return tuple(frame for frame in self.frames if frame.topic == topic)


def payload_digests(raw: RawLog) -> dict[str, str]:
    """SHA-256 of each topic's log times and payloads in log-time order: equal seeds in lockstep give equal digests."""
    hashes: dict[str, Any] = defaultdict(hashlib.sha256)
    for message in _ordered(raw.messages):
        digest = hashes[raw.channels[message.channel_id].topic]
        digest.update(message.log_time.to_bytes(8, "little") + len(message.data).to_bytes(4, "little") + message.data)
    return {topic: hashes[topic].hexdigest() for topic in sorted(hashes)}


def _ordered(messages: Iterable[Message]) -> list[Message]:
    return sorted(messages, key=lambda message: message.log_time)


def _payloads(raw: RawLog) -> dict[str, Payloads]:
    """Decoded protobuf messages (and raw frames) of the topics this program knows."""
    decoders = _decoders(raw)
    topics: dict[str, Payloads] = defaultdict(list)
    for message in _ordered(raw.messages):
        decode = decoders.get(message.channel_id)
        if decode is not None:
            topics[raw.channels[message.channel_id].topic].append((message.log_time, decode(message.data)))
    return topics


def _decoders(raw: RawLog) -> dict[int, Callable[[bytes], Any]]:
    decoders: dict[int, Callable[[bytes], Any]] = {}
    for channel_id, channel in raw.channels.items():
        schema = raw.schemas.get(channel.schema_id)
        if channel.message_encoding == MAVLINK_ENCODING:
            decoders[channel_id] = bytes
        elif schema is not None and schema.name in MESSAGE_KINDS:
            decoders[channel_id] = MESSAGE_KINDS[schema.name].FromString
        elif schema is not None and channel.topic == VEHICLE_TELEMETRY_TOPIC:
            decoders[channel_id] = DecoderFactory().decoder_for(channel.message_encoding, schema)
    return decoders


def _times(payloads: Payloads) -> Array:
    return np.array([t_ns for t_ns, _ in payloads], dtype=np.float64) / 1e9


def _column(payloads: Payloads, field: str, dtype: Any = np.float64) -> NDArray[Any]:
    return np.array([getattr(message, field) for _, message in payloads], dtype=dtype)


def _strings(payloads: Payloads, field: str) -> tuple[str, ...]:
    return tuple(getattr(message, field) for _, message in payloads)


def _control(payloads: Payloads) -> ControlTrack:
    vectors = {
        field: np.column_stack([_column(payloads, name) for name in component_names(field)]) for field in VECTOR_FIELDS
    }
    scalars = {field: _column(payloads, field) for field in SCALAR_FIELDS}
    integers = {field: _column(payloads, field, np.int64) for field in INTEGER_FIELDS}
    phase, fault = (_strings(payloads, field) for field in ("phase", "fault"))
    return ControlTrack(t_s=_times(payloads), phase=phase, fault=fault, **vectors, **scalars, **integers)


def _mission(payloads: Payloads) -> MissionTrack:
    return MissionTrack(
        t_s=_times(payloads),
        state=_strings(payloads, "state"),
        autopilot_mode=_strings(payloads, "autopilot_mode"),
        armed=_column(payloads, "armed", np.bool_),
        landed=_column(payloads, "landed", np.bool_),
        reason=_strings(payloads, "reason"),
    )


def _pose_track(payloads: Payloads) -> PoseTrack:
    poses = [message.pose for _, message in payloads]
    r_m = np.array([(p.position.x, p.position.y, p.position.z) for p in poses], dtype=np.float64)
    attitudes = [(q.w, q.x, q.y, q.z) for q in (p.orientation for p in poses)]
    return PoseTrack(_times(payloads), r_m.reshape(-1, 3), np.array(attitudes, dtype=np.float64).reshape(-1, 4))


def _points(message: Any) -> Array:
    points = [(pose.position.x, pose.position.y, pose.position.z) for pose in message.poses]
    return np.array(points, dtype=np.float64).reshape(-1, 3)


def _lines(topics: dict[str, Payloads]) -> tuple[LogLine, ...]:
    lines = [
        LogLine(t_ns / 1e9, Log.Level.Name(message.level).lower(), message.name, message.message)
        for topic in LOG_TOPICS
        for t_ns, message in topics.get(topic, [])
    ]
    return tuple(sorted(lines, key=lambda line: line.t_s))


def _frames(raw: RawLog) -> tuple[Frame, ...]:
    topics = {i: channel.topic for i, channel in raw.channels.items() if channel.message_encoding == MAVLINK_ENCODING}
    return tuple(
        Frame(message.log_time, topics[message.channel_id], message.data)
        for message in _ordered(raw.messages)
        if message.channel_id in topics
    )


def _metadata(raw: RawLog) -> dict[str, dict[str, str]]:
    merged: dict[str, dict[str, str]] = defaultdict(dict)
    for record in raw.metadata:
        merged[record.name].update(record.metadata)
    return dict(merged)


def _timings(raw: RawLog) -> WallTimings:
    batches = [record.metadata for record in raw.metadata if record.name == "wall_timing"]
    names = ("t_ns", "solve_s", "loop_s", "late_s", "sent_s")
    columns = {name: [_numbers_of(batch, name) for batch in batches] for name in names}
    ticks = [
        int(batch["first_tick"]) + np.arange(len(row)) for batch, row in zip(batches, columns["solve_s"], strict=True)
    ]
    flat = {name: np.array([value for row in rows for value in row], dtype=float) for name, rows in columns.items()}
    t_s = flat.pop("t_ns") / 1e9
    return WallTimings(tick=np.concatenate([np.empty(0, dtype=np.int64), *ticks]), t_s=t_s, **flat)


def _numbers_of(batch: Mapping[str, str], name: str) -> list[float]:
    """One number a tick; NaN where the log was written before there was such a column."""
    if name in batch:
        return list(json.loads(batch[name]))
    return [np.nan] * len(json.loads(batch["solve_s"]))


def _vehicle(payloads: Payloads) -> dict[str, Array]:
    """Numeric fields of the vehicle's own telemetry; the schema is read from the log, not known here."""
    if not payloads:
        return {}
    rows = [_numbers(message, "") for _, message in payloads]
    return {"t_s": _times(payloads)} | {
        name: np.array([row.get(name, np.nan) for row in rows], dtype=np.float64) for name in rows[-1]
    }


def _numbers(message: Any, prefix: str) -> dict[str, float]:
    numbers: dict[str, float] = {}
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        if field.message_type is not None:
            if not field.is_repeated and field.message_type.full_name != "google.protobuf.Timestamp":
                numbers |= _numbers(value, f"{prefix}{field.name}.")
        elif field.is_repeated:
            numbers |= {f"{prefix}{field.name}[{i}]": float(item) for i, item in enumerate(value)}
        elif isinstance(value, int | float):
            numbers[f"{prefix}{field.name}"] = float(value)
    return numbers


def _plan(raw: RawLog, metadata: dict[str, dict[str, str]]) -> FlightPlan | None:
    for attachment in raw.attachments:
        if attachment.name == PLAN_ATTACHMENT:
            plan = plan_from_bytes(attachment.data, f"{raw.path}: attachment {PLAN_ATTACHMENT}")
            seconds = json.loads(metadata.get("plan", {}).get("seconds", "{}"))
            return dataclasses.replace(plan, seconds=seconds)
    return None


def _span(raw: RawLog) -> tuple[float, float]:
    own = [m.log_time for m in raw.messages if not _is_vehicles(raw.channels[m.channel_id].topic)]
    times = own or [message.log_time for message in raw.messages]
    return (min(times) / 1e9, max(times) / 1e9) if times else (0.0, 0.0)


def _is_vehicles(topic: str) -> bool:
    return topic.startswith("/vehicle/") or topic == TRUTH_TOPIC
