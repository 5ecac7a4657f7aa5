"""`sandwich-sitl bench replan`: a new plan in flight, from the question to the answer, and the loop beside it."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sandwich_sitl.options import check_writable, whole


def register(benches: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = benches.add_parser(
        "replan", help="time from an obstacle that appears in flight to a new plan, and what planning does to the loop"
    )
    parser.add_argument("--worlds", type=whole(1), default=3, metavar="N", help="random towns, of seed, seed + 1, ...")
    parser.add_argument("--seed", type=whole(0), default=1, metavar="N", help="of towns and pop-ups")
    parser.add_argument("--nodes", type=whole(1), default=100_000, metavar="N", help="about so many on each map")
    parser.add_argument("--cases", type=whole(1), default=100, metavar="N", help="pop-ups on each")
    parser.add_argument(
        "--late", type=float, default=10.0, metavar="S", help="seconds a loop is watched; 0: not at all"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here too")
    parser.set_defaults(action=_run)


def _run(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.bench.replan_bench import lateness, measure, table
    from sandwich_sitl.config import ReplanConfig

    check_writable("--json", arguments.json)
    rows = [measure(arguments.seed + k, arguments.nodes, arguments.cases, _say) for k in range(arguments.worlds)]
    late = []
    if arguments.late > 0:
        _say("ticks beside a planner")
        late = lateness(arguments.seed, arguments.nodes, arguments.late)
    print(table(rows, late, ReplanConfig().budget_s))
    if arguments.json is not None:
        figures = {"worlds": [asdict(row) for row in rows], "late": [asdict(row) for row in late]}
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    return 0


def _say(step: str) -> None:
    print(step, file=sys.stderr)
