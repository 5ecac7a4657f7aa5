"""Draw a plan in motion and planning space: `python tools/plan_picture.py RUN.mcap|plan.npz [--out plan.png]`.

Routes, corridor and speed: the reference's from a `plan.npz`, the true vehicle's while the mission is ACTIVE from a log.
"""

import argparse
import sys
from pathlib import Path

from sandwich_sitl.errors import InputError, SandwichError
from sandwich_sitl.planning.flight_plan import FlightPlan
from sandwich_sitl.recording.plan_file import load_plan
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.summary import active_spans
from sandwich_sitl.viewing.plan_picture import Track, draw_plan


def main() -> int:
    """Returns the exit status: 0, or 2 on an unusable file."""
    parser = argparse.ArgumentParser(description="Draw a plan in motion and planning space.")
    parser.add_argument("file", type=Path, metavar="RUN.mcap|plan.npz")
    parser.add_argument("--out", type=Path, default=Path("plan.png"), metavar="PNG")
    options = parser.parse_args()
    try:
        plan, flown = read(options.file)
        draw_plan(plan, options.out, flown)
    except SandwichError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    print(options.out)
    return 0


def read(path: Path) -> tuple[FlightPlan, Track | None]:
    """The plan of a file, and the flown track where it is a log with one."""
    if path.suffix == ".npz":
        return load_plan(path), None
    log = RunLog.read(path)
    if log.notice is not None:
        print(log.notice, file=sys.stderr)
    if log.plan is None:
        raise InputError(f"{path}: holds no plan, so there is nothing to draw")
    inside = [any(a <= t < b for a, b in active_spans(log)) for t in log.truth.t_s.tolist()]
    if sum(inside) < 2:
        return log.plan, None
    return log.plan, Track("vehicle", log.truth.t_s[inside], log.truth.r_m[inside][:, :2])


if __name__ == "__main__":
    sys.exit(main())
