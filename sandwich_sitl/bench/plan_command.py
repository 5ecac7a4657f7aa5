"""`sandwich-sitl bench plan`: routes on random worlds, configurations and map files."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any


def register(benches: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = benches.add_parser(
        "plan", help="lengths over the exact optimum and times of every way to find a route"
    )
    parser.add_argument("worlds", type=Path, nargs="*", metavar="FILE", help="a run's YAML or any map file")
    parser.add_argument("--random", type=int, default=3, metavar="N", help="random worlds, of seed, seed + 1, ...")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of random worlds and questions")
    parser.add_argument("--nodes", type=int, default=100_000, metavar="N", help="about so many on each map")
    parser.add_argument("--queries", type=int, default=100, metavar="N", help="on each world")
    parser.add_argument("--reach", type=float, default=0.8, metavar="M", help="growth of random worlds and map files")
    parser.add_argument("--no-peers", action="store_true", help="leave other planners out")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the scores here too")
    parser.set_defaults(action=_run)


def _run(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.bench.plan_bench import bench_world, table
    from sandwich_sitl.bench.plan_worlds import random_world, world_of_file

    worlds = [world_of_file(path, arguments.reach) for path in arguments.worlds]
    worlds += [random_world(arguments.seed + k, arguments.reach) for k in range(arguments.random)]
    results = [
        bench_world(world, arguments.nodes, arguments.queries, arguments.seed, _say, with_peers=not arguments.no_peers)
        for world in worlds
    ]
    print(table(results))
    if arguments.json is not None:
        scores = [asdict(result) for result in results]
        arguments.json.write_text(json.dumps(scores, indent=1) + "\n", encoding="utf-8")
    return 0


def _say(step: str) -> None:
    print(step, file=sys.stderr)
