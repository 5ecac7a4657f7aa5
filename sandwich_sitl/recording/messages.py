"""Protobuf payloads of the log: dataclasses and arrays in, bytes out.

Every nested message is written even when all its values are zero, and no frame id is empty, because viewers ask for
both. Positions are ENU metres in frame "map"; times are nanoseconds of the vehicle's boot time. `PayloadEncoder`
keeps one message of each kind and overwrites it, which makes a tick's three payloads about five times cheaper than
building them anew.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from numpy.typing import NDArray

from sandwich_sitl.planning.flight_plan import Corridor, Reference
from sandwich_sitl.recording import records
from sandwich_sitl.recording.proto.sandwich_telemetry_pb2 import (
    ControlTelemetry,
    MissionState,
    PlanUpdate,
    ReportedObstacle,
)
from sandwich_sitl.recording.records import ControlRecord, MissionRecord, Vector

MAP_FRAME = "map"
BODY_FRAME = "base_link"
ROOT_FRAME = "tf#/"  # the root that Rerun gives every entity, so that "map" is placed without further ado

LOG_LEVELS = {"debug": Log.DEBUG, "info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR, "fatal": Log.FATAL}

VECTOR_FIELDS = (
    "reference_m",
    "estimate_r_m",
    "estimate_v_mps",
    "model_a_mps2",
    "model_j_mps3",
    "setpoint_r_m",
    "setpoint_v_mps",
    "setpoint_a_mps2",
    "snap_mps4",
    "offset_m",
)
SCALAR_FIELDS = ("slack_m", "clearance_m", "delay_s", "reference_rate")
INTEGER_FIELDS = ("solver_status", "solver_iterations", "region", "rung")


def component_names(field: str) -> tuple[str, str, str]:
    """Protobuf names of a vector field: `setpoint_v_mps` -> `setpoint_v_x_mps`, `..._y_mps`, `..._z_mps`."""
    stem, unit = field.rsplit("_", 1)
    return (f"{stem}_x_{unit}", f"{stem}_y_{unit}", f"{stem}_z_{unit}")


_COMPONENTS = tuple((field, *component_names(field)) for field in VECTOR_FIELDS)


def nanoseconds(t_s: float) -> int:
    """Vehicle boot time in whole nanoseconds, the log's time stamp."""
    return round(t_s * 1e9)


def set_timestamp(message: Any, t_ns: int) -> None:
    """Write `message.timestamp`, also when it is zero."""
    stamp = message.timestamp
    stamp.seconds, stamp.nanos = divmod(t_ns, 1_000_000_000)


class PayloadEncoder:
    """Encodes the payloads of a tick into reused messages."""

    def __init__(self) -> None:
        self._control = ControlTelemetry()
        self._tf = FrameTransform(parent_frame_id=MAP_FRAME, child_frame_id=BODY_FRAME)
        self._estimate = PoseInFrame(frame_id=MAP_FRAME)

    def control(self, t_ns: int, record: ControlRecord) -> bytes:
        """`ControlTelemetry` bytes."""
        message = self._control
        set_timestamp(message, t_ns)
        message.phase = record.phase
        message.fault = record.fault
        for field, x, y, z in _COMPONENTS:
            east, north, up = getattr(record, field)
            setattr(message, x, east)
            setattr(message, y, north)
            setattr(message, z, up)
        for field in SCALAR_FIELDS:
            setattr(message, field, getattr(record, field))
        for field in INTEGER_FIELDS:
            setattr(message, field, int(getattr(record, field)))
        return message.SerializeToString()

    def transform(self, t_ns: int, r_m: Vector, q_wxyz: Sequence[float] | NDArray[np.float64]) -> bytes:
        """`foxglove.FrameTransform` bytes of map -> base_link: the body's position and attitude."""
        message = self._tf
        set_timestamp(message, t_ns)
        _set_xyz(message.translation, r_m)
        _set_quaternion(message.rotation, q_wxyz)
        return message.SerializeToString()

    def estimate(self, t_ns: int, r_m: Vector, q_wxyz: Sequence[float] | NDArray[np.float64]) -> bytes:
        """`foxglove.PoseInFrame` bytes."""
        message = self._estimate
        set_timestamp(message, t_ns)
        _set_xyz(message.pose.position, r_m)
        _set_quaternion(message.pose.orientation, q_wxyz)
        return message.SerializeToString()


def root_transform(t_ns: int) -> bytes:
    """The identity from the viewer's root frame to "map"."""
    message = FrameTransform(parent_frame_id=ROOT_FRAME, child_frame_id=MAP_FRAME)
    set_timestamp(message, t_ns)
    _set_xyz(message.translation, (0.0, 0.0, 0.0))
    _set_quaternion(message.rotation, (1.0, 0.0, 0.0, 0.0))
    return message.SerializeToString()


def poses(t_ns: int, xyz_m: NDArray[np.float64]) -> bytes:
    """`foxglove.PosesInFrame` bytes of points (N, 3), each with identity attitude."""
    message = PosesInFrame(frame_id=MAP_FRAME)
    set_timestamp(message, t_ns)
    for point in np.asarray(xyz_m, dtype=np.float64).tolist():
        pose = message.poses.add()
        _set_xyz(pose.position, point)
        _set_quaternion(pose.orientation, (1.0, 0.0, 0.0, 0.0))
    return message.SerializeToString()


def mission_state(t_ns: int, record: MissionRecord) -> bytes:
    """`MissionState` bytes."""
    message = MissionState(
        state=record.state,
        autopilot_mode=record.autopilot_mode,
        armed=record.armed,
        landed=record.landed,
        reason=record.reason,
    )
    set_timestamp(message, t_ns)
    return message.SerializeToString()


def plan_update(t_ns: int, record: records.PlanUpdate) -> bytes:
    """`PlanUpdate` bytes."""
    t_s = record.reference.t_s
    message = PlanUpdate(
        verdict=record.verdict,
        reason=record.reason,
        heard_s=record.heard_s,
        from_s=float(t_s[0]),
        period_s=float(t_s[1] - t_s[0]) if len(t_s) > 1 else 0.0,
        route_m=record.route_m.ravel().tolist(),
        reference_m=record.reference.xyz_m.ravel().tolist(),
        region=record.reference.region.tolist(),
        first_region=record.first_region,
    )
    set_timestamp(message, t_ns)
    corridor = record.corridor
    for ring, Lambda, Gamma in zip(corridor.polygons_m, corridor.Lambda, corridor.Gamma, strict=True):
        planes = np.column_stack([Lambda, Gamma])
        message.regions.add(ring_m=ring.ravel().tolist(), half_planes=planes.ravel().tolist())
    return message.SerializeToString()


def plan_update_of(t_ns: int, message: Any) -> records.PlanUpdate:
    """The record that a `PlanUpdate` message was made of; the paper's quadrangles are not in it."""
    xyz = _points(message.reference_m, 3)
    t_s = message.from_s + message.period_s * np.arange(len(xyz), dtype=np.float64)
    planes = np.array([region.half_planes for region in message.regions], dtype=np.float64)
    planes = planes.reshape(len(message.regions), -1, 3)
    return records.PlanUpdate(
        t_s=t_ns / 1e9,
        heard_s=message.heard_s,
        verdict=message.verdict,
        reason=message.reason,
        route_m=_points(message.route_m),
        reference=Reference(t_s, xyz, np.array(message.region, dtype=np.int64)),
        first_region=message.first_region,
        corridor=Corridor(
            planes[..., :2],
            planes[..., 2],
            tuple(_points(region.ring_m) for region in message.regions),
            np.empty((0, 4, 2)),
        ),
    )


def reported_obstacle(t_ns: int, record: records.ReportedObstacle) -> bytes:
    """`ReportedObstacle` bytes."""
    message = ReportedObstacle(
        name=record.name,
        source=record.source,
        heard_s=record.heard_s,
        height_m=math.nan if record.height_m is None else record.height_m,
        ring_m=record.ring_m.ravel().tolist(),
    )
    set_timestamp(message, t_ns)
    return message.SerializeToString()


def reported_obstacle_of(t_ns: int, message: Any) -> records.ReportedObstacle:
    """The record that a `ReportedObstacle` message was made of."""
    height_m = None if math.isnan(message.height_m) else message.height_m
    ring = _points(message.ring_m)
    return records.ReportedObstacle(t_ns / 1e9, message.name, message.source, message.heard_s, height_m, ring)


def _points(flat: Sequence[float], columns: int = 2) -> NDArray[np.float64]:
    return np.array(flat, dtype=np.float64).reshape(-1, columns)


def log_line(t_ns: int, level: str, text: str, name: str) -> bytes:
    """`foxglove.Log` bytes; `level` is a key of `LOG_LEVELS`."""
    message = Log(level=LOG_LEVELS[level], message=text, name=name, file="", line=0)
    set_timestamp(message, t_ns)
    return message.SerializeToString()


def _set_xyz(target: Any, xyz: Vector) -> None:
    target.x, target.y, target.z = xyz


def _set_quaternion(target: Any, wxyz: Sequence[float] | NDArray[np.float64]) -> None:
    target.w, target.x, target.y, target.z = wxyz
