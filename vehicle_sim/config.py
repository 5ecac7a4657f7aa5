"""What the vehicle reads of a run's YAML file, as frozen dataclasses.

Used: `seed, start_m, clock, logging.flush_s, mpc.rate_hz` and the strict section `vehicle:`. Every other key belongs to
other programs and is passed over. Keys carry their units; ENU where a key says so, else body axes forward, right, down.
"""

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from vehicle_sim.autopilot.parameters import find_parameter_problem
from vehicle_sim.complaints import Loc, Source, explain
from vehicle_sim.errors import ConfigError
from vehicle_sim.parts import (
    STRICT,
    AirframeConfig,
    BatteryConfig,
    FailureConfig,
    HomeConfig,
    ObstacleConfig,
    Positive,
    RangeSensorConfig,
    SensorsConfig,
    SigningConfig,
    WindConfig,
)

_LENIENT = ConfigDict(extra="ignore", strict=True, allow_inf_nan=False)


@dataclass(frozen=True, config=STRICT)
class VehicleConfig:
    """The section `vehicle:`."""

    airframe: AirframeConfig = field(default_factory=AirframeConfig)
    wind: WindConfig = field(default_factory=WindConfig)
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    battery: BatteryConfig = field(default_factory=BatteryConfig)
    home: HomeConfig = field(default_factory=HomeConfig)
    initial_yaw_deg: Annotated[float, Field(ge=-360, le=360, description="heading at boot, clockwise from north")] = 0.0
    system_id: Annotated[int, Field(ge=1, le=255)] = 1
    signing: SigningConfig = field(default_factory=SigningConfig)
    failures: tuple[FailureConfig, ...] = ()
    obstacles: Annotated[
        tuple[ObstacleConfig, ...], Field(description="what the world's map does not show, from a time on")
    ] = ()
    range_sensor: Annotated[RangeSensorConfig | None, Field(description="sends OBSTACLE_DISTANCE; null: none")] = None
    parameters: Annotated[dict[str, float | int], Field(description="PX4 parameters by name")] = field(
        default_factory=dict
    )


@dataclass(frozen=True, config=_LENIENT)
class ClockConfig:
    """As in the run: `lockstep` follows the peer's setpoints, `realtime` the wall clock times `speed`."""

    mode: Literal["realtime", "lockstep"] = "lockstep"
    speed: Annotated[float, Field(gt=0, le=100)] = 1.0


@dataclass(frozen=True, config=_LENIENT)
class LoggingConfig:
    """The MCAP log."""

    flush_s: Positive = 0.25


@dataclass(frozen=True, config=_LENIENT)
class MpcConfig:
    """Of the controller only its period, which is the lockstep period."""

    rate_hz: Positive = 50.0


@dataclass(frozen=True, config=_LENIENT)
class RunConfig:
    """What the vehicle uses of a run's file; `start_m` (x east, y north) is where the vehicle stands."""

    start_m: tuple[float, float]
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    clock: ClockConfig = field(default_factory=ClockConfig)
    logging: LoggingConfig = field(default_factory=LoggingConfig)
    mpc: MpcConfig = field(default_factory=MpcConfig)
    vehicle: VehicleConfig = field(default_factory=VehicleConfig)

    @property
    def period_us(self) -> int:
        """The control period of lockstep in microseconds."""
        return 1000 * round(1000.0 / self.mpc.rate_hz)


_RUN_ADAPTER = TypeAdapter(RunConfig)
_OBSTACLES_ADAPTER = TypeAdapter(tuple[ObstacleConfig, ...])
_VEHICLE_ADAPTER = TypeAdapter(VehicleConfig)


def vehicle_schema() -> dict[str, Any]:
    """The JSON Schema of the section `vehicle:`."""
    schema = _VEHICLE_ADAPTER.json_schema()
    airframe = schema["properties"]["airframe"]
    schema["properties"]["airframe"] = {
        "anyOf": [{"$ref": airframe["$ref"]}, {"type": "string", "description": "an airframe's YAML file"}]
    }
    return schema


def parse_vehicle_section(
    mapping: Mapping[str, Any], where: str, place: Callable[[Loc], str] | None = None
) -> VehicleConfig:
    """Check a `vehicle:` section of the file `where`; `place` says where in it a key stands.

    Raises `ConfigError` with the place (by default the file), key path and the fix.
    """
    place = place or (lambda _: where)
    mapping = _with_airframe_file(mapping, Path(where))
    try:
        config = _VEHICLE_ADAPTER.validate_json(json.dumps(mapping, default=str))
    except ValidationError as error:
        loc, text = explain(error, ("vehicle",))
        raise ConfigError(f"{place(loc)}: {text}") from error
    _check_parameters(config, place)
    return config


def load_run(path: Path, overrides: Mapping[str, Any] | None = None) -> RunConfig:
    """Read a run's YAML file; `overrides` maps dotted key paths ("clock.mode") to values.

    Raises `ConfigError` with file, line, key path and the fix.
    """
    data, root = _read_mapping(path)
    source = Source(path, root, tuple(overrides or ()))
    for key_path, value in (overrides or {}).items():
        _set_value(data, key_path, value, path)
    if isinstance(data.get("vehicle"), dict):
        data["vehicle"] = _with_airframe_file(data["vehicle"], path)
    try:
        config = _RUN_ADAPTER.validate_json(json.dumps(data, default=str))
    except ValidationError as error:
        loc, text = explain(error, ())
        raise ConfigError(f"{source.place(loc)}: {text}") from error
    _check_parameters(config.vehicle, source.place)
    _check_period(config, source)
    return config


def read_obstacles(path: Path) -> tuple[ObstacleConfig, ...]:
    """A JSON list of obstacles, each as in `vehicle.obstacles`. Raises `ConfigError`."""
    try:
        return _OBSTACLES_ADAPTER.validate_json(path.read_bytes())
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); give a JSON file of obstacles") from error
    except ValidationError as error:
        raise ConfigError(f"{path}: {explain(error, ())[1]}") from error


def run_as_dict(config: RunConfig) -> dict[str, Any]:
    """Plain data for the log's metadata."""
    data: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(config)))
    return data


def _with_airframe_file(section: Mapping[str, Any], path: Path) -> Mapping[str, Any]:
    """The section with `airframe: FILE` replaced by what that file, found beside the run's file, says."""
    named = section.get("airframe")
    if not isinstance(named, str):
        return section
    file = path.parent / named
    airframe, root = _read_mapping(file, "vehicle.airframe: give the path of an airframe's YAML file")
    try:
        TypeAdapter(AirframeConfig).validate_json(json.dumps(airframe, default=str))
    except ValidationError as error:
        loc, text = explain(error, ())
        raise ConfigError(f"{Source(file, root, ()).place(loc)}: {text}") from error
    return {**section, "airframe": airframe}


def _check_parameters(config: VehicleConfig, place: Callable[[Loc], str]) -> None:
    problem = find_parameter_problem(config.parameters)
    if problem is not None:
        name, advice = problem
        raise ConfigError(f"{place(('vehicle', 'parameters', name))}: vehicle.parameters.{name}: {advice}")


def _check_period(config: RunConfig, source: Source) -> None:
    period_ms = 1000.0 / config.mpc.rate_hz
    if abs(period_ms - round(period_ms)) > 1e-6 or not 2 <= round(period_ms) <= 200:
        raise ConfigError(
            f"{source.place(('mpc', 'rate_hz'))}: mpc.rate_hz: must give a period of 2 to 200 whole milliseconds (such as 20, "
            f"25, 40, 50, 100), got {config.mpc.rate_hz:g}"
        )


def _read_mapping(path: Path, fix: str = "give the path of a run's YAML file") -> tuple[dict[str, Any], yaml.Node]:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); {fix}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text; save it as UTF-8") from error
    try:
        data = yaml.safe_load(text)
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise ConfigError(f"{path}:{line}: is not valid YAML: {error.problem}") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: is not valid YAML: {' '.join(str(error).split())}") from error
    if not isinstance(data, dict) or root is None:
        raise ConfigError(f"{path}: must be a mapping of keys such as start_m, seed, clock, vehicle")
    return data, root


def _set_value(data: dict[str, Any], key_path: str, value: Any, path: Path) -> None:
    *sections, last = key_path.split(".")
    target = data
    for section in sections:
        target = target.setdefault(section, {})
        if not isinstance(target, dict):
            raise ConfigError(f"{path}: {key_path}: '{section}' is not a section")
    target[last] = value
