import datetime

from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ControlTelemetry(_message.Message):
    __slots__ = ("timestamp", "phase", "reference_x_m", "reference_y_m", "reference_z_m", "estimate_r_x_m", "estimate_r_y_m", "estimate_r_z_m", "estimate_v_x_mps", "estimate_v_y_mps", "estimate_v_z_mps", "model_a_x_mps2", "model_a_y_mps2", "model_a_z_mps2", "model_j_x_mps3", "model_j_y_mps3", "model_j_z_mps3", "setpoint_r_x_m", "setpoint_r_y_m", "setpoint_r_z_m", "setpoint_v_x_mps", "setpoint_v_y_mps", "setpoint_v_z_mps", "setpoint_a_x_mps2", "setpoint_a_y_mps2", "setpoint_a_z_mps2", "snap_x_mps4", "snap_y_mps4", "snap_z_mps4", "slack_m", "solver_status", "solver_iterations", "region", "clearance_m", "rung", "offset_x_m", "offset_y_m", "offset_z_m", "delay_s", "reference_rate", "fault")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    PHASE_FIELD_NUMBER: _ClassVar[int]
    REFERENCE_X_M_FIELD_NUMBER: _ClassVar[int]
    REFERENCE_Y_M_FIELD_NUMBER: _ClassVar[int]
    REFERENCE_Z_M_FIELD_NUMBER: _ClassVar[int]
    ESTIMATE_R_X_M_FIELD_NUMBER: _ClassVar[int]
    ESTIMATE_R_Y_M_FIELD_NUMBER: _ClassVar[int]
    ESTIMATE_R_Z_M_FIELD_NUMBER: _ClassVar[int]
    ESTIMATE_V_X_MPS_FIELD_NUMBER: _ClassVar[int]
    ESTIMATE_V_Y_MPS_FIELD_NUMBER: _ClassVar[int]
    ESTIMATE_V_Z_MPS_FIELD_NUMBER: _ClassVar[int]
    MODEL_A_X_MPS2_FIELD_NUMBER: _ClassVar[int]
    MODEL_A_Y_MPS2_FIELD_NUMBER: _ClassVar[int]
    MODEL_A_Z_MPS2_FIELD_NUMBER: _ClassVar[int]
    MODEL_J_X_MPS3_FIELD_NUMBER: _ClassVar[int]
    MODEL_J_Y_MPS3_FIELD_NUMBER: _ClassVar[int]
    MODEL_J_Z_MPS3_FIELD_NUMBER: _ClassVar[int]
    SETPOINT_R_X_M_FIELD_NUMBER: _ClassVar[int]
    SETPOINT_R_Y_M_FIELD_NUMBER: _ClassVar[int]
    SETPOINT_R_Z_M_FIELD_NUMBER: _ClassVar[int]
    SETPOINT_V_X_MPS_FIELD_NUMBER: _ClassVar[int]
    SETPOINT_V_Y_MPS_FIELD_NUMBER: _ClassVar[int]
    SETPOINT_V_Z_MPS_FIELD_NUMBER: _ClassVar[int]
    SETPOINT_A_X_MPS2_FIELD_NUMBER: _ClassVar[int]
    SETPOINT_A_Y_MPS2_FIELD_NUMBER: _ClassVar[int]
    SETPOINT_A_Z_MPS2_FIELD_NUMBER: _ClassVar[int]
    SNAP_X_MPS4_FIELD_NUMBER: _ClassVar[int]
    SNAP_Y_MPS4_FIELD_NUMBER: _ClassVar[int]
    SNAP_Z_MPS4_FIELD_NUMBER: _ClassVar[int]
    SLACK_M_FIELD_NUMBER: _ClassVar[int]
    SOLVER_STATUS_FIELD_NUMBER: _ClassVar[int]
    SOLVER_ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    REGION_FIELD_NUMBER: _ClassVar[int]
    CLEARANCE_M_FIELD_NUMBER: _ClassVar[int]
    RUNG_FIELD_NUMBER: _ClassVar[int]
    OFFSET_X_M_FIELD_NUMBER: _ClassVar[int]
    OFFSET_Y_M_FIELD_NUMBER: _ClassVar[int]
    OFFSET_Z_M_FIELD_NUMBER: _ClassVar[int]
    DELAY_S_FIELD_NUMBER: _ClassVar[int]
    REFERENCE_RATE_FIELD_NUMBER: _ClassVar[int]
    FAULT_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    phase: str
    reference_x_m: float
    reference_y_m: float
    reference_z_m: float
    estimate_r_x_m: float
    estimate_r_y_m: float
    estimate_r_z_m: float
    estimate_v_x_mps: float
    estimate_v_y_mps: float
    estimate_v_z_mps: float
    model_a_x_mps2: float
    model_a_y_mps2: float
    model_a_z_mps2: float
    model_j_x_mps3: float
    model_j_y_mps3: float
    model_j_z_mps3: float
    setpoint_r_x_m: float
    setpoint_r_y_m: float
    setpoint_r_z_m: float
    setpoint_v_x_mps: float
    setpoint_v_y_mps: float
    setpoint_v_z_mps: float
    setpoint_a_x_mps2: float
    setpoint_a_y_mps2: float
    setpoint_a_z_mps2: float
    snap_x_mps4: float
    snap_y_mps4: float
    snap_z_mps4: float
    slack_m: float
    solver_status: int
    solver_iterations: int
    region: int
    clearance_m: float
    rung: int
    offset_x_m: float
    offset_y_m: float
    offset_z_m: float
    delay_s: float
    reference_rate: float
    fault: str
    def __init__(self, timestamp: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., phase: _Optional[str] = ..., reference_x_m: _Optional[float] = ..., reference_y_m: _Optional[float] = ..., reference_z_m: _Optional[float] = ..., estimate_r_x_m: _Optional[float] = ..., estimate_r_y_m: _Optional[float] = ..., estimate_r_z_m: _Optional[float] = ..., estimate_v_x_mps: _Optional[float] = ..., estimate_v_y_mps: _Optional[float] = ..., estimate_v_z_mps: _Optional[float] = ..., model_a_x_mps2: _Optional[float] = ..., model_a_y_mps2: _Optional[float] = ..., model_a_z_mps2: _Optional[float] = ..., model_j_x_mps3: _Optional[float] = ..., model_j_y_mps3: _Optional[float] = ..., model_j_z_mps3: _Optional[float] = ..., setpoint_r_x_m: _Optional[float] = ..., setpoint_r_y_m: _Optional[float] = ..., setpoint_r_z_m: _Optional[float] = ..., setpoint_v_x_mps: _Optional[float] = ..., setpoint_v_y_mps: _Optional[float] = ..., setpoint_v_z_mps: _Optional[float] = ..., setpoint_a_x_mps2: _Optional[float] = ..., setpoint_a_y_mps2: _Optional[float] = ..., setpoint_a_z_mps2: _Optional[float] = ..., snap_x_mps4: _Optional[float] = ..., snap_y_mps4: _Optional[float] = ..., snap_z_mps4: _Optional[float] = ..., slack_m: _Optional[float] = ..., solver_status: _Optional[int] = ..., solver_iterations: _Optional[int] = ..., region: _Optional[int] = ..., clearance_m: _Optional[float] = ..., rung: _Optional[int] = ..., offset_x_m: _Optional[float] = ..., offset_y_m: _Optional[float] = ..., offset_z_m: _Optional[float] = ..., delay_s: _Optional[float] = ..., reference_rate: _Optional[float] = ..., fault: _Optional[str] = ...) -> None: ...

class MissionState(_message.Message):
    __slots__ = ("timestamp", "state", "autopilot_mode", "armed", "landed", "reason")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    AUTOPILOT_MODE_FIELD_NUMBER: _ClassVar[int]
    ARMED_FIELD_NUMBER: _ClassVar[int]
    LANDED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    state: str
    autopilot_mode: str
    armed: bool
    landed: bool
    reason: str
    def __init__(self, timestamp: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., state: _Optional[str] = ..., autopilot_mode: _Optional[str] = ..., armed: _Optional[bool] = ..., landed: _Optional[bool] = ..., reason: _Optional[str] = ...) -> None: ...

class PlanUpdate(_message.Message):
    __slots__ = ("timestamp", "verdict", "reason", "heard_s", "from_s", "period_s", "route_m", "reference_m", "region", "first_region", "regions")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    VERDICT_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    HEARD_S_FIELD_NUMBER: _ClassVar[int]
    FROM_S_FIELD_NUMBER: _ClassVar[int]
    PERIOD_S_FIELD_NUMBER: _ClassVar[int]
    ROUTE_M_FIELD_NUMBER: _ClassVar[int]
    REFERENCE_M_FIELD_NUMBER: _ClassVar[int]
    REGION_FIELD_NUMBER: _ClassVar[int]
    FIRST_REGION_FIELD_NUMBER: _ClassVar[int]
    REGIONS_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    verdict: str
    reason: str
    heard_s: float
    from_s: float
    period_s: float
    route_m: _containers.RepeatedScalarFieldContainer[float]
    reference_m: _containers.RepeatedScalarFieldContainer[float]
    region: _containers.RepeatedScalarFieldContainer[int]
    first_region: int
    regions: _containers.RepeatedCompositeFieldContainer[Region]
    def __init__(self, timestamp: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., verdict: _Optional[str] = ..., reason: _Optional[str] = ..., heard_s: _Optional[float] = ..., from_s: _Optional[float] = ..., period_s: _Optional[float] = ..., route_m: _Optional[_Iterable[float]] = ..., reference_m: _Optional[_Iterable[float]] = ..., region: _Optional[_Iterable[int]] = ..., first_region: _Optional[int] = ..., regions: _Optional[_Iterable[_Union[Region, _Mapping]]] = ...) -> None: ...

class Region(_message.Message):
    __slots__ = ("ring_m", "half_planes")
    RING_M_FIELD_NUMBER: _ClassVar[int]
    HALF_PLANES_FIELD_NUMBER: _ClassVar[int]
    ring_m: _containers.RepeatedScalarFieldContainer[float]
    half_planes: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, ring_m: _Optional[_Iterable[float]] = ..., half_planes: _Optional[_Iterable[float]] = ...) -> None: ...

class ReportedObstacle(_message.Message):
    __slots__ = ("timestamp", "name", "source", "heard_s", "height_m", "ring_m")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    HEARD_S_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    RING_M_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    name: str
    source: str
    heard_s: float
    height_m: float
    ring_m: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, timestamp: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., name: _Optional[str] = ..., source: _Optional[str] = ..., heard_s: _Optional[float] = ..., height_m: _Optional[float] = ..., ring_m: _Optional[_Iterable[float]] = ...) -> None: ...
