"""`sandwich-sitl`: run, plan, offboard, replay, world, bench, config.

Exit status: 0 done; 1 safety violation or a failed viewer; 2 bad input; 3 no route; 4 map refused; 5 vehicle lost; 6
mission not flown as planned; 130 interrupted.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

# One BLAS thread: these matrices are small, and a second thread only spins on a core that the vehicle needs.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import yaml  # noqa: E402
from pydantic import TypeAdapter, ValidationError  # noqa: E402

from sandwich_sitl.bench.command import add_bench  # noqa: E402
from sandwich_sitl.config import RunConfig, config_as_dict, config_schema, load_config  # noqa: E402
from sandwich_sitl.errors import InputError, SandwichError  # noqa: E402
from sandwich_sitl.options import overrides_of  # noqa: E402
from sandwich_sitl.yaml_document import dotted, first_problem, is_run_file, put  # noqa: E402

if TYPE_CHECKING:
    from sandwich_sitl.world.importers import ImportedWorld


def main(argv: Sequence[str] | None = None) -> int:
    """Parse the command line, do it, return the exit status."""
    arguments = _parser().parse_args(argv)
    try:
        status: int = arguments.action(arguments)
    except SandwichError as error:
        print(f"sandwich-sitl: {error}", file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        print("sandwich-sitl: interrupted", file=sys.stderr)
        return 130
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="sandwich-sitl", description="Plan, fly and replay over MAVLink.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    run = _command(commands, "run", _run, "plan, start the vehicle, fly, log and summarise")
    run.add_argument("--live", action="store_true", help="show the flight in Rerun while it is flown")
    offboard = _command(commands, "offboard", _offboard, "fly a vehicle that is already there")
    offboard.add_argument(
        "--connect", metavar="URI", help="udpin://, udpout://, tcp://HOST:PORT or serial://DEVICE:BAUD"
    )
    _command(commands, "plan", _plan, "compute map and route alone, print lengths, draw them")
    replay = commands.add_parser("replay", help="show a run's log in Rerun")
    replay.add_argument("log", type=Path, metavar="RUN.mcap")
    replay.add_argument("--save", type=Path, metavar="FILE.rrd", help="write a Rerun file instead of opening a window")
    replay.set_defaults(action=_replay)
    world = commands.add_parser("world", help="read a map, say what was read, draw it")
    world.add_argument(
        "file", type=Path, metavar="FILE", help="GeoJSON, .osm(.pbf), map_server .yaml, .map, WKT, CSV, a run's YAML"
    )
    world.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="where to write world.png")
    world.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="an import option, as gap_m=1.5; of a run's YAML any key",
    )
    world.set_defaults(action=_world)
    add_bench(commands)
    config = commands.add_parser("config", help="check a configuration, or print the JSON Schema")
    config.add_argument(
        "config", type=Path, nargs="?", metavar="CONFIG", help="check it and print it with its defaults"
    )
    config.add_argument("--schema", action="store_true", help="print the JSON Schema of a run's YAML file")
    config.set_defaults(action=_config)
    return parser


def _command(commands: Any, name: str, action: Any, text: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(name, help=text)
    parser.add_argument("config", type=Path, metavar="CONFIG", help="the run's YAML file")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where to write (default: runs/NAME-TIME)")
    parser.add_argument("--clock", choices=("realtime", "lockstep"), help="override clock.mode")
    parser.add_argument("--speed", type=float, metavar="X", help="override clock.speed")
    parser.add_argument("--seed", type=int, metavar="N", help="override seed")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="override any key, such as mode=paper"
    )
    parser.set_defaults(action=action)
    return parser


def _loaded(arguments: argparse.Namespace) -> RunConfig:
    overrides = overrides_of(arguments.set)
    named = {"clock.mode": arguments.clock, "clock.speed": arguments.speed, "seed": arguments.seed}
    overrides |= {key: value for key, value in named.items() if value is not None}
    return load_config(arguments.config, overrides)


_WRITTEN = ("run.mcap", "offboard.mcap", "vehicle.mcap", "summary.json", "plan.png", "map.npz", "plan.npz")


def _out(arguments: argparse.Namespace, config: RunConfig) -> Path:
    out: Path = arguments.out or Path("runs") / f"{config.name}-{datetime.now():%Y%m%d-%H%M%S}"
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in _WRITTEN:
            with (out / name).open("ab"):
                pass
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot be written ({error.strerror}: {error.filename}); give another directory"
        ) from error
    for name in _WRITTEN:
        if (out / name).stat().st_size == 0:
            (out / name).unlink()
    return out


def _run(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.launcher import run
    from sandwich_sitl.progress import Progress
    from sandwich_sitl.recording.summary import format_summary

    config = _loaded(arguments)
    out = _out(arguments, config)
    with Progress() as progress:
        result = run(config, arguments.config, out, progress, arguments.live)
    print(format_summary(result.summary))
    print(f"log      {out / 'run.mcap'} (show it: sandwich-sitl replay {out / 'run.mcap'})")
    return result.exit_status


def _offboard(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.launcher import conclude_offboard, make_plan, offboard
    from sandwich_sitl.link.session import check_link
    from sandwich_sitl.progress import Progress
    from sandwich_sitl.recording.summary import format_summary

    if arguments.connect is not None:
        arguments.set.append(f"link.uri={arguments.connect}")
    config = _loaded(arguments)
    check_link(config.link, config.clock)
    out = _out(arguments, config)
    with Progress() as progress:
        plan = make_plan(config, arguments.config, progress)
        flown = offboard(config, plan, out / "offboard.mcap", progress)
        result = conclude_offboard(out / "offboard.mcap", out, flown, progress)
    print(format_summary(result.summary))
    print(f"log      {out / 'run.mcap'}")
    return result.exit_status


def _plan(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.channels.map_file import save_map
    from sandwich_sitl.launcher import make_plan
    from sandwich_sitl.plan_report import plan_report
    from sandwich_sitl.progress import Progress
    from sandwich_sitl.recording.plan_file import plan_bytes
    from sandwich_sitl.viewing.plan_picture import draw_plan

    config = _loaded(arguments)
    out = _out(arguments, config)
    with Progress() as progress:
        plan = make_plan(config, arguments.config, progress)
        progress.stage("picture")
        draw_plan(plan, out / "plan.png")
    save_map(plan.channel_map, out / "map.npz")
    (out / "plan.npz").write_bytes(plan_bytes(plan))
    print(plan_report(plan))
    print(f"picture   {out / 'plan.png'}")
    return 0


def _replay(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.viewing.replay import replay

    replay(arguments.log, arguments.save)
    return 0


def _world(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.viewing.world_picture import draw_world
    from sandwich_sitl.world_report import world_report

    imported, ends = _imported(arguments)
    try:
        arguments.out.mkdir(parents=True, exist_ok=True)
        draw_world(imported.world, arguments.out / "world.png", ends)
    except OSError as error:
        raise InputError(f"--out {arguments.out}: cannot be written ({error.strerror})") from error
    print(world_report(imported))
    print(f"picture   {arguments.out / 'world.png'}")
    return 0


def _imported(arguments: argparse.Namespace) -> "tuple[ImportedWorld, tuple[tuple[float, float], ...]]":
    """The world of a map file or of a run's configuration, and the run's start and goal."""
    from sandwich_sitl.world.importers import ImportOptions, read_world
    from sandwich_sitl.world.load import import_world

    overrides = overrides_of(arguments.set)
    if is_run_file(arguments.file):
        config = load_config(arguments.file, overrides)
        return import_world(config.world, arguments.file), (config.start_m, config.goal_m)
    data: dict[str, Any] = {}
    try:
        for key, value in overrides.items():
            put(data, key, value)
        options = TypeAdapter(ImportOptions).validate_json(json.dumps(data, default=str))
    except InputError as error:
        raise InputError(f"--set {error}") from error
    except ValidationError as error:
        loc, text = first_problem(error)
        raise InputError(f"--set {dotted(loc)}: {text}") from error
    return read_world(arguments.file, options), ()


def _config(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.launcher import check_vehicle_section, check_world, whole_schema
    from sandwich_sitl.world_report import notices

    if arguments.schema:
        print(json.dumps(whole_schema(config_schema()), indent=2))
        return 0
    if arguments.config is None:
        raise InputError("config: give CONFIG to check, or --schema")
    config = load_config(arguments.config)
    check_vehicle_section(config, arguments.config)
    for notice in notices(check_world(config, arguments.config)):
        print(notice, file=sys.stderr)
    print(yaml.safe_dump(config_as_dict(config), sort_keys=False), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
