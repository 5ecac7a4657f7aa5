"""`sandwich-sitl bench loop`: how fast the whole loop is, and where a tick's time goes."""

import argparse
import tempfile
from pathlib import Path
from typing import Any

from sandwich_sitl.options import check_program, overrides_of, positive, whole


def register(benches: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = benches.add_parser("loop", help="the lockstep loop's speed, part by part")
    parser.add_argument("config", type=Path, metavar="CONFIG", help="the run's YAML file")
    parser.add_argument("--solver", action="append", default=[], metavar="NAME", help="an mpc.solver; may be repeated")
    parser.add_argument(
        "--repeat", type=whole(1), default=3, metavar="N", help="plain flights for the factor (default 3)"
    )
    parser.add_argument("--rotorpy", metavar="PYTHON", help="interpreter of an environment with RotorPy")
    parser.add_argument("--peer-seconds", type=positive, default=20.0, metavar="S", help="length of RotorPy's flight")
    parser.add_argument(
        "--realtime",
        type=positive,
        metavar="S",
        help="instead: the vehicle in real time, S seconds at each of three speeds",
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override any key")
    parser.set_defaults(action=_run)


def _run(arguments: argparse.Namespace) -> int:
    check_program("--rotorpy", arguments.rotorpy)
    return _lockstep(arguments) if arguments.realtime is None else _realtime(arguments.config, arguments.realtime)


def _realtime(config_path: Path, seconds: float) -> int:
    from sandwich_sitl.bench.loop_realtime import lateness, start_up

    for name, cold in (("first start of an installation", True), ("start", False)):
        seen = start_up(config_path, cold)
        print(
            f"{name}: first heartbeat after {seen.wall_s:.2f} s, {seen.processor_s:.2f} s of processor time; "
            f"at most {seen.memory_mib:.0f} MiB"
        )
    for speed in (0.1, 1.0, 10.0):
        print(f"speed {speed:g}: " + "; ".join(lateness(config_path, speed, seconds)))
    return 0


def _lockstep(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.bench.loop import FACTORS_HEAD, factors_text, fly, parts_text
    from sandwich_sitl.bench.loop_peer import fly_rotorpy, interpreter
    from sandwich_sitl.recording.reader import RunLog

    given = overrides_of(arguments.set)
    solvers = [{"mpc.solver": name} for name in arguments.solver] or [{}]
    factors, tables = [FACTORS_HEAD], []
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for solver in solvers:
            overrides = {**given, **solver}
            flights = [fly(arguments.config, overrides, work, timed=False) for _ in range(arguments.repeat)]
            factors.append(factors_text(flights))
            timed = fly(arguments.config, overrides, work, timed=True)
            tables.append(parts_text(f"{timed.solver}: offboard process, us", timed.offboard.parts))
            tables.append(parts_text(f"{timed.solver}: vehicle, us", timed.vehicle.parts))
        plan = RunLog.read(work / "run.mcap").plan
    print("\n".join(factors), *tables, sep="\n\n")
    print(f"\nvehicle: at most {timed.vehicle_memory_mib:.0f} MiB")
    assert plan is not None
    print(fly_rotorpy(interpreter(arguments.rotorpy), plan.reference, arguments.peer_seconds))
    return 0
