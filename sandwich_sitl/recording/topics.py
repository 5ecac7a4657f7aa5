"""Topics of the offboard process's log, their message kinds, and the Zenoh keys of the same payloads."""

from typing import Any

from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from sandwich_sitl.recording.proto.sandwich_telemetry_pb2 import (
    ControlTelemetry,
    MissionState,
    PlanUpdate,
    ReportedObstacle,
)

PROTOBUF_TOPICS: dict[str, Any] = {
    "/tf": FrameTransform,
    "/state/estimate": PoseInFrame,
    "/plan/path": PosesInFrame,
    "/plan/horizon": PosesInFrame,
    "/plan/map": SceneUpdate,
    "/plan/update": PlanUpdate,
    "/obstacles": ReportedObstacle,
    "/scene": SceneUpdate,
    "/control/telemetry": ControlTelemetry,
    "/mission/state": MissionState,
    "/log": Log,
}
MAVLINK_TOPICS = ("/mavlink/tx", "/mavlink/rx")
PLAN_ATTACHMENT = "plan.npz"
PLAN_TOPIC = "/plan/file"  # streamed only; the log carries the plan as an attachment
LATCHED_TOPICS = (
    PLAN_TOPIC,
    "/plan/path",
    "/plan/map",
    "/scene",
    "/mission/state",
)  # a late subscriber is given the last value

MESSAGE_KINDS: dict[str, Any] = {kind.DESCRIPTOR.full_name: kind for kind in PROTOBUF_TOPICS.values()}


def stream_key(vehicle_name: str, topic: str) -> str:
    """`sitl/{vehicle}/{component}/{topic}`: "/log" -> "sitl/uav1/offboard/log"; two parts stay two."""
    path = topic.removeprefix("/")
    return f"sitl/{vehicle_name}/{path}" if "/" in path else f"sitl/{vehicle_name}/offboard/{path}"


def obstacle_key(vehicle_name: str) -> str:
    """Where obstacles are reported to a flight."""
    return f"sitl/{vehicle_name}/obstacles"


def stream_encoding(topic: str) -> str:
    """Zenoh encoding of a topic's payloads."""
    if topic == PLAN_TOPIC:
        return "application/octet-stream;npz"
    if topic in MAVLINK_TOPICS:
        return "application/octet-stream;mavlink"
    return f"application/protobuf;{PROTOBUF_TOPICS[topic].DESCRIPTOR.full_name}"
