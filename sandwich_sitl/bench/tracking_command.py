"""`sandwich-sitl bench tracking`: tracking accuracy over seeds and conditions."""

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandwich_sitl.errors import InputError
from sandwich_sitl.options import check_writable, overrides_of

if TYPE_CHECKING:
    from sandwich_sitl.bench.tracking import Flown


def register(benches: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = benches.add_parser("tracking", help="accuracy of whole flights over many seeds")
    parser.add_argument("config", type=Path, metavar="CONFIG", help="the run's YAML file")
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help="flights a condition (default 3)")
    parser.add_argument("--only", metavar="TEXT", help="conditions whose name holds this text")
    parser.add_argument(
        "--towns", action="store_true", help="each seed flies in a town of its own instead of the run's world"
    )
    instead = parser.add_mutually_exclusive_group()
    instead.add_argument("--paper", action="store_true", help="the paper's mode against the default instead")
    instead.add_argument(
        "--ablation", action="store_true", help="each departure from the paper taken back alone instead"
    )
    instead.add_argument("--faults", action="store_true", help="faults of the vehicle in flight instead")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="override any key in all flights"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every flight's numbers here too")
    parser.set_defaults(action=_run)


def _run(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.bench.town_scenes import town_scene
    from sandwich_sitl.bench.tracking import ABLATION, CONDITIONS, FAULTS, PAPER, Flown, fly_all

    conditions = PAPER if arguments.paper else FAULTS if arguments.faults else CONDITIONS
    if arguments.ablation:
        conditions = {name: changes for name, (changes, _) in ABLATION.items()}
    planners = {name: planner for name, (_, planner) in ABLATION.items()} if arguments.ablation else None
    all_conditions = tuple(conditions)
    if arguments.only is not None:
        conditions = {name: changes for name, changes in conditions.items() if arguments.only in name}
    if not conditions or arguments.seeds < 1:
        raise InputError("--only, --seeds: leave no flight; the conditions are " + ", ".join(all_conditions))
    overrides = overrides_of(arguments.set)
    check_writable("--json", arguments.json)

    flights: list[Flown] = []
    scene = town_scene if arguments.towns else None
    with tempfile.TemporaryDirectory() as work:
        seeds = range(1, arguments.seeds + 1)
        try:
            for flown in fly_all(arguments.config, conditions, seeds, overrides, Path(work), planners, scene):
                flights.append(flown)
                errors = f"{flown.rms_m:.3f} / {flown.worst_m:.3f} m"
                print(f"bench: {flown.condition}, seed {flown.seed}: {flown.outcome}, {errors}", file=sys.stderr)
        finally:  # what was flown before a flight that fails is not lost with it
            _report(flights, arguments.json)
    return 0


def _report(flights: "Sequence[Flown]", json_path: Path | None) -> None:
    from sandwich_sitl.bench.tracking import table

    if flights:
        print(table(flights))
    if json_path is not None:
        json_path.write_text(json.dumps([asdict(f) for f in flights], indent=1) + "\n", encoding="utf-8")
