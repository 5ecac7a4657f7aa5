"""`sandwich-sitl bench tick`: what a control tick costs; with `--realtime`, whether its deadlines are kept."""

import argparse
import tempfile
from pathlib import Path
from typing import Any

from sandwich_sitl.errors import InputError
from sandwich_sitl.options import overrides_of


def register(benches: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = benches.add_parser(
        "tick", help="a control tick's cost, and its deadlines in real time"
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="the run's YAML file")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="times the flight's ticks are gone through")
    parser.add_argument("--realtime", metavar="HZ,HZ", help="instead: one flight in real time at each rate")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override any key")
    parser.set_defaults(action=_run)


def _run(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.bench.tick import tick_cost
    from sandwich_sitl.bench.tick_realtime import deadlines

    overrides = overrides_of(arguments.set)
    if arguments.repeat < 1:
        raise InputError("--repeat: must be at least 1")
    with tempfile.TemporaryDirectory() as folder:
        if arguments.realtime is None:
            print("\n".join(tick_cost(arguments.config, overrides, Path(folder), arguments.repeat).lines()))
            return 0
        lines = [
            deadlines(arguments.config, overrides, Path(folder), rate_hz).line()
            for rate_hz in _rates(arguments.realtime)
        ]
    print("\n".join(lines))
    return 0


def _rates(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError as error:
        raise InputError(f"--realtime {text}: must be rates in Hz, such as 50,100") from error
