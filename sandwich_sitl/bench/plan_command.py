"""`sandwich-sitl bench plan`: routes on random worlds, configurations and map files."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sandwich_sitl.errors import InputError
from sandwich_sitl.options import check_writable, positive, whole


def register(benches: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = benches.add_parser(
        "plan", help="routes: lengths over the exact optimum, times, durations and corridors, beside peers"
    )
    parser.add_argument("worlds", type=Path, nargs="*", metavar="FILE", help="a run's YAML or any map file")
    parser.add_argument("--random", type=whole(0), default=3, metavar="N", help="random worlds, of seed, seed + 1, ...")
    parser.add_argument("--seed", type=whole(0), default=1, metavar="N", help="of random worlds and questions")
    parser.add_argument("--nodes", type=whole(1), default=100_000, metavar="N", help="about so many on each map")
    parser.add_argument("--queries", type=whole(1), default=100, metavar="N", help="on each world")
    parser.add_argument("--flights", type=whole(0), default=10, metavar="N", help="tight routes timed on each world")
    parser.add_argument("--radius", type=positive, default=0.3, metavar="M", help="of the vehicle, but in run files")
    parser.add_argument("--margin", type=positive, default=0.5, metavar="M", help="of the planner, but in run files")
    parser.add_argument("--no-peers", action="store_true", help="leave other planners out")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the scores here too")
    parser.set_defaults(action=_run)


def _run(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.bench.plan_bench import Asked, bench_world
    from sandwich_sitl.bench.plan_table import table
    from sandwich_sitl.bench.plan_worlds import random_world, world_of_file

    check_writable("--json", arguments.json)
    if not arguments.worlds and arguments.random == 0:
        raise InputError("no world: give a FILE, or --random of at least 1")
    vehicle = arguments.radius, arguments.margin
    worlds = [world_of_file(path, *vehicle) for path in arguments.worlds]
    worlds += [random_world(arguments.seed + k, *vehicle) for k in range(arguments.random)]
    asked = Asked(arguments.nodes, arguments.queries, arguments.flights, arguments.seed, not arguments.no_peers)
    results = [bench_world(world, asked, _say) for world in worlds]
    print(table(results))
    if arguments.json is not None:
        scores = [asdict(result) for result in results]
        arguments.json.write_text(json.dumps(scores, indent=1) + "\n", encoding="utf-8")
    return 0


def _say(step: str) -> None:
    print(step, file=sys.stderr)
