"""`sandwich-sitl bench`: one subcommand a bench. A bench adds itself with one entry in `_BENCHES`."""

import argparse
from collections.abc import Callable
from typing import Any

from sandwich_sitl.bench import (
    loop_command,
    map_command,
    mpc_command,
    plan_command,
    replan_command,
    tick_command,
    tracking_command,
)

Register = Callable[[Any], None]

_BENCHES: tuple[Register, ...] = (
    map_command.register,
    plan_command.register,
    replan_command.register,
    mpc_command.register,
    tracking_command.register,
    loop_command.register,
    tick_command.register,
)


def add_bench(commands: Any) -> None:
    """Add `bench` and its subcommands to a parser's commands."""
    bench: argparse.ArgumentParser = commands.add_parser("bench", help="measure parts of the program on this machine")
    benches = bench.add_subparsers(required=True, metavar="BENCH")
    for register in _BENCHES:
        register(benches)
