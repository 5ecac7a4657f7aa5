"""Command line: `vehicle-sim CONFIG --connect URI`. Runs until SIGINT or SIGTERM; SIGUSR1 pauses and resumes, SIGUSR2 steps once.

`--contract`, `--parameters`, `--physics` and `--bench` print and end.
"""

import argparse
import dataclasses
import gc
import math
import os
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from vehicle_sim.config import RunConfig, VehicleConfig, load_run, read_obstacles
from vehicle_sim.endpoints import parse_endpoints
from vehicle_sim.errors import ConfigError, VehicleError
from vehicle_sim.fleet import run_fleet
from vehicle_sim.obstacles import RangeSensor, Scene


def build_parser() -> argparse.ArgumentParser:
    """The options."""
    parser = argparse.ArgumentParser(
        prog="vehicle-sim", description="A quadcopter behind a PX4-like autopilot that speaks MAVLink over UDP and TCP."
    )
    add = parser.add_argument
    add("config", type=Path, nargs="?", metavar="CONFIG", help="the run's YAML file")
    add(
        "--connect",
        action="append",
        default=[],
        metavar="URI",
        help="udpout://HOST:PORT, udpin://HOST:PORT or tcp://HOST:PORT (listens); may be given several times",
    )
    add("--bind", metavar="HOST:PORT", help="where the first udpout sends from (default 127.0.0.1:14580)")
    add("--truth", metavar="URI", help="udpout://HOST:PORT that gets HIL_STATE_QUATERNION, the true state, at 50 Hz")
    add("--log", type=Path, metavar="FILE.mcap", help="record into this file")
    add(
        "--surroundings",
        type=Path,
        metavar="FILE.json",
        help="more obstacles for the range sensor, a list like vehicle.obstacles",
    )
    add("--until-eof", action="store_true", help="end when standard input ends, so as not to outlive its starter")
    add("--clock", choices=("realtime", "lockstep"), help="overrides clock.mode")
    add("--speed", type=float, metavar="X", help="overrides clock.speed")
    add("--seed", type=int, metavar="N", help="overrides seed")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="override one key, such as vehicle.system_id=7")
    add("--paused", action="store_true", help="real time: begin paused (SIGUSR1 resumes, SIGUSR2 steps)")
    add("--instance", type=int, default=0, metavar="I", help="adds I to system id and ports, as PX4's instances")
    add("--count", type=int, default=1, metavar="N", help="start N vehicles, instances 0 to N-1")
    add("--contract", action="store_true", help="print the state machine, modes and failsafes, and end")
    add("--parameters", action="store_true", help="print the parameter table, and end")
    add("--physics", action="store_true", help="print what physics and loops do beside what they should, and end")
    add(
        "--bench",
        type=_seconds,
        nargs="?",
        const=60.0,
        metavar="SECONDS",
        help="print how fast the vehicle is, and end",
    )
    return parser


def _seconds(text: str) -> float:
    """An argparse type: how long a flight lasts."""
    try:
        seconds = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text} is not a number of seconds") from error
    if not 1.0 <= seconds < math.inf:
        raise argparse.ArgumentTypeError(f"{text} must be at least 1")
    return seconds


def main(argv: Sequence[str] | None = None) -> int:
    """Exit status 0 after a signal or a listing, 2 when configuration, log or port cannot be used."""
    given = list(sys.argv[1:] if argv is None else argv)
    arguments = build_parser().parse_args(given)
    try:
        if arguments.contract or arguments.parameters or arguments.physics or arguments.bench is not None:
            return _print(arguments)
        _check(arguments)
        return run_fleet(given, arguments.count, arguments.log) if arguments.count > 1 else _fly(arguments)
    except VehicleError as error:
        print(f"vehicle-sim: {error}", file=sys.stderr)
        return error.exit_status


def _print(arguments: argparse.Namespace) -> int:
    from vehicle_sim import bench, figures
    from vehicle_sim.listing import contract_text, parameters_text

    if arguments.contract:
        print(contract_text())
    if arguments.parameters:
        print(parameters_text())
    config = VehicleConfig()
    if arguments.config is not None:
        config = load_run(arguments.config, _overrides(arguments)).vehicle
    if arguments.physics:
        print(figures.describe(figures.physics_figures(config)))
    if arguments.bench is not None:
        print(bench.describe(bench.run_bench(arguments.bench, config)))
    return 0


def _check(arguments: argparse.Namespace) -> None:
    if arguments.config is None:
        raise ConfigError("CONFIG is missing; give the path of a run's YAML file")
    if not arguments.connect:
        raise ConfigError("--connect is missing; give where the clients are, such as udpout://127.0.0.1:14540")
    if arguments.truth is not None and not arguments.truth.startswith("udpout://"):
        raise ConfigError(f"--truth {arguments.truth}: must be udpout://HOST:PORT")
    if not (1 <= arguments.count <= 200 and 0 <= arguments.instance <= 200):
        raise ConfigError("--count must be 1 to 200 and --instance 0 to 200")


def _fly(arguments: argparse.Namespace) -> int:
    from vehicle_sim.pacing import Control
    from vehicle_sim.protocol.node import Node
    from vehicle_sim.protocol.signing import Signing, key_of
    from vehicle_sim.recorder import Recorder
    from vehicle_sim.server import Pace, Server
    from vehicle_sim.transport import open_transport
    from vehicle_sim.vehicle import Vehicle

    config = _for_instance(load_run(arguments.config, _overrides(arguments)), arguments.instance)
    endpoints = parse_endpoints(arguments.connect, arguments.bind, arguments.instance)
    if arguments.truth is not None:
        (truth_endpoint,) = parse_endpoints([arguments.truth], "127.0.0.1:0", arguments.instance)
        endpoints.append(dataclasses.replace(truth_endpoint, bind=("127.0.0.1", 0)))
    stop: list[int] = []
    control = Control(paused=arguments.paused)
    _listen_to_signals(stop, control)
    if arguments.until_eof:
        threading.Thread(target=_stop_at_eof, args=(stop,), daemon=True).start()
    with open_transport(endpoints) as transport:
        recorder = Recorder(arguments.log, config) if arguments.log is not None else None
        try:
            sign = config.vehicle.signing
            node = Node(
                Vehicle(config.vehicle, config.seed, config.period_us, _range_sensor(config, arguments.surroundings)),
                config.clock.mode == "lockstep",
                recorder.sample if recorder is not None else None,
                Signing(key_of(sign.passphrase), sign.epoch) if sign.passphrase else None,
            )
            truth = transport.targets[-1] if arguments.truth is not None else None
            pace = Pace(config.clock.mode == "lockstep", config.clock.speed, config.period_us)
            server = Server(transport, node, pace, recorder, control, truth)
            gc.collect()
            gc.freeze()
            host, port = transport.address(0)
            server.start()
            print(f"vehicle-sim ready on {host}:{port}\n", end="", flush=True)
            server.run(lambda: bool(stop))
            if recorder is not None:
                recorder.write(node.journal)
            if config.clock.mode == "realtime":
                print(server.schedule.report(), flush=True)
        finally:
            if recorder is not None:
                recorder.close()
    return 0


def _range_sensor(config: RunConfig, surroundings: Path | None) -> RangeSensor | None:
    """The sensor, which sees hidden obstacles and those of the map alike."""
    known = read_obstacles(surroundings) if surroundings is not None else ()
    if config.vehicle.range_sensor is None:
        return None
    scene = Scene.of((*config.vehicle.obstacles, *known), config.start_m)
    return RangeSensor(config.vehicle.range_sensor, scene, config.seed)


def _for_instance(config: RunConfig, instance: int) -> RunConfig:
    if instance == 0:
        return config
    system_id = config.vehicle.system_id + instance
    if system_id > 255:
        raise ConfigError(f"--instance {instance}: system id {system_id} is more than 255; lower vehicle.system_id")
    vehicle = dataclasses.replace(config.vehicle, system_id=system_id)
    return dataclasses.replace(config, vehicle=vehicle, seed=config.seed + instance)


def _listen_to_signals(stop: list[int], control: Any) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: stop.append(received))

    def pause(_number: int, _frame: Any) -> None:
        control.paused = not control.paused

    def step(_number: int, _frame: Any) -> None:
        control.steps += 1

    signal.signal(signal.SIGUSR1, pause)
    signal.signal(signal.SIGUSR2, step)


def _stop_at_eof(stop: list[int]) -> None:
    while os.read(0, 4096):  # not sys.stdin: its lock would be held when the interpreter ends
        pass
    stop.append(signal.SIGTERM)


def _overrides(arguments: argparse.Namespace) -> dict[str, Any]:
    overrides: dict[str, Any] = {}
    for item in arguments.set:
        key, separator, text = item.partition("=")
        if not separator or not key:
            raise ConfigError(f"--set {item}: must be KEY=VALUE, such as vehicle.initial_yaw_deg=90")
        try:
            overrides[key] = yaml.safe_load(text)
        except (yaml.YAMLError, ValueError) as error:
            raise ConfigError(f"--set {item}: the value is not valid YAML") from error
    options = {"clock.mode": arguments.clock, "clock.speed": arguments.speed, "seed": arguments.seed}
    return overrides | {key: value for key, value in options.items() if value is not None}
