"""`run`: plan, start the vehicle beside the offboard process, fly, merge both logs, write the summary.

Of the offboard side only this module knows that there is a vehicle program; it starts it as a process and validates
its section of the configuration. Everything between the two goes over MAVLink.
"""

import dataclasses
import json
import math
import platform
import select
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from sandwich_sitl.config import RunConfig, config_as_dict, located
from sandwich_sitl.errors import InputError, LinkError
from sandwich_sitl.link.transport import check_openable
from sandwich_sitl.link_uri import parse_uri
from sandwich_sitl.map_store import MapStore
from sandwich_sitl.margin_notice import margin_notice
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.planning.plan import check_places, plan_flight
from sandwich_sitl.progress import Progress
from sandwich_sitl.recording.merge import merge_logs
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.recorder import RunRecorder
from sandwich_sitl.recording.streams import DebugStreams
from sandwich_sitl.recording.summary import SAFETY_VIOLATION, summarise
from sandwich_sitl.run import FlightResult, Observers, fly
from sandwich_sitl.signals import StopRequests
from sandwich_sitl.viewing.live import live_command
from sandwich_sitl.world.importers import ImportedWorld
from sandwich_sitl.world.load import import_world
from sandwich_sitl.world_report import notices
from sandwich_sitl.yaml_document import place, value_at
from vehicle_sim.config import VehicleConfig, parse_vehicle_section, vehicle_schema
from vehicle_sim.errors import VehicleError

_START_S = 20.0
_STOP_S = 5.0
_PORT_STEP = 40  # PX4: instance i listens on 14580 + i and sends to 14540 + i
_HIGHEST_PORT = 65535 - _PORT_STEP


@dataclass(frozen=True)
class RunResult:
    """Exit status and the summary that was written."""

    exit_status: int
    summary: dict[str, Any]


def check_vehicle_section(config: RunConfig, config_path: Path) -> VehicleConfig:
    """The `vehicle` section as the vehicle reads it; raises `InputError` when it would not accept it."""

    def place_of(loc: Sequence[int | str]) -> str:
        return place(config_path, loc, value_at({"vehicle": config.vehicle}, loc))

    try:
        return parse_vehicle_section(config.vehicle, str(config_path), place_of)
    except VehicleError as error:
        raise InputError(str(error)) from error


def check_world(config: RunConfig, config_path: Path) -> ImportedWorld:
    """Read the world; raise `InputError` when it cannot be, or when start or goal lies outside it or where no run may begin."""
    imported = import_world(config.world, config_path)
    try:
        check_places(config, imported.world)
    except InputError as error:
        raise InputError(located(config, config_path, str(error))) from error
    return imported


def whole_schema(offboard_schema: dict[str, Any]) -> dict[str, Any]:
    """The run file's JSON Schema with the vehicle's section in its place."""
    vehicle = vehicle_schema()
    definitions = {**offboard_schema.get("$defs", {}), **vehicle.pop("$defs", {})}
    properties = {**offboard_schema["properties"], "vehicle": vehicle}
    return {**offboard_schema, "properties": properties, "$defs": definitions}


def make_plan(config: RunConfig, config_path: Path, progress: Progress) -> FlightPlan:
    """Plan with the wall time of each stage noted. Errors name the configuration file."""
    imported = import_world(config.world, config_path)
    for notice in notices(imported):
        progress.note(notice)
    stages: list[tuple[str, float]] = []

    def on_stage(name: str) -> None:
        stages.append((name, time.perf_counter()))
        progress.stage(name)

    try:
        plan = plan_flight(config, imported.world, on_stage, MapStore() if config.planner.keep_map else None)
    except InputError as error:
        raise InputError(located(config, config_path, str(error))) from error
    if plan.channel_map.lost:
        area = sum(lost.area_m2 for lost in plan.channel_map.lost)
        names = ", ".join(lost.name for lost in plan.channel_map.lost)
        progress.note(
            f"map: {area:.2g} m2 of free ground are left out, slivers thinner than a tenth of a cell: {names}"
        )
    for floor in plan.floors.figures if plan.floors is not None else ():
        if floor.refused:
            progress.note(f"floor {floor.altitude_m:g} m: {floor.refused}")
    ends = [began for _, began in stages[1:]] + [time.perf_counter()]
    return dataclasses.replace(
        plan, seconds={name: end - began for (name, began), end in zip(stages, ends, strict=True)}
    )


def run(
    config: RunConfig,
    config_path: Path,
    out: Path,
    progress: Progress,
    live: bool,
    vehicle_program: Sequence[str] = ("vehicle_sim",),
    planner: Callable[[RunConfig, Path, Progress], FlightPlan] | None = None,
) -> RunResult:
    """One whole run into the existing directory `out`: both logs, `run.mcap`, `summary.json`.

    `vehicle_program` is the module that is started with the command line of `vehicle-sim`, and what it wants before that;
    `planner` stands in for `make_plan` where a bench flies plans of its own.
    """
    if (notice := margin_notice(config, check_vehicle_section(config, config_path))) is not None:
        progress.note(notice)
    ports = _ports(config, config_path)
    plan = (planner or make_plan)(config, config_path, progress)
    config = dataclasses.replace(config, link=dataclasses.replace(config.link, uri=f"udpin://{ports.offboard}"))
    vehicle_log = out / "vehicle.mcap"
    if live:
        # Not ours to end: it stops watching by itself when the flight is over, and its window stays until it is closed.
        subprocess.Popen(live_command(config.zenoh), start_new_session=True)
    with _vehicle(config, plan, config_path, ports, vehicle_log, vehicle_program):
        result = offboard(config, plan, out / "offboard.mcap", progress)
    concluded = _conclude([out / "offboard.mcap", vehicle_log], out, result, progress)
    if concluded.exit_status == 0 and concluded.summary["flight"]["rms_error_m"] is None:
        progress.note("the vehicle's log holds no truth, so nobody can say that the flight was safe")
        return dataclasses.replace(concluded, exit_status=1)
    return concluded


def offboard(config: RunConfig, plan: FlightPlan, log_path: Path, progress: Progress) -> FlightResult:
    """Fly `plan` over the configured link, recording into `log_path`; Ctrl-C brakes, holds and lands."""
    data = config_as_dict(config)
    about = {
        "name": config.name,
        "seed": str(config.seed),
        "clock": config.clock.mode,
        "speed": str(config.clock.speed),
        "mode": config.mode,
        "config": json.dumps(data),
        "versions": json.dumps(_versions()),
    }
    streams = DebugStreams.open(config.zenoh, process="offboard", params_json=json.dumps(data))
    if streams.problem is not None:
        progress.note(streams.problem)
    with streams, RunRecorder(log_path, flush_s=config.logging.flush_s, metadata=about, streams=streams) as recorder:
        recorder.plan(0.0, plan)
        with StopRequests() as stop:
            observers = Observers(recorder, progress.flight, streams.obstacle_reports())
            result = fly(config, plan, observers, stop)
        recorder.metadata(
            "result",
            {
                "outcome": str(result.outcome.outcome),
                "reason": result.outcome.reason,
                "wall_seconds": f"{result.wall_seconds:.3f}",
                "late_ticks": str(result.link.late_ticks),
                "worst_late_s": f"{result.link.worst_late_s:.4f}",
                "retries": str(result.link.retries),
                "refused": str(result.link.refused),
            },
        )
        if recorder.problem is not None:
            progress.note(recorder.problem)
    return result


def conclude_offboard(log_path: Path, out: Path, result: FlightResult, progress: Progress) -> RunResult:
    """Summary of a flight against a vehicle that is not ours: there is no truth, so its numbers are None."""
    return _conclude([log_path], out, result, progress)


def _conclude(logs: Sequence[Path], out: Path, result: FlightResult, progress: Progress) -> RunResult:
    merged = out / "run.mcap"
    for problem in merge_logs([path for path in logs if path.exists()], merged):
        progress.note(problem)
    summary = summarise(RunLog.read(merged))
    status = 1 if summary["outcome"] == SAFETY_VIOLATION else result.outcome.exit_status
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return RunResult(status, summary)


@dataclass(frozen=True)
class _Ports:
    """HOST:PORT of both programs."""

    offboard: str
    vehicle: str


def _ports(config: RunConfig, config_path: Path) -> _Ports:
    """Where the two programs meet: PX4's pair (14540, 14580) or any two 40 apart; port 0 stands for two free ones."""
    uri = parse_uri(config.link.uri)
    if uri.kind != "udpin" or uri.number > _HIGHEST_PORT:
        raise InputError(
            f"{config_path}: link.uri: {config.link.uri}: `run` starts the vehicle itself and needs udpin://HOST:PORT "
            f"with PORT at most {_HIGHEST_PORT}; "
            "use `sandwich-sitl offboard` to fly a vehicle that is already there"
        )
    if uri.number == 0:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((uri.host, 0))
            return _Ports(f"{uri.host}:{probe.getsockname()[1]}", f"{uri.host}:0")
    ports = _Ports(f"{uri.host}:{uri.number}", f"{uri.host}:{uri.number + _PORT_STEP}")
    check_openable(f"udpin://{ports.offboard}")
    try:
        check_openable(f"udpin://{ports.vehicle}")
    except InputError as error:
        raise InputError(f"the vehicle's port, {_PORT_STEP} above that of link.uri: {error}") from error
    return ports


@contextmanager
def _vehicle(
    config: RunConfig, plan: FlightPlan, config_path: Path, ports: _Ports, log_path: Path, program: Sequence[str]
) -> Iterator[None]:
    """`vehicle-sim`, started and bound to its port, until the block ends. Its range sensor sees the map's obstacles too."""
    command = [
        sys.executable, "-m", *program, str(config_path),
        "--connect", f"udpout://{ports.offboard}", "--bind", ports.vehicle, "--log", str(log_path),
        "--clock", config.clock.mode, "--speed", str(config.clock.speed), "--seed", str(config.seed),
        "--set", f"vehicle={json.dumps(config.vehicle)}", "--set", f"mpc.rate_hz={config.mpc.rate_hz}",
        "--set", f"start_m={json.dumps(config.start_m)}", "--until-eof",
    ]  # fmt: skip
    surroundings = None
    if config.vehicle.get("range_sensor") is not None:
        surroundings = log_path.with_suffix(".surroundings.json")
        surroundings.write_text(json.dumps(_surroundings(plan)), encoding="utf-8")
        command += ["--surroundings", str(surroundings)]
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        _wait_until_bound(process)
        yield
    finally:
        _stop(process)
        for pipe in (process.stdin, process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()
        if surroundings is not None:
            surroundings.unlink(missing_ok=True)


def _surroundings(plan: FlightPlan) -> list[dict[str, Any]]:
    """The map's obstacles as the vehicle reads them."""
    return [
        {"name": name, "polygon_m": ring.tolist(), "height_m": None if math.isnan(height) else height}
        for name, ring, height in zip(
            plan.obstacle_names, plan.obstacles_m, plan.obstacle_heights_m.tolist(), strict=True
        )
    ]


def _wait_until_bound(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    assert process.stderr is not None
    ready, _, _ = select.select([process.stdout], [], [], _START_S)
    if ready and process.stdout.readline():
        return
    _stop(process)
    said = process.stderr.read().strip().splitlines()
    if process.returncode == InputError.exit_status and said:
        raise InputError(said[-1])
    raise LinkError(f"vehicle-sim did not start within {_START_S:g} s: {said[-1] if said else 'it said nothing'}")


def _stop(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.terminate()
    try:
        process.wait(_STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(_STOP_S)


def _versions() -> dict[str, str]:
    names = ("sandwich-sitl", "pymavlink", "numpy", "scipy", "osqp", "shapely", "mcap", "eclipse-zenoh")
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in names}}
