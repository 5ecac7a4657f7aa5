"""One YAML file describes one run; here it becomes frozen dataclasses.

Keys carry their units (`_m _mps _mps2 _rad _s _hz _deg`). Positions are ENU metres in the world's frame (x east, y
north). Unknown keys, wrong types and values out of range raise `InputError` with file, line, key path and the fix.

The `vehicle` section belongs to the vehicle process, which reads it from the same file; here it stays a plain mapping,
so that the offboard process needs nothing of the vehicle's to fly a real autopilot.
"""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError, model_validator
from pydantic.dataclasses import dataclass

from sandwich_sitl.errors import InputError
from sandwich_sitl.link_uri import valid_uri
from sandwich_sitl.planner_config import AltitudeM, PlannerConfig, ReplanConfig
from sandwich_sitl.world_config import (
    STRICT,
    GeoOriginConfig,
    ObstacleConfig,
    PointM,
    Positive,
    WorldConfig,
    for_vehicle,
)
from sandwich_sitl.yaml_document import YamlDocument, place, value_at, wrong

__all__ = [
    "ClockConfig",
    "GeoOriginConfig",
    "LinkConfig",
    "LoggingConfig",
    "MissionConfig",
    "MpcConfig",
    "ObstacleConfig",
    "PlannerConfig",
    "ReplanConfig",
    "RunConfig",
    "WorldConfig",
    "ZenohConfig",
    "config_as_dict",
    "config_schema",
    "load_config",
    "located",
]


_OF_MARGIN = 0.75  # exp(-(1 / 0.75)^2) = 0.17 of errors that are normal on both axes are larger than the margin


def _whole_milliseconds(rate_hz: float) -> float:
    """Lockstep recognises a period by its milliseconds."""
    if abs(1000.0 / rate_hz - round(1000.0 / rate_hz)) > 1e-9:
        raise ValueError("the period 1 / rate_hz must be whole milliseconds, such as rate_hz 25, 40, 50, 100 or 125")
    return rate_hz


@dataclass(frozen=True, config=STRICT)
class MpcConfig:
    """Model predictive control of the quadruple integrator (paper, section V)."""

    rate_hz: Annotated[float, Field(ge=5, le=500), AfterValidator(_whole_milliseconds)] = 50.0
    horizon_steps: Annotated[int, Field(ge=4, le=100)] = 20
    step_s: Positive = 0.1
    bandwidth_radps: Annotated[float, Field(gt=0, description="omega; the paper's beta is omega^8")] = 8.0
    solver: Annotated[
        Literal["osqp", "active_set", "daqp", "piqp", "clarabel", "hpipm"],
        Field(
            description="active_set is the own exact one; daqp, clarabel (extra `solvers`) and hpipm (extra `hpipm`) are optional"
        ),
    ] = "osqp"
    speed_mps: Annotated[float, Field(gt=0, description="horizontal speed the plan keeps to")] = 12.0
    climb_mps: Annotated[float, Field(gt=0, description="vertical speed the plan keeps to")] = 3.0
    acceleration_mps2: Positive = 6.0
    tilt_deg: Annotated[float, Field(gt=0, lt=80, description="limits the horizontal acceleration to g tan(tilt)")] = 35
    jerk_mps3: Positive = 40.0
    snap_mps4: Positive = 600.0
    height_band_m: Annotated[float, Field(gt=0, description="how far the plan may leave the desired height")] = 1.0


@dataclass(frozen=True, config=STRICT)
class TrackingConfig:
    """What closes the loop round the plan: offset, delay and motion of the vehicle."""

    motion_radps: Annotated[
        float, Field(gt=0, description="bandwidth of the vehicle's estimated motion, and so of the offset aimed off")
    ] = 8.0
    delay_s: Annotated[
        float | None, Field(ge=0, le=0.3, description="from a set-point to the motion it asks for; null: measured")
    ] = None
    offset_limit_m: Annotated[float, Field(gt=0, description="largest offset that is aimed off")] = 1.0


@dataclass(frozen=True, config=STRICT)
class AssuranceConfig:
    """When a plan is not flown."""

    region_tolerance_m: Annotated[float, Field(ge=0, description="how far outside a region a plan may pass")] = 0.02
    position_std_m: Annotated[
        float | None,
        Field(
            gt=0,
            description="standard deviation of the horizontal position, by the autopilot's account, above which it stops "
            "and lands; null: three quarters of planner.margin_m",
        ),
    ] = None


@dataclass(frozen=True, config=STRICT)
class MissionConfig:
    """Limits and deadlines of the mission, in seconds of the run's clock."""

    connect_timeout_s: Positive = 20.0
    ready_timeout_s: Positive = 60.0
    prime_s: Positive = 1.0
    request_timeout_s: Positive = 5.0
    land_timeout_s: Annotated[
        float, Field(gt=0, description="to land, beyond the time that sinking at 0.5 m/s takes")
    ] = 60.0
    brake_mps2: Positive = 3.0
    hold_s: Annotated[
        float, Field(gt=0, description="how long a vehicle that lost its plan waits in the air for a request to land")
    ] = 30.0
    start_tolerance_m: Annotated[float, Field(gt=0, description="how far from start_m the vehicle may stand")] = 2.0
    goal_tolerance_m: Positive = 0.5
    lost_track_m: Annotated[
        float, Field(gt=0, description="distance from the reference at which the plan is given up: brake, then stop")
    ] = 10.0


@dataclass(frozen=True, config=STRICT)
class LinkConfig:
    """MAVLink end point of the offboard process."""

    uri: Annotated[
        str,
        Field(description="udpin://HOST:PORT, udpout://HOST:PORT, tcp://HOST:PORT, serial://DEVICE:BAUD"),
        AfterValidator(valid_uri),
    ] = "udpin://127.0.0.1:14540"
    system_id: Annotated[int, Field(ge=1, le=255)] = 245
    component_id: Annotated[int, Field(ge=1, le=255)] = 191
    loss_timeout_s: Annotated[float, Field(gt=0, description="silence after which the vehicle counts as lost")] = 2.0


@dataclass(frozen=True, config=STRICT)
class ClockConfig:
    """`lockstep`: the vehicle advances one control period a setpoint. `realtime`: wall clock times `speed`."""

    mode: Literal["realtime", "lockstep"] = "lockstep"
    speed: Annotated[float, Field(gt=0, le=100)] = 1.0


@dataclass(frozen=True, config=STRICT)
class LoggingConfig:
    """The MCAP log of a run."""

    flush_s: Annotated[float, Field(gt=0, description="at most this much is lost when a process is killed")] = 0.25
    horizon_hz: Positive = 10.0


@dataclass(frozen=True, config=STRICT)
class ZenohConfig:
    """Debug streams. Loopback unless `listen` or `connect` says otherwise."""

    enabled: bool = True
    listen: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    connect: tuple[str, ...] = ()
    vehicle_name: str = "uav1"


@dataclass(frozen=True, config=STRICT)
class RunConfig:
    """Everything a run depends on."""

    world: WorldConfig
    start_m: PointM
    goal_m: PointM
    altitude_m: Annotated[
        AltitudeM, Field(description="flight altitude above the start, the paper's z0; with floors, the start's")
    ]
    planner: PlannerConfig
    name: str = "run"
    goal_altitude_m: Annotated[
        AltitudeM | None, Field(description="floor from which the vehicle lands at the goal; null: altitude_m")
    ] = None
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    mode: Annotated[
        Literal["timed", "paper"],
        Field(description="paper: one node a step, Euler model, unmended quadrangles; timed: the default"),
    ] = "timed"
    mpc: MpcConfig = field(default_factory=MpcConfig)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    assurance: AssuranceConfig = field(default_factory=AssuranceConfig)
    replan: ReplanConfig = field(default_factory=ReplanConfig)
    mission: MissionConfig = field(default_factory=MissionConfig)
    vehicle: dict[str, Any] = field(default_factory=dict)
    link: LinkConfig = field(default_factory=LinkConfig)
    clock: ClockConfig = field(default_factory=ClockConfig)
    logging: LoggingConfig = field(default_factory=LoggingConfig)
    zenoh: ZenohConfig = field(default_factory=ZenohConfig)

    @property
    def landing_altitude_m(self) -> float:
        """Altitude over the goal."""
        return self.altitude_m if self.goal_altitude_m is None else self.goal_altitude_m

    @property
    def position_std_limit_m(self) -> float:
        """How uncertain of its place a vehicle may fly; at three quarters of the margin one error in six passes the margin."""
        given_m = self.assurance.position_std_m
        return _OF_MARGIN * self.planner.margin_m if given_m is None else given_m

    @model_validator(mode="after")
    def _ends_on_floors(self) -> Self:
        floors_m = list(self.planner.floors_m)
        if not floors_m:
            if self.landing_altitude_m != self.altitude_m:
                low, high = sorted((self.altitude_m, self.landing_altitude_m))
                raise wrong(
                    "goal_altitude_m", f"differs from altitude_m; that takes planner.floors_m: [{low:g}, {high:g}]"
                )
            return self
        if self.mode == "paper":
            raise wrong("planner.floors_m", "belongs to mode: timed; the paper's pipeline has one altitude")
        for key, value in (("altitude_m", self.altitude_m), ("goal_altitude_m", self.landing_altitude_m)):
            if value not in floors_m:
                raise wrong(key, f"{value:g} is none of planner.floors_m {floors_m}; give one of these")
        lowest_m = min(self.altitude_m, self.landing_altitude_m)
        if floors_m[0] < lowest_m:
            raise wrong(
                "planner.floors_m",
                f"{floors_m[0]:g} lies below the floors of start and goal ({lowest_m:g}), where nothing is gained; "
                "remove it, or set altitude_m to it",
            )
        return self


_ADAPTER = TypeAdapter(RunConfig)


def load_config(path: Path, overrides: Mapping[str, Any] | None = None) -> RunConfig:
    """Read a run's YAML file; `overrides` maps dotted key paths ("clock.mode") to values.

    Raises `InputError` with file, line, key path and the fix.
    """
    document = YamlDocument.read(path)
    for key_path, value in (overrides or {}).items():
        document.set(key_path, value)
    try:
        text = json.dumps(document.data, default=str)
    except ValueError as error:
        raise InputError(f"{path}: an alias (*name) refers to itself; write the values out") from error
    try:
        config = _ADAPTER.validate_json(text)
    except ValidationError as error:
        raise InputError(document.describe(error)) from error
    planner = config.planner
    return dataclasses.replace(config, world=for_vehicle(config.world, planner.vehicle_radius_m, planner.margin_m))


def located(config: RunConfig, path: Path, problem: str) -> str:
    """A problem that begins with its key ("start_m: ..."), with the file and the key's line before it."""
    loc = problem.partition(":")[0].split(".")
    return f"{place(path, loc, value_at(config_as_dict(config), loc))}: {problem}"


def config_schema() -> dict[str, Any]:
    """The JSON Schema of a run's YAML file."""
    return _ADAPTER.json_schema()


def config_as_dict(config: RunConfig) -> dict[str, Any]:
    """Plain data that `load_config` would accept again (for logs)."""
    data: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(config)))
    return data
