"""`sandwich-sitl bench mpc`: recorded ticks through every installed solver."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sandwich_sitl.errors import InputError
from sandwich_sitl.options import check_writable, whole

_HORIZONS = {10: 0.1, 20: 0.1, 40: 0.05}


def register(benches: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = benches.add_parser("mpc", help="solvers of the tracking problem side by side")
    parser.add_argument("--solvers", metavar="A,B", help="only these (default: all that are installed)")
    parser.add_argument("--horizons", default="20,40", metavar="N,N", help="steps: 10, 20 (0.1 s) or 40 (0.05 s)")
    parser.add_argument("--log", type=Path, metavar="RUN.mcap", help="ticks of this run instead of the stored ones")
    parser.add_argument("--first", type=whole(1), default=200, metavar="K", help="first tick taken of --log")
    parser.add_argument("--count", type=whole(1), default=400, metavar="K", help="ticks taken of --log")
    parser.add_argument("--save", type=Path, metavar="FILE.npz", help="keep the ticks of --log in a file and stop")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the scores here too")
    parser.set_defaults(action=_run)


def _run(arguments: argparse.Namespace) -> int:
    from sandwich_sitl.bench import ticks
    from sandwich_sitl.bench.mpc import Case, installed, run_case, table
    from sandwich_sitl.control.horizon import MotionLimits
    from sandwich_sitl.recording.reader import RunLog

    check_writable("--json", arguments.json)
    check_writable("--save", arguments.save)
    if arguments.save is not None and arguments.log is None:
        raise InputError("--save: keeps the ticks of a run; name it with --log RUN.mcap")
    limits = MotionLimits(12.0, 3.2, 40.0, 600.0)
    if arguments.log is not None:
        log = RunLog.read(arguments.log)
        sequences = (ticks.from_log(log, arguments.log.parent.name, arguments.first, arguments.count),)
        if arguments.save is not None:
            ticks.save(sequences[0], arguments.save)
            return 0
    else:
        calm, gusty, overdriven = ticks.stored()
        tight = ticks.narrow(gusty)
        made = (ticks.pushed_out(tight), ticks.awkward(tight, limits.acceleration_mps2), ticks.hostile(tight))
        sequences = (calm, gusty, tight, overdriven, *made)  # type: ignore[assignment]
    there = installed()
    if "clarabel" not in there:
        _say(
            "without clarabel (sandwich-sitl[solvers]) errors are measured against active_set alone, itself among them"
        )
    names = tuple(arguments.solvers.split(",")) if arguments.solvers else there
    if unknown := [name for name in names if name not in there]:
        raise InputError(f"--solvers: {', '.join(unknown)} not installed; there are {', '.join(there)}")
    scores = []
    for n_tau in _horizons(arguments.horizons):
        for sequence in sequences:
            case = Case(sequence, n_tau, _HORIZONS[n_tau], 8.0, limits)
            scores += run_case(case, names, lambda name, case=case: _say(f"{case.sequence.name} n={case.n_tau} {name}"))  # type: ignore[misc]
    print(table(scores, "piqp"))
    if arguments.json is not None:
        arguments.json.write_text(json.dumps([asdict(score) for score in scores], indent=1) + "\n", encoding="utf-8")
    return 0


def _horizons(text: str) -> list[int]:
    try:
        chosen = [int(part) for part in text.split(",")]
    except ValueError:
        chosen = []
    if not chosen or any(n not in _HORIZONS for n in chosen):
        raise InputError(f"--horizons {text}: must be some of {', '.join(map(str, _HORIZONS))}")
    return chosen


def _say(text: str) -> None:
    print(f"bench: {text}", file=sys.stderr)
