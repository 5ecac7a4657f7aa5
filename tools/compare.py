"""Compare two runs, number by number and topic by topic: `python tools/compare.py A.mcap B.mcap`.

Two lockstep runs with one seed must have equal payload digests; the exit status is 1 when any topic differs.
"""

import argparse
import signal
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sandwich_sitl.errors import SandwichError
from sandwich_sitl.recording.reader import RunLog
from sandwich_sitl.recording.summary import summarise


def main() -> int:
    """Returns the exit status: 0 equal payloads, 1 different ones, 2 an unusable file."""
    parser = argparse.ArgumentParser(description="Compare two runs: summary numbers and payload digests.")
    parser.add_argument("a", type=Path, metavar="A.mcap")
    parser.add_argument("b", type=Path, metavar="B.mcap")
    options = parser.parse_args()
    try:
        a, b = RunLog.read(options.a), RunLog.read(options.b)
    except SandwichError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    for notice in filter(None, (a.notice, b.notice)):
        print(notice, file=sys.stderr)
    numbers_a, numbers_b = dict(flatten(summarise(a))), dict(flatten(summarise(b)))
    print(f"{'':34s} {'A':>16s} {'B':>16s} {'B - A':>16s}")
    for key in numbers_a:
        print(f"{key:34s} {row(numbers_a[key], numbers_b[key])}")
    differing = [topic for topic in {**a.digests, **b.digests} if a.digests.get(topic) != b.digests.get(topic)]
    print(f"payloads: {'all topics equal' if not differing else 'different: ' + ', '.join(sorted(differing))}")
    return 1 if differing else 0


def flatten(section: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of nested sections with dotted names."""
    for key, value in section.items():
        if isinstance(value, Mapping):
            yield from flatten(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def row(a: Any, b: Any) -> str:
    """Two values and, for numbers, their difference."""
    numeric = all(isinstance(value, int | float) for value in (a, b))
    return f"{shown(a):>16s} {shown(b):>16s} {shown(b - a) if numeric else '':>16s}".rstrip()


def shown(value: Any) -> str:
    """One value in at most 16 columns."""
    if isinstance(value, float):
        return f"{value:.4f}"
    return "-" if value is None else str(value)[:16]


if __name__ == "__main__":
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `| head` is no error
    sys.exit(main())
