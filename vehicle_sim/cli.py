"""Command line: `vehicle-sim CONFIG --connect URI`. Runs until SIGINT or SIGTERM."""

import argparse
import gc
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from vehicle_sim.config import RunConfig, load_run
from vehicle_sim.endpoints import parse_endpoints
from vehicle_sim.errors import ConfigError, VehicleError
from vehicle_sim.protocol.node import Node
from vehicle_sim.recorder import Recorder
from vehicle_sim.server import Pace, Server, open_socket
from vehicle_sim.vehicle import Vehicle


def build_parser() -> argparse.ArgumentParser:
    """The options."""
    parser = argparse.ArgumentParser(
        prog="vehicle-sim", description="A quadcopter behind a PX4-like autopilot that speaks MAVLink 2 over UDP."
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="the run's YAML file")
    parser.add_argument("--connect", required=True, metavar="URI", help="udpout://HOST:PORT or udpin://HOST:PORT")
    parser.add_argument("--bind", metavar="HOST:PORT", help="where udpout sends from (default 127.0.0.1:14580)")
    parser.add_argument("--log", type=Path, metavar="FILE.mcap", help="record into this file")
    parser.add_argument(
        "--until-eof", action="store_true", help="end when standard input ends, so as not to outlive its starter"
    )
    parser.add_argument("--clock", choices=("realtime", "lockstep"), help="overrides clock.mode")
    parser.add_argument("--speed", type=float, metavar="X", help="overrides clock.speed")
    parser.add_argument("--seed", type=int, metavar="N", help="overrides seed")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override one key, such as vehicle.wind.gust_correlation_s=3",
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Exit status 0 after a signal, 2 when configuration, log or port cannot be used."""
    arguments = build_parser().parse_args(argv)
    try:
        return _fly(arguments)
    except VehicleError as error:
        print(f"vehicle-sim: {error}", file=sys.stderr)
        return error.exit_status


def _fly(arguments: argparse.Namespace) -> int:
    config = load_run(arguments.config, _overrides(arguments))
    endpoints = parse_endpoints(arguments.connect, arguments.bind)
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _frame: stop.append(received))
    if arguments.until_eof:
        threading.Thread(target=_stop_at_eof, args=(stop,), daemon=True).start()
    with open_socket(endpoints.bind) as sock:
        recorder = Recorder(arguments.log, config) if arguments.log is not None else None
        try:
            node = Node(
                Vehicle(config.vehicle, config.seed, config.period_us),
                config.clock.mode == "lockstep",
                recorder.sample if recorder is not None else None,
            )
            server = Server(sock, endpoints, node, _pace(config), recorder)
            gc.collect()
            gc.freeze()
            host, port = sock.getsockname()
            print(f"vehicle-sim ready on {host}:{port}", flush=True)
            server.run(lambda: bool(stop))
            if recorder is not None:
                recorder.write(node.journal)
        finally:
            if recorder is not None:
                recorder.close()
    return 0


def _stop_at_eof(stop: list[int]) -> None:
    sys.stdin.buffer.read()
    stop.append(signal.SIGTERM)


def _pace(config: RunConfig) -> Pace:
    return Pace(config.clock.mode == "lockstep", config.clock.speed, config.period_us)


def _overrides(arguments: argparse.Namespace) -> dict[str, Any]:
    overrides: dict[str, Any] = {}
    for item in arguments.set:
        key, separator, text = item.partition("=")
        if not separator or not key:
            raise ConfigError(f"--set {item}: must be KEY=VALUE, such as vehicle.initial_yaw_deg=90")
        try:
            overrides[key] = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ConfigError(f"--set {item}: the value is not valid YAML") from error
    options = {"clock.mode": arguments.clock, "clock.speed": arguments.speed, "seed": arguments.seed}
    return overrides | {key: value for key, value in options.items() if value is not None}
